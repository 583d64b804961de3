//! Sunlight for any direction: the direct part traced through the geometry the field carries (casters.rs, direct.rs), the
//! indirect part passed on from the points where the sun is looked for (bounce.rs).
//!
//! ```text
//! FRGT  u32 per tile and one more: where the tile's block begins in FRAG, in units of 4 bytes
//! FRAG  per tile: u8 fragments of each covered pixel, filled up to a multiple of 4; then 12 bytes per fragment
//!    0 u32 caster   4 u16 strata: bit s is set where point s of the pixel (pixelpoints.rs) sees the caster
//!    6 u16[3] albedo times share of the pixel, in 1/32768
//! GLST GLSS  what of it gleams (gloss.rs); may be left out
//! ```

use crate::bounce::Rgb;
use crate::casters::Casters;
use crate::direct::{SunDisc, ViewRays, direct_pixel, glossy_pixel};
use crate::field::{Field, FieldError};
use crate::gloss::{GLOSS, GlossLayer};
use crate::header::u32_at;
use crate::tile::{TILE_PIXELS, TILE_PX, TileSet, padded};
use crate::vector::Vec3;

/// Length of a fragment, bytes.
pub const FRAGMENT: usize = 12;

/// Checked layers of the direct sunlight.
#[derive(Clone, Copy, Debug)]
pub struct SunSurfaces<'a> {
    casters: Casters<'a>,
    blocks: &'a [u8],
    fragments: &'a [u8],
    gloss: Option<GlossLayer<'a>>,
}

impl<'a> SunSurfaces<'a> {
    pub(crate) fn check(
        [casters, nodes, blocks, fragments]: [&'a [u8]; 4],
        gloss: Option<[&'a [u8]; 2]>,
        response: &TileSet<'_>,
    ) -> Result<Self, FieldError> {
        let mut surfaces = SunSurfaces { casters: Casters::check(casters, nodes)?, blocks, fragments, gloss: None };
        if blocks.len() != (response.tiles() + 1) * 4 {
            return Err(FieldError::Invalid("length of a sunlight layer"));
        }
        for tile in 0..response.tiles() {
            surfaces.check_block(tile, response.tile(tile).pixels())?;
        }
        if let Some([places, records]) = gloss {
            let count = |tile: usize| surfaces.fragments(tile, response.tile(tile).pixels()).1.len() / FRAGMENT;
            surfaces.gloss = Some(GlossLayer::check(places, records, response.tiles(), count)?);
        }
        Ok(surfaces)
    }

    fn check_block(&self, tile: usize, pixels: usize) -> Result<(), FieldError> {
        let bad = FieldError::Invalid("sunlight fragments");
        let (from, to) = (u32_at(self.blocks, tile * 4) as usize * 4, u32_at(self.blocks, tile * 4 + 4) as usize * 4);
        let block = self.fragments.get(from..to).ok_or(bad)?;
        let counts = block.get(..pixels).ok_or(bad)?;
        let total: usize = counts.iter().map(|&c| usize::from(c)).sum();
        let fragments = block.get(pixels.next_multiple_of(4)..).ok_or(bad)?;
        let known = |fragment: &[u8]| (u32_at(fragment, 0) as usize) < self.casters.len();
        let good = fragments.len() == total * FRAGMENT && fragments.chunks_exact(FRAGMENT).all(known);
        if good { Ok(()) } else { Err(bad) }
    }

    /// What throws the shadows.
    pub fn casters(&self) -> Casters<'a> {
        self.casters
    }

    /// Does any surface gleam in the sun?
    pub fn is_glossy(&self) -> bool {
        self.gloss.is_some()
    }

    fn fragments(&self, tile: usize, pixels: usize) -> (&'a [u8], &'a [u8]) {
        let (from, to) = (u32_at(self.blocks, tile * 4) as usize * 4, u32_at(self.blocks, tile * 4 + 4) as usize * 4);
        let block = &self.fragments[from..to];
        (&block[..pixels], &block[pixels.next_multiple_of(4)..])
    }
}

/// Makes the sun's response plane tile by tile for one direction of the sun.
///
/// First [`SunLight::points`] looks at the sun from every bounce point, [`crate::bounce::mean_up`] sums that up once, and
/// then [`SunLight::tile`] makes each tile.
#[derive(Clone, Debug)]
pub struct SunLight {
    disc: SunDisc,
    rays: ViewRays,
}

impl SunLight {
    /// For a field and a unit direction towards the sun, above the horizon.
    pub fn new(field: &Field<'_>, dir_world: Vec3) -> Self {
        SunLight { disc: SunDisc::new(dir_world), rays: ViewRays::new(field.camera(), field.width(), field.height()) }
    }

    /// Writes the cosine times the visibility of the sun times the tint for bounce points `first..first + out.len()`.
    pub fn points(&self, field: &Field<'_>, first: usize, out: &mut [Rgb]) {
        field.bounce().light(&field.sun_surfaces().casters, &self.disc, first, out);
    }

    /// Writes one tile's slot (`[3][padded pixels]`, u16 in 1/32768) of the sun's response plane. `means` is what
    /// [`crate::bounce::mean_up`] made of the light on the bounce points.
    pub fn tile(&self, field: &Field<'_>, tile: usize, means: &[Rgb], slot: &mut [u16]) {
        let response = field.response();
        let (columns, _) = response.grid();
        let (x0, y0) = (tile % columns * TILE_PX, tile / columns * TILE_PX);
        let mask = response.tile(tile);
        let n = padded(mask.pixels());
        if n == 0 || slot.len() < 3 * n {
            return;
        }
        let mut indirect = [[0.0f32; TILE_PIXELS]; 3];
        field.bounce().tile(tile, mask.pixels(), means, &mut indirect);
        let surfaces = field.sun_surfaces();
        let (counts, mut fragments) = surfaces.fragments(tile, mask.pixels());
        let mut gloss = surfaces.gloss.map(|layer| layer.tile(tile));
        for (k, pixel) in mask.covered().enumerate() {
            let (own, rest) = fragments.split_at(usize::from(counts[k]) * FRAGMENT);
            fragments = rest;
            let at = (x0 + pixel % TILE_PX, y0 + pixel / TILE_PX);
            let direct = match &mut gloss {
                None => direct_pixel(&surfaces.casters, own, &self.rays, &self.disc, at),
                Some(records) => {
                    let (lobes, rest) = records.split_at(usize::from(counts[k]) * GLOSS);
                    *records = rest;
                    glossy_pixel(&surfaces.casters, (own, lobes), &self.rays, &self.disc, at)
                }
            };
            for c in 0..3 {
                slot[c * n + k] = libm::rintf((direct[c] + indirect[c][k]) * 32768.0).min(65535.0) as u16;
            }
        }
    }
}
