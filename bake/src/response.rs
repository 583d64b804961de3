//! The response of pixels to every patch of the sky, all patches in one pass.
//!
//! A pixel is seen by 16 rays, one in each of 4 x 4 strata, at the points of `firmware/src/pixelpoints.rs`: so that all
//! pictures of a stack, its sun and the live sun stand for the same points of the same surfaces. Rays are aimed at the patches (a) from the seen
//! surfaces, each patch from a rotating share of the strata, or from all of them where pixel or patch is not uniform, and
//! (b) from every further surface of the paths that go on from there, one patch out of each group of neighbours, so
//! that over the pixel's paths every patch of a group has the same number of rays. A path that escapes adds nothing:
//! all light comes by aimed rays, but for narrow reflection lobes. Aimed rays and paths that follow such a lobe find its
//! light both, and share it by the power heuristic (gloss.rs).

mod twice;

use glam::Vec3A;
use relume_firmware::patches::PatchSet;
use relume_firmware::pixelpoints::{PIXEL_POINTS, pixel_point};
use serde::{Deserialize, Serialize};

use crate::camera::{Camera, CameraView};
use crate::fragments::{Fragment, fragments};
use crate::geometry::{Cone, Geometry, Surface};
use crate::part::{Eye, Part};
use crate::path::{Step, Tracer};
use crate::scene::{Role, Scene};
use crate::strata::{Grid, PatchTable, Rng, class_of};
use crate::viewpoint::{self, TransportError};

/// Width and height of a tile, pixels.
pub const TILE: u32 = 16;

/// How finely light is sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TransportOptions {
    /// Most surface hits of a path, the seen one included; 0 for no limit (Russian roulette ends paths).
    pub max_hits: u32,
    /// The same seed gives the same response, whatever the number of threads.
    pub seed: u64,
    /// Of the four classes of strata, how many aim rays at each patch in a uniform pixel: 1, 2 or 4.
    pub direct_classes: u32,
    /// Paths that go on from each seen surface: 1 to 16.
    pub paths: u32,
    /// Neighbouring patches that share one ray at every later surface of a path: 1 to 64.
    pub patch_group: u32,
    /// Paths that go on from each seen surface of a pixel to find out what it receives of sunlight by way of others:
    /// 1 to 1024, best a multiple of a large power of two.
    pub sun_paths: u32,
}

impl Default for TransportOptions {
    fn default() -> Self {
        TransportOptions { max_hits: 0, seed: 1, direct_classes: 2, paths: 8, patch_group: 8, sun_paths: 80 }
    }
}

impl TransportOptions {
    fn checked(self) -> Self {
        TransportOptions {
            sun_paths: self.sun_paths.clamp(1, 1024),
            direct_classes: if self.direct_classes >= 3 { 4 } else { self.direct_classes.max(1) },
            paths: self.paths.clamp(1, 16),
            patch_group: self.patch_group.clamp(1, 64),
            ..self
        }
    }
}

/// The response of the pixels of one tile.
#[derive(Clone, Debug, PartialEq)]
pub struct TileResponse {
    /// Left column of the tile in the picture.
    pub x0: u32,
    /// Top row of the tile in the picture.
    pub y0: u32,
    /// Columns, at most [`TILE`].
    pub w: u32,
    /// Rows, at most [`TILE`].
    pub h: u32,
    /// Number of patches.
    pub patches: usize,
    /// `[h][w]`: share of each pixel that geometry covers.
    pub coverage: Vec<f32>,
    /// Indices `y * w + x` of the pixels with coverage above 0, ascending.
    pub covered: Vec<u16>,
    /// `[covered][channel 3][patch]`: radiance for patch radiance 1, premultiplied.
    pub response: Vec<f32>,
    /// Same shape: the part of `response` that met two surfaces or more.
    pub indirect: Vec<f32>,
    /// `[covered]`: the surfaces seen.
    pub fragments: Vec<Vec<Fragment>>,
}

impl TileResponse {
    /// Column and row in the picture of the tile's pixel `index`.
    pub(crate) fn place(&self, index: u16) -> (u32, u32) {
        (self.x0 + u32::from(index) % self.w, self.y0 + u32::from(index) / self.w)
    }
}

