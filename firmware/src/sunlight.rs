//! Sunlight for any direction: the direct part traced through the geometry the field carries, the indirect part
//! interpolated from the patches' indirect response.
//!
//! ```text
//! CAST  64 bytes per caster (a triangle), in the order of the leaves of CBVH
//!    0 f32[9] corners, world metres   36 i16[9] corner normals in 1/32767   54 u8 opacity, 255 = opaque   55 reserved
//! CBVH  32 bytes per node, depth first
//!    0 f32[3] low corner   12 u32 next node when the ray misses the box (or after a leaf)
//!   16 f32[3] high corner  28 u32 0: inner node, else first caster << 4 | number of casters (1..=15)
//! FRGT  u32 per tile and one more: where the tile's block begins in FRAG, in units of 4 bytes
//! FRAG  per tile: u8 fragments of each covered pixel, filled up to a multiple of 4; then 12 bytes per fragment
//!    0 u32 caster   4 u16 strata: bit sy*4+sx is set where that sixteenth of the pixel sees the caster
//!    6 u16[3] albedo times share of the pixel, in 1/32768
//! ```

use crate::field::{CameraRecord, Field, FieldError};
use crate::header::{u16_at, u32_at, vec3_at};
use crate::kernel::Kernel;
use crate::relight::{Coefficients, LinearTile};
use crate::tile::{MAX_RANK, TILE_PIXELS, TILE_PX, TileSet, padded};
use crate::weights::FixedWeights;

/// Length of a caster, bytes.
pub const CASTER: usize = 64;
/// Length of a node, bytes.
pub const NODE: usize = 32;
/// Length of a fragment, bytes.
pub const FRAGMENT: usize = 12;
/// Angular diameter of the sun's disc, degrees.
pub const SUN_DIAMETER_DEG: f32 = 0.533;

type Vec3 = [f32; 3];

fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}
fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
fn mul(a: Vec3, s: f32) -> Vec3 {
    a.map(|c| c * s)
}
fn dot(a: Vec3, b: Vec3) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
fn unit(a: Vec3) -> Vec3 {
    let length = libm::sqrtf(dot(a, a));
    if length > 0.0 { mul(a, 1.0 / length) } else { [0.0, 1.0, 0.0] }
}

/// Checked layers of the direct sunlight.
#[derive(Clone, Copy, Debug)]
pub struct SunSurfaces<'a> {
    casters: &'a [u8],
    nodes: &'a [u8],
    blocks: &'a [u8],
    fragments: &'a [u8],
}

