//! What `scene`, `plan` and `merge` are told, and what it means.

use super::values::{ERRORS, NOISES, duration, number, percent, range, shading, site, size, sun, text};
use crate::bake::{BakeError, BakeOptions};
use crate::camera::Camera;
use crate::demo_scene;
use crate::directions;
use crate::effort::{self, Goal};
use crate::scene::{self, Scene, Shading};
use crate::stack::StackError;
use lexopt::prelude::*;
use relume_firmware::glue::failure::{Failure, OrFail};
use relume_firmware::patches::PatchSet;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Stands for the scene that the program brings.
const BUILT_IN: &str = "demo";

/// Everything that may be said.
#[derive(Default)]
pub(super) struct Arguments {
    pub(super) files: Vec<PathBuf>,
    pub(super) camera: Option<PathBuf>,
    pub(super) size: Option<(u32, u32)>,
    pub(super) out: Option<PathBuf>,
    pub(super) plan: Option<PathBuf>,
    pub(super) tiles: Option<Range<u32>>,
    pub(super) resume: bool,
    pub(super) threads: usize,
    pub(super) json: bool,
    pub(super) shading: Shading,
    pub(super) options: BakeOptions,
    /// Folder of the page about the bake.
    pub(super) report: Option<PathBuf>,
    /// What the sampling follows, instead of the options'.
    pub(super) goal: Option<Goal>,
    /// Patches are cut to the scene.
    pub(super) adaptive: bool,
    /// Names of all options that were given.
    given: Vec<String>,
}

impl Arguments {
    /// `None`: help was asked for.
    pub(super) fn parse(parser: &mut lexopt::Parser) -> Result<Option<Self>, Failure> {
        let mut a = Arguments { shading: Shading::Gltf, ..Arguments::default() };
        while let Some(argument) = parser.next()? {
            if let Long(name) = &argument {
                a.given.push((*name).to_owned());
            }
            match argument {
                Value(path) => a.files.push(path.into()),
                Long("camera") => a.camera = Some(parser.value()?.into()),
                Long("size") => a.size = Some(size(&text(parser)?)?),
                Short('o') | Long("out") => a.out = Some(parser.value()?.into()),
                Long("plan") => a.plan = Some(parser.value()?.into()),
                Long("tiles") => a.tiles = Some(range(&text(parser)?)?),
                Long("resume") => a.resume = true,
                Long("directions") => a.options.directions = number(parser, "--directions")?,
                Long("sphere") => a.options.sphere = true,
                Long("adaptive") => a.adaptive = true,
                Long("sun-paths") => a.options.transport.sun_paths = number(parser, "--sun-paths")?,
                Long("max-hits") => a.options.transport.max_hits = number(parser, "--max-hits")?,
                Long("seed") => a.options.transport.seed = number(parser, "--seed")?,
                Long("threads") => a.threads = number(parser, "--threads")?,
                Long("stack") => a.options.stack = Some(parser.value()?.into()),
                Long("sun") => a.options.stack_sun = Some(sun(&text(parser)?)?),
                Long("site") => a.options.site = Some(site(&text(parser)?)?),
                Long("error") => a.options.error = percent("--error", &text(parser)?, ERRORS)?,
                Long("noise") => a.goal = Some(Goal::Noise(percent("--noise", &text(parser)?, NOISES)?)),
                Long("time") => a.goal = Some(Goal::Time(duration("--time", &text(parser)?)?)),
                Long("test-sky") => a.options.test_maps.push(parser.value()?.into()),
                Long("materials") => a.shading = shading(&text(parser)?)?,
                Long("report") => a.report = Some(parser.value()?.into()),
                Long("preview") => a.options.preview = Some(parser.value()?.into()),
                Long("json") => a.json = true,
                Long("help") | Short('h') => return Ok(None),
                other => return Err(other.unexpected().into()),
            }
        }
        Ok(Some(a))
    }

    /// Refuses options that would do nothing: `command` takes only `known` ones; `why` tells what to do instead.
    pub(super) fn only(&self, command: &str, known: &[&str], why: &str) -> Result<(), Failure> {
        match self.given.iter().find(|name| !known.contains(&name.as_str())) {
            Some(name) => Err(Failure::bad(format!("{command}: --{name} does nothing here; {why}"))),
            None => Ok(()),
        }
    }

    /// The scene's file, the only one that `command` takes.
    pub(super) fn scene(&self, command: &str) -> Result<&Path, Failure> {
        match self.files.as_slice() {
            [scene] => Ok(scene),
            [] => Err(missing(command, "the scene file")),
            [_, more, ..] => Err(Failure::bad(format!("{command}: {} is one file too many", more.display()))),
        }
    }

