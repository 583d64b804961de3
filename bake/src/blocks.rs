//! Responses of a block's tiles -> its compressed tiles, bound and way back.

use crate::compress::{Compressed, Target, Whites, block_bound, bound_basis, compress_block, tile_rows};
use crate::encode::{TileBytes, bound_record, mask_of, way_block};
use crate::prior::Prior;
use crate::response::TileResponse;
use crate::sunlayers::{CasterLayers, gloss_records};
use crate::write::FieldTile;
use nalgebra::DMatrix;
use relume_firmware::bound::GROUP;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// A block ready to be written.
#[derive(Debug, Serialize, Deserialize)]
pub struct FieldBlock {
    /// Its record of BNDT.
    pub bound: Vec<u8>,
    /// Its tiles, row by row.
    pub tiles: Vec<FieldTile>,
    /// Light of its covered pixels under an even sky of radiance 1, summed over pixels, mean of the channels.
    pub light: f64,
}

/// One tile of a block.
#[derive(Debug)]
pub struct BlockTile {
    /// Column and row.
    pub at: (u32, u32),
    /// Its response.
    pub response: TileResponse,
    /// Its block of BNCE.
    pub bounce: Vec<u8>,
}

/// Turns responses into bytes.
pub struct BlockCompressor {
    skies: Prior,
    target: Target,
    basis: DMatrix<f32>,
    patches: usize,
    whites: Whites,
    /// Layers of direct sunlight.
    pub casters: CasterLayers,
}

impl BlockCompressor {
    /// A compressor for fields that aims at `error` ([`Target::error`]) under the light of a prior.
    pub fn new(skies: Prior, error: f64, whites: Whites, casters: CasterLayers) -> Self {
        let target = Target { error, ..Target::default() };
        BlockCompressor { basis: bound_basis(&skies), patches: skies.patches(), skies, target, whites, casters }
    }

    /// BNDB.
    pub fn bound_basis_bytes(&self) -> Vec<u8> {
        let modes = self.basis.ncols();
        let dims = modes + self.patches.div_ceil(GROUP);
        let head = [modes, GROUP, dims, 0].into_iter().flat_map(|value| (value as u32).to_le_bytes());
        head.chain(self.basis.iter().flat_map(|value| value.to_le_bytes())).collect()
    }

    /// Compresses the tiles of one block.
    pub fn block(&self, tiles: Vec<BlockTile>) -> FieldBlock {
        let patches = self.patches;
        let response: Vec<f32> = tiles.iter().flat_map(|tile| tile.response.response.iter().copied()).collect();
        let counts: Vec<usize> = tiles.iter().map(|tile| tile.response.covered.len()).collect();
        let sky = compress_block(&response, patches, &counts, &self.skies, &self.target);
        let (mut written, mut row_tops) = (Vec::with_capacity(tiles.len()), Vec::with_capacity(sky.pixels));
        let mut first = 0;
        for tile in tiles {
            let pixels = first..first + tile.response.covered.len();
            first = pixels.end;
            let tile = self.tile(tile, pixels.clone(), &response, &sky);
            row_tops.resize(pixels.end, tile.response.row_top());
            written.push(tile);
        }
        let bound = block_bound(&response, patches, &sky, &row_tops, &self.skies, &self.basis);
        let light = response.iter().map(|&r| f64::from(r)).sum::<f64>() / 3.0;
        FieldBlock { light, bound: bound_record(&bound, self.basis.ncols(), patches), tiles: written }
    }

    fn tile(&self, tile: BlockTile, pixels: Range<usize>, response: &[f32], sky: &Compressed) -> FieldTile {
        let BlockTile { at, response: own, bounce } = tile;
        let mask = mask_of(&own.covered, own.w.max(1));
        let encoded = TileBytes::new(sky, pixels.clone(), mask, self.patches);
        let way_back = if pixels.is_empty() {
            Vec::new()
        } else {
            way_block(&tile_rows(response, &self.whites, sky, pixels.clone(), encoded.row_top()), pixels.len())
        };
        let coverage = own.covered.iter().map(|&at| own.coverage[usize::from(at)]);
        FieldTile {
            at,
            way_back,
            response: encoded,
            bounce,
            // A pixel in the mask is covered, however little.
            coverage: coverage.map(|share| (share * 255.0).round().clamp(1.0, 255.0) as u8).collect(),
            fragments: self.casters.fragments(&own.fragments),
            gloss: gloss_records(&own.fragments),
        }
    }
}
