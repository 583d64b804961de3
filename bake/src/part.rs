//! The parts of a field: what is virtual, and the receivers in its presence and without it. Each is a picture of its own with
//! the same pixels; together they show what a real picture of the site turns into.

use crate::geometry::{Cone, Geometry, Surface};
use crate::path::Tracer;
use crate::scene::{Role, Scene};
use crate::strata::Rng;
use glam::Vec3A;

/// One picture of a bake.
#[derive(Clone, Copy, Debug)]
pub struct Part<'s> {
    /// What light meets on its way.
    pub scene: &'s Scene,
    /// What the picture shows of it, where nothing else is before it.
    pub shows: Role,
    /// The whole scene, where `scene` is not: what hides in it is not shown either.
    pub whole: Option<&'s Scene>,
    /// Folder of its stack, beside those of the other parts; none for the virtual geometry.
    pub stack_folder: Option<&'static str>,
}

impl<'s> Part<'s> {
    /// What is shown of `scene` by the post.
    pub fn of_virtual(scene: &'s Scene) -> Self {
        Part { scene, shows: Role::Virtual, whole: None, stack_folder: None }
    }

    /// The receivers of `scene` with its virtual geometry.
    pub fn with_virtual(scene: &'s Scene) -> Self {
        Part { scene, shows: Role::Receiver, whole: None, stack_folder: Some("with") }
    }

    /// The same points of the receivers of `whole`, of which `real` is all that is really there ([`Scene::real`]).
    pub fn without_virtual(real: &'s Scene, whole: &'s Scene) -> Self {
        Part { scene: real, shows: Role::Receiver, whole: Some(whole), stack_folder: Some("without") }
    }
}

/// Tells which of the rays from the eye see the part.
pub(crate) struct Eye<'s> {
    part: Part<'s>,
    /// Of the whole scene, where the part's is not.
    whole: Option<(Geometry<'s>, &'s Scene)>,
}

impl<'s> Eye<'s> {
    pub(crate) fn new(part: Part<'s>) -> Self {
        Eye { whole: part.whole.map(|whole| (Geometry::new(whole), whole)), part }
    }

    /// The surface of the part that is seen from `origin` along the unit vector `dir_world`, if nothing else is before it.
    pub(crate) fn first(
        &self,
        tracer: &Tracer<'_>,
        origin: Vec3A,
        dir_world: Vec3A,
        cone: Cone,
        rng: &mut Rng,
    ) -> Option<Surface> {
        let seed = rng.next_u32();
        if let Some((geometry, scene)) = &self.whole {
            geometry.closest(origin, dir_world, seed).filter(|hit| scene.role(hit.triangle) == self.part.shows)?;
        }
        let hit = tracer.geometry.closest(origin, dir_world, seed)?;
        (self.part.scene.role(hit.triangle) == self.part.shows).then(|| tracer.geometry.surface(&hit, dir_world, cone))
    }
}