impl<'a> SunSurfaces<'a> {
    pub(crate) fn check(
        [casters, nodes, blocks, fragments]: [&'a [u8]; 4],
        response: &TileSet<'_>,
    ) -> Result<Self, FieldError> {
        let surfaces = SunSurfaces { casters, nodes, blocks, fragments };
        let whole = casters.len() % CASTER == 0 && nodes.len() % NODE == 0;
        if !whole || blocks.len() != (response.tiles() + 1) * 4 {
            return Err(FieldError::Invalid("length of a sunlight layer"));
        }
        let finite = |bytes: &[u8], floats: &[usize]| floats.iter().all(|&at| f32_finite(bytes, at));
        let corners = [0, 4, 8, 12, 16, 20, 24, 28, 32];
        if !casters.chunks_exact(CASTER).all(|caster| finite(caster, &corners)) {
            return Err(FieldError::Invalid("sunlight caster"));
        }
        let count = nodes.len() / NODE;
        for (index, node) in nodes.chunks_exact(NODE).enumerate() {
            let (next, leaf) = (u32_at(node, 12) as usize, u32_at(node, 28));
            let last = (leaf >> 4) as usize + (leaf & 15) as usize;
            let leaf_good = leaf == 0 || (leaf & 15 != 0 && last <= casters.len() / CASTER && next == index + 1);
            if next <= index || next > count || !leaf_good || !finite(node, &[0, 4, 8, 16, 20, 24]) {
                return Err(FieldError::Invalid("sunlight node"));
            }
        }
        for tile in 0..response.tiles() {
            surfaces.check_block(tile, response.tile(tile).pixels())?;
        }
        Ok(surfaces)
    }

    fn check_block(&self, tile: usize, pixels: usize) -> Result<(), FieldError> {
        let bad = FieldError::Invalid("sunlight fragments");
        let (from, to) = (u32_at(self.blocks, tile * 4) as usize * 4, u32_at(self.blocks, tile * 4 + 4) as usize * 4);
        let block = self.fragments.get(from..to).ok_or(bad)?;
        let counts = block.get(..pixels).ok_or(bad)?;
        let total: usize = counts.iter().map(|&c| usize::from(c)).sum();
        let fragments = block.get(pixels.next_multiple_of(4)..).ok_or(bad)?;
        let casters = self.casters.len() / CASTER;
        let known = |fragment: &[u8]| (u32_at(fragment, 0) as usize) < casters;
        let good = fragments.len() == total * FRAGMENT && fragments.chunks_exact(FRAGMENT).all(known);
        if good { Ok(()) } else { Err(bad) }
    }

    /// Number of casters.
    pub fn casters(&self) -> usize {
        self.casters.len() / CASTER
    }

    /// Share of light (0..=1) that reaches `origin` from direction `dir`.
    pub fn transmittance(&self, origin: Vec3, dir: Vec3) -> f32 {
        // A zero component would make 0 * infinity; a tiny one moves the ray by less than a rounding.
        let inverse = dir.map(|d| 1.0 / if d.abs() < 1e-12 { 1e-12 } else { d });
        let count = self.nodes.len() / NODE;
        let (mut left, mut index) = (1.0f32, 0);
        while index < count {
            let node = &self.nodes[index * NODE..][..NODE];
            let leaf = u32_at(node, 28);
            if !hits_box(node, origin, inverse) {
                index = u32_at(node, 12) as usize;
                continue;
            }
            index += 1;
            let first = (leaf >> 4) as usize;
            for caster in first..first + (leaf & 15) as usize {
                let caster = &self.casters[caster * CASTER..][..CASTER];
                if hits_triangle(caster, origin, dir) {
                    left *= 1.0 - f32::from(caster[54]) / 255.0;
                    if left < 1.0 / 512.0 {
                        return 0.0;
                    }
                }
            }
        }
        left
    }

    fn fragments(&self, tile: usize, pixels: usize) -> (&'a [u8], &'a [u8]) {
        let (from, to) = (u32_at(self.blocks, tile * 4) as usize * 4, u32_at(self.blocks, tile * 4 + 4) as usize * 4);
        let block = &self.fragments[from..to];
        (&block[..pixels], &block[pixels.next_multiple_of(4)..])
    }
}

fn f32_finite(bytes: &[u8], at: usize) -> bool {
    f32::from_bits(u32_at(bytes, at)).is_finite()
}

/// Slab test; the margin of 4 rounding errors keeps edges closed (Ize, *Robust BVH Ray Traversal*, JCGT 2013).
fn hits_box(node: &[u8], origin: Vec3, inverse: Vec3) -> bool {
    let (low, high) = (vec3_at(node, 0), vec3_at(node, 16));
    let (mut near, mut far) = (0.0f32, f32::INFINITY);
    for axis in 0..3 {
        let a = (low[axis] - origin[axis]) * inverse[axis];
        let b = (high[axis] - origin[axis]) * inverse[axis];
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    near <= far * 1.000_000_5
}

fn corners(caster: &[u8]) -> [Vec3; 3] {
    [vec3_at(caster, 0), vec3_at(caster, 12), vec3_at(caster, 24)]
}

/// Moller and Trumbore, *Fast, minimum storage ray-triangle intersection*, 1997; any distance > 0.
fn hits_triangle(caster: &[u8], origin: Vec3, dir: Vec3) -> bool {
    let [v0, v1, v2] = corners(caster);
    let (e1, e2) = (sub(v1, v0), sub(v2, v0));
    let p = cross(dir, e2);
    let det = dot(e1, p);
    if det == 0.0 {
        return false;
    }
    let inverse = 1.0 / det;
    let s = sub(origin, v0);
    let u = dot(s, p) * inverse;
    let q = cross(s, e1);
    let v = dot(dir, q) * inverse;
    u >= 0.0 && v >= 0.0 && u + v <= 1.0 && dot(e2, q) * inverse > 0.0
}

/// Rays through the field's pixels.
#[derive(Clone, Copy, Debug)]
pub struct ViewRays {
    origin: Vec3,
    forward: Vec3,
    right: Vec3,
    down: Vec3,
    centre: [f32; 2],
}

impl ViewRays {
    /// For a camera file's values and a picture of `width` x `height` px (square pixels, row 0 on top).
    pub fn new(camera: &CameraRecord, width: usize, height: usize) -> Self {
        let forward = unit(sub(camera.target, camera.position));
        let right = unit(cross(forward, camera.up));
        let down = cross(forward, right);
        let half = 0.5 * camera.fov_y_deg.to_radians();
        let pixel = libm::sinf(half) / libm::cosf(half) / (0.5 * height as f32);
        ViewRays {
            origin: camera.position,
            forward,
            right: mul(right, pixel),
            down: mul(down, pixel),
            centre: [0.5 * width as f32, 0.5 * height as f32],
        }
    }

    /// Direction (not of unit length) through the picture position `x`, `y` in px.
    fn dir(&self, x: f32, y: f32) -> Vec3 {
        add(self.forward, add(mul(self.right, x - self.centre[0]), mul(self.down, y - self.centre[1])))
    }
}

/// Directions over the sun's disc for one position of the sun.
#[derive(Clone, Copy, Debug)]
pub struct SunDisc {
    points: [Vec3; 16],
}

impl SunDisc {
    /// 16 directions of equal solid angle over the 0.533 degree disc around `dir_world`.
    pub fn new(dir_world: Vec3) -> Self {
        let axis = unit(dir_world);
        let helper = if axis[1].abs() < 0.9 { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] };
        let right = unit(cross(helper, axis));
        let up = cross(axis, right);
        let radius = (0.5 * SUN_DIAMETER_DEG).to_radians();
        let mut points = [axis; 16];
        // Vogel's spiral: equal areas, no rows that could line up with an edge.
        for (k, point) in points.iter_mut().enumerate() {
            let r = radius * libm::sqrtf((k as f32 + 0.5) / 16.0);
            let (sin, cos) = libm::sincosf(k as f32 * 2.399_963_2);
            *point = unit(add(axis, add(mul(right, r * cos), mul(up, r * sin))));
        }
        SunDisc { points }
    }
}

/// What a pixel sees, ready for rays to the sun.
struct Point {
    origin: Vec3,
    normal: Vec3,
}

/// The surface point of a caster seen along `dir` from `eye`, and its shading normal, both towards the viewer.
fn surface_point(caster: &[u8], eye: Vec3, dir: Vec3) -> Point {
    let [v0, v1, v2] = corners(caster);
    let (e1, e2) = (sub(v1, v0), sub(v2, v0));
    let p = cross(dir, e2);
    let det = dot(e1, p);
    let inverse = if det != 0.0 { 1.0 / det } else { 0.0 };
    let s = sub(eye, v0);
    // A stratum's centre may just miss the caster that most of the stratum sees: hold it inside.
    let u = (dot(s, p) * inverse).clamp(0.0, 1.0);
    let v = (dot(dir, cross(s, e1)) * inverse).clamp(0.0, 1.0);
    let shrink = if u + v > 1.0 { 1.0 / (u + v) } else { 1.0 };
    let (u, v) = (u * shrink, v * shrink);
    let at = add(v0, add(mul(e1, u), mul(e2, v)));
    let corner = |k: usize| {
        let component = |c: usize| f32::from(u16_at(caster, 36 + 6 * k + 2 * c) as i16);
        [component(0), component(1), component(2)]
    };
    let normal = unit(add(mul(corner(0), 1.0 - u - v), add(mul(corner(1), u), mul(corner(2), v))));
    let normal = if dot(normal, dir) > 0.0 { mul(normal, -1.0) } else { normal };
    let geometric = unit(cross(e1, e2));
    let geometric = if dot(geometric, dir) > 0.0 { mul(geometric, -1.0) } else { geometric };
    let size = at.iter().chain(&sub(at, eye)).fold(0.0f32, |m, c| m.max(c.abs()));
    Point { origin: add(at, mul(geometric, size * OFFSET)), normal }
}

/// Ray origins stand off the surface by this share of the largest coordinate or distance: some rounding errors of f32.
const OFFSET: f32 = 3e-5;

/// How closely a pixel is looked at.
#[derive(Clone, Copy)]
struct Effort {
    /// Every how many strata one is used.
    stride: usize,
    /// Rays per stratum.
    rays: usize,
}

const GLANCE: Effort = Effort { stride: 4, rays: 1 };
const BORDER: Effort = Effort { stride: 1, rays: 1 };
const STUDY: Effort = Effort { stride: 1, rays: 8 };

/// Direct light of one pixel and whether all its rays agreed.
struct Lit {
    rgb: [f32; 3],
    state: State,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Outside,
    Dark,
    Bright,
    Mixed,
}

impl SunSurfaces<'_> {
    /// Direct response of one pixel: sum over fragments of albedo/pi times the mean of cosine times visibility.
    fn pixel(
        &self,
        fragments: &[u8],
        rays: &ViewRays,
        disc: &SunDisc,
        (px, py): (usize, usize),
        effort: Effort,
    ) -> Lit {
        let mut rgb = [0.0f32; 3];
        let (mut bright, mut dark) = (false, false);
        let turn = (px * 5 + py * 3) % 16;
        for fragment in fragments.chunks_exact(FRAGMENT) {
            let caster = &self.casters[u32_at(fragment, 0) as usize * CASTER..][..CASTER];
            let strata = u16_at(fragment, 4);
            let (mut sum, mut count) = (0.0f32, 0.0f32);
            let step = effort.stride.min(strata.count_ones().max(1) as usize);
            let seen_strata = (0..16).filter(|s| strata >> s & 1 != 0);
            for s in seen_strata.skip(turn % step).step_by(step) {
                let at = [(s % 4) as f32 * 0.25 + 0.125, (s / 4) as f32 * 0.25 + 0.125];
                let point = surface_point(caster, rays.origin, rays.dir(px as f32 + at[0], py as f32 + at[1]));
                for k in 0..effort.rays {
                    let light = disc.points[(turn + s * 3 + k * 16 / effort.rays) % 16];
                    let cosine = dot(point.normal, light);
                    let seen = if cosine > 0.0 { self.transmittance(point.origin, light) } else { 0.0 };
                    bright |= seen > 0.0;
                    dark |= seen < 1.0 && cosine > 0.0;
                    sum += seen * cosine.max(0.0);
                    count += 1.0;
                }
            }
            if count > 0.0 {
                let mean = sum / count * core::f32::consts::FRAC_1_PI;
                for (c, value) in rgb.iter_mut().enumerate() {
                    *value += f32::from(u16_at(fragment, 6 + 2 * c)) / 32768.0 * mean;
                }
            }
        }
        let state = match (bright, dark) {
            (true, true) => State::Mixed,
            (true, false) => State::Bright,
            _ => State::Dark,
        };
        Lit { rgb, state }
    }

