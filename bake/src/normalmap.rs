//! Normal maps: tangent-space normals with mipmaps whose shortened vectors tell how rough a surface looks from afar.

use glam::{Vec2, Vec3};

use crate::mipmap::{around, halved, levels_at, under};
use crate::texture::Wrap;

/// A picture of tangent-space normals, row 0 at v = 0.
#[derive(Clone, Debug, PartialEq)]
pub struct NormalMap {
    /// The finest first.
    levels: Vec<Level>,
    wrap: [Wrap; 2],
}

#[derive(Clone, Debug, PartialEq)]
struct Level {
    size: (usize, usize),
    /// `[height][width]`, in 1/32767; the mean of unit vectors, which is shorter the more they differ.
    normals: Vec<[i16; 3]>,
}

/// What a normal map says about a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MappedNormal {
    /// Unit, in tangent space: x along the tangent, y along the bitangent, z along the normal.
    pub normal: Vec3,
    /// What the normals that are averaged here add to the square of alpha.
    pub alpha2: f32,
}

impl NormalMap {
    /// Of 8-bit texels: a code c stands for 2 c / 255 - 1 (glTF 2.0, 3.9.3). `None` when the sizes do not agree or one is 0.
    pub fn new(width: usize, height: usize, texels: &[[u8; 4]], wrap: [Wrap; 2]) -> Option<Self> {
        if width == 0 || height == 0 || texels.len() != width.checked_mul(height)? {
            return None;
        }
        let unit = |[x, y, z, _]: &[u8; 4]| {
            let vector = Vec3::new(f32::from(*x), f32::from(*y), f32::from(*z)) * (2.0 / 255.0) - 1.0;
            // Half a code from the middle is as near to straight up as 8 bits get.
            let straight = vector.x.abs() < 0.005 && vector.y.abs() < 0.005;
            if straight { Vec3::Z } else { vector.normalize_or(Vec3::Z) }
        };
        let size = (width, height);
        let mut levels = vec![Level { size, normals: texels.iter().map(|texel| coded(unit(texel))).collect() }];
        while let Some(level) = levels.last().and_then(Level::next) {
            levels.push(level);
        }
        Some(NormalMap { levels, wrap })
    }

    /// The normal at `uv` on the level `lod`, its x and y times `scale`.
    pub fn sample(&self, uv: Vec2, lod: f32, scale: f32) -> MappedNormal {
        let (low, high, part) = levels_at(lod, self.levels.len());
        let mean = self.levels[low].at(self.wrap, uv).lerp(self.levels[high].at(self.wrap, uv), part);
        let length = mean.length();
        let stretch = Vec3::new(scale, scale, 1.0);
        let normal = (mean * stretch).normalize_or(Vec3::Z);
        // Toksvig's measure: slopes of variance s in x and in y shorten the mean to about 1 - s, and a facet distribution of
        // alpha^2 has the variance alpha^2 / 2. On the finest level the vectors in between are a surface that bends.
        let spread = 2.0 * scale * scale * (1.0 / length.max(1e-3) - 1.0).max(0.0);
        MappedNormal { normal, alpha2: spread * lod.clamp(0.0, 1.0) }
    }

    /// Width and height in texels.
    pub fn size(&self) -> (usize, usize) {
        self.levels[0].size
    }

    /// Takes all of it into a checksum.
    pub(crate) fn checksum(&self, sum: &mut crc32fast::Hasher) {
        sum.update(format!("{:?} {:?}", self.size(), self.wrap).as_bytes());
        self.levels[0].normals.iter().flatten().for_each(|value| sum.update(&value.to_le_bytes()));
    }
}

impl Level {
    fn at(&self, wrap: [Wrap; 2], uv: Vec2) -> Vec3 {
        let of = |(texel, weight): (usize, f32)| decoded(self.normals[texel]) * weight;
        around(self.size, wrap, uv).map_or(Vec3::Z, |texels| texels.into_iter().map(of).sum())
    }

    fn next(&self) -> Option<Level> {
        let size = halved(self.size)?;
        let mean = |texel: usize| {
            let mut sum = Vec3::ZERO;
            let at = (texel % size.0, texel / size.0);
            under(self.size, size, at, |texel, share| sum += decoded(self.normals[texel]) * share);
            coded(sum)
        };
        Some(Level { size, normals: (0..size.0 * size.1).map(mean).collect() })
    }
}

fn coded(vector: Vec3) -> [i16; 3] {
    vector.to_array().map(|value| (value.clamp(-1.0, 1.0) * 32767.0).round() as i16)
}

fn decoded(code: [i16; 3]) -> Vec3 {
    Vec3::from(code.map(f32::from)) / 32767.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn code(normal: Vec3) -> [u8; 4] {
        let [x, y, z] = ((normal + 1.0) * 127.5).to_array().map(|v| v.round() as u8);
        [x, y, z, 255]
    }

    #[test]
    fn normals_are_unit_and_scaled() {
        let tilted = Vec3::new(0.6, 0.0, 0.8);
        let map = NormalMap::new(2, 2, &[code(tilted); 4], [Wrap::Repeat; 2]).unwrap();
        let found = map.sample(Vec2::new(0.3, 0.9), 0.0, 1.0);
        assert!((found.normal - tilted).length() < 0.01 && found.alpha2 == 0.0, "{found:?}");
        let steep = map.sample(Vec2::ZERO, 5.0, 0.5).normal;
        assert!((steep.x / steep.z - 0.375).abs() < 0.01, "{steep}");
        let level = NormalMap::new(1, 1, &[[128, 127, 255, 0]], [Wrap::Repeat; 2]).unwrap();
        assert_eq!(level.sample(Vec2::ZERO, 0.0, 1.0).normal, Vec3::Z);
    }

    #[test]
    fn opposite_slopes_are_level_and_rough_from_afar() {
        let slope = 0.2f32;
        let texels: Vec<_> =
            (0..16).map(|k| code(Vec3::new(if k % 2 == 0 { slope } else { -slope }, 0.0, 1.0).normalize())).collect();
        let map = NormalMap::new(4, 4, &texels, [Wrap::Repeat; 2]).unwrap();
        let far = map.sample(Vec2::splat(0.5), 2.0, 1.0);
        assert!(far.normal.z > 0.9999, "{far:?}");
        // The slopes' variance in x alone, slope^2, counts half for each axis: alpha^2 = 2 (slope^2 / 2).
        assert!((far.alpha2 / (slope * slope) - 1.0).abs() < 0.06, "{far:?}");
        assert_eq!(map.sample(Vec2::splat(0.5), 0.0, 1.0).alpha2, 0.0);
    }
}