/// Light transport from the patches to the pixels of one camera.
pub struct Transport<'s> {
    pub(crate) tracer: Tracer<'s>,
    pub(crate) view: CameraView,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) options: TransportOptions,
    eye: Eye<'s>,
    patches: PatchTable,
}

/// What one pixel's rays from the eye met, one per stratum.
pub(crate) type Seen = Vec<Option<Surface>>;

impl<'s> Transport<'s> {
    /// Prepares the virtual geometry of `scene` for the view of `camera` at `size` (width, height) pixels.
    ///
    /// # Errors
    /// [`TransportError`]: zero size, no triangles, a camera that sees nothing or stands inside a wall.
    pub fn new(
        scene: &'s Scene,
        camera: &Camera,
        patch_set: PatchSet,
        size: (u32, u32),
        options: TransportOptions,
    ) -> Result<Self, TransportError> {
        Transport::of(Part::of_virtual(scene), camera, patch_set, size, options)
    }

    /// The same for any part of a scene. Receivers may be out of the camera's sight.
    ///
    /// # Errors
    /// As [`Transport::new`].
    pub fn of(
        part: Part<'s>,
        camera: &Camera,
        patch_set: PatchSet,
        size: (u32, u32),
        options: TransportOptions,
    ) -> Result<Self, TransportError> {
        viewpoint::check_size(size)?;
        if part.scene.triangles.is_empty() {
            return Err(TransportError::NoTriangles);
        }
        let geometry = Geometry::new(part.scene);
        let view = camera.view(size.0, size.1);
        if part.shows == Role::Virtual {
            viewpoint::check_view(&geometry, &view, size)?;
        }
        let options = options.checked();
        Ok(Transport {
            eye: Eye::new(part),
            tracer: Tracer { geometry, max_hits: options.max_hits },
            view,
            width: size.0,
            height: size.1,
            options,
            patches: PatchTable::new(&patch_set),
        })
    }

    /// Number of patches.
    pub fn patches(&self) -> usize {
        self.patches.len()
    }

    /// Tiles across and down.
    pub fn tiles(&self) -> (u32, u32) {
        (self.width.div_ceil(TILE), self.height.div_ceil(TILE))
    }

    /// Left, top, width and height of tile (`tx`, `ty`); width and height are 0 outside the picture.
    pub(crate) fn tile_rectangle(&self, tx: u32, ty: u32) -> [u32; 4] {
        let (x0, y0) = ((tx * TILE).min(self.width), (ty * TILE).min(self.height));
        [x0, y0, TILE.min(self.width - x0), TILE.min(self.height - y0)]
    }

    /// The response of tile (`tx`, `ty`). Depends on the seed and the pixels only.
    pub fn tile(&self, tx: u32, ty: u32) -> TileResponse {
        let [x0, y0, w, h] = self.tile_rectangle(tx, ty);
        let patches = self.patches.len();
        let mut tile = TileResponse {
            x0,
            y0,
            w,
            h,
            patches,
            coverage: vec![0.0; (w * h) as usize],
            covered: Vec::new(),
            response: Vec::new(),
            indirect: Vec::new(),
            fragments: Vec::new(),
        };
        for index in 0..w * h {
            let (x, y) = (x0 + index % w, y0 + index / w);
            let (seen, mut rng) = self.seen(x, y);
            let hits = seen.iter().flatten().count();
            if hits == 0 {
                continue;
            }
            tile.coverage[index as usize] = hits as f32 / seen.len() as f32;
            tile.covered.push(index as u16);
            tile.fragments.push(fragments(&seen));
            let from = tile.response.len();
            tile.response.resize(from + 3 * patches, 0.0);
            tile.indirect.resize(from + 3 * patches, 0.0);
            let (response, indirect) = (&mut tile.response[from..], &mut tile.indirect[from..]);
            self.further_light(&seen, [&mut *response, &mut *indirect], &mut rng);
            response.iter_mut().zip(&*indirect).for_each(|(all, further)| *all += further);
            self.first_light(&seen, response, &mut rng);
        }
        tile
    }

