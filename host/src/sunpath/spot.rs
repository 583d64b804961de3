//! Bright, compact spots of a frame: the sun, if it shows, among what glares beside it.
//!
//! Pixels of at least [`LEVEL`] times the frame's peak (linear, mean of the channels) that touch each other make a spot. Its
//! place is the centroid of what stands above the ring around it, which is unbiased for a disc that clips, too, as long as
//! its glare is even. Spots on the picture's edge, long streaks, large bright areas and low humps are none.

use crate::camera::Frame;
use crate::grey::LinearGrey;
use crate::quantile::median;
use crate::response::Response;

/// Share of the frame's peak.
const LEVEL: f64 = 0.8;
/// Spots kept per frame.
const KEPT: usize = 3;
/// Frames with more bright pieces than this show no sun but a bright sky.
const MOST_PIECES: usize = 400;
/// Largest share of the picture.
const LARGEST_SHARE: f64 = 0.01;
/// The peak must stand this many times above the ring around it.
const CONTRAST: f64 = 1.3;
/// A frame whose brightest pixel lies below this share of the full well is dark.
const DARK: f64 = 0.03;
/// Longest axis over shortest of a spot of more than [`SMALL`] pixels.
const LONGEST: f64 = 3.0;
const SMALL: usize = 12;

/// A spot that may be the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Centroid, pixels.
    pub position_px: [f64; 2],
    /// Radius of a disc of the same area, pixels.
    pub radius_px: f64,
    /// Light above the ring around it, full-well fractions x pixels.
    pub light: f64,
}

impl Spot {
    /// How far off the centroid may be, relative to a small spot's: large ones are rarely even.
    pub fn spread(&self) -> f64 {
        (self.radius_px / 4.0).max(1.0)
    }
}

/// Finds spots; keeps its buffers from frame to frame.
#[derive(Debug)]
pub struct SpotFinder {
    grey: LinearGrey,
    /// Linear light per pixel of the frame being looked at.
    light: Vec<f32>,
    /// Which pixels belong to a piece already.
    taken: Vec<bool>,
    piece: Vec<usize>,
}

impl SpotFinder {
    /// A finder for frames of a camera.
    pub fn new(response: Response) -> Self {
        SpotFinder { grey: LinearGrey::new(response), light: Vec::new(), taken: Vec::new(), piece: Vec::new() }
    }

    /// The spots of a frame, the one with most light first, at most three.
    pub fn find(&mut self, frame: &Frame) -> Vec<Spot> {
        self.grey.take(frame, &mut self.light);
        let peak = self.light.iter().copied().fold(0.0, f32::max);
        if f64::from(peak) < DARK {
            return Vec::new();
        }
        let level = (LEVEL * f64::from(peak)) as f32;
        self.taken.clear();
        self.taken.resize(self.light.len(), false);
        let (mut spots, mut pieces) = (Vec::new(), 0);
        for pixel in 0..self.light.len() {
            if self.light[pixel] < level || self.taken[pixel] {
                continue;
            }
            pieces += 1;
            if pieces > MOST_PIECES {
                return Vec::new();
            }
            self.gather(pixel, level, (frame.width, frame.height));
            spots.extend(self.spot((frame.width, frame.height)));
        }
        spots.sort_by(|a, b| b.light.total_cmp(&a.light));
        spots.truncate(KEPT);
        spots
    }

