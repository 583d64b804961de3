//! What a bake says about itself: the META layer and `relume-bake info`.

use crate::error::SkyError;
use crate::noise::Noise;
use crate::write::{FieldTile, FieldWriter};
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Facts about a bake. Serialised without anything that differs from run to run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Tiles with at least one covered pixel.
    pub tiles_covered: usize,
    /// Tiles in all.
    pub tiles: usize,
    /// Mean rank over covered pixels.
    pub rank_mean: f64,
    /// Largest rank.
    pub rank_max: usize,
    /// Bytes of response and coverage per covered pixel.
    pub bytes_per_covered_pixel: f64,
    /// Wall-clock seconds of the bake.
    #[serde(skip)]
    pub seconds: f64,
    /// Mean light of the covered pixels under an even sky of radiance 1.
    pub light_mean: f64,
    /// Errors against the response before compression, under skies that no prior knows.
    #[serde(default)]
    pub held_out: Vec<SkyError>,
    /// Noise of the light transport, estimated on some tiles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<Noise>,
    /// What an imported field was made from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imported: Option<Imported>,
    #[serde(skip)]
    rank_sum: f64,
    #[serde(skip)]
    light_sum: f64,
}

/// What an imported field was made from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Imported {
    /// Which kind of source.
    pub kind: String,
    /// Per patch, in the field's order, the picture's name.
    pub pictures: Vec<String>,
    /// Did the source say where the camera stands? If not, the header's is a stand-in.
    pub camera_known: bool,
    /// Negative values that were taken as 0.
    pub negative_values: u64,
}

impl Report {
    /// Counts a tile.
    pub fn add(&mut self, tile: &FieldTile) {
        let record = &tile.response.record;
        self.tiles += 1;
        self.tiles_covered += usize::from(record.pixels > 0);
        self.rank_sum += f64::from(record.rank) * f64::from(record.pixels);
        self.rank_max = self.rank_max.max(usize::from(record.rank));
    }

    /// Counts a block's light.
    pub fn add_light(&mut self, light: f64) {
        self.light_sum += light;
    }

    /// Closes the sums.
    pub fn finish(&mut self, writer: &FieldWriter, time: Duration) {
        let covered = f64::from(writer.covered().max(1));
        self.rank_mean = self.rank_sum / covered;
        self.light_mean = self.light_sum / covered;
        self.bytes_per_covered_pixel = writer.response_bytes() as f64 / covered;
        self.seconds = time.as_secs_f64();
    }

    /// The META layer.
    pub fn to_json(&self) -> String {
        // A struct of numbers always serialises.
        serde_json::to_string(self).unwrap_or_default()
    }
}
