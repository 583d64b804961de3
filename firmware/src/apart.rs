//! Patches apart: their own rows -> light beside that of the factors.

use crate::field::Field;
use crate::kernel::{Kernel, RowsLight, UNIT_LIMIT};
use crate::relight::{LinearTile, TileLight};
use crate::tile::{TILE_PIXELS, Tile};
use crate::wayback::{PatchRows, RowCodes, RowFacts};
use crate::weights::Apart;

/// Patches that are added at once.
const AT_ONCE: usize = 8;

/// Unpacked rows of one patch in all tiles: they cost little while the patch stays apart from frame to frame.
#[derive(Clone, Copy, Debug)]
pub struct UnpackedRows<'a> {
    /// Patch.
    pub patch: u16,
    /// Codes, laid out like the row scales; whatever where they do not fit bytes.
    pub codes: &'a [u8],
    /// `[tile]`; all 0 where a tile has no rows.
    pub facts: &'a [RowFacts],
}

impl<'a> UnpackedRows<'a> {
    /// A patch's out of `all`, where they most likely lie at `place`.
    pub fn of<'l>(all: &'l [UnpackedRows<'a>], place: usize, patch: u16) -> Option<&'l UnpackedRows<'a>> {
        let is_it = |unpacked: &&UnpackedRows<'_>| unpacked.patch == patch;
        all.get(place).filter(is_it).or_else(|| all.iter().find(is_it))
    }

    /// Unpacks the rows of `patch` in a tile into its slot of `codes`, `[3][padded pixels]`.
    pub fn unpack(field: &Field<'_>, tile: &Tile<'_>, patch: u16, kernel: Kernel, slot: &mut [u8]) -> RowFacts {
        let Some(rows) = field.way_back().get(tile, usize::from(patch)) else { return RowFacts::default() };
        let facts = rows.facts();
        if facts.fit_bytes() && facts.top > 0 {
            rows.decode_bytes(kernel, slot);
        }
        facts
    }
}

/// What is known of a patch's rows in a tile, from `unpacked` if they are there ([`UnpackedRows::of`]); all 0 without rows.
pub fn row_facts(
    (field, tile): (&Field<'_>, &Tile<'_>),
    unpacked: &[UnpackedRows<'_>],
    place: usize,
    patch: u16,
) -> RowFacts {
    match UnpackedRows::of(unpacked, place, patch) {
        Some(unpacked) => unpacked.facts[tile.index],
        None => field.way_back().get(tile, patch.into()).map_or(RowFacts::default(), |rows| rows.facts()),
    }
}

/// Writes the light of the patches that are set apart, by their own rows; `false` if there is none here.
pub fn add_rows(
    field: &Field<'_>,
    tile: &Tile<'_>,
    light: &TileLight<'_>,
    kernel: Kernel,
    out: &mut LinearTile,
) -> bool {
    let is_unpacked = |(place, apart): (usize, Apart)| UnpackedRows::of(light.unpacked, place, apart.patch).is_some();
    if light.weights.apart().enumerate().all(is_unpacked) {
        return light.weights.apart().next().is_some() && add_with((field, tile), light, kernel, &mut [], out);
    }
    let mut room = [[0; 3 * TILE_PIXELS]; AT_ONCE];
    add_with((field, tile), light, kernel, &mut room, out)
}

/// The same with room to unpack [`AT_ONCE`] patches, or none where all are unpacked.
fn add_with(
    (field, tile): (&Field<'_>, &Tile<'_>),
    light: &TileLight<'_>,
    kernel: Kernel,
    room: &mut [[u8; 3 * TILE_PIXELS]],
    out: &mut LinearTile,
) -> bool {
    let n = tile.padded_pixels();
    let (mut any, mut shining) = (false, Shining::default());
    for (place, Apart { patch, light: weight }) in light.weights.apart().enumerate() {
        let unpacked = UnpackedRows::of(light.unpacked, place, patch);
        let packed = || field.way_back().get(tile, patch.into());
        let facts = unpacked.map(|unpacked| unpacked.facts[tile.index]).or_else(|| Some(packed()?.facts()));
        let Some(facts) = facts.filter(|facts| facts.top > 0) else { continue };
        if !any {
            out.planes(n).into_iter().for_each(|plane| plane.fill(0.0));
            any = true;
        }
        let unit = core::array::from_fn(|c| (facts.unit * weight[c] * tile.row_unit(c)).min(UNIT_LIMIT));
        if !facts.fit_bytes() {
            packed().into_iter().for_each(|rows| add_wide(&rows, &unit, tile, out));
            continue;
        }
        let slot = unpacked.map(|unpacked| &unpacked.codes[tile.plane_at..tile.plane_at + 3 * n]);
        if let Some(rows) = slot.is_none().then(packed).flatten() {
            rows.decode_bytes(kernel, &mut room[shining.count][..3 * n]);
        }
        shining.push(slot, unit);
        if shining.count == AT_ONCE {
            shining.add(kernel, room, tile, out);
        }
    }
    shining.add(kernel, room, tile, out);
    any
}

/// Patches whose light waits to be added: where their codes are, if not in the room of their number, and their units.
#[derive(Default)]
struct Shining<'a> {
    patches: [(Option<&'a [u8]>, [f32; 3]); AT_ONCE],
    count: usize,
}

impl<'a> Shining<'a> {
    fn push(&mut self, codes: Option<&'a [u8]>, unit: [f32; 3]) {
        self.patches[self.count] = (codes, unit);
        self.count += 1;
    }

    /// Adds them, and waits for others.
    fn add(&mut self, kernel: Kernel, room: &[[u8; 3 * TILE_PIXELS]], tile: &Tile<'_>, out: &mut LinearTile) {
        let n = tile.padded_pixels();
        let light = |k: usize| match self.patches[k] {
            (Some(codes), unit) => RowsLight { codes, unit },
            (None, unit) => RowsLight { codes: room.get(k).map_or(&[], |codes| &codes[..3 * n]), unit },
        };
        let lights: [RowsLight<'_>; AT_ONCE] = core::array::from_fn(light);
        if self.count > 0 {
            kernel.add_rows(&lights[..self.count], tile.rows, out.planes(n));
        }
        self.count = 0;
    }
}

/// Adds light of codes that do not fit bytes: of one patch in a thousand, the same way for all kernels.
fn add_wide(rows: &PatchRows<'_>, unit: &[f32; 3], tile: &Tile<'_>, out: &mut LinearTile) {
    let mut codes = RowCodes::default();
    rows.decode(&mut codes);
    for (c, plane) in out.planes(tile.padded_pixels()).into_iter().enumerate() {
        for ((value, &code), row) in plane.iter_mut().zip(&codes.0[c]).zip(tile.row_codes(c)) {
            let code = f32::from(code);
            *value += code * code * unit[c] * f32::from(row);
        }
    }
}
