//! How much each patch matters in the picture: what its light adds to the mean of all pixels, per radiance.
//!
//! From the field's factors, once at the start: the mean of response[x][c][i] = rows[c][x] sum_k U[x][k] V[c][k][i] over
//! the pixels x is (sum over x of rows U) V, which costs a hundredth of a frame. Lower patches count with the upper ones,
//! as what the ground sends up comes from them.

use crate::map::luminance;
use relume_firmware::field::Field;
use relume_firmware::tile::Tile;

/// Mean response of the covered pixels to each patch, per radiance and solid angle of the patch (1/sr, luminance); never
/// less than a hundredth of the mean, so that no part of the sky goes unseen.
pub fn importance(field: &Field<'_>) -> Vec<f32> {
    let (tiles, set) = (field.response(), field.patch_set());
    let mut sums = vec![[0.0f32; 3]; set.len()];
    for tile in (0..tiles.tiles()).map(|index| tiles.tile(index)).filter(|tile| tile.pixels() > 0) {
        add_tile(&tile, &mut sums);
    }
    let pixels = tiles.covered().max(1) as f32;
    let mut found: Vec<f32> = sums.iter().map(|&sum| luminance(sum.map(|v| v.max(0.0))) / pixels).collect();
    let upper = set.upper();
    // The ground is lit by the whole upper hemisphere, by the cosine.
    let ground: f32 = found[upper..].iter().sum();
    for (patch, value) in found[..upper].iter_mut().enumerate() {
        let omega = set.solid_angle_sr(patch);
        let bounced = 0.2 * ground * set.dir_world(patch)[1] / std::f32::consts::PI;
        *value = *value / omega + bounced;
    }
    let least = 0.01 * found[..upper].iter().sum::<f32>() / upper as f32;
    found[..upper].iter_mut().for_each(|value| *value = value.max(least));
    found.truncate(upper);
    found
}

fn add_tile(tile: &Tile<'_>, sums: &mut [[f32; 3]]) {
    let (n, rank) = (tile.padded_pixels(), tile.rank());
    let columns = tile.v.len() / (3 * tile.v_rank()).max(1);
    for c in 0..3 {
        let mut weights = [0.0f32; 128];
        for (x, row) in tile.row_codes(c).map(f32::from).enumerate() {
            for (k, weight) in weights[..rank].iter_mut().enumerate() {
                *weight += row * f32::from(tile.u[(k / 2 * n + x) * 2 + k % 2] as i8);
            }
        }
        let exponent = i32::from(tile.record.row_exponent[c]) + i32::from(tile.record.v_exponent[c]);
        let unit = (f64::from(exponent)).exp2() as f32;
        for (k, scale) in tile.v_scales(c).enumerate().take(rank) {
            let factor = weights[k] * f32::from(scale) * unit;
            let row = &tile.v[(c * tile.v_rank() + k) * columns..][..sums.len()];
            sums.iter_mut().zip(row).for_each(|(sum, &v)| sum[c] += factor * f32::from(v as i8));
        }
    }
}
