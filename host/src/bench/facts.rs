//! What a field says about itself that the bench reports: covered pixels and bytes read.

use relume_firmware::field::Field;
use relume_firmware::kernel::Kernel;
use relume_firmware::levels::apart;
use relume_firmware::tile::{TILE_PX, TILE_RECORD};
use relume_firmware::weights::{Apart, LightApart, MOST_STANDOUTS};

use super::method::BenchSky;

/// Places `y * width + x` of all covered pixels, ascending: the order of everything the bench compares.
pub fn covered(field: &Field<'_>) -> Vec<u32> {
    let (tiles, width) = (field.response(), field.width());
    let (across, _) = tiles.grid();
    let mut places: Vec<u32> = Vec::with_capacity(tiles.covered());
    for index in 0..tiles.tiles() {
        let (x0, y0) = (index % across * TILE_PX, index / across * TILE_PX);
        let place = |at: usize| ((y0 + at / TILE_PX) * width + x0 + at % TILE_PX) as u32;
        places.extend(tiles.tile(index).covered().map(place));
    }
    places.sort_unstable();
    places
}

/// Bytes that one full frame reads with at most `max_rank` ranks: records, U, V, scales and coverage of every tile with
/// covered pixels, all patches lit, and with `sun` the traced response to the sun (three u16 per padded pixel).
pub fn bytes_read(field: &Field<'_>, max_rank: usize, sun: bool) -> usize {
    let tiles = field.response();
    (0..tiles.tiles())
        .map(|index| {
            let tile = tiles.tile(index);
            if tile.pixels() == 0 {
                return TILE_RECORD;
            }
            let rank = tile.rank().min(max_rank.saturating_add(max_rank % 2));
            let pixels = tile.padded_pixels();
            let planes = if sun { 12 } else { 6 };
            let coverage = field.coverage(index).map_or(0, <[u8]>::len);
            TILE_RECORD + rank * pixels + planes * pixels + coverage
        })
        .chain((0..tiles.blocks()).map(|block| tiles.v_bytes(block)))
        .sum()
}

/// Bytes of the way back that a full frame reads under a sky: the rows of the patches that outshine it.
pub fn way_back_bytes(field: &Field<'_>, sky: &BenchSky) -> usize {
    let mut room = [Apart::default(); MOST_STANDOUTS];
    let LightApart::Some(patches) = apart(0, field, &sky.weights.radiance, Kernel::detect(), &mut room) else {
        return 0;
    };
    let tiles = field.response();
    let rows = |index: usize, patch: u16| field.way_back().get(&tiles.tile(index), usize::from(patch));
    let places = patches.iter().flat_map(|apart| (0..tiles.tiles()).map(move |index| (index, apart.patch)));
    places.filter_map(|(index, patch)| rows(index, patch)).map(|rows| rows.bytes()).sum()
}
