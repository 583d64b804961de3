//! The exact pictures: f64 sums over the stack, for all skies in one pass over its images.

use super::method::BenchSky;

/// Sums in the making, one picture of the covered pixels per sky.
pub struct Sums {
    pictures: Vec<Vec<[f64; 3]>>,
}

impl Sums {
    /// Black pictures of `pixels` covered pixels.
    pub fn new(skies: usize, pixels: usize) -> Self {
        Sums { pictures: vec![vec![[0.0; 3]; pixels]; skies] }
    }

    /// Adds the image of a patch (or of the sun, at `patch` = number of patches) under every sky.
    pub fn add(&mut self, skies: &[BenchSky], patch: usize, image: &[[f32; 3]]) {
        for (picture, sky) in self.pictures.iter_mut().zip(skies) {
            let weight = match sky.weights.radiance.get(patch) {
                Some(radiance) => *radiance,
                None => sky.weights.sun.map_or([0.0; 3], |sun| sun.irradiance),
            };
            if weight == [0.0; 3] {
                continue;
            }
            let weight = weight.map(f64::from);
            for (sum, value) in picture.iter_mut().zip(image) {
                for c in 0..3 {
                    sum[c] += f64::from(value[c]) * weight[c];
                }
            }
        }
    }

    /// The finished pictures, in the skies' order.
    pub fn finish(self) -> Vec<Vec<[f64; 3]>> {
        self.pictures
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weights::{PatchWeights, SunWeight};

    #[test]
    fn two_patches_and_the_sun_by_hand() {
        let sun = SunWeight { dir_world: [0.0, 1.0, 0.0], irradiance: [10.0, 20.0, 30.0] };
        let sky = |sun| BenchSky {
            name: String::new(),
            weights: PatchWeights { radiance: vec![[1.0, 2.0, 3.0], [0.0; 3]], sun },
            exposure: 1.0,
            exact: None,
        };
        let skies = [sky(None), sky(Some(sun))];
        let mut sums = Sums::new(2, 1);
        sums.add(&skies, 0, &[[0.5, 0.5, 0.25]]);
        sums.add(&skies, 1, &[[9.0, 9.0, 9.0]]);
        sums.add(&skies, 2, &[[0.1, 0.2, 0.5]]);
        let pictures = sums.finish();
        assert_eq!(pictures[0], [[0.5, 1.0, 0.75]]);
        let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
        assert!(near(pictures[1][0][0], 1.5) && near(pictures[1][0][1], 5.0) && near(pictures[1][0][2], 15.75));
    }
}
