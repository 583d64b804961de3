//! Pictures -> spool -> blocks -> field.

use super::fault::ImportError;
use super::mask;
use super::patches::{Lights, name_of};
use super::picture::{Encoding, Picture};
use super::source::{Side, Source};
use super::spool::{EDGE, Spool};
use crate::assembly::Assembly;
use crate::bake::{BakeError, Baked};
use crate::blocks::{BlockCompressor, BlockTile};
use crate::bouncepoints::BouncePoints;
use crate::brightness::brightness;
use crate::camera::Camera;
use crate::compress::Target;
use crate::error::{ExactTile, TestLight};
use crate::heldout::{TestSky, captured, test_lights};
use crate::job::{DoneBlock, block_count, block_grid, in_order};
use crate::prior::Prior;
use crate::progress::Progress;
use crate::report::Imported;
use crate::response::TileResponse;
use crate::stack::{Manifest, StackWriter};
use crate::sunlayers::CasterLayers;
use crate::viewpoint::check_shape;
use rayon::prelude::*;
use relume_firmware::field::{CameraRecord, Header};
use relume_firmware::patches::PatchSet;
use relume_firmware::tile::{BLOCK_TILES, TILE_PX};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

/// How to import.
#[derive(Clone, Debug)]
pub struct ImportOptions {
    /// What whole-number pixels mean; `None`: what the set says, else by their bits.
    pub encoding: Option<Encoding>,
    /// A picture of the coverage instead of the set's.
    pub mask: Option<PathBuf>,
    /// Which side light comes from, instead of what the set says.
    pub side: Option<Side>,
    /// Pixels are means over squares of so many.
    pub shrink: usize,
    /// Relative error that the compression aims at.
    pub error: f64,
    /// Where the camera stands, if that is known.
    pub camera: Option<Camera>,
    /// Also write the uncompressed stack there.
    pub stack: Option<PathBuf>,
    /// Captured radiance maps that the field's error is told for, too.
    pub test_maps: Vec<PathBuf>,
    /// Folder for the spool, which is gone in the end.
    pub spool_folder: PathBuf,
    /// Show a bar with the time left on a terminal.
    pub progress: bool,
}

impl Default for ImportOptions {
    fn default() -> Self {
        ImportOptions {
            encoding: None,
            mask: None,
            side: None,
            shrink: 1,
            error: Target::default().error,
            camera: None,
            stack: None,
            test_maps: Vec::new(),
            spool_folder: std::env::temp_dir(),
            progress: true,
        }
    }
}

/// Pixels that tell how bright each light makes the picture, about.
const SAMPLES: f64 = 3072.0;
/// Above so many pixels the sums that errors are told by would take too much memory: none are told.
const MOST_TESTED_PX: usize = 8_000_000;
/// Makes a field of a set of pictures. The same pictures and options give the same bytes whatever the number of threads.
///
/// # Errors
/// [`ImportError`].
pub fn import(mut source: Source, options: &ImportOptions) -> Result<Baked, ImportError> {
    let started = Instant::now();
    source.encoding = options.encoding.or(source.encoding);
    source.mask = options.mask.clone().or(source.mask);
    source.side = options.side.unwrap_or(source.side);
    let lights = Lights::of(&source)?;
    let sheet = Sheet::of(&source, options.shrink)?;
    if let Some(camera) = &options.camera {
        check_shape(camera, (sheet.size.0 as u32, sheet.size.1 as u32)).map_err(BakeError::from)?;
    }
    let test_light = test_light(&lights.set, sheet.coverage.len(), &options.test_maps)?;
    let read = read_all(&source, &lights, &sheet, options)?;
    let (prior, whites) = brightness(Prior::for_set(&lights.set), &read.samples);
    let work = Work {
        stack: stack_writer(&source, &lights.set, sheet.size, options)?,
        compressor: BlockCompressor::new(prior, options.error, whites, CasterLayers::none()),
        patches: lights.set.len(),
        spool: read.spool,
        sheet,
        test_light,
    };
    let mut assembly = work.run(options)?;
    let report = assembly.close(started.elapsed());
    if report.light_mean <= 0.0 || !report.light_mean.is_finite() {
        return Err(ImportError::Dark(source.place));
    }
    report.imported = Some(Imported {
        kind: source.kind.to_owned(),
        pictures: lights.pictures.iter().map(|&picture| name_of(&source.pictures[picture])).collect(),
        camera_known: options.camera.is_some(),
        negative_values: read.negative,
    });
    if let Some(stack) = work.stack {
        stack.finish().map_err(BakeError::from)?;
    }
    let header = header(&source, lights.set, work.sheet.size, options);
    let scene = [Vec::new(), Vec::new(), BouncePoints::no_layer()];
    Ok(assembly.into_field(header, scene, work.test_light)?)
}

/// Size and coverage of the pictures.
struct Sheet {
    first: PathBuf,
    size: (usize, usize),
    /// `[y][x]`.
    coverage: Vec<f32>,
}

