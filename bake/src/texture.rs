//! Textures: codes in, linear out, bilinear, with glTF's wrap modes, texture transform and mipmaps.

use glam::{Vec2, Vec4};

use crate::mipmap::{around, halved, levels_at, under};

/// What happens outside 0..1 along one axis of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Wrap {
    /// The picture is repeated.
    #[default]
    Repeat,
    /// The picture is repeated, every other copy mirrored.
    Mirror,
    /// The edge goes on.
    Clamp,
}

impl Wrap {
    pub(crate) fn texel(self, index: i64, size: i64) -> usize {
        let wrapped = match self {
            Wrap::Repeat => index.rem_euclid(size),
            Wrap::Clamp => index.clamp(0, size - 1),
            Wrap::Mirror => {
                let folded = index.rem_euclid(2 * size);
                if folded < size { folded } else { 2 * size - 1 - folded }
            }
        };
        wrapped as usize
    }
}

/// The affine map from a mesh's coordinates to the texture's (`KHR_texture_transform`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UvTransform {
    /// Added last.
    pub offset: Vec2,
    /// Counter-clockwise, radians.
    pub rotation: f32,
    /// Applied first.
    pub scale: Vec2,
}

impl Default for UvTransform {
    fn default() -> Self {
        UvTransform { offset: Vec2::ZERO, rotation: 0.0, scale: Vec2::ONE }
    }
}

impl UvTransform {
    /// The texture's coordinates for a mesh's.
    pub fn apply(&self, uv: Vec2) -> Vec2 {
        let scaled = uv * self.scale;
        let (sin, cos) = self.rotation.sin_cos();
        // The extension's specification: translation * rotation * scale, rotation [c s; -s c] in its (u, v).
        Vec2::new(cos * scaled.x + sin * scaled.y, cos * scaled.y - sin * scaled.x) + self.offset
    }
}

/// What a texture's codes stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Encoding {
    /// Colours by the sRGB curve.
    Srgb,
    /// Plain values.
    Linear,
}

/// An 8-bit picture with straight alpha, row 0 at v = 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    width: usize,
    height: usize,
    /// `[height][width]`.
    texels: Vec<[u8; 4]>,
    /// Code -> linear.
    linear: Vec<f32>,
    encoding: Encoding,
    /// Width, height and texels of the coarser levels, if there are any.
    coarser: Vec<Level>,
    /// Wrap modes along u and v.
    pub wrap: [Wrap; 2],
}

impl Texture {
    /// A texture of `width` x `height` sRGB texels with straight alpha, row-major; `None` when the sizes do not agree
    /// or one is zero.
    pub fn new(width: usize, height: usize, texels: Vec<[u8; 4]>, wrap: [Wrap; 2]) -> Option<Self> {
        Self::encoded(width, height, texels, wrap, Encoding::Srgb)
    }

    /// The same for texels of any encoding.
    pub fn encoded(
        width: usize,
        height: usize,
        texels: Vec<[u8; 4]>,
        wrap: [Wrap; 2],
        encoding: Encoding,
    ) -> Option<Self> {
        if width == 0 || height == 0 || texels.len() != width.checked_mul(height)? {
            return None;
        }
        let value = |code: u32| match encoding {
            Encoding::Srgb => srgb_to_linear(code as f32 / 255.0),
            Encoding::Linear => code as f32 / 255.0,
        };
        let linear = (0..=255u32).map(value).collect();
        Some(Texture { width, height, texels, linear, encoding, coarser: Vec::new(), wrap })
    }

    /// Adds the coarser levels, which [`Texture::sample_level`] then uses.
    pub fn make_mipmaps(&mut self) {
        let mut finer = Level { size: (self.width, self.height), texels: Vec::new() };
        self.coarser.clear();
        while let Some(size) = halved(finer.size) {
            let texels = if self.coarser.is_empty() { &self.texels } else { &finer.texels };
            let mean = |texel| self.mean(texels, finer.size, size, (texel % size.0, texel / size.0));
            let level = Level { size, texels: (0..size.0 * size.1).map(mean).collect() };
            self.coarser.push(level.clone());
            finer = level;
        }
    }