    /// Direct response of a tile's covered pixels to a sun of irradiance 1, `[channel][pixel]`.
    ///
    /// Each pixel gets a glance of a few rays; those that see an edge of the shadow, or lie beside one, are looked at
    /// with rays from every stratum to every part of the disc.
    fn direct_tile(&self, field: &Field<'_>, tile: usize, rays: &ViewRays, disc: &SunDisc, out: &mut DirectTile) {
        let response = field.response();
        let (columns, _) = response.grid();
        let (x0, y0) = (tile % columns * TILE_PX, tile / columns * TILE_PX);
        let mask = response.tile(tile);
        let (counts, fragments) = self.fragments(tile, mask.pixels());
        let mut states = [State::Outside; TILE_PIXELS];
        for study in [false, true] {
            let mut at = 0;
            for (k, pixel) in mask.covered().enumerate() {
                let bytes = usize::from(counts[k]) * FRAGMENT;
                let own = &fragments[at..at + bytes];
                at += bytes;
                let (x, y) = (pixel % TILE_PX, pixel / TILE_PX);
                let border = x == 0 || y == 0 || x + 1 == TILE_PX || y + 1 == TILE_PX;
                let effort = match (study, border) {
                    (true, _) if on_edge(&states, x, y) => STUDY,
                    (true, _) => continue,
                    (false, true) => BORDER,
                    (false, false) => GLANCE,
                };
                let lit = self.pixel(own, rays, disc, (x0 + x, y0 + y), effort);
                for (plane, value) in out.0.iter_mut().zip(lit.rgb) {
                    plane[k] = value;
                }
                if !study {
                    states[pixel] = lit.state;
                }
            }
        }
    }
}