impl Sheet {
    fn of(source: &Source, shrink: usize) -> Result<Self, ImportError> {
        let first = source.pictures[0].file.clone();
        let picture = Picture::read(&first, source.encoding)?;
        let (full, picture) = (picture.size, picture.shrunk(shrink));
        let size = picture.size;
        let most = relume_firmware::field::MAX_EDGE as usize;
        if size.0 == 0 || size.1 == 0 || size.0 > most || size.1 > most {
            let fault =
                format!("{}x{} pixels; a field has 1 to {most} each way: choose another --shrink", size.0, size.1);
            return Err(ImportError::file(&first, fault));
        }
        let coverage = match (&source.mask, picture.alpha) {
            (Some(file), _) => {
                let (own, coverage) = mask::read(file, shrink)?;
                if own != size {
                    return Err(ImportError::Size { file: file.clone(), size: own, first, wanted: full });
                }
                coverage
            }
            (None, Some(alpha)) => alpha.into_iter().map(|share| share.clamp(0.0, 1.0)).collect(),
            (None, None) => vec![1.0; size.0 * size.1],
        };
        Ok(Sheet { first, size, coverage })
    }
}

/// What reading all pictures brings.
struct Read {
    spool: Spool,
    /// Response of some pixels, `[pixel][3][patch]`.
    samples: Vec<f32>,
    negative: u64,
}

/// Reads every picture once, on all threads, and spools its patch's response.
fn read_all(source: &Source, lights: &Lights, sheet: &Sheet, options: &ImportOptions) -> Result<Read, ImportError> {
    let places = sample_places(sheet);
    let patches = lights.set.len();
    let folder = &options.spool_folder;
    let full = |source, need: u64| ImportError::Spool { folder: folder.clone(), source, need_mb: need >> 20 };
    let spool = Spool::new(folder, patches, sheet.size, &sheet.coverage).map_err(|error| full(error, 0))?;
    let bar = options.progress.then(|| Progress::new("read", patches as u64));
    let samples = Mutex::new(vec![0.0f32; places.len() * 3 * patches]);
    let counts: Result<Vec<u64>, ImportError> = (0..patches)
        .into_par_iter()
        .map(|patch| {
            let (response, negative) = response_of(source, lights, sheet, (patch, options.shrink))?;
            spool.write(patch, &response).map_err(|error| full(error, spool.bytes()))?;
            let mut samples = samples.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            for (k, &at) in places.iter().enumerate() {
                (0..3).for_each(|c| samples[(3 * k + c) * patches + patch] = response[3 * at + c]);
            }
            bar.iter().for_each(Progress::step);
            Ok(negative)
        })
        .collect();
    let samples = samples.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    Ok(Read { negative: counts?.iter().sum(), samples, spool })
}

/// A patch's response, `[y][x][3]`, premultiplied, and how many values were below 0.
fn response_of(
    source: &Source,
    lights: &Lights,
    sheet: &Sheet,
    (patch, shrink): (usize, usize),
) -> Result<(Vec<f32>, u64), ImportError> {
    let light = &source.pictures[lights.pictures[patch]];
    let picture = Picture::read(&light.file, source.encoding)?.shrunk(shrink);
    if picture.size != sheet.size {
        let (first, wanted) = (sheet.first.clone(), sheet.size);
        return Err(ImportError::Size { file: light.file.clone(), size: picture.size, first, wanted });
    }
    let omega = f64::from(lights.set.solid_angle_sr(patch));
    let scale = light.irradiance.map_or([1.0; 3], |irradiance| irradiance.map(|e| (omega / e) as f32));
    let (mut response, mut negative) = (picture.rgb, 0);
    for (pixel, &share) in response.as_chunks_mut::<3>().0.iter_mut().zip(&sheet.coverage) {
        let share = if picture.premultiplied && share > 0.0 { 1.0 } else { share };
        for (value, scale) in pixel.iter_mut().zip(scale) {
            negative += u64::from(*value < 0.0);
            *value = value.max(0.0) * scale * share;
        }
    }
    Ok((response, negative))
}

/// Covered pixels on a grid over the picture.
fn sample_places(sheet: &Sheet) -> Vec<usize> {
    let covered: Vec<usize> = (0..sheet.coverage.len()).filter(|&at| sheet.coverage[at] > 0.0).collect();
    let step = (covered.len() as f64 / SAMPLES).max(1.0);
    let count = (covered.len() as f64 / step) as usize;
    (0..count).map(|k| covered[(k as f64 * step) as usize]).collect()
}

fn test_light(set: &PatchSet, pixels: usize, maps: &[PathBuf]) -> Result<TestLight, ImportError> {
    if pixels > MOST_TESTED_PX {
        return Ok(TestLight::new(Vec::new()));
    }
    let maps: Result<Vec<TestSky>, _> = maps.iter().map(|map| captured(map, set)).collect();
    let maps = maps.map_err(BakeError::from)?;
    Ok(TestLight::new(test_lights(set).into_iter().chain(maps).collect()))
}

