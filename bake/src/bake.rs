//! The job: scene -> response -> tiles -> field bytes, tile by tile.

use crate::bouncepoints::BouncePoints;
use crate::camera::Camera;
use crate::compress::{Target, compress, patch_residuals};
use crate::encode::{TileBytes, mask_of, residual_block};
use crate::prior::Prior;
use crate::progress::Progress;
use crate::report::Report;
use crate::response::{TileResponse, Transport, TransportOptions};
use crate::scene::Scene;
use crate::stack::{Manifest, ManifestSun, StackError, StackWriter};
use crate::sunlayers::CasterLayers;
use crate::viewpoint::TransportError;
use crate::write::{FieldTile, FieldWriter};
use glam::Vec3;
use rayon::prelude::*;
use relume_firmware::field::{CameraRecord, Header};
use relume_firmware::patches::{PatchError, PatchSet};
use std::path::PathBuf;
use std::time::Instant;

/// What to bake.
#[derive(Clone, Debug)]
pub struct BakeOptions {
    /// Width and height, px.
    pub size: (u32, u32),
    /// Patches of the upper hemisphere.
    pub directions: usize,
    /// Sampling of the light transport.
    pub transport: TransportOptions,
    /// Relative error that the compression aims at.
    pub error: f64,
    /// Also write the uncompressed stack there.
    pub stack: Option<PathBuf>,
    /// The sun of the stack: azimuth and altitude, degrees.
    pub stack_sun: Option<[f64; 2]>,
    /// Latitude and longitude of the site, degrees.
    pub site: Option<[f64; 2]>,
    /// Show a bar with the time left on a terminal.
    pub progress: bool,
}

impl Default for BakeOptions {
    fn default() -> Self {
        BakeOptions {
            size: (512, 384),
            directions: 256,
            transport: TransportOptions::default(),
            error: Target::default().error,
            stack: None,
            stack_sun: None,
            site: None,
            progress: true,
        }
    }
}

