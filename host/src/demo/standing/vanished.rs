//! The site of the study: as it is, as it was, and the field baked for its view camera.

use std::path::Path;

use relume_bake::bake::{BakeOptions, bake};
use relume_bake::camera::Camera;
use relume_bake::demo_scene;
use relume_bake::response::TransportOptions;
use relume_bake::scene::Scene;

use super::judge::covered;
use super::measured::{measured_camera, reprojection_px, true_camera};
use super::{Effort, Lens};
use crate::failure::{Failure, OrFail};
use crate::outfile::write_whole;
use crate::relight::FieldFile;

/// What the field is called in its folder.
pub(super) const FIELD: &str = "site.field";

/// The site as it is and as it was.
pub(super) struct Vanished {
    pub(super) whole: Scene,
    pub(super) real: Scene,
    /// The view camera as it is.
    pub(super) camera: Camera,
    pub(super) file: FieldFile,
    /// Of the field's pixels, which the temple covers.
    pub(super) covered: Vec<bool>,
    /// How far the camera that the field was baked for shows places from where they are, px: rms and the largest.
    pub(super) reprojection_px: [f64; 2],
}

impl Vanished {
    /// Bakes into `folder`; behind a lens by the camera that marks on a still tell, which stands in `camera.json` there.
    pub(super) fn bake(folder: &Path, effort: &Effort, lens: Lens, seed: u64) -> Result<Self, Failure> {
        let (whole, pinhole) = demo_scene::site();
        let real = whole.real();
        let (camera, known) = match lens {
            Lens::Pinhole => (pinhole, pinhole),
            Lens::Distorting => {
                let camera = true_camera(&pinhole);
                (camera, measured_camera(&camera, &real, seed, &folder.join("camera.json"))?)
            }
        };
        let (paths, sun_paths) = effort.bake_paths;
        let options = BakeOptions {
            size: effort.size,
            transport: TransportOptions { paths, sun_paths, ..TransportOptions::default() },
            site: Some(demo_scene::SITE_DEG),
            ..BakeOptions::default()
        };
        let baked = bake(&whole, &known, &options).or_runtime()?;
        let path = folder.join(FIELD);
        write_whole(&path, |out| std::io::Write::write_all(out, &baked.bytes))?;
        let reprojection_px = reprojection_px(&camera, &known, effort.size.0);
        let file = FieldFile::open(&path).or_runtime()?;
        let covered = covered(&file.field());
        Ok(Vanished { whole, real, camera, file, covered, reprojection_px })
    }
}
