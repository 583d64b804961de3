//! Direct sunlight of one pixel: the points at which it looks at the scene, and the sun's disc seen from each.

use crate::casters::{Beam, Caster, Casters, Passage, Suspects};
use crate::field::CameraRecord;
use crate::gloss::{GLOSS, Gloss, reflecting_normal};
use crate::header::{u16_at, u32_at};
use crate::lens::Lens;
use crate::pixelpoints::{PIXEL_POINTS, pixel_point};
use crate::sunlight::FRAGMENT;
use crate::vector::{Vec3, add, cross, dot, length, mul, sub, unit};

/// Angular diameter of the sun's disc, degrees.
pub const SUN_DIAMETER_DEG: f32 = 0.533;

/// Rays through the field's pixels.
#[derive(Clone, Copy, Debug)]
pub struct ViewRays {
    origin: Vec3,
    forward: Vec3,
    right: Vec3,
    down: Vec3,
    centre: [f32; 2],
    lens: Option<Lens>,
}

/// Rays through one pixel.
struct PixelRays {
    /// Direction at `centre`, px; not of unit length.
    dir: Vec3,
    across: Vec3,
    down: Vec3,
    centre: [f32; 2],
}

impl PixelRays {
    /// Direction (not of unit length) through the picture position `x`, `y` in px.
    fn dir(&self, x: f32, y: f32) -> Vec3 {
        add(self.dir, add(mul(self.across, x - self.centre[0]), mul(self.down, y - self.centre[1])))
    }
}

impl ViewRays {
    /// For a camera file's values and a picture of `width` x `height` px (square pixels, row 0 on top).
    pub fn new(camera: &CameraRecord, width: usize, height: usize) -> Self {
        let forward = unit(sub(camera.target, camera.position));
        let right = unit(cross(forward, camera.up));
        let down = cross(forward, right);
        let half = 0.5 * camera.fov_y_deg.to_radians();
        let pinhole = libm::sinf(half) / libm::cosf(half) / (0.5 * height as f32);
        let pixel = if camera.lens.is_some() { 1.0 } else { pinhole };
        ViewRays {
            origin: camera.position,
            forward,
            right: mul(right, pixel),
            down: mul(down, pixel),
            centre: [0.5 * width as f32, 0.5 * height as f32],
            lens: camera.lens,
        }
    }

    /// Within a pixel the lens is taken as linear: what that leaves out is its bend over half a pixel.
    fn pixel(&self, (px, py): (usize, usize)) -> PixelRays {
        let Some(lens) = &self.lens else {
            return PixelRays { dir: self.forward, across: self.right, down: self.down, centre: self.centre };
        };
        let centre = [px as f32 + 0.5, py as f32 + 0.5];
        let ray = lens.ray(centre.map(f64::from));
        let to_world = |[x, y, z]: [f64; 3]| {
            add(mul(self.forward, z as f32), add(mul(self.right, x as f32), mul(self.down, y as f32)))
        };
        let [dir, across, down] = [ray.dir_camera, ray.across, ray.down].map(to_world);
        PixelRays { dir, across, down, centre }
    }
}

/// Directions over the disc in all; each point of a pixel uses a share of its own.
const DISC: usize = SHARE * PIXEL_POINTS;
/// Directions that one point uses: a set that is even over the disc by itself.
const SHARE: usize = 16;

/// Directions over the sun's disc for one position of the sun.
#[derive(Clone, Copy, Debug)]
pub struct SunDisc {
    points: [Vec3; DISC],
    axis: Vec3,
    /// Tangent of the angular radius, with a margin for rounding.
    slope: f32,
}

impl SunDisc {
    /// Directions of equal solid angle over the 0.533 degree disc around `dir_world`.
    pub fn new(dir_world: Vec3) -> Self {
        // The second coordinate of Sobol's sequence; the first is the index with its bits turned round.
        const SOBOL: [u32; 8] = [128, 192, 160, 240, 136, 204, 170, 255];
        let axis = unit(dir_world);
        let helper = if axis[1].abs() < 0.9 { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] };
        let right = unit(cross(helper, axis));
        let up = cross(axis, right);
        let radius = (0.5 * SUN_DIAMETER_DEG).to_radians();
        let mut points = [axis; DISC];
        for (k, point) in points.iter_mut().enumerate() {
            let across = (k as u32).reverse_bits() >> 24;
            let down = (0..8).filter(|bit| k >> bit & 1 != 0).fold(0, |sum, bit| sum ^ SOBOL[bit]);
            let r = radius * libm::sqrtf((across as f32 + 0.5) / DISC as f32);
            let (sin, cos) = libm::sincosf((down as f32 + 0.5) / DISC as f32 * core::f32::consts::TAU);
            *point = unit(add(axis, add(mul(right, r * cos), mul(up, r * sin))));
        }
        SunDisc { points, axis, slope: 1.01 * radius }
    }

    /// One direction of the disc; neighbouring numbers give unlike ones.
    pub(crate) fn direction(&self, k: usize) -> Vec3 {
        self.points[k % DISC]
    }

    fn share(&self, s: usize) -> &[Vec3] {
        &self.points[s % PIXEL_POINTS * SHARE..][..SHARE]
    }
}

