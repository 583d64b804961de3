//! Another renderer in the path tracer's place: the site and its skies as files for it, and the pictures that it made of them.
//!
//! The folder holds `site.glb` (what has vanished is marked), `camera.json`, `moments.json` and a lat-long map `NAME.sky.exr`
//! per moment, without the sun's disc, which `moments.json` describes. The renderer adds, per moment that it draws,
//! `NAME.real.exr` (all that is not marked `virtual`), `NAME.whole.1.exr` and `NAME.whole.2.exr` (everything, by two seeds):
//! linear radiance of Lambert surfaces, premultiplied, alpha = coverage, box filter.

use std::path::{Path, PathBuf};

use exr::prelude::read_first_rgba_layer_from_file;
use relume_bake::camera::Camera;
use relume_bake::environment::Reference;
use relume_bake::gltf_write::write_glb;
use relume_bake::scene::Scene;
use serde::Serialize;

use super::view::MAP_HEIGHT;
use super::{Drawn, Hour};
use crate::failure::{Failure, OrFail};
use crate::outfile::write_whole;
use crate::picture::write_exr;
use crate::skymodel::SkyModel;

/// An entry of `moments.json`.
#[derive(Serialize)]
pub(super) struct Sky {
    name: String,
    time_utc: String,
    /// Unit direction towards the sun, and RGB irradiance on a plane normal to it, of a disc of 0.533 degrees; none: no sun.
    sun: Option<Sun>,
}

#[derive(Serialize)]
struct Sun {
    dir_world: [f32; 3],
    irradiance: [f32; 3],
}

#[derive(Serialize)]
struct Moments<'s> {
    size: [u32; 2],
    moments: &'s [Sky],
}

/// Writes a moment's map into `folder`.
pub(super) fn write_sky(folder: &Path, hour: &Hour, truth: &SkyModel) -> Result<Sky, Failure> {
    let (name, map) = (hour.name(), truth.map(MAP_HEIGHT));
    let opaque = vec![1.0; map.pixels.len()];
    write_exr(&folder.join(format!("{name}.sky.exr")), map.width, map.height, &map.pixels, &opaque).or_runtime()?;
    let sun = truth.sun().map(|sun| Sun { dir_world: sun.dir_world, irradiance: sun.irradiance });
    Ok(Sky { name, time_utc: crate::sun::format_utc(hour.unix_s), sun })
}

/// Writes the site and the list of moments, to be drawn in `size` = width and height, into `folder`; in words, what is there.
pub(super) fn write_site(
    folder: &Path,
    size: (u32, u32),
    (scene, camera): (&Scene, &Camera),
    skies: &[Sky],
) -> Result<String, Failure> {
    write_glb(&folder.join("site.glb"), scene)?;
    write_whole(&folder.join("camera.json"), |file| std::io::Write::write_all(file, camera.to_json().as_bytes()))?;
    let moments = Moments { size: [size.0, size.1], moments: skies };
    write_whole(&folder.join("moments.json"), |file| Ok(serde_json::to_writer_pretty(file, &moments)?))?;
    let (count, folder) = (skies.len(), folder.display());
    Ok(format!(
        "{folder}: site.glb, camera.json, moments.json and {count} skies; draw NAME.real.exr, NAME.whole.1.exr and \
         NAME.whole.2.exr there, then: relume demo --standing --truth {folder}\n"
    ))
}

fn picture(folder: &Path, hour: &Hour, of: &str) -> PathBuf {
    folder.join(format!("{}.{of}.exr", hour.name()))
}

/// Did the renderer draw this moment?
pub(super) fn is_drawn(folder: &Path, hour: &Hour) -> bool {
    picture(folder, hour, "real").exists()
}

/// What is said of a folder in which no moment is drawn.
pub(super) fn nothing_drawn(folder: &Path) -> Failure {
    let folder = folder.display();
    Failure::bad(format!(
        "--truth {folder}: holds no NAME.real.exr of these --hours; draw the moments that relume demo --standing --export wrote"
    ))
}

/// What the renderer drew of a moment, in `size` = width and height.
pub(super) fn drawn(folder: &Path, hour: &Hour, size: (u32, u32)) -> Result<Drawn, Failure> {
    let read = |of: &str| read(&picture(folder, hour, of), size);
    Ok(Drawn { real: read("real")?, halves: [read("whole.1")?, read("whole.2")?] })
}