    /// The surfaces that the rays from the eye meet in pixel (`x`, `y`), and the pixel's random numbers from there on.
    pub(crate) fn seen(&self, x: u32, y: u32) -> (Seen, Rng) {
        let mut rng = Rng::new(self.options.seed, x, y, 0);
        let origin = self.view.position.as_vec3a();
        // Each of 4 x 4 points stands for its part of the pixel.
        let cone = Cone { width: 0.0, spread: 0.25 * self.view.pixel_angle(x as f32 + 0.5, y as f32 + 0.5) };
        let mut look = |s: usize| {
            let [right, down] = pixel_point(s);
            let direction = Vec3A::from(self.view.direction(x as f32 + right, y as f32 + down)?);
            self.eye.first(&self.tracer, origin, direction, cone, &mut rng)
        };
        let seen = (0..PIXEL_POINTS).map(&mut look).collect();
        (seen, rng)
    }

    /// Adds the light that reaches the seen surfaces straight from the patches to `[channel][patch]`.
    fn first_light(&self, seen: &Seen, response: &mut [f32], rng: &mut Rng) {
        let patches = self.patches.len();
        let usual = self.usual_classes(seen);
        for patch in 0..patches {
            let classes = self.classes(patch, usual);
            let aimed = self.first_density(patch, usual);
            let rays = classes * seen.len() as u32 / 4;
            let grid = Grid::new(rays);
            let turn = rng.next_u32();
            let weight = self.patches.solid_angle_sr[patch] / (std::f32::consts::PI * rays as f32);
            let mut cell = turn >> 2;
            let mut sum = Vec3A::ZERO;
            for (k, surface) in seen.iter().enumerate() {
                if (class_of(k as u32) + turn) & 3 >= classes {
                    continue;
                }
                cell += 1;
                if let Some(surface) = surface
                    && !self.patches.below(patch, surface.normal_flat)
                {
                    let direction = self.patches.direction(patch, grid.point(cell % rays, rng.jitter()));
                    sum += self.sent_on(surface, direction, aimed, self.options.paths as f32);
                }
            }
            for channel in 0..3 {
                response[channel * patches + patch] += sum[channel] * weight;
            }
        }
    }

    /// Pi times the radiance that `surface` sends on of radiance 1 from `dir_world`, over 1 sr; what an aimed ray of the density
    /// `aimed` brings of it when `paths` paths start there.
    fn sent_on(&self, surface: &Surface, dir_world: Vec3A, aimed: f32, paths: f32) -> Vec3A {
        let passed = || self.tracer.geometry.transmittance(surface.position, dir_world);
        let cosine = surface.cosine(dir_world);
        match &surface.gloss {
            None if cosine > 0.0 => surface.albedo * (cosine * passed()),
            Some(gloss) if surface.is_above(dir_world) => {
                let part = gloss.aimed_part(dir_world, aimed, paths);
                let light = gloss.sent_on(surface.albedo * cosine, dir_world, part);
                if light.max_element() > 0.0 { light * passed() } else { Vec3A::ZERO }
            }
            _ => Vec3A::ZERO,
        }
    }

    /// Of the classes of strata, how many aim rays at a patch that is not wide.
    fn usual_classes(&self, seen: &Seen) -> u32 {
        if uniform(seen) { self.options.direct_classes } else { 4 }
    }

    fn classes(&self, patch: usize, usual: u32) -> u32 {
        if self.patches.wide(patch) { 4 } else { usual }
    }

    /// Density (1/sr) of rays aimed at a patch from one seen surface.
    fn first_density(&self, patch: usize, usual: u32) -> f32 {
        0.25 * self.classes(patch, usual) as f32 / self.patches.solid_angle_sr[patch]
    }

    /// The patches of the group that begins with `group`.
    fn group_size(&self, group: usize) -> usize {
        (self.patches.len() - group).min(self.options.patch_group as usize)
    }

