//! Which part of which pixel's light belongs to which patch: geometry, worked out once per lens.
//!
//! A pixel counts when all of it looks above the horizon and it is not masked: one that the horizon cuts shows the ground
//! as well. Its solid angle goes whole to the patch that holds it. Where a border of patches or the horizon cuts a pixel,
//! 8x8 sub-samples tell how much of it lies where, and radiance there is interpolated between the centres of the pixels
//! around: a patch then gets the light of its own part and not the pixel's mean. What no pixel that counts is next to (a
//! strip of half a pixel along the horizon) takes the nearest one above it.

use crate::lens::Lens;
use crate::sun::angle_deg;
use relume_firmware::patches::PatchSet;

/// Sub-samples of a cut pixel, a side.
const SUB: usize = 8;
/// How far above a sub-sample without neighbours a pixel that counts is looked for, pixels.
const REACH_PX: f64 = 3.0;

/// The light of a pixel that belongs to a patch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Share {
    pub pixel: u32,
    pub patch: u16,
    /// sr
    pub omega: f32,
}

/// Pixels and their patches.
pub(super) struct Shares {
    /// Sorted by patch.
    pub shares: Vec<Share>,
    /// Where each patch's begin, and the end; and how far from the patch's direction its farthest pixel looks, degrees.
    starts: Vec<usize>,
    reach_deg: Vec<f32>,
    /// Per picture pixel its centre's direction and solid angle, which is 0 where it does not count.
    pub dirs: Vec<[f32; 3]>,
    pub omegas: Vec<f32>,
    /// Per patch: solid angle that was seen, sr, and the mean direction of that (not of unit length).
    pub seen: Vec<f64>,
    pub seen_dirs: Vec<[f32; 3]>,
    /// The mean of its pixels' directions, by their shares: where the light of an even sky stands.
    pub middles: Vec<[f64; 3]>,
}

/// Where a picture position looks: direction and density, sr per pixel.
fn look(lens: &Lens, at: [f64; 2]) -> Option<([f64; 3], f64)> {
    lens.unproject(at).zip(lens.solid_angle_sr(at))
}

struct Builder<'l> {
    lens: &'l Lens,
    set: &'l PatchSet,
    width: usize,
    height: usize,
    omegas: Vec<f32>,
    shares: Vec<Share>,
    seen: Vec<f64>,
    moments: Vec<[f64; 3]>,
}

impl Shares {
    /// For a lens, a picture size and a patch set; `mask`, like the lens's own, is false where a pixel is no sky.
    pub fn new(lens: &Lens, (width, height): (usize, usize), set: &PatchSet, mask: Option<&[bool]>) -> Self {
        let corners = corner_patches(lens, (width, height), set);
        let corner = |pixel: usize, k: usize| corners[(pixel / width + k / 2) * (width + 1) + pixel % width + k % 2];
        let corners_of = |pixel: usize| [0, 1, 2, 3].map(|k| corner(pixel, k));
        let is_open = |pixel: usize| {
            mask.is_none_or(|mask| mask.get(pixel).copied().unwrap_or(false))
                && lens.mask().is_none_or(|mask| mask.is_sky(pixel))
        };
        let centre = |pixel: usize| [(pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5];
        let (mut dirs, mut omegas) = (vec![[0.0; 3]; width * height], vec![0.0; width * height]);
        for pixel in (0..width * height).filter(|&pixel| is_open(pixel)) {
            if let (true, Some((dir, density))) =
                (corners_of(pixel).iter().all(Option::is_some), look(lens, centre(pixel)))
            {
                (dirs[pixel], omegas[pixel]) = (dir.map(|c| c as f32), density as f32);
            }
        }
        let mut builder = Builder {
            lens,
            set,
            width,
            height,
            omegas,
            shares: Vec::new(),
            seen: vec![0.0; set.len()],
            moments: vec![[0.0; 3]; set.len()],
        };
        for pixel in (0..width * height).filter(|&pixel| is_open(pixel)) {
            match corners_of(pixel) {
                [None, None, None, None] => {}
                [Some(patch), b, c, d] if [b, c, d] == [Some(patch); 3] => builder.whole(pixel, patch, dirs[pixel]),
                _ => builder.cut(pixel),
            }
        }
        builder.finish(dirs)
    }

    /// Those of one patch.
    pub fn of_patch(&self, patch: usize) -> &[Share] {
        &self.shares[self.starts[patch]..self.starts[patch + 1]]
    }

    /// Whether any pixel of a patch, which lies in `dir_world`, may look within some degrees of another direction.
    pub fn is_near(&self, patch: usize, dir_world: [f32; 3], other_world: [f32; 3], within_deg: f32) -> bool {
        angle_deg(dir_world, other_world) as f32 <= within_deg + self.reach_deg[patch]
    }

    /// Pixels that count.
    pub fn count(&self) -> usize {
        self.omegas.iter().filter(|&&omega| omega > 0.0).count()
    }
}

/// The patch that each corner of each pixel looks at; none below the horizon or beyond the lens.
fn corner_patches(lens: &Lens, (width, height): (usize, usize), set: &PatchSet) -> Vec<Option<u16>> {
    let patch = |corner: usize| {
        let dir = lens.unproject([(corner % (width + 1)) as f64, (corner / (width + 1)) as f64])?;
        (dir[1] >= 0.0).then(|| set.patch_of(dir.map(|c| c as f32)) as u16)
    };
    (0..(width + 1) * (height + 1)).map(patch).collect()
}

impl Builder<'_> {
    /// A pixel within one patch.
    fn whole(&mut self, pixel: usize, patch: u16, dir: [f32; 3]) {
        let omega = self.omegas[pixel];
        if omega > 0.0 {
            self.note(patch, f64::from(omega), dir.map(f64::from));
            self.shares.push(Share { pixel: pixel as u32, patch, omega });
        }
    }

