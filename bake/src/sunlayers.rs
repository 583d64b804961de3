//! The layers of direct sunlight: casters, their bounding volumes, and what each pixel sees
//! (layouts: firmware/src/casters.rs and sunlight.rs).

use crate::cutout::sun_casters;
use crate::fragments::Fragment;
use crate::scene::Scene;
use glam::Vec3;
use obvhs::BvhBuildParams;
use obvhs::bvh2::{Bvh2, builder::build_bvh2_from_tris};
use obvhs::triangle::Triangle;
use relume_firmware::casters::{CASTER, NODE};
use relume_firmware::gloss::{Gloss, Lobe};
use relume_firmware::sunlight::FRAGMENT;

/// Casters per leaf at most; the layout has 4 bits for it.
const LEAF: u32 = 4;

/// CAST and CBVH of a scene, and where each triangle of the scene lies in CAST.
pub struct CasterLayers {
    /// Casters, in leaf order; those that stop no light come last and lie in no leaf.
    pub casters: Vec<u8>,
    /// Nodes, depth first.
    pub nodes: Vec<u8>,
    caster_of_triangle: Vec<u32>,
}

impl CasterLayers {
    /// Of no geometry at all: such a field does not answer suns.
    pub fn none() -> Self {
        CasterLayers { casters: Vec::new(), nodes: Vec::new(), caster_of_triangle: Vec::new() }
    }

    /// Builds the layers. Deterministic.
    pub fn new(scene: &Scene) -> Self {
        let (all, shapes) = sun_casters(scene);
        let stopping: Vec<u32> = (0..all.len() as u32).filter(|&k| opacity_code(all[k as usize].opacity) > 0).collect();
        let triangles: Vec<Triangle> = stopping
            .iter()
            .map(|&k| {
                let [v0, v1, v2] = all[k as usize].positions.map(Into::into);
                Triangle { v0, v1, v2 }
            })
            .collect();
        let mut order: Vec<u32> = Vec::with_capacity(all.len());
        let mut nodes = Vec::new();
        if !triangles.is_empty() {
            let params =
                BvhBuildParams { pre_split: false, max_prims_per_leaf: LEAF, ..BvhBuildParams::medium_build() };
            let bvh = build_bvh2_from_tris(&triangles, params, &mut Default::default());
            let mut flat = DepthFirst { bvh: &bvh, nodes: &mut nodes, leaves: &mut order };
            flat.put(0);
            order.iter_mut().for_each(|k| *k = stopping[*k as usize]);
        }
        order.extend((0..all.len() as u32).filter(|&k| opacity_code(all[k as usize].opacity) == 0));
        let mut place = vec![0u32; all.len()];
        let mut casters = vec![0u8; all.len() * CASTER];
        for (at, &k) in order.iter().enumerate() {
            place[k as usize] = at as u32;
            let caster = &all[k as usize];
            let slot = &mut casters[at * CASTER..][..CASTER];
            put_corners(slot, &caster.positions, &caster.normals);
            slot[54] = opacity_code(caster.opacity);
        }
        let caster_of_triangle = shapes.iter().map(|&k| place[k as usize]).collect();
        CasterLayers { casters, nodes, caster_of_triangle }
    }

    /// A tile's block of FRAG.
    pub fn fragments(&self, pixels: &[Vec<Fragment>]) -> Vec<u8> {
        let mut block: Vec<u8> = pixels.iter().map(|own| own.len().min(255) as u8).collect();
        block.resize(block.len().next_multiple_of(4), 0);
        for fragment in pixels.iter().flat_map(|own| own.iter().take(255)) {
            let mut bytes = [0u8; FRAGMENT];
            bytes[..4].copy_from_slice(&self.caster_of_triangle[fragment.triangle as usize].to_le_bytes());
            bytes[4..6].copy_from_slice(&fragment.strata.to_le_bytes());
            for (c, albedo) in fragment.albedo.iter().enumerate() {
                let code = (albedo * 32768.0).round().clamp(0.0, 65535.0) as u16;
                bytes[6 + 2 * c..8 + 2 * c].copy_from_slice(&code.to_le_bytes());
            }
            block.extend_from_slice(&bytes);
        }
        block
    }
}

