//! What passes before the sky during a series: birds, and clouds whose edges drift.
//!
//! A ghost multiplies the radiance behind it. Where it is follows from the seed and the frame's number alone.

use super::sensor::splitmix;

/// Birds and clouds that pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ghosts {
    /// Dark discs that cross the picture.
    pub birds: u32,
    /// Radius of a bird, pixels.
    pub bird_px: f64,
    /// Way of a bird from one frame to the next, pixels.
    pub bird_px_per_frame: f64,
    /// Share of the sky's radiance that a bird shows.
    pub bird_share: f64,
    /// Round clouds with soft edges.
    pub clouds: u32,
    /// Radius of a cloud, pixels; the edge is a tenth of it wide.
    pub cloud_px: f64,
    /// Way of a cloud from one frame to the next, pixels.
    pub cloud_px_per_frame: f64,
    /// Radiance of a cloud over that of the sky behind it.
    pub cloud_gain: f64,
    /// Places and ways.
    pub seed: u64,
}

impl Default for Ghosts {
    fn default() -> Self {
        Ghosts {
            birds: 0,
            bird_px: 5.0,
            bird_px_per_frame: 12.0,
            bird_share: 0.15,
            clouds: 0,
            cloud_px: 60.0,
            cloud_px_per_frame: 2.0,
            cloud_gain: 2.5,
            seed: 1,
        }
    }
}

/// A disc on its way, pixels.
struct Disc {
    centre: [f64; 2],
    step: [f64; 2],
    radius: f64,
}

impl Disc {
    /// Distance of a pixel's centre from the disc's centre at a frame, in radii.
    fn distance(&self, at: [f64; 2], frame: u64) -> f64 {
        let passed = frame as f64;
        let off: [f64; 2] = std::array::from_fn(|k| at[k] - self.centre[k] - passed * self.step[k]);
        off[0].hypot(off[1]) / self.radius
    }
}

/// What one frame's ghosts do to a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passing {
    /// Factor on the radiance by clouds and birds.
    pub seen: f32,
    /// Factor by clouds alone: a bird is no part of the sky.
    pub sky: f32,
}

impl Ghosts {
    /// Whether nothing passes.
    pub fn none(&self) -> bool {
        self.birds == 0 && self.clouds == 0
    }

    /// What passes each of `pixels` (indices into a picture `width` wide and `height` high) in a frame.
    pub fn passing(&self, (width, height): (usize, usize), frame: u64, pixels: &[usize]) -> Vec<Passing> {
        let discs = |count, radius, way, salt| self.discs(count, radius, way, salt, (width, height));
        let birds = discs(self.birds, self.bird_px, self.bird_px_per_frame, 1);
        let clouds = discs(self.clouds, self.cloud_px, self.cloud_px_per_frame, 2);
        let one = |&index: &usize| {
            let at = [(index % width) as f64 + 0.5, (index / width) as f64 + 0.5];
            // The edge runs from 0.95 to 1.05 radii.
            let cover = |disc: &Disc| smooth(10.0 * (1.05 - disc.distance(at, frame)));
            let sky = clouds.iter().map(|disc| 1.0 + (self.cloud_gain - 1.0) * cover(disc)).fold(1.0, f64::max);
            let hidden = birds.iter().any(|disc| disc.distance(at, frame) <= 1.0);
            Passing { seen: (if hidden { sky * self.bird_share } else { sky }) as f32, sky: sky as f32 }
        };
        pixels.iter().map(one).collect()
    }

    fn discs(&self, count: u32, radius: f64, way: f64, salt: u64, size: (usize, usize)) -> Vec<Disc> {
        let mut state = self.seed.wrapping_mul(0x2545_f491_4f6c_dd1d) ^ salt;
        let mut uniform = || (splitmix(&mut state) >> 11) as f64 / (1u64 << 53) as f64;
        let mut disc = || {
            // Somewhere in the middle half, so that a few frames do not lead out of the picture.
            let centre = [size.0, size.1].map(|side| (0.25 + 0.5 * uniform()) * side as f64);
            let (sin, cos) = (uniform() * std::f64::consts::TAU).sin_cos();
            Disc { centre, step: [way * cos, way * sin], radius }
        };
        (0..count).map(|_| disc()).collect()
    }
}

fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn birds_hide_their_area_and_move_on() {
        let ghosts = Ghosts { birds: 1, bird_px: 6.0, bird_px_per_frame: 20.0, ..Ghosts::default() };
        let pixels: Vec<usize> = (0..200 * 200).collect();
        let hidden = |frame| -> Vec<usize> {
            let passing = ghosts.passing((200, 200), frame, &pixels);
            assert!(passing.iter().all(|p| p.sky == 1.0));
            (0..pixels.len()).filter(|&i| passing[i].seen < 1.0).collect()
        };
        let (first, second) = (hidden(0), hidden(1));
        let area = std::f64::consts::PI * 36.0;
        assert!((first.len() as f64 / area - 1.0).abs() < 0.1, "{}", first.len());
        assert!(!second.is_empty() && first.iter().all(|at| !second.contains(at)));
    }

    #[test]
    fn clouds_are_part_of_the_sky() {
        let ghosts = Ghosts { clouds: 1, ..Ghosts::default() };
        let pixels: Vec<usize> = (0..300 * 300).collect();
        let passing = ghosts.passing((300, 300), 3, &pixels);
        assert!(passing.iter().all(|p| p.seen == p.sky && (1.0..=2.5).contains(&p.sky)));
        assert!(passing.iter().any(|p| p.sky == 2.5) && passing.iter().any(|p| p.sky == 1.0));
    }
}