    fn note(&mut self, patch: u16, omega: f64, dir: [f64; 3]) {
        self.seen[usize::from(patch)] += omega;
        let moment = &mut self.moments[usize::from(patch)];
        *moment = std::array::from_fn(|k| moment[k] + omega * dir[k]);
    }

    /// A pixel that a border of patches, the horizon or the lens's edge cuts.
    fn cut(&mut self, pixel: usize) {
        let first = self.shares.len();
        for sub in 0..SUB * SUB {
            let part = |k: usize| (k as f64 + 0.5) / SUB as f64;
            let at = [(pixel % self.width) as f64 + part(sub % SUB), (pixel / self.width) as f64 + part(sub / SUB)];
            let Some((dir, density)) = look(self.lens, at).filter(|(dir, _)| dir[1] >= 0.0) else { continue };
            let patch = self.set.patch_of(dir.map(|c| c as f32)) as u16;
            let omega = density / (SUB * SUB) as f64;
            let Some(taps) = self.taps(at).or_else(|| self.above(dir, density)) else { continue };
            self.note(patch, omega, dir);
            for (pixel, weight) in taps.into_iter().filter(|(_, weight)| *weight > 0.0) {
                let omega = (omega * weight) as f32;
                match self.shares[first..].iter_mut().find(|s| s.pixel == pixel && s.patch == patch) {
                    Some(share) => share.omega += omega,
                    None => self.shares.push(Share { pixel, patch, omega }),
                }
            }
        }
    }

    /// Does this pixel count?
    fn counts(&self, [x, y]: [i64; 2]) -> Option<usize> {
        let inside = (0..self.width as i64).contains(&x) && (0..self.height as i64).contains(&y);
        let pixel = (y * self.width as i64 + x) as usize;
        (inside && self.omegas[pixel] > 0.0).then_some(pixel)
    }

    /// The four pixel centres around a position and their bilinear weights, of those that count.
    fn taps(&self, at: [f64; 2]) -> Option<[(u32, f64); 4]> {
        let corner = at.map(|c| (c - 0.5).floor());
        let [u, v] = [at[0] - 0.5 - corner[0], at[1] - 0.5 - corner[1]];
        let mut taps = [(0, 0.0); 4];
        for (k, tap) in taps.iter_mut().enumerate() {
            let weight = (if k % 2 == 0 { 1.0 - u } else { u }) * (if k / 2 == 0 { 1.0 - v } else { v });
            let place = [corner[0] as i64 + (k % 2) as i64, corner[1] as i64 + (k / 2) as i64];
            if let Some(pixel) = self.counts(place) {
                *tap = (pixel as u32, weight);
            }
        }
        let total: f64 = taps.iter().map(|(_, weight)| weight).sum();
        (total > 0.0).then(|| taps.map(|(pixel, weight)| (pixel, weight / total)))
    }

    /// The nearest pixel that counts, straight up from a direction.
    fn above(&self, dir: [f64; 3], density: f64) -> Option<[(u32, f64); 4]> {
        let level = dir[0].hypot(dir[2]).max(1e-9);
        let altitude = dir[1].atan2(level);
        let step = 0.5 * density.sqrt();
        let found = (1..=(2.0 * REACH_PX) as i32).find_map(|k| {
            let (sin, cos) = (altitude + f64::from(k) * step).sin_cos();
            let at = self.lens.project([dir[0] / level * cos, sin, dir[2] / level * cos])?;
            self.counts(at.map(|c| c.floor() as i64))
        });
        found.map(|pixel| [(pixel as u32, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)])
    }

    fn finish(mut self, dirs: Vec<[f32; 3]>) -> Shares {
        self.shares.sort_unstable_by_key(|share| (share.patch, share.pixel));
        self.shares.dedup_by(|next, kept| {
            let same = (next.patch, next.pixel) == (kept.patch, kept.pixel);
            if same {
                kept.omega += next.omega;
            }
            same
        });
        self.shares.shrink_to_fit();
        let starts: Vec<usize> =
            (0..=self.set.len()).map(|patch| self.shares.partition_point(|s| usize::from(s.patch) < patch)).collect();
        let apart_deg = |share: &Share, patch| angle_deg(self.set.dir_world(patch), dirs[share.pixel as usize]) as f32;
        let farthest = |patch: usize| {
            self.shares[starts[patch]..starts[patch + 1]]
                .iter()
                .map(|share| apart_deg(share, patch))
                .fold(0.0, f32::max)
        };
        let reach_deg = (0..self.set.len()).map(farthest).collect();
        let middle = |patch: usize| {
            let (mut sum, mut whole) = ([0.0; 3], 0.0);
            for share in &self.shares[starts[patch]..starts[patch + 1]] {
                let (dir, omega) = (dirs[share.pixel as usize], f64::from(share.omega));
                sum = std::array::from_fn(|k| sum[k] + omega * f64::from(dir[k]));
                whole += omega;
            }
            sum.map(|c: f64| c / whole.max(1e-12))
        };
        let middles = (0..self.set.len()).map(middle).collect();
        let mean = |(moment, seen): (&[f64; 3], &f64)| moment.map(|c| (c / seen.max(1e-12)) as f32);
        let seen_dirs = self.moments.iter().zip(&self.seen).map(mean).collect();
        Shares {
            shares: self.shares,
            starts,
            reach_deg,
            dirs,
            omegas: self.omegas,
            seen: self.seen,
            seen_dirs,
            middles,
        }
    }
}
