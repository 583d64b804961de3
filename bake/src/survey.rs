//! A look at a scene before hours are spent on it: what is allowed, but seldom meant.
//!
//! A coarse grid of rays tells what the picture shows; what is wrong where nobody looks is not told. The thresholds are
//! rules of thumb: each notice says what was found, so that whoever meant it can go on.

use crate::camera::CameraView;
use crate::geometry::{Cone, Geometry, Hit, Surface, may_let_light_through};
use crate::scene::Scene;
use crate::strata::{Grid, hash};
use glam::{Vec2, Vec3A};
use std::collections::BTreeMap;

/// Rays through the picture: a square of so many.
const SIDE: u32 = 96;
/// Whitewash reflects about 0.8 and fresh snow 0.9; nothing at a site reflects more.
const WHITEST: f32 = 0.9;
/// Share of what is seen of a material from which a fault of it is told.
const MUCH: f64 = 0.2;
/// A material that fills less of the picture is not worth a notice.
const LITTLE: f64 = 0.002;
/// Distances of the middle of what is seen between which a scene in metres is believed, m.
const BELIEVED_M: std::ops::RangeInclusive<f32> = 0.5..=2000.0;
/// Height of a camera over what is below it up to which a scene in metres is believed, m: a mast or a tower, but no eye of a
/// visitor (1.7 m) in centimetres or inches.
const BELIEVED_HEIGHT_M: f32 = 40.0;
/// Cosine of the slope from which a surface is ground or roof rather than wall.
const LEVEL: f32 = 0.7;

/// Rays that run along axes run along the edges of modelled things too easily.
const TILT: Vec3A = Vec3A::new(1.3e-3, 0.4e-3, 0.7e-3);

/// Something that is seldom meant, one line each.
pub type Notice = String;

/// What a ray through the picture found.
struct Look {
    hit: Hit,
    surface: Surface,
    material: u32,
    base_color: Vec3A,
}

/// Looks at `scene` as the camera sees it; `is_small`: a thing on a table, of which it may be near.
pub fn survey(
    scene: &Scene,
    geometry: &Geometry<'_>,
    view: &CameraView,
    (size, is_small): ((u32, u32), bool),
) -> Vec<Notice> {
    let looks = looks(scene, geometry, view, size);
    let mut notices: Vec<Notice> = Vec::new();
    notices.extend(scale(&looks, is_small).or_else(|| height(geometry, view)));
    notices.extend(underground(geometry, view));
    let mut of_material: BTreeMap<u32, Vec<&Look>> = BTreeMap::new();
    looks.iter().for_each(|look| of_material.entry(look.material).or_default().push(look));
    for (material, seen) in of_material {
        if (seen.len() as f64) < LITTLE * looks.len() as f64 {
            continue;
        }
        let name = name_of(scene, material);
        // Silver does reflect nearly all.
        if !scene
            .materials
            .get(material as usize)
            .is_some_and(|m| m.finish.metallic > 0.5 && m.finish.texture.is_none())
        {
            notices.extend(too_white(&name, &seen));
        }
        notices.extend(turned(scene, &name, &seen));
        // Leaves, grilles and panes are meant to be sheets.
        if !scene.materials.get(material as usize).is_some_and(|m| may_let_light_through(scene, m)) {
            notices.extend(thin(geometry, &name, &seen));
        }
    }
    notices
}

fn looks(scene: &Scene, geometry: &Geometry<'_>, view: &CameraView, size: (u32, u32)) -> Vec<Look> {
    let origin = view.position.as_vec3a();
    let size = Vec2::new(size.0 as f32, size.1 as f32);
    let look = |cell: u32| {
        let word = hash(cell);
        let jitter = Vec2::new((word >> 16) as f32, (word & 0xffff) as f32) / 65536.0;
        let at = Grid::new(SIDE * SIDE).point(cell, jitter) * size;
        let direction = view.direction(at.x, at.y)?.into();
        let hit = geometry.closest(origin, direction, cell)?;
        let material = scene.triangles.get(hit.triangle as usize)?.material;
        Some(Look {
            surface: geometry.surface(&hit, direction, Cone::default()),
            base_color: geometry.base_color(&hit),
            hit,
            material,
        })
    };
    (0..SIDE * SIDE).filter_map(look).collect()
}

fn name_of(scene: &Scene, material: u32) -> String {
    match scene.materials.get(material as usize) {
        Some(material) if !material.name.is_empty() => format!("material '{}'", material.name),
        _ => format!("material {material}"),
    }
}

fn share(seen: &[&Look], is_so: impl Fn(&Look) -> bool) -> f64 {
    seen.iter().filter(|look| is_so(look)).count() as f64 / seen.len().max(1) as f64
}

