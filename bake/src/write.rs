//! Tiles -> field bytes: collects the layers and writes the file whole or not at all.

use crate::encode::TileBytes;
use relume_firmware::field::{HEADER, Header, LAYER_ALIGN, LAYER_CRITICAL, LAYER_ENTRY, Layer, LayerKind};
use relume_firmware::glue::outfile::{OutError, write_whole};
use relume_firmware::tile::{ALL_WHOLE, BLOCK_TILES, PLACE_UNIT};
use relume_firmware::wayback::NO_WAY;
use std::io::Write;
use std::path::Path;

/// The layers of a tile set while they grow.
#[derive(Debug, Default)]
struct TileSetBytes {
    records: Vec<u8>,
    u: Vec<u8>,
    v: Vec<u8>,
    rows: Vec<u8>,
    /// Places of V by block.
    v_places: std::collections::HashMap<(u32, u32), u32>,
}

/// Appends at the next place and returns it.
fn append(layer: &mut Vec<u8>, bytes: &[u8]) -> u32 {
    layer.resize(layer.len().next_multiple_of(PLACE_UNIT), 0);
    let place = (layer.len() / PLACE_UNIT) as u32;
    layer.extend_from_slice(bytes);
    place
}

impl TileSetBytes {
    /// `block` is the block's column and row: the first tile of it that has pixels brings the V of all.
    fn push(&mut self, tile: TileBytes, block: (u32, u32), coverage_place: u32) {
        let mut record = tile.record;
        record.u_place = append(&mut self.u, &tile.u);
        if record.pixels > 0 {
            record.v_place = *self.v_places.entry(block).or_insert_with(|| append(&mut self.v, &tile.v));
        }
        record.rows_place = append(&mut self.rows, &tile.rows);
        record.coverage_place = coverage_place;
        self.records.extend_from_slice(&record.encode());
    }
}

/// A field file while it grows, tile by tile in row order.
#[derive(Debug, Default)]
pub struct FieldWriter {
    response: TileSetBytes,
    coverage: Vec<u8>,
    bounce_places: Vec<u8>,
    bounce: Vec<u8>,
    blocks: Vec<u8>,
    fragments: Vec<u8>,
    way_places: Vec<u8>,
    way_blocks: Vec<u8>,
    bound_basis: Vec<u8>,
    bounds: Vec<u8>,
    covered: u32,
}

/// All that one tile adds.
#[derive(Debug)]
pub struct FieldTile {
    /// Response to the patches.
    pub response: TileBytes,
    /// The tile's block of BNCE, empty if no light comes from the bounce points.
    pub bounce: Vec<u8>,
    /// Coverage of the covered pixels, in mask order.
    pub coverage: Vec<u8>,
    /// The tile's block of FRAG.
    pub fragments: Vec<u8>,
    /// The tile's block of WAYD, empty if it has none.
    pub way_back: Vec<u8>,
    /// Column and row of the tile.
    pub at: (u32, u32),
}

impl FieldWriter {
    /// Adds the next tile.
    pub fn push(&mut self, tile: FieldTile) {
        self.covered += u32::from(tile.response.record.pixels);
        let whole = tile.coverage.iter().all(|&share| share == 255);
        let place = if whole { ALL_WHOLE } else { append(&mut self.coverage, &padded_bytes(tile.coverage)) };
        let edge = BLOCK_TILES as u32;
        self.response.push(tile.response, (tile.at.0 / edge, tile.at.1 / edge), place);
        self.bounce_places.extend_from_slice(&((self.bounce.len() / 4) as u32).to_le_bytes());
        self.bounce.extend_from_slice(&tile.bounce);
        self.blocks.extend_from_slice(&((self.fragments.len() / 4) as u32).to_le_bytes());
        self.fragments.extend_from_slice(&tile.fragments);
        let place = if tile.way_back.is_empty() { NO_WAY } else { append(&mut self.way_blocks, &tile.way_back) };
        self.way_places.extend_from_slice(&place.to_le_bytes());
    }

