//! Synthetic light on a stack, and its sum by the tests' own arithmetic.

use crate::picture::{Linear, read_exr, read_grey};
use std::fmt::Write as _;
use std::path::Path;

/// A patch as `manifest.toml` tells it, or the sun.
#[derive(Clone, Debug)]
pub struct Patch {
    /// File name.
    pub file: String,
    /// Unit direction towards the light.
    pub dir_world: [f64; 3],
    /// Solid angle, sr; 0 for the sun.
    pub solid_angle_sr: f64,
}

/// Patches and sun of a stack's manifest, read line by line.
///
/// # Panics
/// If it is not what `relume-bake --stack` writes.
pub fn patches(stack: &Path) -> (Vec<Patch>, Option<Patch>) {
    let text = std::fs::read_to_string(stack.join("manifest.toml")).expect("a manifest");
    let (mut patches, mut sun) = (Vec::new(), None);
    for table in text.split("\n[").skip(1) {
        let value = |key: &str| table.lines().find_map(|line| line.strip_prefix(key)?.trim().strip_prefix("= "));
        let dir: Vec<f64> = value("direction")
            .expect("a direction")
            .trim_matches(['[', ']'])
            .split(',')
            .map(|part| part.trim().parse().expect("a number"))
            .collect();
        let dir_world = [dir[0], dir[1], dir[2]];
        if table.starts_with("sun]") {
            sun = Some(Patch { file: "sun.exr".into(), dir_world, solid_angle_sr: 0.0 });
        } else {
            let file = value("file").expect("a file").trim_matches('"').to_owned();
            let solid_angle_sr = value("solid_angle_sr").expect("a solid angle").parse().expect("a number");
            patches.push(Patch { file, dir_world, solid_angle_sr });
        }
    }
    (patches, sun)
}

/// Light for a stack: radiance per patch, and the sun's irradiance.
#[derive(Clone, Debug)]
pub struct Light {
    /// One per patch.
    pub radiance: Vec<[f64; 3]>,
    /// The sun of `sun.exr`.
    pub sun: Option<[f64; 3]>,
}

impl Light {
    /// `W.csv` of this light.
    ///
    /// # Panics
    /// If the stack has no sun and the light has.
    pub fn csv(&self, stack: &Path) -> String {
        let (patches, sun) = patches(stack);
        let mut text = String::from("x,y,z,solid_angle_sr,r,g,b\n");
        let suns = self.sun.iter().map(|light| (sun.clone().expect("the stack has a sun"), *light));
        for (patch, [r, g, b]) in patches.into_iter().zip(self.radiance.iter().copied()).chain(suns) {
            let [x, y, z] = patch.dir_world;
            let _ = writeln!(text, "{x},{y},{z},{},{r},{g},{b}", patch.solid_angle_sr);
        }
        text
    }

    /// The sum over the stack's pictures, f64.
    pub fn sum(&self, stack: &Path) -> Linear {
        let (patches, sun) = patches(stack);
        let lights = patches.iter().zip(&self.radiance).chain(sun.iter().zip(&self.sun));
        let mut total: Option<Linear> = None;
        for (patch, light) in lights {
            let picture = read_exr(&stack.join(&patch.file));
            let total = total.get_or_insert_with(|| Linear {
                rgb: vec![[0.0; 3]; picture.rgb.len()],
                alpha: read_grey(&stack.join("coverage.exr")),
                ..picture
            });
            for (sum, pixel) in total.rgb.iter_mut().zip(&picture.rgb) {
                (0..3).for_each(|c| sum[c] += pixel[c] * light[c]);
            }
        }
        total.unwrap_or(Linear { width: 0, height: 0, rgb: Vec::new(), alpha: Vec::new() })
    }
}
