//! Base-colour textures: sRGB in, linear out, bilinear, with glTF's wrap modes and texture transform.

use glam::{Vec2, Vec4};

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
    fn texel(self, index: i64, size: i64) -> usize {
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

/// An 8-bit sRGB picture with straight alpha, row 0 at v = 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    width: usize,
    height: usize,
    /// `[height][width]`.
    texels: Vec<[u8; 4]>,
    /// sRGB code -> linear.
    linear: Vec<f32>,
    /// Wrap modes along u and v.
    pub wrap: [Wrap; 2],
}

impl Texture {
    /// A texture of `width` x `height` sRGB texels with straight alpha, row-major; `None` when the sizes do not agree
    /// or one is zero.
    pub fn new(width: usize, height: usize, texels: Vec<[u8; 4]>, wrap: [Wrap; 2]) -> Option<Self> {
        if width == 0 || height == 0 || texels.len() != width.checked_mul(height)? {
            return None;
        }
        let linear = (0..=255u32).map(|code| srgb_to_linear(code as f32 / 255.0)).collect();
        Some(Texture { width, height, texels, linear, wrap })
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
        sum.update(format!("{}x{} {:?}", self.width, self.height, self.wrap).as_bytes());
        sum.update(self.texels.as_flattened());
    }

    /// Smallest and largest alpha of all texels, 0..1.
    pub fn alpha_range(&self) -> (f32, f32) {
        let codes = self.texels.iter().map(|t| t[3]);
        let (low, high) = codes.fold((255, 0), |(low, high), a: u8| (a.min(low), a.max(high)));
        (f32::from(low) / 255.0, f32::from(high) / 255.0)
    }

    /// Width and height in texels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    fn texel(&self, corner: Vec2, dx: i64, dy: i64) -> Vec4 {
        let x = self.wrap[0].texel((corner.x as i64).saturating_add(dx), self.width as i64);
        let y = self.wrap[1].texel((corner.y as i64).saturating_add(dy), self.height as i64);
        let [r, g, b, a] = self.texels[y * self.width + x];
        let linear = |code: u8| self.linear[usize::from(code)];
        Vec4::new(linear(r), linear(g), linear(b), f32::from(a) / 255.0)
    }
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
    fn transform_scales_turns_then_moves() {
        let turn =
            UvTransform { offset: Vec2::new(0.5, 0.0), rotation: std::f32::consts::FRAC_PI_2, scale: Vec2::splat(2.0) };
        // u = 1 scaled to 2; turned by 90 degrees it lies along -v (image rows run down).
        assert!((turn.apply(Vec2::X) - Vec2::new(0.5, -2.0)).length() < 1e-6);
    }
}