/// What does not gleam.
const DULL: Gloss =
    Gloss { bend: [0.0; 3], lobe: Lobe { alpha: 1.0, f0: [0.0; 3], f90: 0.0, coat_f0: 0.0, coat_f90: 0.0 } };

/// A tile's records of GLSS, one per fragment of its block of FRAG; none if nothing gleams.
pub fn gloss_records(pixels: &[Vec<Fragment>]) -> Vec<u8> {
    let fragments = || pixels.iter().flat_map(|own| own.iter().take(255));
    if fragments().all(|fragment| fragment.gloss.is_none()) {
        return Vec::new();
    }
    fragments().flat_map(|fragment| fragment.gloss.unwrap_or(DULL).encode()).collect()
}

fn opacity_code(opacity: f32) -> u8 {
    (opacity * 255.0).round().clamp(0.0, 255.0) as u8
}

fn put_corners(slot: &mut [u8], positions: &[Vec3; 3], normals: &[Vec3; 3]) {
    for (k, value) in positions.iter().flat_map(|p| p.to_array()).enumerate() {
        slot[4 * k..4 * k + 4].copy_from_slice(&value.to_le_bytes());
    }
    for (k, value) in normals.iter().flat_map(|n| n.to_array()).enumerate() {
        let code = (value * 32767.0).round().clamp(-32767.0, 32767.0) as i16;
        slot[36 + 2 * k..38 + 2 * k].copy_from_slice(&code.to_le_bytes());
    }
}

/// Writes a tree depth first, so that a ray walks it forwards without a stack.
struct DepthFirst<'a> {
    bvh: &'a Bvh2,
    nodes: &'a mut Vec<u8>,
    leaves: &'a mut Vec<u32>,
}

impl DepthFirst<'_> {
    fn put(&mut self, root: usize) {
        // Nodes still to be written, and for inner nodes already written the place whose "next" is then known.
        enum Step {
            Write(usize),
            Close(usize),
        }
        let mut steps = vec![Step::Write(root)];
        while let Some(step) = steps.pop() {
            match step {
                Step::Close(at) => {
                    let next = (self.nodes.len() / NODE) as u32;
                    self.nodes[at * NODE + 12..at * NODE + 16].copy_from_slice(&next.to_le_bytes());
                }
                Step::Write(index) => {
                    let at = self.nodes.len() / NODE;
                    let node = &self.bvh.nodes[index];
                    self.put_box(index);
                    steps.push(Step::Close(at));
                    if node.prim_count > 0 {
                        let first = self.leaves.len() as u32;
                        let from = node.first_index as usize;
                        let own = &self.bvh.primitive_indices[from..from + node.prim_count as usize];
                        self.leaves.extend_from_slice(own);
                        let leaf = first << 4 | node.prim_count;
                        self.nodes[at * NODE + 28..at * NODE + 32].copy_from_slice(&leaf.to_le_bytes());
                    } else {
                        let first = node.first_index as usize;
                        // The larger box first: it is the likelier to stop a shadow ray.
                        let area = |k: usize| self.bvh.nodes[k].aabb.half_area();
                        let swap = area(first) < area(first + 1);
                        let (near, far) = if swap { (first + 1, first) } else { (first, first + 1) };
                        steps.push(Step::Write(far));
                        steps.push(Step::Write(near));
                    }
                }
            }
        }
    }

    fn put_box(&mut self, index: usize) {
        let aabb = &self.bvh.nodes[index].aabb;
        let mut bytes = [0u8; NODE];
        for axis in 0..3 {
            bytes[4 * axis..4 * axis + 4].copy_from_slice(&aabb.min[axis].to_le_bytes());
            bytes[16 + 4 * axis..20 + 4 * axis].copy_from_slice(&aabb.max[axis].to_le_bytes());
        }
        self.nodes.extend_from_slice(&bytes);
    }
}
