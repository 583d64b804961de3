//! The job: scene -> response -> tiles -> field bytes, tile by tile.

use crate::blocks::{BlockCompressor, BlockTile, FieldBlock};
use crate::bouncepoints::BouncePoints;
use crate::camera::Camera;
use crate::compress::Whites;
use crate::error::{ExactTile, TestLight};
use crate::heldout::{TestSky, captured, test_skies};
use crate::progress::Progress;
use crate::report::Report;
use crate::response::{Transport, TransportOptions};
use crate::scene::Scene;
use crate::stack::{Manifest, ManifestSun, StackError, StackWriter};
use crate::sun::SunDisc;
use crate::sunlayers::CasterLayers;
use crate::transfer::Gathered;
use crate::viewpoint::TransportError;
use crate::write::FieldWriter;
use glam::Vec3;
use rayon::prelude::*;
use relume_firmware::field::{CameraRecord, Field, FieldError, Header};
use relume_firmware::glue::map::MapError;
use relume_firmware::patches::{PatchError, PatchSet};
use relume_firmware::tile::BLOCK_TILES;
use relume_firmware::weights::WeightError;
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
    /// Captured radiance maps that the field's error is told for, too.
    pub test_maps: Vec<PathBuf>,
    /// Show a bar with the time left on a terminal.
    pub progress: bool,
}