/// Ray origins stand off the surface by these shares of the largest coordinate and of the scene's diagonal, as in the
/// bake.
const LIFT_COORDINATE: f32 = 1e-5;
const LIFT_SCENE: f32 = 1e-6;

/// The points of one fragment of a pixel.
struct Facet {
    /// Lifted off the surface.
    points: [Vec3; PIXEL_POINTS],
    /// Shading normals, towards the viewer.
    normals: [Vec3; PIXEL_POINTS],
    /// The point's stratum.
    strata: [u8; PIXEL_POINTS],
    count: usize,
    /// Unit normal of the plane, towards the viewer.
    plane: Vec3,
    is_flat: bool,
}

impl Facet {
    fn new(caster: &Caster<'_>, strata: u16, rays: &ViewRays, (px, py): (usize, usize), lift_scene: f32) -> Self {
        let corners = caster.corners();
        let [v0, v1, v2] = corners;
        let across = cross(sub(v1, v0), sub(v2, v0));
        let height = dot(across, sub(v0, rays.origin));
        let towards = if height > 0.0 { -1.0 } else { 1.0 };
        let plane = mul(unit(across), towards);
        let is_flat = caster.is_flat();
        let corner_normals = caster.corner_normals();
        let towards_viewer = |normal: Vec3| if dot(normal, plane) < 0.0 { mul(normal, -1.0) } else { normal };
        let flat = towards_viewer(unit(corner_normals[0]));
        let none = [[0.0; 3]; PIXEL_POINTS];
        let through = rays.pixel((px, py));
        let mut facet = Facet { points: none, normals: none, strata: [0; PIXEL_POINTS], count: 0, plane, is_flat };
        for s in (0..PIXEL_POINTS).filter(|s| strata >> s & 1 != 0) {
            let [x, y] = pixel_point(s);
            let dir = through.dir(px as f32 + x, py as f32 + y);
            let facing = dot(across, dir);
            if facing == 0.0 {
                continue;
            }
            let at = add(rays.origin, mul(dir, height / facing));
            let lift = at.iter().fold(0.0f32, |m, c| m.max(c.abs())) * LIFT_COORDINATE + lift_scene;
            let k = facet.count;
            facet.points[k] = add(at, mul(plane, lift));
            facet.normals[k] =
                if is_flat { flat } else { towards_viewer(normal_at(at, &corners, &corner_normals, across)) };
            facet.strata[k] = s as u8;
            facet.count += 1;
        }
        facet
    }

    fn points(&self) -> &[Vec3] {
        &self.points[..self.count]
    }

    fn beam<'b>(&'b self, disc: &SunDisc) -> Beam<'b> {
        let points = self.points();
        let sum = points.iter().fold([0.0; 3], |sum, &point| add(sum, point));
        let origin = mul(sum, 1.0 / points.len().max(1) as f32);
        let radius = points.iter().fold(0.0f32, |m, &point| m.max(length(sub(point, origin))));
        Beam { points, origin, radius, dir: disc.axis, slope: disc.slope }
    }

    /// Mean over the points of cosine times visible share of the disc.
    fn lit(&self, casters: &Casters<'_>, disc: &SunDisc, suspects: &mut Suspects) -> f32 {
        // The disc's radius as a sine is a little below the slope.
        let height = dot(self.plane, disc.axis);
        if self.count == 0 || height <= -disc.slope {
            return 0.0;
        }
        let passage = casters.beam(&self.beam(disc), suspects);
        let cosine = dot(self.normals[0], disc.axis);
        match passage {
            Passage::Blocked => return 0.0,
            Passage::Free if self.is_flat && height > disc.slope && cosine > disc.slope => return cosine,
            _ => {}
        }
        let mut sum = 0.0;
        for k in 0..self.count {
            for &light in disc.share(usize::from(self.strata[k])) {
                let cosine = dot(self.normals[k], light);
                if cosine > 0.0 && dot(self.plane, light) > 0.0 {
                    let parted = passage == Passage::Parted;
                    sum +=
                        cosine * if parted { casters.transmittance_past(suspects, self.points[k], light) } else { 1.0 };
                }
            }
        }
        sum / (self.count * SHARE) as f32
    }
}

