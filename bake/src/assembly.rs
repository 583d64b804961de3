//! Blocks, in order -> a whole field.

use crate::bake::{BakeError, BakeOptions, Baked};
use crate::blocks::BlockCompressor;
use crate::camera::Camera;
use crate::error::{ExactTile, TestLight};
use crate::job::{DoneBlock, Job};
use crate::noise::{Noise, covered_tiles, some_of};
use crate::receivers::nested;
use crate::report::Report;
use crate::scene::Role;
use crate::viewpoint::TransportError;
use crate::write::FieldWriter;
use relume_firmware::field::{Field, Header};
use relume_firmware::patches::PatchSet;
use std::time::Duration;

/// Mean light, under an even sky of radiance 1, below which a view is taken for the inside of something closed: what gets
/// there came through cracks between triangles.
const DARK_LIGHT: f64 = 1e-4;

/// A field while its blocks come in.
pub struct Assembly {
    columns: u32,
    /// Blocks of the row that is not whole yet.
    row: Vec<DoneBlock>,
    next: u32,
    writer: FieldWriter,
    report: Report,
    /// In the order of the file.
    exact: Vec<ExactTile>,
}

impl Assembly {
    /// Of a job's blocks.
    pub fn new(job: &Job<'_>) -> Self {
        Assembly::of(job.grid().0, &job.compressor)
    }

    /// Of blocks that a compressor made, so many columns of them.
    pub fn of(columns: u32, compressor: &BlockCompressor) -> Self {
        let mut writer = FieldWriter::default();
        writer.set_bound_basis(compressor.bound_basis_bytes());
        let row = Vec::new();
        Assembly { columns, row, next: 0, writer, report: Report::default(), exact: Vec::new() }
    }

    /// Number of the block that comes next.
    pub fn next(&self) -> u32 {
        self.next
    }

    /// Takes the next block; one that is there already is left out.
    pub fn push(&mut self, done: DoneBlock) {
        if done.number != self.next {
            return;
        }
        self.next += 1;
        self.row.push(done);
        if self.row.len() == self.columns as usize {
            self.close_row();
        }
    }

    fn close_row(&mut self) {
        let mut tiles = Vec::new();
        for DoneBlock { block, exact, .. } in self.row.drain(..) {
            self.writer.push_bound(&block.bound);
            self.report.add_light(block.light);
            tiles.extend(block.tiles.into_iter().zip(exact));
        }
        // The file holds tiles row by row.
        tiles.sort_by_key(|(tile, _)| (tile.at.1, tile.at.0));
        for (tile, exact) in tiles {
            self.report.add(&tile);
            self.writer.push(tile);
            self.exact.push(exact);
        }
    }

    /// The field, once all blocks are there.
    ///
    /// # Errors
    /// [`BakeError`]: nothing of the scene is lit, or the stack cannot be written.
    pub fn finish(
        mut self,
        mut job: Job<'_>,
        camera: &Camera,
        options: &BakeOptions,
        took: Duration,
    ) -> Result<Baked, BakeError> {
        let is_virtual = job.part.shows == Role::Virtual;
        let light_mean = self.close(took).light_mean;
        if is_virtual && self.writer.covered() == 0 && !job.part.scene.roles.is_empty() {
            return Err(BakeError::NothingVirtual);
        }
        if is_virtual && light_mean < DARK_LIGHT {
            let position = camera.position.map(|c| c as f32);
            return Err(TransportError::Dark { position }.into());
        }
        if let Some(stack) = job.stack {
            stack.finish()?;
        }
        let tiles = some_of(&covered_tiles(&job.transport));
        self.report.noise = Some(Noise::of(&mut job.transport, &tiles, &job.test_light));
        let casters = job.compressor.casters;
        let scene = [casters.casters, casters.nodes, job.bounce.layer()];
        self.into_field(header(camera, job.patches, options), scene, job.test_light)
    }

    /// Puts receivers into the field: baked with the virtual geometry and without it. Where the camera sees none of them they
    /// are left out.
    ///
    /// # Errors
    /// [`BakeError::Unsound`], which is a fault of this program.
    pub fn set_receivers(&mut self, with: &Baked, without: &Baked) -> Result<(), BakeError> {
        if Field::new(&with.bytes)?.header().covered > 0 {
            self.writer.set_receivers(nested(&with.bytes)?, without.bytes.clone());
        }
        Ok(())
    }

    /// Closes the sums of the report, which may be added to.
    pub fn close(&mut self, took: Duration) -> &mut Report {
        self.report.finish(&self.writer, took);
        &mut self.report
    }

    /// The closed field, with the layers `scene` (CAST, CBVH, BPNT), and its errors under `light`.
    ///
    /// # Errors
    /// [`BakeError::Unsound`], which is a fault of this program.
    pub fn into_field(mut self, header: Header, scene: [Vec<u8>; 3], light: TestLight) -> Result<Baked, BakeError> {
        let draft = self.writer.into_draft(header, scene);
        self.report.held_out = light.errors(&Field::new(draft.bytes())?, &self.exact)?;
        let bytes = draft.finish(&self.report.to_json());
        Ok(Baked { bytes, report: self.report, exact: self.exact, light })
    }
}

fn header(camera: &Camera, patches: PatchSet, options: &BakeOptions) -> Header {
    Header {
        width: options.size.0,
        height: options.size.1,
        patches,
        covered: 0,
        camera: camera.record(options.size),
        error_target: options.error as f32,
        site: options.site.map(|site| site.map(|degrees| degrees as f32)),
        seed: options.transport.seed,
        max_hits: options.transport.max_hits,
    }
}