    /// The output.
    pub(super) fn out(&self, command: &str) -> Result<&Path, Failure> {
        self.out.as_deref().ok_or_else(|| missing(command, "-o"))
    }

    /// Options with the size, which has no default.
    pub(super) fn options(&self, command: &str) -> Result<BakeOptions, Failure> {
        let size = self.size.ok_or_else(|| missing(command, "--size WxH"))?;
        Ok(BakeOptions { size, ..self.options.clone() })
    }

    /// `options`, with patches that fit the scene, if they are to.
    fn adapted(
        &self,
        (scene, camera, names): (&Scene, &Camera, &str),
        options: BakeOptions,
    ) -> Result<BakeOptions, Failure> {
        if !self.adaptive {
            return Ok(options);
        }
        let cuts = self.on_threads(|| directions::fit(scene, camera, &options))?.map_err(|error| told(error, names))?;
        let options = BakeOptions { cuts: Some(Box::new(cuts)), ..options };
        let set = PatchSet::of_subdivided(cuts);
        let sizes = || (0..set.len()).map(|patch| set.solid_angle_sr(patch));
        let (least, most) = (sizes().fold(f32::MAX, f32::min), sizes().fold(0.0, f32::max));
        eprintln!(
            "directions: {} patches above the horizon and {} below, of {least:.4} to {most:.4} sr",
            set.upper(),
            set.lower()
        );
        Ok(options)
    }

    /// `options`, with the patches and the sampling that are asked for by what they should do.
    pub(super) fn sampled(
        &self,
        (scene, camera, names): (&Scene, &Camera, &str),
        options: BakeOptions,
    ) -> Result<BakeOptions, Failure> {
        let options = self.adapted((scene, camera, names), options)?;
        let Some(goal) = self.goal else { return Ok(options) };
        let effort = self.on_threads(|| effort::choose(scene, camera, &options, goal))?;
        let effort = effort.map_err(|error| told(error, names))?;
        let falls_short = match goal {
            Goal::Noise(most) if !effort.met => {
                format!(" (not the {:.2} % asked for: no finer sampling)", 100.0 * most)
            }
            Goal::Time(most) if !effort.met => {
                format!(" (not the {:.0} s asked for: no coarser one)", most.as_secs_f64())
            }
            _ => String::new(),
        };
        eprintln!("{effort}{falls_short}");
        Ok(BakeOptions { transport: effort.transport, ..options })
    }

    /// Runs `work` on as many threads as were asked for.
    pub(super) fn on_threads<T: Send>(&self, work: impl FnOnce() -> T + Send) -> Result<T, Failure> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads).build().or_runtime()?;
        Ok(pool.install(work))
    }
}

/// Something that `command` needs was not given.
pub(super) fn missing(command: &str, what: &str) -> Failure {
    Failure::bad(format!("{command}: {what} is missing (see relume-bake --help)"))
}

/// The scene, where it is seen from, and the names of both for messages.
pub(super) fn scene_and_camera(
    scene: &Path,
    camera: Option<&Path>,
    shading: Shading,
) -> Result<(Scene, Camera, String), Failure> {
    match (scene.as_os_str() == BUILT_IN, camera) {
        (true, None) => {
            let (scene, camera) = demo_scene::temple();
            Ok((scene.shaded(shading), camera, BUILT_IN.to_owned()))
        }
        (true, Some(_)) => Err(Failure::bad("scene demo: leave --camera out; the built-in scene brings its own")),
        (false, None) => Err(missing("scene", "--camera")),
        (false, Some(camera)) => {
            let names = format!("{} with {}", scene.display(), camera.display());
            let loaded = scene::load(scene, shading).or_bad()?;
            let camera = Camera::load(camera).or_bad()?;
            loaded.notices.iter().for_each(|notice| eprintln!("{}: {notice}", scene.display()));
            Ok((loaded.scene, camera, names))
        }
    }
}

/// A failed bake of the scene and camera called `names`, for the user.
pub(super) fn told(error: BakeError, names: &str) -> Failure {
    match error {
        BakeError::Stack(StackError::Write { .. }) => Failure::Runtime(error.into()),
        BakeError::Ledger(ref fault) if fault.is_of_the_disk() => Failure::Runtime(error.into()),
        BakeError::Transport(_) => Failure::bad(format!("{names}: {error}")),
        _ => Failure::BadInput(error.into()),
    }
}
