//! A whole bake: scene -> blocks -> field bytes, from where an interrupted one stopped if asked to.

use crate::camera::Camera;
use crate::error::{ExactTile, TestLight};
use crate::job::DoneBlock;
use crate::jobs::{self, Jobs, Scenes};
use crate::ledger::{Ledger, LedgerError};
use crate::plan::{PlanError, identity};
use crate::preview::{PREVIEW_SKY, Preview};
use crate::report::Report;
use crate::response::TransportOptions;
use crate::scene::Scene;
use crate::stack::StackError;
use crate::survey::{Notice, survey};
use crate::viewpoint::TransportError;
use glam::Vec3;
use relume_firmware::field::FieldError;
use relume_firmware::glue::map::MapError;
use relume_firmware::patches::{PatchError, PatchSet, Subdivided};
use relume_firmware::weights::WeightError;
use std::path::PathBuf;
use std::time::Instant;

/// What to bake.
#[derive(Clone, Debug)]
pub struct BakeOptions {
    /// Width and height, px.
    pub size: (u32, u32),
    /// Patches: of the upper hemisphere, or of all directions alike.
    pub directions: usize,
    /// Light comes from all around, as on a thing on a table.
    pub sphere: bool,
    /// Patches cut to the scene ([`crate::directions::fit`]), instead of equal ones.
    pub cuts: Option<Box<Subdivided>>,
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
    /// Where blocks that are done are kept until the field is.
    pub ledger: Option<LedgerOptions>,
    /// Told of what is allowed but seldom meant, once the bake has begun.
    pub notify: Option<fn(&Notice)>,
    /// A picture of the bake while it runs, PNG.
    pub preview: Option<PathBuf>,
    /// Show a bar with the time left on a terminal.
    pub progress: bool,
}

impl BakeOptions {
    /// The patches.
    ///
    /// # Errors
    /// [`PatchError`]: too few directions, or too many.
    pub fn patch_set(&self) -> Result<PatchSet, PatchError> {
        let equal = if self.sphere { PatchSet::sphere(self.directions)? } else { PatchSet::new(self.directions)? };
        Ok(self.cuts.as_deref().map_or(equal, |cuts| PatchSet::of_subdivided(*cuts)))
    }
}

/// A file of finished blocks.
#[derive(Clone, Debug)]
pub struct LedgerOptions {
    /// The file.
    pub path: PathBuf,
    /// Go on with what an earlier run left there.
    pub resume: bool,
}

impl Default for BakeOptions {
    fn default() -> Self {
        BakeOptions {
            size: (512, 384),
            directions: 256,
            sphere: false,
            cuts: None,
            transport: TransportOptions::default(),
            error: crate::compress::Target::default().error,
            stack: None,
            stack_sun: None,
            site: None,
            test_maps: Vec::new(),
            ledger: None,
            notify: None,
            preview: None,
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
    /// Nothing of what the camera sees is virtual.
    #[error(
        "the camera sees receivers and occluders only: mark as relume = receiver what is really there and nothing else, or correct the camera's position or target"
    )]
    NothingVirtual,
    /// The stack could not be written.
    #[error(transparent)]
    Stack(#[from] StackError),
    /// The same, before anything else was read.
    #[error("--test-sky: {}: {source}", file.display())]
    TestSky {
        /// The map's file.
        file: PathBuf,
        /// What happened.
        source: std::io::Error,
    },
    /// Shares that do not make a field.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// Blocks cannot be kept, or those of an earlier run cannot be taken.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
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
    /// Exact sums of its tiles under the held-out skies.
    pub exact: Vec<ExactTile>,
    /// The held-out skies.
    pub light: TestLight,
}

/// Direction of an azimuth (degrees clockwise from true north) and altitude (degrees), with north at `north_deg`
/// (degrees from -Z towards +X).
pub fn sun_dir_world([azimuth_deg, altitude_deg]: [f64; 2], north_deg: f64) -> Vec3 {
    let (azimuth, altitude) = ((azimuth_deg + north_deg).to_radians(), altitude_deg.to_radians());
    let level = altitude.cos();
    Vec3::new((level * azimuth.sin()) as f32, altitude.sin() as f32, (-level * azimuth.cos()) as f32)
}

/// Bakes a field. The same scene, options and seed give the same bytes whatever the number of threads, and whether in one go
/// or after interruptions.
///
/// # Errors
/// [`BakeError`].
pub fn bake(scene: &Scene, camera: &Camera, options: &BakeOptions) -> Result<Baked, BakeError> {
    let started = Instant::now();
    let scenes = Scenes::new(scene);
    let jobs = Jobs::new(&scenes, camera, options)?;
    let mut intake = Intake::new(&jobs, options);
    let open = |kept: &LedgerOptions| {
        let bake = (identity(scene, camera, options)?, 0..jobs.blocks());
        Ok::<_, BakeError>(Ledger::open(&kept.path, bake, kept.resume, |block| intake.take(block))?)
    };
    let mut ledger = options.ledger.as_ref().map(open).transpose()?;
    if let Some(notify) = options.notify {
        let transport = &jobs.main().transport;
        survey(scene, &transport.tracer.geometry, &transport.view, (options.size, options.sphere))
            .iter()
            .for_each(notify);
    }
    jobs.run(intake.all.next()..jobs.blocks(), options.progress, |block| {
        ledger.as_mut().map(|ledger| ledger.append(&block)).transpose()?;
        intake.take(block);
        Ok(())
    })?;
    let baked = intake.all.finish(jobs, camera, options, started.elapsed());
    if let (Err(_), Some(ledger)) = (&baked, ledger) {
        // Every block is there and they make no field: no second run would.
        ledger.discard();
    }
    if let Some(Err(fault)) = intake.preview.map(|preview| preview.write()) {
        eprintln!("notice: --preview: {fault}; the field does not need it");
    }
    baked
}

/// Where blocks that are done go.
struct Intake {
    all: jobs::Intake,
    /// Blocks that the preview shows.
    virtual_blocks: u32,
    preview: Option<Preview>,
}

impl Intake {
    fn new(jobs: &Jobs<'_>, options: &BakeOptions) -> Self {
        let job = jobs.main();
        let sky = job.test_light.names().position(|name| name == PREVIEW_SKY).unwrap_or(0);
        let begin = |file: &PathBuf| Preview::new(file.clone(), options.size, sky, &job.small);
        Intake {
            all: jobs::Intake::new(jobs),
            virtual_blocks: job.blocks(),
            preview: options.preview.as_ref().map(begin),
        }
    }

    fn take(&mut self, block: DoneBlock) {
        if let Some(preview) = self.preview.as_mut().filter(|_| block.number < self.virtual_blocks) {
            preview.add(&block);
        }
        self.all.push(block);
    }
}
