//! Fields of closed-form responses that are hard on numbers, with the uncompressed response kept beside them.

use relume_bake::blocks::{BlockCompressor, BlockTile};
use relume_bake::compress::Whites;
use relume_bake::prior::Prior;
use relume_bake::response::TileResponse;
use relume_bake::scene::Scene;
use relume_bake::sunlayers::CasterLayers;
use relume_bake::write::FieldWriter;
use relume_firmware::bouncepoint::POINT_GRID;
use relume_firmware::field::{CameraRecord, Field, Header};
use relume_firmware::patches::PatchSet;
use relume_firmware::tile::{BLOCK_TILES, TILE_PX};

/// What a tile is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Matter {
    /// A tinted ground whose sky is cut by a plane that turns from pixel to pixel.
    Street,
    /// Each pixel sees one patch alone.
    OnePatch,
    /// Neighbouring patches and pixels differ by signs without pattern: what compression leaves out alternates.
    Checkers,
    /// Nothing comes back.
    Black,
    /// No blue comes back.
    NoBlue,
    /// Only red comes back.
    OnlyRed,
    /// A street with every third row of pixels black, and some channels of others.
    BlackRows,
    /// A street from 1e-6 to 1e6 of its light.
    Decades,
    /// A street a thousand times as dark, with a smooth ramp over its pixels.
    Dim,
    /// Every other pixel covered, by half.
    Holes,
    /// No geometry.
    Empty,
}

/// A field in memory and the response it was made from.
pub struct StressField {
    /// The patches.
    pub patches: PatchSet,
    /// Width and height, px.
    pub size: (u32, u32),
    /// What each tile is made of.
    pub matter: Vec<Matter>,
    /// The file.
    pub bytes: Vec<u8>,
    /// Per tile `[covered pixel][3][patch]`.
    pub responses: Vec<Vec<f32>>,
}

