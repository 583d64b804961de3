//! Materials of the demo's site and the small textures that vary them.

use glam::Vec3;

use super::noise::{fbm, hash, smoothstep};
use crate::material::{Alpha, Finish, Material};
use crate::texture::{Texture, Wrap};

/// Indices into the scene's materials.
pub(super) mod material {
    pub const STONE: u32 = 0;
    pub const ASHLAR: u32 = 1;
    pub const TILE: u32 = 2;
    pub const GROUND: u32 = 3;
    pub const ROCK: u32 = 4;
    pub const CYPRESS: u32 = 5;
    pub const SHRUB: u32 = 6;
    pub const BARK: u32 = 7;
}

/// Linear Rec.709 reflectances: weathered limestone lies near 0.55, dry grass near 0.25, cypress near 0.05.
const COLORS: [(&str, [f32; 3], Option<u32>); 8] = [
    ("limestone", [0.66, 0.58, 0.46], Some(0)),
    ("ashlar", [0.63, 0.55, 0.43], Some(1)),
    ("roof tile", [0.50, 0.30, 0.19], Some(0)),
    ("ground", [1.0, 1.0, 1.0], Some(2)),
    ("rock", [0.44, 0.41, 0.36], Some(0)),
    ("cypress", [0.050, 0.075, 0.035], None),
    ("shrub", [0.105, 0.125, 0.055], None),
    ("bark", [0.14, 0.10, 0.07], None),
];

/// The materials in the order of [`material`].
pub(super) fn materials() -> Vec<Material> {
    let opaque = |&(name, [r, g, b], texture): &(&str, [f32; 3], Option<u32>)| Material {
        name: name.to_owned(),
        base_color: [r, g, b, 1.0],
        texture,
        alpha: Alpha::Opaque,
        finish: Finish::default(),
    };
    COLORS.iter().map(opaque).collect()
}

/// The textures in the order that [`materials`] refers to.
pub(super) fn textures() -> Vec<Texture> {
    [tiled(512, weathered), tiled(512, ashlar), tiled(1024, ground)].into_iter().flatten().collect()
}

/// A square texture that tiles; `of(u, v)` gives linear colour for u and v in 0..1.
fn tiled(size: usize, of: impl Fn(f32, f32) -> Vec3) -> Option<Texture> {
    let at = |index: usize| (index as f32 + 0.5) / size as f32;
    let texel = |index: usize| {
        let [r, g, b] = of(at(index % size), at(index / size)).to_array().map(srgb_code);
        [r, g, b, 255]
    };
    Texture::new(size, size, (0..size * size).map(texel).collect(), [Wrap::Repeat; 2])
}

fn srgb_code(linear: f32) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let value = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (255.0 * value + 0.5) as u8
}

/// Limestone without joints: stains of a metre, grain of centimetres, faint streaks from rain. 8 m a repeat.
fn weathered(u: f32, v: f32) -> Vec3 {
    let stain = fbm(u * 6.0, v * 6.0, 4, 6, 11);
    let streak = fbm(u * 48.0, v * 6.0, 2, 6, 23);
    let grain = fbm(u * 96.0, v * 96.0, 2, 96, 37);
    let tone = (0.90 + 0.12 * stain + 0.07 * streak + 0.07 * grain).clamp(0.4, 1.0);
    let warm = 0.06 * fbm(u * 4.0, v * 4.0, 3, 4, 53);
    Vec3::new(tone * (1.0 + 0.4 * warm), tone, tone * (1.0 - warm))
}

/// Squared blocks in courses of half a metre, six to eight metres, joints a centimetre wide. 8 m a repeat.
fn ashlar(u: f32, v: f32) -> Vec3 {
    let course = (v * 16.0).floor();
    let along = u * 6.0 + 0.5 * (course % 2.0);
    let block = along.floor() % 6.0;
    let tone = 0.84 + 0.15 * hash(block as i64, course as i64, 5);
    let (across, up) = (along - along.floor(), v * 16.0 - course);
    let edge_m = (across.min(1.0 - across) * 8.0 / 6.0).min(up.min(1.0 - up) * 0.5);
    let joint = 0.55 + 0.45 * smoothstep(0.006, 0.026, edge_m);
    weathered(u, v) * tone * joint
}

/// Dry grass, bare earth and a little green. 32 m a repeat.
fn ground(u: f32, v: f32) -> Vec3 {
    let earth = Vec3::new(0.36, 0.275, 0.18);
    let straw = Vec3::new(0.34, 0.285, 0.135);
    let green = Vec3::new(0.16, 0.175, 0.065);
    let patches = fbm(u * 7.0, v * 7.0, 5, 7, 71);
    let growth = fbm(u * 5.0, v * 5.0, 5, 5, 97);
    let tufts = fbm(u * 110.0, v * 110.0, 3, 110, 113);
    let grass = straw.lerp(green, smoothstep(-0.05, 0.45, growth + 0.5 * tufts));
    let color = earth.lerp(grass, smoothstep(-0.25, 0.15, patches + 0.4 * tufts));
    color * (1.0 + 0.45 * tufts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_surface_reflects_more_than_stone_can() {
        let (materials, textures) = (materials(), textures());
        assert_eq!(textures.len(), 3);
        for material in &materials {
            let mut means = [0.0f32; 3];
            for index in 0..900 {
                let uv = glam::Vec2::new((index % 30) as f32 / 30.0, (index / 30) as f32 / 30.0);
                let texel = material.texture.map_or(glam::Vec4::ONE, |texture| textures[texture as usize].sample(uv));
                for channel in 0..3 {
                    let albedo = material.base_color[channel] * texel[channel];
                    assert!(albedo <= 0.9, "{} {albedo}", material.name);
                    means[channel] += albedo / 900.0;
                }
            }
            let stone = material.name == "limestone";
            assert!(!stone || (means[1] > 0.42 && means[0] < 0.68), "{means:?}");
        }
    }
}