fn stack_writer(
    source: &Source,
    set: &PatchSet,
    size: (usize, usize),
    options: &ImportOptions,
) -> Result<Option<StackWriter>, ImportError> {
    let size = (size.0 as u32, size.1 as u32);
    let create = |dir: &PathBuf| {
        let manifest = Manifest::new(set, size, source.made_by.0, source.made_by.1, source.north_deg);
        StackWriter::create(dir, manifest)
    };
    Ok(options.stack.as_ref().map(create).transpose().map_err(BakeError::from)?)
}

/// Everything that all blocks share.
struct Work {
    spool: Spool,
    sheet: Sheet,
    patches: usize,
    compressor: BlockCompressor,
    test_light: TestLight,
    stack: Option<StackWriter>,
}

impl Work {
    fn size(&self) -> (u32, u32) {
        (self.sheet.size.0 as u32, self.sheet.size.1 as u32)
    }

    fn run(&self, options: &ImportOptions) -> Result<Assembly, ImportError> {
        let blocks = block_count(self.size());
        let mut assembly = Assembly::of(block_grid(self.size()).0, &self.compressor);
        let bar = options.progress.then(|| Progress::new("compress", u64::from(blocks)));
        let done = |block| {
            assembly.push(block);
            Ok(())
        };
        in_order(0..blocks, bar.as_ref(), |number| self.block(number, &options.spool_folder), done)?;
        Ok(assembly)
    }

    fn block(&self, number: u32, folder: &Path) -> Result<DoneBlock, ImportError> {
        let values = self.spool.read(number as usize);
        let need_mb = self.spool.bytes() >> 20;
        let values = values.map_err(|source| ImportError::Spool { folder: folder.to_owned(), source, need_mb })?;
        let columns = block_grid(self.size()).0;
        let (x0, y0) = (number % columns * EDGE as u32, number / columns * EDGE as u32);
        let mut tiles = Vec::with_capacity(BLOCK_TILES * BLOCK_TILES);
        let edge = TILE_PX as u32;
        for y in (y0..(y0 + EDGE as u32).min(self.size().1)).step_by(TILE_PX) {
            for x in (x0..(x0 + EDGE as u32).min(self.size().0)).step_by(TILE_PX) {
                let response = self.tile((x, y), (x - x0, y - y0), values.as_deref());
                if let Some(stack) = &self.stack {
                    stack.write_tile(&response, None).map_err(BakeError::from)?;
                }
                tiles.push(BlockTile { at: (x / edge, y / edge), response, bounce: Vec::new() });
            }
        }
        let exact = |tile: &BlockTile| self.test_light.sums(&tile.response.response);
        let exact: Vec<ExactTile> = tiles.iter().map(exact).collect();
        Ok(DoneBlock { number, block: self.compressor.block(tiles), exact })
    }

    /// The tile at `(x0, y0)`, which is `within` the block of these values.
    fn tile(&self, (x0, y0): (u32, u32), within: (u32, u32), values: Option<&[f32]>) -> TileResponse {
        let (w, h) = ((self.size().0 - x0).min(TILE_PX as u32), (self.size().1 - y0).min(TILE_PX as u32));
        let share = |index: u32| self.sheet.coverage[((y0 + index / w) * self.size().0 + x0 + index % w) as usize];
        let coverage: Vec<f32> = (0..w * h).map(share).collect();
        let covered: Vec<u16> = (0..w * h).filter(|&index| coverage[index as usize] > 0.0).map(|i| i as u16).collect();
        let block = EDGE * EDGE * 3;
        let mut response = Vec::with_capacity(covered.len() * 3 * self.patches);
        for &index in &covered {
            let (x, y) = (within.0 + u32::from(index) % w, within.1 + u32::from(index) / w);
            let at = 3 * (y as usize * EDGE + x as usize);
            for c in 0..3 {
                let of_patch = |patch: usize| values.map_or(0.0, |values| values[patch * block + at + c]);
                response.extend((0..self.patches).map(of_patch));
            }
        }
        let fragments = vec![Vec::new(); covered.len()];
        let patches = self.patches;
        TileResponse { x0, y0, w, h, patches, coverage, covered, response, indirect: Vec::new(), fragments }
    }
}

fn header(source: &Source, patches: PatchSet, size: (usize, usize), options: &ImportOptions) -> Header {
    let camera = match &options.camera {
        Some(camera) => camera.record((size.0 as u32, size.1 as u32)),
        // A stand-in: nothing of the picture comes from it.
        None => CameraRecord {
            position: [0.0, 0.0, 1.0],
            target: [0.0; 3],
            up: [0.0, 1.0, 0.0],
            fov_y_deg: 45.0,
            north_deg: source.north_deg as f32,
            lens: None,
        },
    };
    Header {
        width: size.0 as u32,
        height: size.1 as u32,
        patches,
        covered: 0,
        camera,
        error_target: options.error as f32,
        site: None,
        seed: source.made_by.1,
        max_hits: source.made_by.0,
    }
}
