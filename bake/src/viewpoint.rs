//! Tells a camera that cannot give a picture before hours are spent on it.

use glam::{Vec2, Vec3A};

use crate::camera::{Camera, CameraView};
use crate::geometry::{Geometry, Hit};
use crate::strata::{Grid, hash};

/// Largest width or height of a picture, pixels.
pub const MAX_SIDE: u32 = 16384;

/// Why a scene cannot be baked from a camera.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TransportError {
    /// The picture has no pixels, or too many.
    #[error("size {width}x{height}: choose a width and a height from 1 to {MAX_SIDE}")]
    Size {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// The picture has not the shape of the still that the camera's lens was measured on.
    #[error(
        "size {width}x{height}: the camera's lens was measured on a still of {}x{} (size_px), another shape; choose a size \
         of that shape",
        still[0], still[1]
    )]
    Shape {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Width and height of the still, pixels.
        still: [u32; 2],
    },
    /// The scene has no triangles.
    #[error("the scene has no triangles; export at least one mesh with faces")]
    NoTriangles,
    /// No ray of the camera meets the scene.
    #[error(
        "the camera at {position:?} sees nothing of the scene, which lies around {centre:?}; correct position or target"
    )]
    NothingSeen {
        /// The camera's position, m.
        position: [f32; 3],
        /// Middle of the scene, m.
        centre: [f32; 3],
    },
    /// The camera stands inside closed geometry, or touches it.
    #[error(
        "the camera at {position:?} stands inside a wall (the nearest surface is {distance} m away); move position"
    )]
    InsideWall {
        /// The camera's position, m.
        position: [f32; 3],
        /// Median distance of what the camera sees, m.
        distance: f32,
    },
    /// Nothing that the camera sees is reached by light.
    #[error(
        "no light reaches what the camera at {position:?} sees: it stands inside a wall or a closed room; move position"
    )]
    Dark {
        /// The camera's position, m.
        position: [f32; 3],
    },
}

/// # Errors
/// [`TransportError::Size`] when a side is 0 or above [`MAX_SIDE`].
pub(crate) fn check_size((width, height): (u32, u32)) -> Result<(), TransportError> {
    if (1..=MAX_SIDE).contains(&width) && (1..=MAX_SIDE).contains(&height) {
        Ok(())
    } else {
        Err(TransportError::Size { width, height })
    }
}

/// # Errors
/// [`TransportError::Shape`] when the camera's lens was measured on a still of another shape than `size`.
pub(crate) fn check_shape(camera: &Camera, (width, height): (u32, u32)) -> Result<(), TransportError> {
    match camera.optics {
        Some(optics) if !optics.fits((width, height)) => {
            Err(TransportError::Shape { width, height, still: optics.size_px })
        }
        _ => Ok(()),
    }
}

/// Shares of the scene's diagonal, of rays that see only what is nearer, and of all directions that meet backs.
const TOUCHING: f32 = 1e-3;
const MOST_RAYS: f32 = 0.9;
const ALL_AROUND: f32 = 0.98;

/// Sends a coarse grid of rays through the picture and, if those see only backs, rays all around.
///
/// # Errors
/// [`TransportError::NothingSeen`] and [`TransportError::InsideWall`].
pub(crate) fn check_view(geometry: &Geometry, view: &CameraView, size: (u32, u32)) -> Result<(), TransportError> {
    let origin = view.position.as_vec3a();
    let position = origin.to_array();
    let side = 64u32;
    let rays = (side * side) as f32;
    let hits: Vec<Hit> = (0..side * side)
        .filter_map(|cell| {
            let at = Grid::new(side * side).point(cell, jitter(cell)) * Vec2::new(size.0 as f32, size.1 as f32);
            geometry.closest(origin, view.direction(at.x, at.y)?.into(), cell)
        })
        .collect();
    if hits.is_empty() {
        return Err(TransportError::NothingSeen { position, centre: geometry.centre().to_array() });
    }
    let touching = hits.iter().filter(|hit| hit.distance < TOUCHING * geometry.diagonal()).count();
    let backs = hits.iter().filter(|hit| hit.back).count() as f32;
    let enclosed = backs > MOST_RAYS * rays && backs_around(geometry, origin) > ALL_AROUND;
    if touching as f32 > MOST_RAYS * rays || enclosed {
        let mut distances: Vec<f32> = hits.iter().map(|hit| hit.distance).collect();
        distances.sort_by(f32::total_cmp);
        return Err(TransportError::InsideWall { position, distance: distances[distances.len() / 2] });
    }
    Ok(())
}

/// The share of all directions in which the first thing met is the back of a surface.
fn backs_around(geometry: &Geometry, origin: Vec3A) -> f32 {
    let cells = 1024u32;
    let met = (0..cells).filter(|&cell| {
        let at = Grid::new(cells).point(cell, jitter(cell));
        let height = 2.0 * at.x - 1.0;
        let (sin, cos) = (std::f32::consts::TAU * at.y).sin_cos();
        let radius = (1.0 - height * height).max(0.0).sqrt();
        geometry.closest(origin, Vec3A::new(radius * cos, height, radius * sin), cell).is_some_and(|hit| hit.back)
    });
    met.count() as f32 / cells as f32
}

fn jitter(cell: u32) -> Vec2 {
    let word = hash(cell);
    Vec2::new((word >> 16) as f32, (word & 0xffff) as f32) / 65536.0
}