    /// Collects the pixels from `level` on that touch `seed`, by edges or corners.
    fn gather(&mut self, seed: usize, level: f32, (width, height): (usize, usize)) {
        self.piece.clear();
        self.piece.push(seed);
        self.taken[seed] = true;
        let mut next = 0;
        while let Some(&pixel) = self.piece.get(next) {
            next += 1;
            let (x, y) = (pixel % width, pixel / width);
            for row in y.saturating_sub(1)..=(y + 1).min(height - 1) {
                for col in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                    let near = row * width + col;
                    if !self.taken[near] && self.light[near] >= level {
                        self.taken[near] = true;
                        self.piece.push(near);
                    }
                }
            }
        }
    }

    /// The gathered piece as a spot, if it is one.
    fn spot(&self, (width, height): (usize, usize)) -> Option<Spot> {
        let area = self.piece.len();
        let place = |pixel: usize| [(pixel % width) as f64, (pixel / width) as f64];
        let mean = |axis: usize| self.piece.iter().map(|&pixel| place(pixel)[axis]).sum::<f64>() / area as f64;
        let centre = [mean(0), mean(1)];
        if area as f64 > LARGEST_SHARE * (width * height) as f64 || (area > SMALL && self.longish(centre, place)) {
            return None;
        }
        let radius = (area as f64 / std::f64::consts::PI).sqrt();
        let (inner, outer) = (radius + 2.0, radius + 5.0);
        let inside = |c: f64, end: usize| c - inner >= 0.0 && c + inner <= (end - 1) as f64;
        if !inside(centre[0], width) || !inside(centre[1], height) {
            return None;
        }
        let mut ring = Vec::new();
        let mut near = Vec::new();
        let rows = (centre[1] - outer).max(0.0) as usize..=((centre[1] + outer) as usize).min(height - 1);
        for row in rows {
            for col in (centre[0] - outer).max(0.0) as usize..=((centre[0] + outer) as usize).min(width - 1) {
                let (light, away) =
                    (f64::from(self.light[row * width + col]), (col as f64 - centre[0]).hypot(row as f64 - centre[1]));
                if away <= inner {
                    near.push(([col as f64 + 0.5, row as f64 + 0.5], light));
                } else if away <= outer {
                    ring.push(light);
                }
            }
        }
        let peak = near.iter().map(|pixel| pixel.1).fold(0.0, f64::max);
        let around = median(&mut ring)?;
        if peak < CONTRAST * around {
            return None;
        }
        let above = |light: f64| (light - around).max(0.0);
        let light: f64 = near.iter().map(|pixel| above(pixel.1)).sum();
        let centroid = |axis: usize| near.iter().map(|pixel| pixel.0[axis] * above(pixel.1)).sum::<f64>() / light;
        Some(Spot { position_px: [centroid(0), centroid(1)], radius_px: radius, light })
    }

    /// Whether the piece is a streak: its longest axis against its shortest, from second moments.
    fn longish(&self, centre: [f64; 2], place: impl Fn(usize) -> [f64; 2]) -> bool {
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for &pixel in &self.piece {
            let [x, y] = place(pixel);
            let (x, y) = (x - centre[0], y - centre[1]);
            (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        }
        let (half, root) = (0.5 * (xx + yy), (0.25 * (xx - yy).powi(2) + xy * xy).sqrt());
        half + root > LONGEST * LONGEST * (half - root)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 60;

    /// A frame of a given light per place (pixels), each pixel the mean of 8x8 points, clipped, linear codes.
    fn frame(light: impl Fn(f64, f64) -> f64) -> Frame {
        let mut frame = Frame::default();
        let codes = frame.codes_u8(SIZE, SIZE);
        for pixel in 0..SIZE * SIZE {
            let points = (0..64).map(|i| {
                let at = |c: usize, i: usize| c as f64 + (i as f64 + 0.5) / 8.0;
                light(at(pixel % SIZE, i % 8), at(pixel / SIZE, i / 8))
            });
            let mean = points.sum::<f64>() / 64.0;
            codes[pixel * 3..pixel * 3 + 3].fill((255.0 * mean).round().clamp(0.0, 255.0) as u8);
        }
        frame
    }

    fn disc(x: f64, y: f64, radius: f64, strength: f64) -> impl Fn(f64, f64) -> f64 {
        move |px, py| if (px - x).hypot(py - y) < radius { strength } else { 0.02 }
    }

    fn find(frame: &Frame) -> Vec<Spot> {
        SpotFinder::new(Response::default()).find(frame)
    }

    #[test]
    fn a_disc_is_found_to_a_tenth_of_a_pixel_and_a_clipped_one_to_a_quarter() {
        for (i, &(x, y)) in [(30.2, 21.7), (12.5, 40.9), (44.03, 33.33), (25.61, 25.18)].iter().enumerate() {
            let off = |strength: f64, glare: f64| {
                let disc = disc(x, y, 1.7, strength);
                let seen = frame(|px, py| disc(px, py) + glare / (1.0 + ((px - x).hypot(py - y) / 1.5).powi(4)));
                let spots = find(&seen);
                assert_eq!(spots.len(), 1, "{spots:?}");
                (spots[0].position_px[0] - x).hypot(spots[0].position_px[1] - y)
            };
            assert!(off(0.9, 0.0) < 0.1, "{i}: {}", off(0.9, 0.0));
            assert!(off(300.0, 2.0) < 0.25, "{i}: {}", off(300.0, 2.0));
        }
    }

    #[test]
    fn clouds_streaks_edges_and_the_dark_are_no_spots() {
        assert!(find(&frame(|_, _| 0.01)).is_empty(), "dark");
        assert!(find(&frame(|_, _| 0.5)).is_empty(), "even");
        assert!(find(&frame(|_, y| if (y - 30.0).abs() < 1.5 { 1.0 } else { 0.1 })).is_empty(), "streak");
        assert!(find(&frame(disc(30.0, 30.0, 9.0, 1.0))).is_empty(), "a bright cloud");
        assert!(find(&frame(disc(1.0, 30.0, 1.7, 1.0))).is_empty(), "on the edge");
        assert!(
            find(&frame(|x, y| 0.8 + 0.1 * (-((x - 30.0).powi(2) + (y - 30.0).powi(2)) / 9.0).exp())).is_empty(),
            "a hump"
        );
    }

    #[test]
    fn the_brighter_of_two_comes_first() {
        let (sun, ghost) = (disc(20.0, 20.0, 2.0, 1.0), disc(45.5, 40.5, 1.4, 0.95));
        let spots = find(&frame(|x, y| sun(x, y).max(ghost(x, y))));
        assert_eq!(spots.len(), 2);
        assert!((spots[0].position_px[0] - 20.0).abs() < 0.1 && spots[0].light > spots[1].light);
    }
}
