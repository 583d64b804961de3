use super::*;
use crate::prior::{Mixture, draw_skies};
use crate::random::Random;
use relume_firmware::patches::PatchSet;
use relume_firmware::wayback::way_unit;
use std::sync::OnceLock;

fn set() -> PatchSet {
    PatchSet::new(64).unwrap()
}

fn prior() -> &'static Prior {
    static PRIOR: OnceLock<Prior> = OnceLock::new();
    PRIOR.get_or_init(|| Prior::of_mixture(&set(), &Mixture { skies: 600, ..Mixture::default() }))
}

fn target() -> Target {
    Target { error: 0.0035, ..Target::default() }
}

/// A level street between a wall and a post: each pixel's view of the patches is cut by two half planes.
fn street(pixels: usize, noise: f64) -> Vec<f32> {
    let set = set();
    let mut random = Random::new(9);
    let mut response = Vec::new();
    for pixel in 0..pixels {
        let (x, z) = ((pixel % 16) as f32 / 16.0, (pixel / 16) as f32 / 16.0);
        for albedo in [0.7, 0.5, 0.3] {
            for patch in 0..set.len() {
                let inside = (0..64).filter(|k| {
                    let d = set.sample(patch, [((k / 8) as f32 + 0.5) / 8.0, ((k % 8) as f32 + 0.5) / 8.0]);
                    let wall = d[0] > 0.0 && d[1] * (1.2 - x) < d[0] * 0.8;
                    let post = d[2] < 0.0 && (d[0] + d[2] * (x - 0.5) / (z + 0.4)).abs() < 0.15 * -d[2];
                    d[1] > 0.0 && !wall && !post
                });
                let share = inside.count() as f32 / 64.0;
                let cosine = set.dir_world(patch)[1].max(0.0) * set.solid_angle_sr(patch) / std::f32::consts::PI;
                let bounced = 0.02 * albedo * set.solid_angle_sr(patch);
                let factor = (1.0 + noise * random.normal()).max(0.0) as f32;
                response.push((albedo * cosine * share + bounced) * factor);
            }
        }
    }
    response
}

/// Sums in f64 over the response and over the tile, per pixel and channel.
fn lit(response: &[f32], tile: &Compressed, sky: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let sum = |row: &[f32]| row.iter().zip(sky).map(|(&r, w)| f64::from(r) * w).sum::<f64>();
    let exact = response.chunks_exact(sky.len()).map(sum).collect();
    let shown = (0..tile.pixels * 3).map(|i| sum(&tile.row(i / 3, i % 3))).collect();
    (exact, shown)
}

fn relative_rmse(exact: &[f64], shown: &[f64]) -> f64 {
    let square: f64 = exact.iter().zip(shown).map(|(a, b)| (a - b).powi(2)).sum();
    (square / exact.len() as f64).sqrt() / (exact.iter().sum::<f64>() / exact.len() as f64)
}

