//! Tiles -> field bytes: collects the layers and writes the file whole or not at all.

use crate::encode::TileBytes;
use relume_firmware::field::{HEADER, Header, LAYER_ALIGN, LAYER_CRITICAL, LAYER_ENTRY, Layer, LayerKind};
use relume_firmware::gloss::GLOSS;
use relume_firmware::glue::outfile::{OutError, write_whole};
use relume_firmware::patches::Listed;
use relume_firmware::tile::{ALL_WHOLE, BLOCK_TILES, PLACE_UNIT};
use relume_firmware::wayback::NO_WAY;
use serde::{Deserialize, Serialize};
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
    gloss_places: Vec<u8>,
    gloss: Vec<u8>,
    way_places: Vec<u8>,
    way_blocks: Vec<u8>,
    bound_basis: Vec<u8>,
    bounds: Vec<u8>,
    receivers: Option<[Vec<u8>; 2]>,
    covered: u32,
}

/// All that one tile adds.
#[derive(Debug, Serialize, Deserialize)]
pub struct FieldTile {
    /// Response to the patches.
    pub response: TileBytes,
    /// The tile's block of BNCE, empty if no light comes from the bounce points.
    pub bounce: Vec<u8>,
    /// Coverage of the covered pixels, in mask order.
    pub coverage: Vec<u8>,
    /// The tile's block of FRAG.
    pub fragments: Vec<u8>,
    /// The tile's records of GLSS, empty if nothing gleams.
    pub gloss: Vec<u8>,
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
        self.gloss_places.extend_from_slice(&((self.gloss.len() / GLOSS) as u32).to_le_bytes());
        self.gloss.extend_from_slice(&tile.gloss);
        let place = if tile.way_back.is_empty() { NO_WAY } else { append(&mut self.way_blocks, &tile.way_back) };
        self.way_places.extend_from_slice(&place.to_le_bytes());
    }

    /// Sets the basis of the bounds, BNDB.
    pub fn set_bound_basis(&mut self, basis: Vec<u8>) {
        self.bound_basis = basis;
    }

    /// Sets the receivers, RCVW and RCVO.
    pub fn set_receivers(&mut self, with: Vec<u8>, without: Vec<u8>) {
        self.receivers = Some([with, without]);
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
    pub fn into_bytes(self, header: Header, scene: [Vec<u8>; 3], meta: &str) -> Vec<u8> {
        self.into_draft(header, scene).finish(meta)
    }

    /// The file but for its META, which may tell what only the whole field shows.
    pub fn into_draft(mut self, mut header: Header, scene: [Vec<u8>; 3]) -> Draft {
        header.covered = self.covered;
        self.blocks.extend_from_slice(&((self.fragments.len() / 4) as u32).to_le_bytes());
        self.bounce_places.extend_from_slice(&((self.bounce.len() / 4) as u32).to_le_bytes());
        let (response, [casters, nodes, points]) = (self.response, scene);
        let mut layers: Vec<(LayerKind, u32, Vec<u8>)> = vec![
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
        ];
        if !self.gloss.is_empty() {
            self.gloss_places.extend_from_slice(&((self.gloss.len() / GLOSS) as u32).to_le_bytes());
            layers.push((*b"GLST", LAYER_CRITICAL, self.gloss_places));
            layers.push((*b"GLSS", LAYER_CRITICAL, self.gloss));
        }
        if let Some([with, without]) = self.receivers {
            layers.push((*b"RCVW", 0, with));
            layers.push((*b"RCVO", 0, without));
        }
        if let Some(lens) = &header.camera.lens {
            layers.push((*b"LENS", LAYER_CRITICAL, lens.encode().to_vec()));
        }
        if let Some(list) = header.patches.listed() {
            layers.push((*b"DIRS", LAYER_CRITICAL, directions(list)));
        }
        if let Some(cells) = header.patches.subdivided() {
            layers.push((*b"CUTS", LAYER_CRITICAL, cells.layer().to_vec()));
        }
        Draft::new(header, layers)
    }
}

/// The layer DIRS.
fn directions(list: &Listed) -> Vec<u8> {
    let entries = (0..list.len()).flat_map(|patch| list.encode_entry(patch));
    list.encode_head().into_iter().chain(entries).collect()
}

/// A field file whose last layer, META, is empty as yet: a sound field already.
#[derive(Debug)]
pub struct Draft {
    header: Header,
    table: Vec<u8>,
    file: Vec<u8>,
}

impl Draft {
    /// Header, table and aligned layers; each layer's memory is given back once it is copied.
    pub fn new(header: Header, layers: Vec<(LayerKind, u32, Vec<u8>)>) -> Self {
        let first = (HEADER + (layers.len() + 1) * LAYER_ENTRY).next_multiple_of(LAYER_ALIGN);
        let whole = layers.iter().fold(first, |end, (_, _, bytes)| (end + bytes.len()).next_multiple_of(LAYER_ALIGN));
        let mut draft = Draft { header, table: Vec::new(), file: Vec::with_capacity(whole + META_ROOM) };
        draft.file.resize(first, 0);
        for (kind, flags, bytes) in layers {
            draft.push(kind, flags, &bytes);
        }
        draft.push(*b"META", 0, &[]);
        draft.seal();
        draft
    }

    fn push(&mut self, kind: LayerKind, flags: u32, bytes: &[u8]) {
        let (offset, length, crc32) = (self.file.len() as u64, bytes.len() as u64, crc32fast::hash(bytes));
        self.table.extend_from_slice(&Layer { kind, flags, offset, length, crc32 }.encode());
        self.file.extend_from_slice(bytes);
        self.file.resize(self.file.len().next_multiple_of(LAYER_ALIGN), 0);
    }

    /// Puts header and table in front.
    fn seal(&mut self) {
        let header = self.header.encode(self.file.len() as u64, &self.table);
        self.file[..HEADER].copy_from_slice(&header);
        self.file[HEADER..HEADER + self.table.len()].copy_from_slice(&self.table);
    }

    /// The bytes of the field so far.
    pub fn bytes(&self) -> &[u8] {
        &self.file
    }

    /// The whole file, with this META.
    pub fn finish(mut self, meta: &str) -> Vec<u8> {
        self.table.truncate(self.table.len() - LAYER_ENTRY);
        self.push(*b"META", 0, meta.as_bytes());
        self.seal();
        self.file
    }
}

/// Room for META, so that the file need not move when it comes, bytes.
const META_ROOM: usize = 1 << 14;

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