    /// The mean of the texels of a level of size `from` under texel `at` of one of size `to`; colours count by their alpha, what
    /// cannot be seen has none.
    fn mean(&self, texels: &[[u8; 4]], from: (usize, usize), to: (usize, usize), at: (usize, usize)) -> [u8; 4] {
        let (mut plain, mut seen) = (Vec4::ZERO, Vec4::ZERO);
        under(from, to, at, |texel, share| {
            let value = self.decoded(texels[texel]);
            plain += value * share;
            seen += value * (share * value.w);
        });
        let color = if self.encoding == Encoding::Srgb && plain.w > 0.0 { seen / plain.w } else { plain };
        let code = |value: f32| match self.encoding {
            Encoding::Srgb => (linear_to_srgb(value) * 255.0).round() as u8,
            Encoding::Linear => (value * 255.0).round() as u8,
        };
        [code(color.x), code(color.y), code(color.z), (plain.w * 255.0).round() as u8]
    }

    /// The linear colour and alpha at `uv` on the level `lod` (0 the finest, 1 half its size), linear between levels.
    pub fn sample_level(&self, uv: Vec2, lod: f32) -> Vec4 {
        let (low, high, part) = levels_at(lod, 1 + self.coarser.len());
        let fine = self.on_level(low, uv);
        if part > 0.0 { fine.lerp(self.on_level(high, uv), part) } else { fine }
    }

    fn on_level(&self, level: usize, uv: Vec2) -> Vec4 {
        let Some(coarse) = level.checked_sub(1).and_then(|k| self.coarser.get(k)) else { return self.sample(uv) };
        let of = |(texel, weight): (usize, f32)| self.decoded(coarse.texels[texel]) * weight;
        around(coarse.size, self.wrap, uv).map_or(Vec4::ONE, |texels| texels.into_iter().map(of).sum())
    }

    fn decoded(&self, [r, g, b, a]: [u8; 4]) -> Vec4 {
        let linear = |code: u8| self.linear[usize::from(code)];
        Vec4::new(linear(r), linear(g), linear(b), f32::from(a) / 255.0)
    }

    /// The linear colour and alpha at `uv`, bilinear between texel centres.
    pub fn sample(&self, uv: Vec2) -> Vec4 {
        let at = uv * Vec2::new(self.width as f32, self.height as f32) - 0.5;
        if !at.is_finite() {
            return Vec4::ONE;
        }
        let corner = at.floor();
        let part = at - corner;
        let row = |dy: i64| {
            let (a, b) = (self.texel(corner, 0, dy), self.texel(corner, 1, dy));
            a + (b - a) * part.x
        };
        let (top, bottom) = (row(0), row(1));
        top + (bottom - top) * part.y
    }

    /// Takes all of it into a checksum.
    pub(crate) fn checksum(&self, sum: &mut crc32fast::Hasher) {
        sum.update(format!("{}x{} {:?} {:?}", self.width, self.height, self.wrap, self.encoding).as_bytes());
        sum.update(self.texels.as_flattened());
    }

    /// Smallest and largest alpha of all texels, 0..1.
    pub fn alpha_range(&self) -> (f32, f32) {
        let codes = self.texels.iter().map(|t| t[3]);
        let (low, high) = codes.fold((255, 0), |(low, high), a: u8| (a.min(low), a.max(high)));
        (f32::from(low) / 255.0, f32::from(high) / 255.0)
    }

    /// `[height][width]`, as encoded, straight alpha.
    pub fn texels(&self) -> &[[u8; 4]] {
        &self.texels
    }