/// Is the pixel mixed, or does any neighbour in the tile differ from it?
fn on_edge(states: &[State; TILE_PIXELS], x: usize, y: usize) -> bool {
    let own = states[y * TILE_PX + x];
    let near = |v: usize| v.saturating_sub(1)..=(v + 1).min(TILE_PX - 1);
    own == State::Mixed
        || near(y).any(|ny| {
            near(x).any(|nx| {
                let other = states[ny * TILE_PX + nx];
                other != own && other != State::Outside
            })
        })
}

struct DirectTile([[f32; TILE_PIXELS]; 3]);

/// Makes the sun's response plane tile by tile for one direction of the sun.
#[derive(Clone, Debug)]
pub struct SunLight {
    disc: SunDisc,
    rays: ViewRays,
    indirect: FixedWeights,
}

impl SunLight {
    /// For a field and a unit direction towards the sun, above the horizon.
    pub fn new(field: &Field<'_>, dir_world: Vec3) -> Self {
        let mut light = SunLight::without(field);
        light.set(field, dir_world);
        light
    }

    /// For a field, before it has a direction ([`SunLight::set`]).
    pub fn without(field: &Field<'_>) -> Self {
        SunLight {
            disc: SunDisc { points: [[0.0; 3]; 16] },
            rays: ViewRays::new(field.camera(), field.width(), field.height()),
            indirect: FixedWeights::dark(field.patch_set().len()),
        }
    }