/// A whole number from any, without pattern.
pub fn scatter(x: u32) -> u32 {
    let x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    let x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

impl Matter {
    /// Coverage of pixel `(x, y)` of the picture; its response times `scale` is added to `out`, `[3][patch]`.
    fn respond(self, patches: &PatchSet, (x, y): (u32, u32), scale: f32, out: &mut Vec<f32>) -> f32 {
        let covered = match self {
            Matter::Empty => 0.0,
            Matter::Holes if (x + y) % 2 == 0 => 0.0,
            Matter::Holes => 0.5,
            _ => 1.0,
        };
        let within = y % 16 * 16 + x % 16;
        let all = match self {
            Matter::Decades => 10f32.powf(12.0 * within as f32 / 255.0 - 6.0),
            Matter::Dim => 1e-3 * (1.0 + within as f32 / 64.0),
            Matter::BlackRows if y % 3 == 1 => 0.0,
            _ => 1.0,
        };
        for (c, albedo) in [0.7f32, 0.5, 0.3].into_iter().enumerate() {
            let tint = match self {
                Matter::Black => 0.0,
                Matter::NoBlue if c == 2 => 0.0,
                Matter::OnlyRed if c > 0 => 0.0,
                Matter::BlackRows if (x as usize + c).is_multiple_of(5) => 0.0,
                _ => albedo,
            };
            if covered > 0.0 {
                let seen = |patch: usize| self.seen(patches, patch, within);
                out.extend((0..patches.len()).map(|patch| seen(patch) * tint * all * covered * scale));
            }
        }
        covered
    }

    /// Response to a patch of an untinted pixel.
    fn seen(self, patches: &PatchSet, patch: usize, within: u32) -> f32 {
        let d = patches.dir_world(patch);
        let cosine = d[1].max(0.0) * patches.solid_angle_sr(patch) / std::f32::consts::PI;
        let turn = within as f32 / 40.0;
        let height = d[0] * turn.cos() + d[2] * turn.sin() - 0.4 * d[1];
        let open = (0.5 - 6.0 * height).clamp(0.0, 1.0) * cosine + 0.01 * patches.solid_angle_sr(patch);
        match self {
            Matter::OnePatch if (within as usize * 7 + 3) % patches.len() == patch => 1.0,
            Matter::OnePatch => 0.0,
            Matter::Checkers => open * if scatter(within * 5003 + patch as u32) & 1 == 0 { 1.5 } else { 0.5 },
            _ => open,
        }
    }
}

impl StressField {
    /// A field of `upper` patches above the horizon and `size` px that aims at `error`; its tiles are of `matter`, again
    /// and again, and their responses `scale` times what they would be.
    ///
    /// # Panics
    /// If the writer and the reader of fields contradict each other.
    pub fn new(upper: usize, size: (u32, u32), error: f64, matter: &[Matter], scale: f32) -> Self {
        let patches = PatchSet::new(upper).expect("a patch count in range");
        let (edge, block) = (TILE_PX as u32, BLOCK_TILES as u32);
        let (columns, rows) = (size.0.div_ceil(edge), size.1.div_ceil(edge));
        let matter: Vec<Matter> = matter.iter().copied().cycle().take((columns * rows) as usize).collect();
        let tile = |index: usize| {
            let at = (index as u32 % columns, index as u32 / columns);
            tile_response(&patches, at, size, matter[index], scale)
        };
        let responses: Vec<Vec<f32>> = (0..matter.len()).map(|index| tile(index).response).collect();
        let whites = Whites::of(&responses.concat(), patches.len());
        let compressor =
            BlockCompressor::new(Prior::skies(&patches), error, whites, CasterLayers::new(&Scene::default()));
        let mut writer = FieldWriter::default();
        writer.set_bound_basis(compressor.bound_basis_bytes());
        let mut tiles = Vec::new();
        for (by, bx) in (0..rows.div_ceil(block)).flat_map(|y| (0..columns.div_ceil(block)).map(move |x| (y, x))) {
            let places = (by * block..rows.min(by * block + block))
                .flat_map(|y| (bx * block..columns.min(bx * block + block)).map(move |x| (x, y)));
            let of_block =
                places.map(|at| BlockTile { at, response: tile((at.1 * columns + at.0) as usize), bounce: Vec::new() });
            let found = compressor.block(of_block.collect());
            writer.push_bound(&found.bound);
            tiles.extend(found.tiles);
        }
        tiles.sort_by_key(|tile| (tile.at.1, tile.at.0));
        tiles.into_iter().for_each(|tile| writer.push(tile));
        let layers = [compressor.casters.casters, compressor.casters.nodes, vec![0; POINT_GRID]];
        let bytes = writer.into_bytes(header(patches, size, error), layers, "{}");
        StressField { patches, size, matter, bytes, responses }
    }

    /// The checked field.
    ///
    /// # Panics
    /// If the reader refuses it.
    pub fn field(&self) -> Field<'_> {
        Field::new(&self.bytes).expect("a field that the reader takes")
    }
}

fn header(patches: PatchSet, (width, height): (u32, u32), error: f64) -> Header {
    let camera = CameraRecord {
        position: [0.0; 3],
        target: [0.0, 0.0, -1.0],
        up: [0.0, 1.0, 0.0],
        fov_y_deg: 45.0,
        north_deg: 0.0,
        lens: None,
    };
    let error_target = error as f32;
    Header { width, height, patches, covered: 0, camera, error_target, site: None, seed: 0, max_hits: 0 }
}

fn tile_response(patches: &PatchSet, at: (u32, u32), size: (u32, u32), matter: Matter, scale: f32) -> TileResponse {
    let edge = TILE_PX as u32;
    let (x0, y0) = (at.0 * edge, at.1 * edge);
    let (w, h) = ((size.0 - x0).min(edge), (size.1 - y0).min(edge));
    let mut response = Vec::new();
    let pixels = (0..h).flat_map(|y| (0..w).map(move |x| (x0 + x, y0 + y)));
    let coverage: Vec<f32> = pixels.map(|pixel| matter.respond(patches, pixel, scale, &mut response)).collect();
    let covered: Vec<u16> = (0..(w * h) as u16).filter(|&k| coverage[usize::from(k)] > 0.0).collect();
    let fragments = vec![Vec::new(); covered.len()];
    TileResponse { x0, y0, w, h, patches: patches.len(), coverage, covered, response, indirect: Vec::new(), fragments }
}