/// Lobes of this alpha and wider change little over the disc: half vectors turn by less than a twentieth of their width.
const EVEN: f32 = 0.05;
/// From this many of the disc's radii above the horizon of a surface on, the cosine changes little over the disc.
const STEEP: f32 = 4.0;
/// Where directions to the eye differ by less than this share of a lobe's width, they are one.
const ONE_VIEW: f32 = 0.02;

/// What one point of a glossy fragment sends to the eye.
#[derive(Clone, Copy)]
struct Gleam<'g> {
    gloss: &'g Gloss,
    /// To the eye, unit.
    view: Vec3,
    /// Shading normal of the diffuse base.
    normal: Vec3,
    /// Normal of the microfacets.
    facing: Vec3,
}

impl Gleam<'_> {
    fn is_lit(&self, light: Vec3) -> bool {
        dot(self.normal, light) > 0.0 || dot(self.facing, light) > 0.0
    }

    /// Cosine times the share that the diffuse base gets, and the reflection times cosine, of light from `light`.
    fn of(&self, light: Vec3) -> (f32, Vec3) {
        let reflected = self.gloss.lobe.reflected(self.facing, self.view, light);
        let cosine = |normal: Vec3| dot(normal, light).max(0.0);
        (reflected.base * cosine(self.normal), mul(reflected.specular, cosine(self.facing)))
    }
}

impl Facet {
    fn gleam<'g>(&self, k: usize, gloss: &'g Gloss, eye: Vec3) -> Gleam<'g> {
        let smooth = self.normals[k];
        let normal = if gloss.bend == [0.0; 3] { smooth } else { unit(add(smooth, gloss.bend)) };
        let view = unit(sub(eye, self.points[k]));
        Gleam { gloss, view, normal, facing: reflecting_normal(view, self.plane, normal) }
    }

    /// Means over the points of [`Gleam::of`] times the visible share of the disc.
    fn lit_glossy(
        &self,
        casters: &Casters<'_>,
        disc: &SunDisc,
        suspects: &mut Suspects,
        (gloss, eye): (&Gloss, Vec3),
    ) -> (f32, Vec3) {
        let (mut base, mut specular) = (0.0, [0.0; 3]);
        let height = dot(self.plane, disc.axis);
        if self.count == 0 || height <= -disc.slope {
            return (base, specular);
        }
        let passage = casters.beam(&self.beam(disc), suspects);
        if passage == Passage::Blocked {
            return (base, specular);
        }
        let even = gloss.lobe.alpha >= EVEN
            && height > STEEP * disc.slope
            && (passage == Passage::Free || dot(self.normals[0], disc.axis) > STEEP * disc.slope);
        if even {
            return self.lit_evenly(casters, disc, suspects, (gloss, eye), passage == Passage::Parted);
        }
        let mut take = |gleam: &Gleam<'_>, light: Vec3, share: f32| {
            let (through, off) = gleam.of(light);
            base += through * share;
            specular = add(specular, mul(off, share));
        };
        for k in 0..self.count {
            let gleam = self.gleam(k, gloss, eye);
            let above = |light: &&Vec3| dot(self.plane, **light) > 0.0 && gleam.is_lit(**light);
            for &light in disc.share(usize::from(self.strata[k])).iter().filter(above) {
                let parted = passage == Passage::Parted;
                let seen = if parted { casters.transmittance_past(suspects, self.points[k], light) } else { 1.0 };
                take(&gleam, light, seen);
            }
        }
        let all = 1.0 / (self.count * SHARE) as f32;
        (base * all, mul(specular, all))
    }

    /// The same where neither lobe nor cosine changes over the disc: what is reflected of the disc's middle times what is seen of
    /// the disc. A flat facet that is small from where the eye is has one reflection for all of its points.
    fn lit_evenly(
        &self,
        casters: &Casters<'_>,
        disc: &SunDisc,
        suspects: &mut Suspects,
        (gloss, eye): (&Gloss, Vec3),
        parted: bool,
    ) -> (f32, Vec3) {
        let seen = |suspects: &mut Suspects, k: usize| {
            if !parted {
                return 1.0;
            }
            let lights = disc.share(usize::from(self.strata[k])).iter();
            let mean = 1.0 / SHARE as f32;
            lights.map(|&light| casters.transmittance_past(suspects, self.points[k], light) * mean).sum::<f32>()
        };
        let across = length(sub(self.points[0], self.points[self.count - 1]));
        let is_one = self.is_flat && across < ONE_VIEW * gloss.lobe.alpha * length(sub(eye, self.points[0]));
        let mean = 1.0 / self.count as f32;
        if is_one {
            let visible = (0..self.count).map(|k| seen(suspects, k)).sum::<f32>() * mean;
            let (base, specular) =
                if visible > 0.0 { self.gleam(0, gloss, eye).of(disc.axis) } else { (0.0, [0.0; 3]) };
            return (base * visible, mul(specular, visible));
        }
        let (mut base, mut specular) = (0.0, [0.0; 3]);
        for k in 0..self.count {
            let visible = seen(suspects, k) * mean;
            if visible > 0.0 {
                let (through, off) = self.gleam(k, gloss, eye).of(disc.axis);
                base += through * visible;
                specular = add(specular, mul(off, visible));
            }
        }
        (base, specular)
    }
}