    /// Takes another direction, where it stands: small stacks hold no second one.
    pub fn set(&mut self, field: &Field<'_>, dir_world: Vec3) {
        let patches = field.patch_set();
        let mut kernel = [0.0f32; crate::patches::MAX_PATCHES];
        let kernel = &mut kernel[..patches.len()];
        crate::interpolate::sun_patch_weights(patches, dir_world, kernel);
        let mut grey = [[0.0f32; 3]; crate::patches::MAX_PATCHES];
        for (rgb, &weight) in grey.iter_mut().zip(kernel.iter()) {
            *rgb = [weight; 3];
        }
        // Weights remember their scale: begin anew, so that a direction looks the same whatever was before.
        self.indirect = FixedWeights::dark(patches.len());
        // The interpolation is finite and not negative, so it is never refused.
        let _ = self.indirect.set(&grey[..patches.len()], None, 1.0, &[]);
        self.disc = SunDisc::new(dir_world);
    }

    /// Writes one tile's slot (`[3][padded pixels]`, u16 in 1/32768) of the sun's response plane.
    pub fn tile(&self, field: &Field<'_>, tile: usize, kernel: Kernel, slot: &mut [u16]) {
        let own = field.sun_indirect().tile(tile);
        let n = padded(own.pixels());
        if n == 0 || slot.len() < 3 * n {
            return;
        }
        let mut linear = LinearTile::new();
        let mut coefficients = Coefficients::ZERO;
        coefficients.project(&own, &self.indirect, kernel, MAX_RANK);
        coefficients.reconstruct(&own, None, kernel, &mut linear);
        let mut direct = DirectTile([[0.0; TILE_PIXELS]; 3]);
        field.sun_surfaces().direct_tile(field, tile, &self.rays, &self.disc, &mut direct);
        for c in 0..3 {
            for (x, out) in slot[c * n..][..n].iter_mut().enumerate() {
                let indirect = linear.0[c][x].max(0.0);
                *out = libm::rintf((direct.0[c][x] + indirect) * 32768.0).min(65535.0) as u16;
            }
        }
    }
}