fn read(path: &Path, size: (u32, u32)) -> Result<Reference, Failure> {
    let bad = |what: String| Failure::bad(format!("{}: {what}; draw it again as linear RGBA EXR", path.display()));
    let image = read_first_rgba_layer_from_file(
        path,
        |size, _| (size.width(), vec![[0.0f32; 4]; size.area()]),
        |(width, pixels), at, (r, g, b, a): (f32, f32, f32, f32)| pixels[at.y() * *width + at.x()] = [r, g, b, a],
    );
    let layer = image.map_err(|error| bad(format!("cannot be read: {error}")))?.layer_data;
    if (layer.size.width(), layer.size.height()) != (size.0 as usize, size.1 as usize) {
        let exr::prelude::Vec2(width, height) = layer.size;
        return Err(bad(format!("is of {width}x{height} pixels, not {}x{}", size.0, size.1)));
    }
    let (_, pixels) = layer.channel_data.pixels;
    if pixels.iter().flatten().any(|value| !value.is_finite() || *value < 0.0) {
        return Err(bad("holds a value that is negative or no number".to_owned()));
    }
    // A sum of shares in floats may miss 1 by little.
    let share = |alpha: f32| if alpha > 1.0 - 1e-4 { 1.0 } else { alpha };
    let (rgb, coverage) = pixels.iter().map(|&[r, g, b, a]| ([r, g, b], share(a))).unzip();
    Ok(Reference { width: size.0, height: size.1, rgb, coverage })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (3, 2);
    const HOUR: Hour = Hour { day: "clear", unix_s: 1_790_928_000.0 };

    fn put(folder: &Path, of: &str, (width, height): (usize, usize), rgb: [f32; 3], alpha: f32) {
        let count = width * height;
        write_exr(&picture(folder, &HOUR, of), width, height, &vec![rgb; count], &vec![alpha; count]).unwrap();
    }

    #[test]
    fn a_moment_is_drawn_when_its_pictures_are_there_and_comes_back_as_drawn() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(HOUR.name(), "clear_0800");
        assert!(!is_drawn(folder.path(), &HOUR));
        put(folder.path(), "whole.1", (3, 2), [0.5, 0.25, 2.0], 0.999_95);
        put(folder.path(), "whole.2", (3, 2), [0.5, 0.25, 2.0], 0.5);
        put(folder.path(), "real", (3, 2), [0.0, 1.0, 7.5], 1.0);
        let found = drawn(folder.path(), &HOUR, SIZE).unwrap();
        assert!(is_drawn(folder.path(), &HOUR));
        assert_eq!((found.real.width, found.real.height, found.real.rgb[5]), (3, 2, [0.0, 1.0, 7.5]));
        assert_eq!((found.halves[0].coverage[0], found.halves[1].coverage[0]), (1.0, 0.5));
    }

    #[test]
    fn pictures_that_cannot_be_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let told = |folder: &Path| drawn(folder, &HOUR, SIZE).err().unwrap().to_string();
        let mut bad = vec![told(folder.path())];
        put(folder.path(), "real", (2, 3), [1.0; 3], 1.0);
        bad.push(told(folder.path()));
        assert!(bad[1].contains("2x3 pixels, not 3x2"), "{bad:?}");
        put(folder.path(), "real", (3, 2), [1.0, -0.5, 1.0], 1.0);
        bad.push(told(folder.path()));
        std::fs::write(picture(folder.path(), &HOUR, "real"), "no picture").unwrap();
        bad.push(told(folder.path()));
        assert!(
            bad.iter().all(|told| told.contains("clear_0800.real.exr") && told.contains("draw it again")),
            "{bad:?}"
        );
    }

    #[test]
    fn the_site_is_written_with_the_moments_to_draw() {
        let folder = tempfile::tempdir().unwrap();
        let (scene, camera) = relume_bake::demo_scene::site();
        let day = super::super::Day::all().next().unwrap();
        let sky = day.sky(HOUR.unix_s).unwrap();
        let entry = write_sky(folder.path(), &HOUR, &sky).unwrap();
        write_site(folder.path(), (240, 160), (&scene, &camera), &[entry]).unwrap();
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        let told: serde_json::Value = serde_json::from_str(&read("moments.json")).unwrap();
        assert_eq!(
            (&told["size"], &told["moments"][0]["name"]),
            (&serde_json::json!([240, 160]), &"clear_0800".into())
        );
        let irradiance = told["moments"][0]["sun"]["irradiance"][1].as_f64().unwrap();
        assert!((irradiance / f64::from(sky.sun().unwrap().irradiance[1]) - 1.0).abs() < 1e-6);
        assert_eq!(Camera::parse(&read("camera.json"), Path::new("c")).unwrap(), camera);
        assert!(folder.path().join("clear_0800.sky.exr").is_file() && folder.path().join("site.glb").is_file());
    }
}