    /// Sets the basis of the bounds, BNDB.
    pub fn set_bound_basis(&mut self, basis: Vec<u8>) {
        self.bound_basis = basis;
    }

    /// Adds the next block's record of BNDT.
    pub fn push_bound(&mut self, record: &[u8]) {
        self.bounds.extend_from_slice(record);
    }

    /// Covered pixels so far.
    pub fn covered(&self) -> u32 {
        self.covered
    }

    /// Bytes of U, V, scales and coverage so far: what a frame may read.
    pub fn response_bytes(&self) -> usize {
        let set = &self.response;
        set.records.len() + set.u.len() + set.v.len() + set.rows.len() + self.coverage.len()
    }

    /// The whole file. `scene` are CAST, CBVH and BPNT, `meta` JSON; `header.covered` is set here.
    pub fn into_bytes(mut self, mut header: Header, scene: [Vec<u8>; 3], meta: &str) -> Vec<u8> {
        header.covered = self.covered;
        self.blocks.extend_from_slice(&((self.fragments.len() / 4) as u32).to_le_bytes());
        self.bounce_places.extend_from_slice(&((self.bounce.len() / 4) as u32).to_le_bytes());
        let (response, [casters, nodes, points]) = (self.response, scene);
        let layers: [(LayerKind, u32, Vec<u8>); 17] = [
            (*b"TILE", LAYER_CRITICAL, response.records),
            (*b"ROWS", LAYER_CRITICAL, response.rows),
            (*b"RESU", LAYER_CRITICAL, response.u),
            (*b"RESV", LAYER_CRITICAL, response.v),
            (*b"COVR", LAYER_CRITICAL, self.coverage),
            (*b"CAST", LAYER_CRITICAL, casters),
            (*b"CBVH", LAYER_CRITICAL, nodes),
            (*b"FRGT", LAYER_CRITICAL, self.blocks),
            (*b"FRAG", LAYER_CRITICAL, self.fragments),
            (*b"BNDB", 0, self.bound_basis),
            (*b"BNDT", 0, self.bounds),
            (*b"WAYT", 0, self.way_places),
            (*b"WAYD", 0, self.way_blocks),
            (*b"BPNT", LAYER_CRITICAL, points),
            (*b"BTIL", LAYER_CRITICAL, self.bounce_places),
            (*b"BNCE", LAYER_CRITICAL, self.bounce),
            (*b"META", 0, meta.as_bytes().to_vec()),
        ];
        assemble(&header, &layers)
    }
}

/// Header, table and aligned layers.
fn assemble(header: &Header, layers: &[(LayerKind, u32, Vec<u8>)]) -> Vec<u8> {
    let mut table = Vec::with_capacity(layers.len() * LAYER_ENTRY);
    let mut offset = (HEADER + layers.len() * LAYER_ENTRY).next_multiple_of(LAYER_ALIGN);
    for (kind, flags, bytes) in layers {
        let crc32 = crc32fast::hash(bytes);
        let layer = Layer { kind: *kind, flags: *flags, offset: offset as u64, length: bytes.len() as u64, crc32 };
        table.extend_from_slice(&layer.encode());
        offset = (offset + bytes.len()).next_multiple_of(LAYER_ALIGN);
    }
    let mut file = Vec::with_capacity(offset);
    file.extend_from_slice(&header.encode(offset as u64, &table));
    file.extend_from_slice(&table);
    for (_, _, bytes) in layers {
        file.resize(file.len().next_multiple_of(LAYER_ALIGN), 0);
        file.extend_from_slice(bytes);
    }
    file.resize(offset, 0);
    file
}

fn padded_bytes(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.resize(relume_firmware::tile::padded(bytes.len()), 0);
    bytes
}

/// Writes the field so that it appears whole or not at all.
///
/// # Errors
/// [`OutError`]: the place cannot be written, or the disk is full.
pub fn save(path: &Path, bytes: &[u8]) -> Result<(), OutError> {
    write_whole(path, |out| out.write_all(bytes))
}
