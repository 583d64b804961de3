//! Tangents for normal maps of meshes that bring none.

use glam::{Vec2, Vec3, Vec4};

use super::Triangle;

/// Tangents at the corners of a triangle whose normal map has the coordinates `uvs`: along the map's u, across each corner's
/// normal; w tells on which side the bitangent, up in the picture, lies. All zero where the coordinates do not tell.
pub(super) fn of(triangle: &Triangle, uvs: [Vec2; 3]) -> [Vec4; 3] {
    let [a, b, c] = triangle.positions;
    let (along_b, along_c) = (uvs[1] - uvs[0], uvs[2] - uvs[0]);
    let turn = along_b.perp_dot(along_c);
    let side = if turn < 0.0 { -1.0 } else { 1.0 };
    // The gradient of u over the surface, but for its length.
    let along_u: Vec3 = ((b - a) * along_c.y - (c - a) * along_b.y) * side;
    triangle.normals.map(|normal| {
        let tangent = along_u - normal * normal.dot(along_u);
        // Pictures count v downwards: seen from the front of an unmirrored map u, then v, turn clockwise.
        if turn == 0.0 { Vec4::ZERO } else { tangent.normalize_or_zero().extend(-side) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_on_a_wall_has_its_right_and_its_up() {
        let wall = Triangle {
            positions: [Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: [Vec3::Z; 3],
            uvs: [Vec2::ZERO; 3],
            material: 0,
        };
        // The picture hangs upright: u to the right, v downwards.
        let upright = of(&wall, [Vec2::new(0.0, 1.0), Vec2::new(1.0, 1.0), Vec2::new(0.0, 0.0)]);
        assert_eq!(upright, [Vec3::X.extend(1.0); 3]);
        let mirrored = of(&wall, [Vec2::new(1.0, 1.0), Vec2::new(0.0, 1.0), Vec2::new(1.0, 0.0)]);
        assert_eq!(mirrored, [Vec3::NEG_X.extend(-1.0); 3]);
        assert_eq!(of(&wall, [Vec2::ZERO; 3]), [Vec4::ZERO; 3]);
    }
}