impl Default for BakeOptions {
    fn default() -> Self {
        BakeOptions {
            size: (512, 384),
            directions: 256,
            transport: TransportOptions::default(),
            error: crate::compress::Target::default().error,
            stack: None,
            stack_sun: None,
            site: None,
            test_maps: Vec::new(),
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
    /// The finished field is not sound.
    #[error("the field that was made is not sound: {0}; report this")]
    Unsound(#[from] FieldError),
    /// A held-out sky cannot be read.
    #[error("--test-sky: {0}")]
    TestMap(#[from] MapError),
    /// A held-out sky is not for this field.
    #[error("a held-out sky: {0}")]
    Sky(#[from] WeightError),
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

/// Mean light, under an even sky of radiance 1, below which a view is taken for the inside of something closed: what gets
/// there came through cracks between triangles.
const DARK_LIGHT: f64 = 1e-4;

/// Bakes a field. The same scene, options and seed give the same bytes whatever the number of threads.
///
/// # Errors
/// [`BakeError`].
pub fn bake(scene: &Scene, camera: &Camera, options: &BakeOptions) -> Result<Baked, BakeError> {
    let started = Instant::now();
    let patches = PatchSet::new(options.directions)?;
    let maps: Result<Vec<TestSky>, MapError> = options.test_maps.iter().map(|path| captured(path, &patches)).collect();
    let test_light = TestLight::new(test_skies(&patches).into_iter().chain(maps?).collect());
    let transport = Transport::new(scene, camera, patches, options.size, options.transport)?;
    let whites = whites(scene, camera, patches, options)?;
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
        compressor: BlockCompressor::new(&patches, options.error, whites, CasterLayers::new(scene)),
        stack,
        stack_sun: stack_sun.map(|(_, dir)| SunDisc::new(dir)),
        test_light,
    };
    let Tiles { writer, mut report, exact } = job.run(options.progress)?;
    report.finish(&writer, started.elapsed());
    if report.light_mean < DARK_LIGHT {
        let position = camera.position.map(|c| c as f32);
        return Err(TransportError::Dark { position }.into());
    }
    if let Some(stack) = job.stack {
        stack.finish()?;
    }
    let header = header(camera, patches, options);
    let casters = job.compressor.casters;
    let draft = writer.into_draft(header, [casters.casters, casters.nodes, job.bounce.layer()]);
    report.held_out = job.test_light.errors(&Field::new(draft.bytes())?, &exact)?;
    Ok(Baked { bytes: draft.finish(&report.to_json()), report })
}

/// About so many pixels of a small picture tell how bright each patch makes the large one.
const SMALL_PX: f64 = 3072.0;

/// Display white under each patch alone, from a small picture of the same view.
fn whites(scene: &Scene, camera: &Camera, patches: PatchSet, options: &BakeOptions) -> Result<Whites, BakeError> {
    let (width, height) = options.size;
    let times = (f64::from(width) * f64::from(height) / SMALL_PX).sqrt().floor().max(2.0) as u32;
    let size = (width.div_ceil(times), height.div_ceil(times));
    let small = Transport::new(scene, camera, patches, size, options.transport)?;
    let (columns, rows) = small.tiles();
    let places: Vec<(u32, u32)> = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))).collect();
    let tiles: Vec<Vec<f32>> = places.par_iter().map(|&(x, y)| small.tile(x, y).response).collect();
    Ok(Whites::of(&tiles.concat(), patches.len()))
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

struct Job<'s> {
    transport: Transport<'s>,
    compressor: BlockCompressor,
    bounce: BouncePoints,
    stack: Option<StackWriter>,
    stack_sun: Option<SunDisc>,
    test_light: TestLight,
}

/// What comes of all tiles.
struct Tiles {
    writer: FieldWriter,
    report: Report,
    /// In the order of the file.
    exact: Vec<ExactTile>,
}

/// A block, and per tile of it, row by row, its exact sums.
type Compressed = (FieldBlock, Vec<ExactTile>);

/// Tiles in flight, at least: enough for any number of cores, and with one row of blocks a bound on memory.
const BATCH_TILES: usize = 128;

impl Job<'_> {
    fn run(&self, progress: bool) -> Result<Tiles, BakeError> {
        let (columns, rows) = self.transport.tiles();
        let edge = BLOCK_TILES as u32;
        let bar = progress.then(|| Progress::new("bake", u64::from(columns.div_ceil(edge) * rows.div_ceil(edge))));
        let (mut writer, mut report, mut exact) = (FieldWriter::default(), Report::default(), Vec::new());
        writer.set_bound_basis(self.compressor.bound_basis_bytes());
        let block_rows: Vec<u32> = (0..rows.div_ceil(edge)).collect();
        let at_once = BATCH_TILES.div_ceil(columns as usize * BLOCK_TILES).max(1);
        for batch in block_rows.chunks(at_once) {
            let places: Vec<(u32, u32)> =
                batch.iter().flat_map(|&y| (0..columns.div_ceil(edge)).map(move |x| (x, y))).collect();
            let blocks: Result<Vec<Compressed>, BakeError> = places
                .par_iter()
                .map(|&place| {
                    let block = self.block(place)?;
                    if let Some(bar) = &bar {
                        bar.step();
                    }
                    Ok(block)
                })
                .collect();
            let mut tiles = Vec::new();
            for (block, sums) in blocks? {
                writer.push_bound(&block.bound);
                report.add_light(block.light);
                tiles.extend(block.tiles.into_iter().zip(sums));
            }
            // The file holds tiles row by row.
            tiles.sort_by_key(|(tile, _)| (tile.at.1, tile.at.0));
            for (tile, sums) in tiles {
                report.add(&tile);
                writer.push(tile);
                exact.push(sums);
            }
        }
        Ok(Tiles { writer, report, exact })
    }

    /// Transport, stack and compression of the block in column and row `place`.
    fn block(&self, place: (u32, u32)) -> Result<Compressed, BakeError> {
        let (columns, rows) = self.transport.tiles();
        let edge = BLOCK_TILES as u32;
        let mut tiles = Vec::with_capacity(BLOCK_TILES * BLOCK_TILES);
        for ty in (place.1 * edge..(place.1 + 1) * edge).take_while(|&ty| ty < rows) {
            for tx in (place.0 * edge..(place.0 + 1) * edge).take_while(|&tx| tx < columns) {
                let response = self.transport.tile(tx, ty);
                let Gathered { bounce, sun } = self.transport.gather(&self.bounce, &response, self.stack_sun.as_ref());
                if let Some(stack) = &self.stack {
                    let sun = self.stack_sun.as_ref().map(|disc| self.transport.sun_tile(&response, &sun, disc));
                    stack.write_tile(&response, sun.as_deref())?;
                }
                tiles.push(BlockTile { at: (tx, ty), response, bounce });
            }
        }
        let sums = tiles.iter().map(|tile| self.test_light.sums(&tile.response.response)).collect();
        Ok((self.compressor.block(tiles), sums))
    }
}
