//! A painted mask: what really stands in front of the picture and is in no model, such as trees and railings.

use super::ViewError;
use crate::damage::Damage;
use relume_firmware::shade::{log_factor, shaded};
use relume_firmware::surface::xrgb;
use relume_firmware::tile::TILE_PX;
use relume_firmware::tone::{ViewLight, code};
use std::path::Path;

/// Where the view is shown over the picture.
#[derive(Clone)]
pub struct Mask {
    width: usize,
    /// Shares of the view in 255ths, row 0 at the top.
    shares: Vec<u8>,
    /// Tiles that have any.
    tiles: Vec<usize>,
    light: ViewLight,
    /// What stands in front in today's light, where the view is a still of another; empty: as the view shows it.
    relit: Vec<u32>,
}

impl Mask {
    /// Reads a grey PNG or JPEG of the field's size: white where something stands in front.
    ///
    /// # Errors
    /// [`ViewError`]: it cannot be read, or has another size.
    pub fn load_sized(path: &Path, width: usize, height: usize) -> Result<Self, ViewError> {
        let unreadable = |reason: String| ViewError::Read { path: path.to_path_buf(), reason };
        let picture = super::decode(path).map_err(|e| unreadable(e.to_string()))?.into_luma8();
        let found = (picture.width() as usize, picture.height() as usize);
        if found != (width, height) {
            return Err(ViewError::Size { path: path.to_path_buf(), found, field: (width, height) });
        }
        Ok(Mask::new(width, picture.into_raw()))
    }

    /// Of shares in 255ths, rows of `width`.
    pub fn new(width: usize, shares: Vec<u8>) -> Self {
        let columns = width.div_ceil(TILE_PX);
        let mut tiles: Vec<usize> = shares
            .iter()
            .enumerate()
            .filter(|(_, share)| **share > 0)
            .map(|(at, _)| at / width / TILE_PX * columns + at % width / TILE_PX)
            .collect();
        tiles.sort_unstable();
        tiles.dedup();
        Mask { width, shares, tiles, light: ViewLight::new(), relit: Vec::new() }
    }

    /// Shares of the view in 255ths, row 0 at the top.
    pub fn shares(&self) -> &[u8] {
        &self.shares
    }

    /// Multiplies the light of what stands in front, as `view` shows it, by `factors` of red, green and blue.
    pub fn relight(&mut self, view: &[u32], factors: Option<[f32; 3]>) {
        self.relit.clear();
        if let Some(factors) = factors.filter(|factors| *factors != [1.0; 3]) {
            let log_factors = factors.map(log_factor);
            let lit = |(&view, &share): (&u32, &u8)| if share == 0 { view } else { shaded(view, log_factors) };
            self.relit.extend(view.iter().zip(&self.shares).map(lit));
        }
    }

    /// Marks the tiles in which another view shows.
    pub fn mark(&self, damage: &mut Damage) {
        self.tiles.iter().for_each(|&tile| damage.mark(tile));
    }

    /// What is marked of `picture`, with `view` in front, to `shown`; in linear light.
    pub fn put(&self, damage: &Damage, (picture, view): (&[u32], &[u32]), shown: &mut [u32]) {
        let view = if self.relit.is_empty() { view } else { &self.relit };
        for (rows, columns) in damage.areas() {
            for row in rows {
                let place = row * self.width + columns.start..row * self.width + columns.end;
                for at in place {
                    shown[at] = match self.shares[at] {
                        0 => picture[at],
                        255 => view[at],
                        share => self.mixed(picture[at], view[at], f32::from(share) / 255.0),
                    };
                }
            }
        }
    }

    fn mixed(&self, picture: u32, view: u32, share: f32) -> u32 {
        let ([_, r, g, b], [_, vr, vg, vb]) = (picture.to_be_bytes(), view.to_be_bytes());
        let mix = |own: u8, view: u8| {
            let own = self.light.linear(own);
            code(own + share * (self.light.linear(view) - own))
        };
        xrgb([mix(r, vr), mix(g, vg), mix(b, vb)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_in_front_is_the_view_and_its_edge_is_mixed_in_linear_light() {
        let mut shares = vec![0; 20 * 17];
        (shares[1], shares[2], shares[16 * 20 + 19]) = (255, 128, 255);
        let mask = Mask::new(20, shares);
        let mut damage = Damage::none(20, 17);
        mask.mark(&mut damage);
        assert_eq!((mask.tiles.as_slice(), damage.count()), (&[0, 3][..], 2));
        let (picture, view) = (vec![0x00ff_ffff; 340], vec![0; 340]);
        let mut shown = vec![7; 340];
        mask.put(&damage, (&picture, &view), &mut shown);
        // 127 of 255 of white's light are code 187; tile 1 was not marked.
        assert_eq!([shown[0], shown[1], shown[2], shown[339]], [0x00ff_ffff, 0, 0x00bb_bbbb, 0]);
        assert_eq!(shown[17], 7);
    }

    #[test]
    fn in_other_light_it_is_shown_in_that() {
        let mut mask = Mask::new(16, vec![255; 256]);
        let mut damage = Damage::none(16, 16);
        mask.mark(&mut damage);
        let (view, mut shown) = (vec![0x00ff_ffff; 256], vec![7; 256]);
        for (factors, expected) in
            [(Some([0.25, 1.0, 0.0]), 0x0089_ff00), (Some([1.0; 3]), 0x00ff_ffff), (None, 0x00ff_ffff)]
        {
            mask.relight(&view, factors);
            mask.put(&damage, (&[0; 256], &view), &mut shown);
            assert_eq!(shown, [expected; 256]);
        }
    }
}