/// The shading normal where `at` lies in a triangle with the normal `across` (its length twice the area).
fn normal_at(at: Vec3, [v0, v1, v2]: &[Vec3; 3], normals: &[Vec3; 3], across: Vec3) -> Vec3 {
    let area2 = dot(across, across);
    let share = |from: Vec3, to: Vec3| dot(across, cross(sub(to, from), sub(at, from))) / area2;
    let (u, v) = (share(*v2, *v0).clamp(0.0, 1.0), share(*v0, *v1).clamp(0.0, 1.0));
    unit(add(mul(normals[0], 1.0 - u - v), add(mul(normals[1], u), mul(normals[2], v))))
}

/// What a fragment's record says: the surface where the pixel sees it.
fn facet_of(casters: &Casters<'_>, fragment: &[u8], rays: &ViewRays, pixel: (usize, usize)) -> Facet {
    let caster = casters.get(u32_at(fragment, 0));
    Facet::new(&caster, strata_of(fragment), rays, pixel, casters.diagonal() * LIFT_SCENE)
}

fn strata_of(fragment: &[u8]) -> u16 {
    u16_at(fragment, 4)
}

/// Albedo times share of the pixel.
fn albedo_of(fragment: &[u8]) -> Vec3 {
    core::array::from_fn(|c| f32::from(u16_at(fragment, 6 + 2 * c)) / 32768.0)
}

/// Direct response of one pixel: sum over its fragments of albedo/pi times the mean of cosine times visibility.
pub(crate) fn direct_pixel(
    casters: &Casters<'_>,
    fragments: &[u8],
    rays: &ViewRays,
    disc: &SunDisc,
    pixel: (usize, usize),
) -> Vec3 {
    let mut rgb = [0.0f32; 3];
    let mut suspects = Suspects::NONE;
    for fragment in fragments.chunks_exact(FRAGMENT) {
        let mean = facet_of(casters, fragment, rays, pixel).lit(casters, disc, &mut suspects);
        rgb = add(rgb, mul(albedo_of(fragment), mean * core::f32::consts::FRAC_1_PI));
    }
    rgb
}

/// [`direct_pixel`] for fragments that gleam: each with its record of GLSS.
pub(crate) fn glossy_pixel(
    casters: &Casters<'_>,
    (fragments, lobes): (&[u8], &[u8]),
    rays: &ViewRays,
    disc: &SunDisc,
    pixel: (usize, usize),
) -> Vec3 {
    let mut rgb = [0.0f32; 3];
    let mut suspects = Suspects::NONE;
    for (fragment, record) in fragments.chunks_exact(FRAGMENT).zip(lobes.chunks_exact(GLOSS)) {
        let facet = facet_of(casters, fragment, rays, pixel);
        let gloss = Gloss::decode(record);
        let (base, specular) = facet.lit_glossy(casters, disc, &mut suspects, (&gloss, rays.origin));
        let share = strata_of(fragment).count_ones() as f32 / PIXEL_POINTS as f32;
        rgb = add(rgb, add(mul(albedo_of(fragment), base * core::f32::consts::FRAC_1_PI), mul(specular, share)));
    }
    rgb
}
