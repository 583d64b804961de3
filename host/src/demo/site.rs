//! The demo's site: scene, field and stack.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use relume_bake::bake::{BakeOptions, Baked, bake};
use relume_bake::camera::Camera;
use relume_bake::demo_scene;
use relume_bake::response::TransportOptions;
use relume_bake::scene::Scene;

use crate::exact::Stack;
use crate::failure::{Failure, OrFail};
use crate::relight::FieldFile;
use crate::sun::Place;

/// Width and height of the pictures.
pub(super) const SIZE: (u32, u32) = (300, 200);

/// What the land around throws back: what a post takes it for unless its file says otherwise.
const GROUND_ALBEDO: f64 = 0.2;

/// What is baked, and how long that took.
pub(super) struct Site {
    pub scene: Scene,
    pub camera: Camera,
    pub file: FieldFile,
    pub bytes: usize,
    pub bake_time: Duration,
    pub baked: relume_bake::report::Report,
    stack: PathBuf,
}

impl Site {
    /// Bakes the built-in scene; the field and its uncompressed stack go into `folder`.
    pub fn bake(folder: &Path) -> Result<Self, Failure> {
        let (scene, camera) = demo_scene::temple();
        let stack = folder.join("stack");
        let options = BakeOptions {
            size: SIZE,
            transport: TransportOptions { paths: 2, sun_paths: 10, ..TransportOptions::default() },
            stack: Some(stack.clone()),
            site: Some(demo_scene::SITE_DEG),
            ..BakeOptions::default()
        };
        let started = Instant::now();
        let Baked { bytes, report, .. } = bake(&scene, &camera, &options).or_runtime()?;
        let bake_time = started.elapsed();
        let path = folder.join("temple.field");
        crate::outfile::write_whole(&path, |out| std::io::Write::write_all(out, &bytes))?;
        let file = FieldFile::open(&path).or_runtime()?;
        Ok(Site { scene, camera, file, bytes: bytes.len(), bake_time, baked: report, stack })
    }

    /// Opens the uncompressed stack.
    pub fn open_stack(&self) -> Result<Stack, Failure> {
        Stack::open(&self.stack).or_runtime()
    }

    /// Where the site lies.
    pub fn place() -> Place {
        let [latitude_deg, longitude_deg] = demo_scene::SITE_DEG;
        Place { latitude_deg, longitude_deg }
    }

    /// The same as a post's file has it.
    pub fn in_config() -> crate::config::Site {
        crate::config::Site { place: Site::place(), elevation_m: 0.0, ground_albedo: GROUND_ALBEDO }
    }

    /// The bake in one line.
    pub fn told(&self) -> String {
        format!(
            "bake: {} triangles, {}x{}, {} patches in {:.0} s; field {:.2} MB, mean rank {:.1}",
            self.scene.triangles.len(),
            SIZE.0,
            SIZE.1,
            self.file.field().patch_set().len(),
            self.bake_time.as_secs_f64(),
            self.bytes as f64 / 1e6,
            self.baked.rank_mean
        )
    }
}
