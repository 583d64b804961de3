//! Responses of a block's tiles -> its compressed tiles, bound and way back.

use crate::compress::{Compressed, Target, block_bound, bound_basis, compress_block, tile_rows};
use crate::encode::{TileBytes, bound_record, mask_of, way_block};
use crate::prior::Prior;
use crate::response::TileResponse;
use crate::sunlayers::CasterLayers;
use crate::write::FieldTile;
use nalgebra::DMatrix;
use relume_firmware::bound::GROUP;
use relume_firmware::patches::PatchSet;
use std::ops::Range;

/// A block ready to be written.
#[derive(Debug)]
pub struct FieldBlock {
    /// Its record of BNDT.
    pub bound: Vec<u8>,
    /// Its tiles, row by row.
    pub tiles: Vec<FieldTile>,
}

/// Turns responses into bytes.
pub struct BlockCompressor {
    skies: Prior,
    suns: Prior,
    target: Target,
    sun_target: Target,
    basis: DMatrix<f32>,
    patches: usize,
    /// Layers of direct sunlight.
    pub casters: CasterLayers,
}

/// Indirect sunlight is a fifth of the light or less, and its interpolation is no better than this.
const SUN_INDIRECT_ERROR: f64 = 0.02;
const SUN_INDIRECT_RANK: usize = 8;

impl BlockCompressor {
    /// A compressor for fields of this patch set that aims at `error` ([`Target::error`]).
    pub fn new(patches: &PatchSet, error: f64, casters: CasterLayers) -> Self {
        let skies = Prior::skies(patches);
        BlockCompressor {
            basis: bound_basis(&skies),
            skies,
            suns: Prior::sun_interpolation(patches),
            target: Target { error, ..Target::default() },
            sun_target: Target { error: SUN_INDIRECT_ERROR, max_rank: SUN_INDIRECT_RANK },
            patches: patches.len(),
            casters,
        }
    }

    /// BNDB.
    pub fn bound_basis_bytes(&self) -> Vec<u8> {
        let modes = self.basis.ncols();
        let dims = modes + self.patches.div_ceil(GROUP);
        let head = [modes, GROUP, dims, 0].into_iter().flat_map(|value| (value as u32).to_le_bytes());
        head.chain(self.basis.iter().flat_map(|value| value.to_le_bytes())).collect()
    }

    /// Compresses the tiles of one block, given with their column and row.
    pub fn block(&self, tiles: &[((u32, u32), TileResponse)]) -> FieldBlock {
        let patches = self.patches;
        let response: Vec<f32> = tiles.iter().flat_map(|(_, tile)| tile.response.iter().copied()).collect();
        let indirect: Vec<f32> = tiles.iter().flat_map(|(_, tile)| tile.indirect.iter().copied()).collect();
        let counts: Vec<usize> = tiles.iter().map(|(_, tile)| tile.covered.len()).collect();
        let sky = compress_block(&response, patches, &counts, &self.skies, &self.target);
        let sun = compress_block(&indirect, patches, &counts, &self.suns, &self.sun_target);
        let (mut written, mut row_tops) = (Vec::with_capacity(tiles.len()), Vec::with_capacity(sky.pixels));
        let mut first = 0;
        for (at, tile) in tiles {
            let pixels = first..first + tile.covered.len();
            first = pixels.end;
            let (tile, row_top) = self.tile(*at, tile, pixels.clone(), &response, &sky, &sun);
            row_tops.resize(pixels.end, row_top);
            written.push(tile);
        }
        let bound = block_bound(&response, patches, &sky, &row_tops, &self.skies, &self.basis);
        FieldBlock { bound: bound_record(&bound, self.basis.ncols(), patches), tiles: written }
    }

    fn tile(
        &self,
        at: (u32, u32),
        tile: &TileResponse,
        pixels: Range<usize>,
        response: &[f32],
        sky: &Compressed,
        sun: &Compressed,
    ) -> (FieldTile, [f32; 3]) {
        let mask = mask_of(&tile.covered, tile.w.max(1));
        let encode = |block: &Compressed| TileBytes::new(block, pixels.clone(), mask, self.patches);
        let coverage = tile.covered.iter().map(|&at| tile.coverage[usize::from(at)]);
        let encoded = encode(sky);
        let row_top = encoded.row_top();
        let way_back = if pixels.is_empty() {
            Vec::new()
        } else {
            way_block(&tile_rows(response, self.patches, sky, pixels.clone(), row_top), pixels.len())
        };
        let tile = FieldTile {
            at,
            way_back,
            response: encoded,
            sun_indirect: encode(sun),
            // A pixel in the mask is covered, however little.
            coverage: coverage.map(|share| (share * 255.0).round().clamp(1.0, 255.0) as u8).collect(),
            fragments: self.casters.fragments(&tile.fragments),
        };
        (tile, row_top)
    }
}
