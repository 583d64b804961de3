//! A field many times over, each at addresses of its own: more bytes than the caches hold, relit in turn.
#![allow(unsafe_code)]

use std::fs::File;
use std::path::Path;

use anyhow::Context;
use memmap2::{MmapMut, MmapOptions};
use relume_firmware::field::{Field, LayerKind};

/// Layers that every frame reads. The others stay shared: the sun's, read when it has moved, and the rows of the way
/// back, read when a patch begins to stand out.
const PER_FRAME: [LayerKind; 7] = [*b"TILE", *b"ROWS", *b"RESU", *b"RESV", *b"COVR", *b"BNDB", *b"BNDT"];
/// Step in which memory becomes a copy's own; no larger than any system's page.
const PAGE: usize = 4096;

/// Copies of a field file.
pub struct FieldCopies(Vec<MmapMut>);

impl FieldCopies {
    /// Maps `count` copies of a field file; what every frame reads has memory of its own in each.
    ///
    /// # Errors
    /// When the file or the memory cannot be had.
    pub fn map(path: &Path, field: &Field<'_>, count: usize) -> anyhow::Result<Self> {
        let file = File::open(path).with_context(|| path.display().to_string())?;
        let mut copies = Vec::with_capacity(count);
        for _ in 0..count {
            // SAFETY: a private map; that nobody rewrites a field in place while it is used is the condition under which
            // any field file is used.
            let mut map = unsafe { MmapOptions::new().map_copy(&file) }.context("cannot map the field again")?;
            anyhow::ensure!(map.len() == field.file_bytes(), "{}: the file has changed", path.display());
            for layer in field.layers().filter(|layer| PER_FRAME.contains(&layer.kind)) {
                let (from, to) = (layer.offset as usize, (layer.offset + layer.length) as usize);
                // Writing is what makes a page the map's own.
                for at in (from..to).step_by(PAGE).chain(to.checked_sub(1)) {
                    map[at] = std::hint::black_box(map[at]);
                }
            }
            copies.push(map);
        }
        Ok(FieldCopies(copies))
    }

    /// Bytes that become a copy's own.
    pub fn bytes_each(field: &Field<'_>) -> usize {
        let layers = field.layers().filter(|layer| PER_FRAME.contains(&layer.kind));
        layers.map(|layer| layer.length as usize).sum()
    }

    /// The fields.
    ///
    /// # Errors
    /// When a copy is no sound field.
    pub fn fields(&self) -> anyhow::Result<Vec<Field<'_>>> {
        self.0.iter().map(|map| Field::new(map).map_err(|error| anyhow::anyhow!("{error}"))).collect()
    }
}