    /// Width and height in texels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    fn texel(&self, corner: Vec2, dx: i64, dy: i64) -> Vec4 {
        let x = self.wrap[0].texel((corner.x as i64).saturating_add(dx), self.width as i64);
        let y = self.wrap[1].texel((corner.y as i64).saturating_add(dy), self.height as i64);
        self.decoded(self.texels[y * self.width + x])
    }
}

/// A coarser level.
#[derive(Clone, Debug, PartialEq)]
struct Level {
    size: (usize, usize),
    /// `[height][width]`.
    texels: Vec<[u8; 4]>,
}

fn linear_to_srgb(value: f32) -> f32 {
    let value = value.clamp(0.0, 1.0);
    if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

/// The linear value of an sRGB value, both 0..1 (IEC 61966-2-1).
pub fn srgb_to_linear(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checker(wrap: Wrap) -> Texture {
        let texels = vec![[255, 255, 255, 255], [0, 0, 0, 0], [188, 0, 0, 255], [0, 188, 0, 255]];
        Texture::new(2, 2, texels, [wrap; 2]).unwrap()
    }

    #[test]
    fn centres_are_exact_and_between_is_linear() {
        let texture = checker(Wrap::Repeat);
        assert_eq!(texture.sample(Vec2::new(0.25, 0.25)), Vec4::ONE);
        // 188 / 255 is linear 0.5029.
        assert!((texture.sample(Vec2::new(0.25, 0.75)).x - 0.5029).abs() < 1e-4);
        let middle = texture.sample(Vec2::new(0.5, 0.25));
        assert!((middle - Vec4::splat(0.5)).abs().max_element() < 1e-6);
    }

    #[test]
    fn wrap_modes_differ_outside() {
        let at = Vec2::new(1.25, 0.25);
        assert_eq!(checker(Wrap::Repeat).sample(at).w, 1.0);
        assert_eq!(checker(Wrap::Mirror).sample(at).w, 0.0);
        assert_eq!(checker(Wrap::Clamp).sample(at).w, 0.0);
        assert_eq!(checker(Wrap::Clamp).sample(Vec2::new(-5.0, 0.25)).w, 1.0);
        assert!(checker(Wrap::Repeat).sample(Vec2::splat(f32::NAN)).is_finite());
        assert!(checker(Wrap::Mirror).sample(Vec2::splat(-3e30)).is_finite());
    }

    #[test]
    fn mipmaps_average_light_and_leave_out_what_cannot_be_seen() {
        let mut texture = checker(Wrap::Repeat);
        texture.make_mipmaps();
        let white = (1.0 + 0.502_886_5) / 3.0;
        let far = texture.sample_level(Vec2::new(0.3, 0.6), 7.0);
        // White, red and green of equal alpha; the fourth texel is not there.
        assert!((far - Vec4::new(white, white, 1.0 / 3.0, 0.75)).abs().max_element() < 3e-3, "{far}");
        let between = texture.sample_level(Vec2::splat(0.25), 0.5);
        assert!((between - (Vec4::ONE + far) * 0.5).abs().max_element() < 1e-5, "{between}");
        assert_eq!(texture.sample_level(Vec2::splat(0.25), -3.0), Vec4::ONE);
    }

    #[test]
    fn plain_values_are_not_bent() {
        let texture = Texture::encoded(1, 1, vec![[0, 128, 51, 255]], [Wrap::Clamp; 2], Encoding::Linear).unwrap();
        assert!((texture.sample(Vec2::ZERO) - Vec4::new(0.0, 128.0 / 255.0, 0.2, 1.0)).abs().max_element() < 1e-6);
    }

    #[test]
    fn transform_scales_turns_then_moves() {
        let turn =
            UvTransform { offset: Vec2::new(0.5, 0.0), rotation: std::f32::consts::FRAC_PI_2, scale: Vec2::splat(2.0) };
        // u = 1 scaled to 2; turned by 90 degrees it lies along -v (image rows run down).
        assert!((turn.apply(Vec2::X) - Vec2::new(0.5, -2.0)).length() < 1e-6);
    }
}