/// What to do with a scene in other units than metres.
const UNITS: &str = "glTF counts in metres; if the scene was modelled in other units, scale it (Blender: Scene Properties > Units) and \
                     apply the scale";

/// A scene in other units is seen from absurdly far or near.
fn scale(looks: &[Look], is_small: bool) -> Option<Notice> {
    let mut distances: Vec<f32> = looks.iter().map(|look| look.hit.distance).collect();
    distances.sort_unstable_by(f32::total_cmp);
    let middle = *distances.get(distances.len() / 2)?;
    let (is_far, is_near) = (middle > *BELIEVED_M.end(), middle < *BELIEVED_M.start() && !is_small);
    let than = if is_far { "more than" } else { "less than" };
    (is_far || is_near).then(|| format!("half of what the camera sees is {than} {middle:.3} m away: {UNITS}"))
}

/// The same is seen from as high as a tower.
fn height(geometry: &Geometry<'_>, view: &CameraView) -> Option<Notice> {
    let down = (TILT - Vec3A::Y).normalize();
    let height = geometry.closest(view.position.as_vec3a(), down, 0)?.distance;
    (height > BELIEVED_HEIGHT_M).then(|| format!("the camera is {height:.0} m above what is below it: {UNITS}"))
}

/// Nothing below the camera, and something right above it: it stands under the ground.
fn underground(geometry: &Geometry<'_>, view: &CameraView) -> Option<Notice> {
    let origin = view.position.as_vec3a();
    let up = (Vec3A::Y + TILT).normalize();
    let above = geometry.closest(origin, up, 0)?;
    let is_open_below = geometry.closest(origin, -up, 0).is_none();
    (is_open_below && above.back).then(|| {
        let height = above.distance;
        let [x, y, z] = view.position.to_array();
        format!("the camera at [{x}, {y}, {z}] is {height:.2} m under the ground: raise its position")
    })
}

fn too_white(name: &str, seen: &[&Look]) -> Option<Notice> {
    let mean = seen.iter().map(|look| look.base_color).sum::<Vec3A>() / seen.len() as f32;
    let most = mean.max_element();
    (most > WHITEST).then(|| {
        format!(
            "{name} reflects {:.0} % of the light: whitewash reflects 80, marble 70, limestone 50; light bounces too often \
             between such walls. Take a base colour of at most 0.8 (linear), or of 230 of 255 in a picture",
            100.0 * most
        )
    })
}

/// Backs that are seen, and shading normals that point into the wall.
fn turned(scene: &Scene, name: &str, seen: &[&Look]) -> Option<Notice> {
    let is_inside_out = |look: &Look| {
        scene.triangles.get(look.hit.triangle as usize).is_some_and(|triangle| {
            let [a, b, c] = triangle.positions;
            let flat = (b - a).cross(c - a);
            triangle.normals.iter().map(|normal| normal.dot(flat)).sum::<f32>() < 0.0
        })
    };
    let advice = "Blender: Edit Mode > Mesh > Normals > Recalculate Outside";
    let (backs, inside_out) = (share(seen, |look| look.hit.back), share(seen, is_inside_out));
    if inside_out > MUCH {
        Some(format!(
            "{name}: on {:.0} % of what is seen of it the normals point into the surface, and edges will be shaded as if lit \
             from behind ({advice})",
            100.0 * inside_out
        ))
    } else if backs > MUCH {
        Some(format!("{name}: {:.0} % of what is seen of it are backs of faces ({advice})", 100.0 * backs))
    } else {
        None
    }
}

/// Walls that are sheets: behind their front there is no back.
fn thin(geometry: &Geometry<'_>, name: &str, seen: &[&Look]) -> Option<Notice> {
    let walls: Vec<&Look> =
        seen.iter().copied().filter(|look| !look.hit.back && look.surface.normal_flat.y.abs() < LEVEL).collect();
    let is_sheet = |look: &Look| {
        let inwards = (TILT - look.surface.normal_flat).normalize();
        // The surface's point is lifted off towards the viewer: go as far in.
        let from = look.surface.position + inwards * (2.0 * geometry.lift(look.surface.position));
        geometry.closest(from, inwards, 0).is_none_or(|behind| !behind.back)
    };
    let sheets = walls.iter().filter(|look| is_sheet(look)).count() as f64;
    let (walls, all) = (walls.len() as f64, seen.len() as f64);
    (walls > MUCH * all && sheets > 2.0 * MUCH * walls).then(|| {
        format!(
            "{name}: {:.0} % of the walls seen have no thickness: they look like paper at their edges (Blender: Solidify \
             modifier)",
            100.0 * sheets / walls
        )
    })
}

#[cfg(test)]
mod tests;