#[test]
fn fresh_skies_meet_the_target() {
    let response = street(256, 0.0);
    let target = Target { error: 0.01, max_rank: 96 };
    let tile = compress(&response, set().len(), prior(), &target);
    let fresh = draw_skies(&set(), &Mixture { seed: 4711, skies: 60, ..Mixture::default() });
    let mut errors: Vec<f64> = fresh
        .iter()
        .map(|sky| {
            let (exact, shown) = lit(&response, &tile, sky);
            relative_rmse(&exact, &shown)
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    assert!(errors[30] < 0.005 && errors[59] < 0.04, "{} {}", errors[30], errors[59]);
    assert!(tile.rank < 40, "{}", tile.rank);
}

#[test]
fn a_smaller_error_takes_more_rank_and_delivers() {
    let response = street(256, 0.0);
    let sky = &draw_skies(&set(), &Mixture { seed: 5, skies: 1, ..Mixture::default() })[0];
    let at = |error: f64| {
        let tile = compress(&response, set().len(), prior(), &Target { error, ..target() });
        let (exact, shown) = lit(&response, &tile, sky);
        (tile.rank, relative_rmse(&exact, &shown))
    };
    let (coarse, fine) = (at(0.05), at(0.005));
    assert!(fine.0 > coarse.0 && fine.1 < 0.5 * coarse.1, "{coarse:?} {fine:?}");
}

/// Spherical harmonics up to the second order, and the upper half alone: what every smooth light is mostly made of.
#[test]
fn low_order_lights_are_near_exact() {
    let (set, response) = (set(), street(256, 0.1));
    let tile = compress(&response, set.len(), prior(), &Target { error: 0.01, max_rank: 96 });
    let even: f64 = lit(&response, &tile, &vec![1.0; set.len()]).0.iter().sum::<f64>() / (3 * 256) as f64;
    let lights: [fn([f64; 3]) -> f64; 10] = [
        |_| 1.0,
        |[x, _, _]| 1.0 + x,
        |[_, y, _]| 1.0 + y,
        |[_, _, z]| 1.0 + z,
        |[x, y, _]| 1.0 + x * y,
        |[_, y, z]| 1.0 + y * z,
        |[x, _, z]| 1.0 + x * z,
        |[x, _, z]| 1.0 + 0.5 * (x * x - z * z),
        |[_, y, _]| y * y,
        |[_, y, _]| f64::from(u8::from(y >= 0.0)),
    ];
    let errors = lights.map(|light| {
        let sky: Vec<f64> = (0..set.len()).map(|patch| light(set.dir_world(patch).map(f64::from))).collect();
        let (exact, shown) = lit(&response, &tile, &sky);
        let square: f64 = exact.iter().zip(&shown).map(|(a, b)| (a - b).powi(2)).sum();
        (square / exact.len() as f64).sqrt() / even
    });
    // The target is 1 %; a sky of no particular order is what it costs.
    let mut random = Random::new(12);
    let rough: Vec<f64> = (0..set.len()).map(|_| 2.0 * random.unit()).collect();
    let (exact, shown) = lit(&response, &tile, &rough);
    assert!(errors[0] < 1e-3 && errors.iter().all(|&error| error < 4e-3), "{errors:?}");
    assert!(relative_rmse(&exact, &shown) > 5.0 * errors[0], "{}", relative_rmse(&exact, &shown));
}

#[test]
fn a_low_rank_tile_comes_back_to_rounding() {
    let patches = set().len();
    let mut random = Random::new(3);
    let pattern: Vec<Vec<f64>> = (0..2).map(|_| (0..patches).map(|_| random.unit()).collect()).collect();
    let mut response = Vec::new();
    for pixel in 0..100 {
        let share = f64::from(pixel) / 99.0;
        for tint in [1.0, 0.5, 0.01] {
            response
                .extend((0..patches).map(|p| (tint * (share * pattern[0][p] + (1.0 - share) * pattern[1][p])) as f32));
        }
    }
    let tile = compress(&response, patches, prior(), &target());
    assert_eq!(tile.rank, 2);
    let worst = response.chunks_exact(patches).enumerate().fold(0.0f32, |worst, (i, row)| {
        let top = row.iter().fold(0.0f32, |a, &b| a.max(b));
        let off = row.iter().zip(tile.row(i / 3, i % 3)).fold(0.0f32, |a, (r, s)| a.max((r - s).abs()));
        worst.max(off / top)
    });
    assert!(worst < 0.04, "{worst}");
}

#[test]
fn black_tiles_pixels_and_channels_stay_black() {
    let patches = set().len();
    let black = compress(&vec![0.0; patches * 3 * 7], patches, prior(), &target());
    assert_eq!((black.rank, black.pixels, black.row_scale.len()), (0, 7, 7));
    let mut response = street(20, 0.0);
    response[5 * 3 * patches..6 * 3 * patches].fill(0.0);
    response[(9 * 3 + 1) * patches..(9 * 3 + 2) * patches].fill(0.0);
    let tile = compress(&response, patches, prior(), &target());
    assert_eq!(tile.row_scale[5], [0.0; 3]);
    assert!(tile.u[5 * tile.rank..6 * tile.rank].iter().all(|&u| u == 0));
    assert!(tile.row_scale[9][1] == 0.0 && tile.row_scale[9][0] > 0.0);
    assert!(compress(&[], patches, prior(), &target()).rank == 0);
}

#[test]
fn one_pixel_and_one_patch() {
    let patches = set().len();
    let one = street(1, 0.0);
    let tile = compress(&one, patches, prior(), &target());
    let (exact, shown) = lit(&one, &tile, &vec![1.0; patches]);
    assert_eq!((tile.pixels, tile.rank), (1, 2));
    assert!(relative_rmse(&exact, &shown) < 0.002);
    // Light from one patch only, six decades of brightness between the pixels.
    let mut spots = vec![0.0f32; patches * 3 * 256];
    for (row, values) in spots.chunks_exact_mut(patches).enumerate() {
        values[17] = 10f32.powi(-((row / 3) as i32 % 7));
    }
    let tile = compress(&spots, patches, prior(), &target());
    let (exact, shown) = lit(&spots, &tile, &vec![1.0; patches]);
    assert!(tile.rank == 2 && relative_rmse(&exact, &shown) < 0.001);
}

#[test]
fn noise_buys_little_rank() {
    let target = Target { error: 0.02, max_rank: 96 };
    let rank = |noise: f64| compress(&street(256, noise), set().len(), prior(), &target).rank;
    let (clean, grainy) = (rank(0.0), rank(0.1));
    assert!(grainy <= clean + 12, "{clean} {grainy}");
}

#[test]
fn the_same_bytes_every_time_and_codes_use_their_range() {
    let response = street(200, 0.05);
    let once = compress(&response, set().len(), prior(), &target());
    assert_eq!(once, compress(&response, set().len(), prior(), &target()));
    assert_eq!(once.u.len(), once.pixels * once.rank);
    for channel in 0..3 {
        assert_eq!(once.v[channel].len(), once.rank * set().len());
        assert!(once.v[channel].iter().all(|&v| v != i8::MIN));
    }
    for k in 0..once.rank {
        let top = (0..once.pixels).map(|p| once.u[p * once.rank + k].unsigned_abs()).max();
        assert_eq!(top, Some(127), "column {k}");
    }
}

#[test]
fn the_rank_stays_under_its_cap() {
    let tile = compress(&street(256, 0.6), set().len(), prior(), &Target { error: 1e-5, max_rank: 31 });
    assert_eq!(tile.rank, 30);
}

/// A street whose second half is a plain, evenly lit wall: its tile needs fewer ranks.
#[test]
fn tiles_of_a_block_keep_the_ranks_they_need() {
    let patches = set().len();
    let mut response = street(256, 0.0);
    let plain: Vec<f32> = response[..3 * patches].to_vec();
    (0..256).for_each(|k| response.extend(plain.iter().map(|r| r * (0.5 + k as f32 / 512.0))));
    let block = compress_block(&response, patches, &[256, 256], prior(), &target());
    assert!(block.ranks[0] > block.ranks[300] && block.ranks[0] <= block.rank, "{:?}", block.ranks);
    let sky = &draw_skies(&set(), &Mixture { seed: 5, skies: 1, ..Mixture::default() })[0];
    let (exact, shown) = lit(&response, &block, sky);
    for half in [0..768, 768..1536] {
        assert!(relative_rmse(&exact[half.clone()], &shown[half]) < 0.004);
    }
    // The bytes say the same as the factors.
    for tile in [0..256usize, 256..512] {
        let bytes = crate::encode::TileBytes::new(&block, tile.clone(), [255; 32], patches);
        let (rank, v_rank) = (usize::from(bytes.record.rank), usize::from(bytes.record.v_rank));
        assert_eq!((rank, v_rank), (block.ranks[tile.start], block.rank));
        for (x, pixel) in tile.enumerate().step_by(37) {
            for c in 0..3 {
                let row =
                    f32::from(u16::from_le_bytes([bytes.rows[2 * (c * 256 + x)], bytes.rows[2 * (c * 256 + x) + 1]]));
                let mut shown = vec![0.0f32; patches];
                for k in 0..rank {
                    let u = f32::from(bytes.u[(k / 2 * 256 + x) * 2 + k % 2] as i8);
                    let stride = patches.next_multiple_of(16);
                    let at = 3 * v_rank * stride + 2 * (c * v_rank + k);
                    let scale = f32::from(u16::from_le_bytes([bytes.v[at], bytes.v[at + 1]]));
                    let unit =
                        2f32.powi(i32::from(bytes.record.row_exponent[c]) + i32::from(bytes.record.v_exponent[c]));
                    for (i, shown) in shown.iter_mut().enumerate() {
                        *shown += row * u * f32::from(bytes.v[(c * v_rank + k) * stride + i] as i8) * scale * unit;
                    }
                }
                for (a, b) in shown.iter().zip(block.row(pixel, c)) {
                    assert!((a - b).abs() < 1e-5, "{a} {b}");
                }
            }
        }
    }
}

/// The way back restores a patch alone, which the factors do not know.
#[test]
fn a_torch_is_restored_by_its_own_rows() {
    let patches = set().len();
    let response = street(256, 0.1);
    let block = compress(&response, patches, prior(), &Target { error: 0.01, max_rank: 96 });
    let top = block.row_scale.iter().fold([0.0f32; 3], |top, s| [0, 1, 2].map(|c| top[c].max(s[c])));
    let rows = tile_rows(&response, &Whites::of(&response, patches), &block, 0..256, top);
    let mut torch = vec![0.0; patches];
    torch[40] = 1.0;
    let (exact, shown) = lit(&response, &block, &torch);
    let patch = &rows[40];
    let unit = f64::from(way_unit(patch.quarters));
    let restored: Vec<f64> = (0..256 * 3)
        .map(|i| {
            let code = f64::from(patch.codes[[1, 0, 2][i % 3]][i / 3]);
            let step = f64::from(block.row_scale[i / 3][i % 3]) * unit;
            assert!((code * step.sqrt() - exact[i].sqrt()).abs() <= 0.50001 * step.sqrt());
            code * code * step
        })
        .collect();
    let (before, after) = (relative_rmse(&exact, &shown), relative_rmse(&exact, &restored));
    assert!(before > 0.1 && after < 0.03, "{before} {after}");
}

/// Channels without light say nothing about the unit, and those with light are restored in it.
#[test]
fn rows_of_a_single_channel_are_restored() {
    let patches = set().len();
    let mut response = street(64, 0.1);
    response.chunks_exact_mut(patches).enumerate().filter(|(i, _)| i % 3 > 0).for_each(|(_, row)| row.fill(0.0));
    let block = compress(&response, patches, prior(), &target());
    let bytes = crate::encode::TileBytes::new(&block, 0..64, [255; 32], patches);
    let top = bytes.row_top();
    let rows = tile_rows(&response, &Whites::of(&response, patches), &block, 0..64, top);
    let largest = response.iter().fold(0.0f32, |top, &r| top.max(r));
    for patch in &rows {
        let codes = f32::from(patch.codes.iter().flatten().copied().max().unwrap_or(0)) + 0.25;
        let bound = top.map(|top| (codes + patch.rest_units) * way_unit(patch.quarters) * top);
        assert!(bound.iter().all(|&bound| bound < 0.1 * largest), "{bound:?} {largest}");
    }
}

/// A small picture cannot tell the exposure that shows a patch which about one pixel in a hundred sees: where that turns out
/// to be a bright one, the rows hold dim pixels beside bright ones within four codes.
#[test]
fn a_patch_that_few_pixels_see_is_shown_by_its_dim_ones() {
    let patches = set().len();
    let few = 40;
    let mut small = street(4096, 0.0);
    small.iter_mut().skip(few).step_by(patches).for_each(|value| *value = 0.0);
    // 0.9 % of the small picture's pixels see it.
    small.iter_mut().skip(few).step_by(patches).take(3 * 37).for_each(|value| *value = 0.2);
    let mut response = street(256, 0.0);
    let dim = 0.2 / 2200.0;
    let lit = response.iter_mut().skip(few).step_by(patches).enumerate();
    lit.for_each(|(i, value)| *value = if i < 24 { 0.2 } else { dim });
    let block = compress(&response, patches, prior(), &target());
    let top = block.row_scale.iter().fold([0.0f32; 3], |top, s| [0, 1, 2].map(|c| top[c].max(s[c])));
    let rows = &tile_rows(&response, &Whites::of(&small, patches), &block, 0..256, top)[few];
    let exposure = 0.8 / f64::from(dim);
    let codes_off = |i: usize| {
        let step = f64::from(block.row_scale[i / 3][i % 3]) * f64::from(way_unit(rows.quarters));
        let code = f64::from(rows.codes[[1, 0, 2][i % 3]][i / 3]);
        let shown = |light: f64| 255.0 * srgb((light * exposure).min(1.0));
        (shown(code * code * step) - shown(response[i * patches + few].into())).abs()
    };
    let worst = (0..256 * 3).map(codes_off).fold(0.0, f64::max);
    assert!(worst < 3.5, "{worst} codes off");
}

/// IEC 61966-2-1.
fn srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}
