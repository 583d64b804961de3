//! The demonstration's site, built in code: a Doric temple on a headland above the sea, with a ruin before it.
//!
//! World: metres, +Y up, north -Z, east +X; the ground under the temple lies at y = 0. The temple is a peripteros of six
//! by thirteen columns in the proportions of the fifth century BC, its front turned to the sunrise, seen from the
//! south-east: the sun rakes its front in the morning and its flank for the rest of the day.

mod building;
mod land;
mod mesh;
mod noise;
mod order;
mod stone;

use glam::{Affine3A, Vec2, Vec3};

use crate::camera::Camera;
use crate::scene::{Role, Scene};

/// Latitude and longitude of the site, degrees north and east: a headland of the Aegean.
pub const SITE_DEG: [f64; 2] = [37.6, 24.0];

/// Where the viewing post stands and what it looks at, (x, z).
const EYE: Vec2 = Vec2::new(33.5, 29.0);
const AIM: Vec2 = Vec2::new(2.6, 0.0);

/// The front looks this many degrees south of east.
const TURN_DEG: f32 = 10.0;

/// The site and the viewpoint of its viewing post.
pub fn temple() -> (Scene, Camera) {
    let (scene, camera) = site();
    (Scene { roles: Vec::new(), ..scene }, camera)
}

/// The same as it is: the temple has vanished, and everything else is there. Land and ruin take its shadow; the cypresses are
/// in front of it.
pub fn site() -> (Scene, Camera) {
    let mut mesh = mesh::Mesh::new();
    let mut roles = Vec::new();
    mesh.place = temple_place();
    building::temple(&mut mesh);
    roles.resize(mesh.triangles.len(), Role::Virtual);
    mesh.place = Affine3A::IDENTITY;
    land::terrain(&mut mesh);
    land::ruin(&mut mesh);
    land::scatter(&mut mesh);
    roles.resize(mesh.triangles.len(), Role::Receiver);
    land::cypresses(&mut mesh);
    roles.resize(mesh.triangles.len(), Role::Occluder);
    let scene = Scene {
        triangles: mesh.triangles,
        materials: stone::materials(),
        textures: stone::textures(),
        roles,
        ..Scene::default()
    };
    (scene, viewpoint())
}

/// From the temple's own frame (long axis x) to the world.
fn temple_place() -> Affine3A {
    Affine3A::from_rotation_y(-TURN_DEG.to_radians())
}

fn viewpoint() -> Camera {
    let eye = Vec3::new(EYE.x, land::height(EYE.x, EYE.y) + 2.6, EYE.y);
    Camera {
        position: eye.as_dvec3().to_array(),
        target: Vec3::new(AIM.x, 5.0, AIM.y).as_dvec3().to_array(),
        up: [0.0, 1.0, 0.0],
        fov_y_deg: 34.0,
        optics: None,
        north_deg: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scene_is_sound() {
        let (scene, camera) = temple();
        assert!((10_000..60_000).contains(&scene.triangles.len()), "{}", scene.triangles.len());
        assert!(camera.check(std::path::Path::new("demo")).is_ok());
        for triangle in &scene.triangles {
            assert!((triangle.material as usize) < scene.materials.len());
            let finite = triangle.positions.iter().chain(&triangle.normals).all(|v| v.is_finite());
            assert!(finite && triangle.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4));
        }
        for material in &scene.materials {
            assert!(material.texture.is_none_or(|texture| (texture as usize) < scene.textures.len()));
        }
    }

    #[test]
    fn the_ground_meets_the_steps_and_nothing_buries_the_viewpoint() {
        for angle in 0..360 {
            let (sin, cos) = (angle as f32).to_radians().sin_cos();
            let foot = temple_place().transform_point3(Vec3::new(16.4 * cos, 0.0, 7.6 * sin));
            assert!(land::height(foot.x, foot.z).abs() < 0.3, "{angle}");
        }
        let [x, y, z] = viewpoint().position.map(|v| v as f32);
        assert!(y > land::height(x, z) + 2.0);
    }
}