    /// Adds to `[channel][patch]` the light that paths from the seen surfaces find: `first` what comes along the lobes of
    /// these themselves, `further` what comes by way of others.
    fn further_light(&self, seen: &Seen, [first, further]: [&mut [f32]; 2], rng: &mut Rng) {
        let usual = self.usual_classes(seen);
        let samples = seen.len() as u32;
        let total = samples * self.options.paths;
        let blocks = Grid::new(self.options.paths);
        let cells = Grid::new(samples);
        let start = rng.next_u32() >> 1;
        for path in 0..self.options.paths {
            // Within block `path` of directions every sample takes another cell.
            let turn = rng.next_u32() % samples;
            for (k, surface) in seen.iter().enumerate() {
                let Some(surface) = surface else { continue };
                let cell = (k as u32 * 5 + turn) % samples;
                let at = [blocks.point(path, cells.point(cell, rng.jitter())), rng.square()];
                let pick = k as u32 + 5 * path;
                self.tracer.walk(surface, at, rng, |step, throughput, hits, rng| {
                    let throughput = throughput / total as f32;
                    match step {
                        Step::Met(surface) => {
                            let pick = pick.wrapping_add(start.wrapping_mul(hits));
                            self.aim(surface, throughput, pick, further, rng);
                        }
                        Step::Escaped { from, dir_world } if hits == 1 => {
                            let paths = self.options.paths as f32;
                            let aimed = |patch| self.first_density(patch, usual);
                            self.escape(from, dir_world, throughput, (aimed, paths), first);
                        }
                        Step::Escaped { from, dir_world } => {
                            let aimed = |patch| self.further_density(patch);
                            self.escape(from, dir_world, throughput, (aimed, 1.0), further);
                        }
                    }
                });
            }
        }
    }

    /// Density (1/sr) of rays aimed at a patch from one later surface.
    fn further_density(&self, patch: usize) -> f32 {
        let group = self.options.patch_group as usize;
        1.0 / (self.group_size(patch / group * group) as f32 * self.patches.solid_angle_sr[patch])
    }

    /// Adds what a path that followed the lobe of `from` finds of a patch, but for what aimed rays find of it.
    fn escape(
        &self,
        from: &Surface,
        dir_world: Vec3A,
        throughput: Vec3A,
        (aimed, paths): (impl Fn(usize) -> f32, f32),
        light: &mut [f32],
    ) {
        let (patches, patch) = (self.patches.len(), self.patches.set.patch_of(dir_world.to_array()));
        let Some(gloss) = from.gloss.filter(|_| patch < patches) else { return };
        let part = 1.0 - gloss.aimed_part(dir_world, aimed(patch), paths);
        for channel in 0..3 {
            light[channel * patches + patch] += throughput[channel] * part;
        }
    }

    /// Adds the light that `surface` passes on from one patch of every group, weighted by the group's size.
    fn aim(&self, surface: &Surface, throughput: Vec3A, pick: u32, indirect: &mut [f32], rng: &mut Rng) {
        let patches = self.patches.len();
        let value = surface.albedo * throughput * std::f32::consts::FRAC_1_PI;
        if value.max_element() <= 0.0 && surface.gloss.is_none() {
            return;
        }
        for group in (0..patches).step_by(self.options.patch_group as usize) {
            let size = self.group_size(group);
            let patch = group + pick.wrapping_add(crate::strata::hash(group as u32)) as usize % size;
            let at = rng.jitter();
            if self.patches.below(patch, surface.normal_flat) {
                continue;
            }
            let direction = self.patches.direction(patch, at);
            let weight = self.patches.solid_angle_sr[patch] * size as f32;
            let light = if surface.gloss.is_none() {
                let cosine = surface.cosine(direction);
                if cosine <= 0.0 {
                    continue;
                }
                let passed = self.tracer.geometry.transmittance(surface.position, direction);
                value * (passed * cosine * self.patches.solid_angle_sr[patch] * size as f32)
            } else {
                let sent_on = self.sent_on(surface, direction, 1.0 / weight, 1.0);
                throughput * sent_on * (weight * std::f32::consts::FRAC_1_PI)
            };
            for channel in 0..3 {
                indirect[channel * patches + patch] += light[channel];
            }
        }
    }
}

/// Whether all samples of a pixel met one kind of surface: a quarter of them then stands for all.
fn uniform(seen: &Seen) -> bool {
    let Some(Some(first)) = seen.first() else { return false };
    seen.iter().all(|surface| {
        surface.is_some_and(|s| {
            s.normal.dot(first.normal) > 0.98 && (s.reflectance() - first.reflectance()).length() < 0.05
        })
    })
}

#[cfg(test)]
pub(crate) mod glossy_tests;
#[cfg(test)]
pub(crate) mod tests;