/// Why a bake failed.
#[derive(Debug, thiserror::Error)]
pub enum BakeError {
    /// The number of directions.
    #[error("--directions: {0}")]
    Patches(#[from] PatchError),
    /// Scene and camera do not give a picture.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// The stack could not be written.
    #[error(transparent)]
    Stack(#[from] StackError),
}

/// A finished field, still in memory.
#[derive(Debug)]
pub struct Baked {
    /// The file's bytes.
    pub bytes: Vec<u8>,
    /// Facts about the bake, also in the file's META layer.
    pub report: Report,
}

/// Direction of an azimuth (degrees clockwise from true north) and altitude (degrees), with north at `north_deg`
/// (degrees from -Z towards +X).
pub fn sun_dir_world([azimuth_deg, altitude_deg]: [f64; 2], north_deg: f64) -> Vec3 {
    let (azimuth, altitude) = ((azimuth_deg + north_deg).to_radians(), altitude_deg.to_radians());
    let level = altitude.cos();
    Vec3::new((level * azimuth.sin()) as f32, altitude.sin() as f32, (-level * azimuth.cos()) as f32)
}

/// Bakes a field. The same scene, options and seed give the same bytes whatever the number of threads.
///
/// # Errors
/// [`BakeError`].
pub fn bake(scene: &Scene, camera: &Camera, options: &BakeOptions) -> Result<Baked, BakeError> {
    let started = Instant::now();
    let patches = PatchSet::new(options.directions)?;
    let transport = Transport::new(scene, camera, patches, options.size, options.transport)?;
    let stack_sun = options.stack_sun.map(|sun| (sun, sun_dir_world(sun, camera.north_deg)));
    let stack = options.stack.as_deref().map(|dir| {
        let transport = &options.transport;
        let mut manifest = Manifest::new(&patches, options.size, transport.max_hits, transport.seed, camera.north_deg);
        manifest.sun = stack_sun.map(|([azimuth, altitude], dir)| ManifestSun::new(azimuth, altitude, dir.to_array()));
        StackWriter::create(dir, manifest)
    });
    let stack = stack.transpose()?;
    let job = Job {
        bounce: transport.bounce_points(),
        transport,
        compression: Compression::new(&patches, options.error),
        casters: CasterLayers::new(scene),
        stack,
        stack_sun: stack_sun.map(|(_, dir)| dir),
    };
    let (writer, mut report) = job.run(options.progress)?;
    if report.rank_max == 0 {
        let position = camera.position.map(|c| c as f32);
        return Err(TransportError::Dark { position }.into());
    }
    if let Some(stack) = job.stack {
        stack.finish()?;
    }
    report.finish(&writer, started.elapsed());
    let header = header(camera, patches, options);
    let bytes =
        writer.into_bytes(header, [job.casters.casters, job.casters.nodes, job.bounce.layer()], &report.to_json());
    Ok(Baked { bytes, report })
}

fn header(camera: &Camera, patches: PatchSet, options: &BakeOptions) -> Header {
    let f32s = |v: [f64; 3]| v.map(|c| c as f32);
    let camera = CameraRecord {
        position: f32s(camera.position),
        target: f32s(camera.target),
        up: f32s(camera.up),
        fov_y_deg: camera.fov_y_deg as f32,
        north_deg: camera.north_deg as f32,
    };
    Header {
        width: options.size.0,
        height: options.size.1,
        patches,
        covered: 0,
        camera,
        error_target: options.error as f32,
        site: options.site.map(|site| site.map(|degrees| degrees as f32)),
        seed: options.transport.seed,
        max_hits: options.transport.max_hits,
    }
}

/// Turns responses into tile bytes.
struct Compression {
    skies: Prior,
    target: Target,
    patches: PatchSet,
}

impl Compression {
    fn new(patches: &PatchSet, error: f64) -> Self {
        Compression { skies: Prior::skies(patches), target: Target { error, ..Target::default() }, patches: *patches }
    }

    fn tile(&self, tile: &TileResponse, casters: &CasterLayers, bounce: Vec<u8>) -> FieldTile {
        let patches = self.patches.len();
        let mask = mask_of(&tile.covered, tile.w.max(1));
        let coverage = tile.covered.iter().map(|&at| tile.coverage[usize::from(at)]);
        let response = compress(&tile.response, patches, &self.skies, &self.target);
        FieldTile {
            residuals: residual_block(&patch_residuals(&tile.response, patches, &response), response.pixels),
            response: TileBytes::new(&response, mask, patches),
            bounce,
            // A pixel in the mask is covered, however little.
            coverage: coverage.map(|share| (share * 255.0).round().clamp(1.0, 255.0) as u8).collect(),
            fragments: casters.fragments(&tile.fragments),
        }
    }
}

struct Job<'s> {
    transport: Transport<'s>,
    compression: Compression,
    casters: CasterLayers,
    bounce: BouncePoints,
    stack: Option<StackWriter>,
    stack_sun: Option<Vec3>,
}

/// Tiles in flight: enough for any number of cores, and a bound on memory.
const BATCH: usize = 128;

impl Job<'_> {
    fn run(&self, progress: bool) -> Result<(FieldWriter, Report), BakeError> {
        let (columns, rows) = self.transport.tiles();
        let order: Vec<(u32, u32)> = (0..rows).flat_map(|ty| (0..columns).map(move |tx| (tx, ty))).collect();
        let bar = progress.then(|| Progress::new("bake", order.len() as u64));
        let (mut writer, mut report) = (FieldWriter::default(), Report::default());
        for batch in order.chunks(BATCH) {
            let tiles: Result<Vec<FieldTile>, BakeError> = batch
                .par_iter()
                .map(|&(tx, ty)| {
                    let tile = self.tile(tx, ty)?;
                    if let Some(bar) = &bar {
                        bar.step();
                    }
                    Ok(tile)
                })
                .collect();
            for tile in tiles? {
                report.add(&tile);
                writer.push(tile);
            }
        }
        Ok((writer, report))
    }

    fn tile(&self, tx: u32, ty: u32) -> Result<FieldTile, BakeError> {
        let response = self.transport.tile(tx, ty);
        if let Some(stack) = &self.stack {
            let sun = self.stack_sun.map(|dir| self.transport.sun_tile(tx, ty, dir));
            stack.write_tile(&response, sun.as_deref())?;
        }
        let bounce = self.transport.bounce_block(&self.bounce, &response);
        Ok(self.compression.tile(&response, &self.casters, bounce))
    }
}
