//! Whole frames at the ends: sizes, levels, dark tiles, flicker, and light that must be refused.

use relume::relight::{Budget, FrameCounters, Framebuffer, Relighter, View};
use relume::weights::PatchWeights;
use relume_firmware::kernel::Kernel;
use relume_firmware::tile::TILE_PX;
use relume_firmware::tone::srgb_code;
use relume_firmware::weights::WeightError;
use relume_tests::stressbound::{Examiner, TileFound};
use relume_tests::stressfield::{Matter, StressField, scatter};
use relume_tests::stresslight::{self as light, PatchLight};
use std::time::Duration;

const PLAIN: [Matter; 5] = [Matter::Street, Matter::Checkers, Matter::BlackRows, Matter::Empty, Matter::Holes];
const BEHIND: u32 = 0x0012_3456;

fn sky(light: &PatchLight) -> PatchWeights {
    PatchWeights { radiance: light.clone(), sun: None }
}

/// A post's picture, frame after frame.
struct Shown<'f> {
    stress: &'f StressField,
    relighter: Relighter<'f>,
    view: View,
    framebuffer: Framebuffer,
}

impl<'f> Shown<'f> {
    fn new(stress: &'f StressField, kernel: Kernel) -> Self {
        let (width, height) = (stress.size.0 as usize, stress.size.1 as usize);
        Shown {
            stress,
            relighter: Relighter::with_kernel(stress.field(), 1, kernel),
            view: View::new(width, height, vec![BEHIND; width * height]),
            framebuffer: Framebuffer::new(width, height),
        }
    }

    /// Draws a light and holds every pixel against the truth and the frame's own bound. Pixels covered in part are left
    /// out: the view shows through them.
    fn frame(&mut self, given: &PatchLight, exposure: f32) -> FrameCounters {
        self.relighter.set_weights(&sky(given), exposure).unwrap();
        let counters = self.relighter.draw(&self.view, &mut self.framebuffer);
        let bound = f64::from(counters.bound_codes.unwrap());
        let (field, width) = (self.relighter.field(), self.framebuffer.width);
        let columns = field.response().grid().0;
        let mut covered = vec![false; self.framebuffer.pixels.len()];
        for (index, response) in self.stress.responses.iter().enumerate() {
            let tile = field.response().tile(index);
            for (pixel, rows) in tile.covered().zip(response.chunks_exact(3 * given.len())) {
                let (x, y) = (index % columns * TILE_PX + pixel % TILE_PX, index / columns * TILE_PX + pixel / TILE_PX);
                covered[y * width + x] = true;
                for (c, row) in rows.chunks_exact(given.len()).enumerate().filter(|_| field.coverage(index).is_none()) {
                    let truth: f64 = row.iter().zip(given).map(|(&r, rgb)| f64::from(r) * f64::from(rgb[c])).sum();
                    let code = srgb_code((truth * f64::from(exposure)).clamp(0.0, 1.0));
                    let shown = f64::from(self.framebuffer.pixels[y * width + x] >> (16 - 8 * c) & 0xff);
                    assert!((shown - code).abs() <= bound, "({x}, {y}) {c}: {shown}, not {code}; bound {bound}");
                }
            }
        }
        for (at, &word) in self.framebuffer.pixels.iter().enumerate().filter(|&(at, _)| !covered[at]) {
            assert_eq!(word, BEHIND, "pixel {at} is not covered");
        }
        counters
    }
}

#[test]
fn pictures_of_any_size() {
    for size in [(1, 1), (16, 16), (17, 33), (31, 15), (47, 49), (5, 64)] {
        let stress = StressField::new(16, size, 0.004, &PLAIN, 1.0);
        let given = light::captured(&stress.patches, 4, 1.0);
        let mut expected = None;
        for kernel in Kernel::paths() {
            let mut shown = Shown::new(&stress, kernel);
            shown.frame(&given, 0.5);
            shown.frame(&light::torch(&stress.patches, 5, 100.0), 0.5);
            shown.relighter.set_budget(Budget::ErrorCodes(1.5)).unwrap();
            shown.frame(&light::torch(&stress.patches, 9, 300.0), 0.2);
            let pixels = shown.framebuffer.pixels;
            assert_eq!(expected.get_or_insert_with(|| pixels.clone()), &pixels, "{size:?} {}", kernel.name());
        }
    }
}

/// A live view under light that mostly stands still: the same bytes as a new relighter's, which draws everything. One that is
/// expected is composited from its first change on.
#[test]
fn a_live_view_is_composited_as_if_all_were_drawn() {
    for (size, expected) in [((17, 33), false), ((47, 49), true), ((5, 64), false), ((17, 33), true)] {
        let stress = StressField::new(16, size, 0.004, &PLAIN, 1.0);
        let geometry =
            (0..stress.field().response().tiles()).filter(|&t| stress.field().response().tile(t).pixels() > 0);
        let geometry = geometry.count();
        for kernel in Kernel::paths() {
            let mut live = Shown::new(&stress, kernel);
            if expected {
                live.relighter.expect_live_view();
            }
            for frame in 0..8u32 {
                let given = light::captured(&stress.patches, 4, if frame < 5 { 1.0 } else { 3.0 });
                let mut fresh = Shown::new(&stress, kernel);
                for shown in [&mut live, &mut fresh] {
                    let behind = shown.view.pixels_mut().iter_mut().enumerate();
                    behind.for_each(|(at, word)| *word = scatter(at as u32 + 7919 * frame) & 0x00ff_ffff);
                    shown.relighter.set_weights(&sky(&given), 0.3).unwrap();
                }
                let counters = live.relighter.draw(&live.view, &mut live.framebuffer);
                fresh.relighter.draw(&fresh.view, &mut fresh.framebuffer);
                assert_eq!(live.framebuffer.pixels, fresh.framebuffer.pixels, "{size:?} {} {frame}", kernel.name());
                let settled = (if expected { 1..5 } else { 2..5 }).contains(&frame) || frame > 5;
                assert!(!settled || counters.tiles_drawn == 0, "{frame}: {counters:?}");
                assert!(!settled || counters.tiles_composited > 0, "{frame}: {counters:?}");
                assert_eq!(counters.tiles_drawn + counters.tiles_composited + counters.tiles_kept, geometry, "{frame}");
            }
        }
    }
}

/// A sky that wanders: whatever was kept, in whole blocks or tile by tile, is within a code of a picture drawn anew, over
/// redrawing, another view and another exposure.
#[test]
fn kept_tiles_are_within_a_code_of_a_new_picture() {
    let stress = StressField::new(64, (95, 63), 0.004, &[Matter::Street, Matter::Checkers, Matter::Holes], 1.0);
    let mut chance = light::Chance(11);
    let mut given = light::captured(&stress.patches, 4, 0.4);
    let [mut shown, mut fresh] = [0; 2].map(|_| Shown::new(&stress, Kernel::detect()));
    let (mut kept, mut drawn, mut spared) = (0, 0, 0);
    for frame in 0..60 {
        let step = [0.0005f32, 0.003, 0.02][frame / 4 % 3];
        for _ in 0..6 {
            let patch = chance.below(given.len());
            given[patch] = given[patch].map(|v| v * (1.0 + step * (2.0 * chance.unit() - 1.0)));
        }
        match frame {
            20 => shown.relighter.redraw(),
            30 => shown.view.pixels_mut().fill(BEHIND),
            _ => {}
        }
        let exposure = if frame < 40 { 0.4 } else { 0.3 };
        let counters = shown.frame(&given, exposure);
        fresh.relighter.invalidate();
        fresh.relighter.set_weights(&sky(&given), exposure).unwrap();
        fresh.relighter.draw(&fresh.view, &mut fresh.framebuffer);
        for (a, b) in shown.framebuffer.pixels.iter().zip(&fresh.framebuffer.pixels) {
            let apart = a.to_be_bytes().into_iter().zip(b.to_be_bytes()).map(|(a, b)| a.abs_diff(b)).max();
            assert!(apart <= Some(1), "frame {frame}: {a:06x}, not {b:06x}");
        }
        kept += counters.tiles_kept;
        drawn += counters.tiles_drawn;
        spared += counters.blocks_spared;
    }
    println!("a wandering sky: {drawn} tiles drawn, {kept} kept, {spared} blocks not even projected");
    assert!(kept > drawn, "{kept} of {drawn}");
    assert!(spared > 60, "{spared}");
}

/// A sky that trembles about what it was, patches that are shown by their own rows among it: nothing is projected, the picture
/// stays within its bound (which [`Shown::frame`] checks), and a frame that must draw everything shows the newest light.
#[test]
fn a_trembling_sky_costs_no_projection() {
    let stress = StressField::new(64, (95, 63), 0.004, &[Matter::Street, Matter::Checkers, Matter::Holes], 1.0);
    let mut chance = light::Chance(5);
    for base in [light::captured(&stress.patches, 4, 0.4), light::torch(&stress.patches, 9, 30.0)] {
        let mut shown = Shown::new(&stress, Kernel::detect());
        shown.frame(&base, 0.4);
        let mut given = base.clone();
        for frame in 0..70 {
            given.clone_from(&base);
            given.iter_mut().for_each(|rgb| *rgb = rgb.map(|v| v * (1.0 + 0.0004 * (2.0 * chance.unit() - 1.0))));
            let counters = shown.frame(&given, 0.4);
            let at_work = counters.blocks_projected + counters.blocks_stepped;
            assert!(10 * at_work <= counters.blocks && counters.tiles_drawn == 0, "{frame}: {counters:?}");
        }
        let mut fresh = Shown::new(&stress, Kernel::detect());
        fresh.frame(&given, 0.4);
        shown.relighter.redraw();
        shown.frame(&given, 0.4);
        assert_eq!(shown.framebuffer.pixels, fresh.framebuffer.pixels);
    }
}

/// However little time there is, a frame says how far off it is, and a still sky's picture gets finished; with time enough
/// nothing waits.
#[test]
fn time_budgets_let_tiles_wait_within_the_bound() {
    let stress = StressField::new(16, (95, 79), 0.004, &[Matter::Street, Matter::Checkers, Matter::Holes], 1.0);
    let skies = [2, 3].map(|seed| light::captured(&stress.patches, seed, 1.0));
    let between = |share: f32| -> PatchLight {
        let pairs = skies[0].iter().zip(&skies[1]);
        pairs.map(|(a, b)| std::array::from_fn(|c| a[c] + share * (b[c] - a[c]))).collect()
    };
    let changing = |time: Duration| {
        let mut shown = Shown::new(&stress, Kernel::detect());
        shown.relighter.set_budget(Budget::Time(time)).unwrap();
        assert_eq!(shown.frame(&skies[0], 0.5).tiles_waiting, 0, "what was never drawn does not wait");
        let frames: Vec<FrameCounters> = (1..=20).map(|k| shown.frame(&between(k as f32 / 20.0), 0.5)).collect();
        (shown, frames)
    };
    let (mut hasty, frames) = changing(Duration::from_nanos(1));
    let tiles = frames[0].tiles;
    for counters in &frames {
        let all = counters.tiles_drawn + counters.tiles_waiting + counters.tiles_kept + counters.tiles_empty;
        assert!(counters.tiles_drawn <= tiles.div_ceil(16) && all == tiles, "{counters:?}");
    }
    assert!(frames.iter().all(|counters| counters.tiles_waiting > 0), "the light changes faster than that");
    // The light stands still: more and more is right, and at last all.
    let mut waiting = frames[19].tiles_waiting;
    while waiting > 0 {
        let counters = hasty.frame(&skies[1], 0.5);
        assert!(counters.tiles_waiting < waiting, "{counters:?}");
        waiting = counters.tiles_waiting;
    }
    let (leisurely, frames) = changing(Duration::from_secs(100));
    assert!(frames.iter().all(|counters| counters.tiles_waiting == 0), "time enough");
    let code = |word: u32, c: usize| (word >> (8 * c) & 0xff) as i32;
    let pairs = hasty.framebuffer.pixels.iter().zip(&leisurely.framebuffer.pixels);
    assert!(pairs.into_iter().all(|(&a, &b)| (0..3).all(|c| (code(a, c) - code(b, c)).abs() <= 1)));
}

/// Up by 2^20 and down again within 30 frames: every frame within its bound, and the last as the first.
#[test]
fn light_that_goes_up_and_down_by_two_to_the_twenty_in_a_second() {
    let stress = StressField::new(16, (33, 17), 0.004, &PLAIN, 1.0);
    let mut shown = Shown::new(&stress, Kernel::detect());
    let given = light::captured(&stress.patches, 2, 1.0);
    let mut first = None;
    for frame in 0..=30i32 {
        let level = 2f32.powf(20.0 * (1.0 - (frame - 15).abs() as f32 / 15.0));
        shown.frame(&light::times(&given, level), 0.5);
        first.get_or_insert_with(|| shown.framebuffer.pixels.clone());
    }
    for _ in 0..15 {
        shown.frame(&light::times(&given, (1 << 20) as f32), 0.5);
        shown.frame(&given, 0.5);
    }
    let code = |word: u32, c: usize| (word >> (8 * c) & 0xff) as i32;
    let pairs = first.as_ref().unwrap().iter().zip(&shown.framebuffer.pixels);
    assert!(pairs.into_iter().all(|(&a, &b)| (0..3).all(|c| (code(a, c) - code(b, c)).abs() <= 1)));
}

/// The brightest patch goes back and forth over the light at which the scale doubles.
#[test]
fn flicker_at_a_scale_boundary_steps_and_keeps_tiles() {
    let stress = StressField::new(16, (33, 17), 0.004, &[Matter::Street], 1.0);
    let mut shown = Shown::new(&stress, Kernel::detect());
    let given = light::times(&vec![[1.0; 3]; stress.patches.len()], 32767.0 / 16384.0);
    for frame in 0..40 {
        let about = if frame % 2 == 0 { 0.9999 } else { 1.0001 };
        let counters = shown.frame(&light::times(&given, about), 0.25);
        assert!(frame < 2 || counters.blocks_projected == 0 && counters.tiles_drawn == 0, "{frame}: {counters:?}");
    }
}

#[test]
fn no_light_and_light_too_small_for_numbers_is_dark() {
    let stress = StressField::new(16, (20, 18), 0.004, &[Matter::Street], 1.0);
    let mut shown = Shown::new(&stress, Kernel::detect());
    for radiance in [0.0, f32::from_bits(1), 1e-42, f32::MIN_POSITIVE] {
        let counters = shown.frame(&vec![[radiance; 3]; stress.patches.len()], 1.0);
        assert!(shown.framebuffer.pixels.iter().all(|&word| word == 0));
        assert!(counters.bound_codes.unwrap() < 0.6, "{counters:?}");
    }
    // The same light, brought into range by the exposure, counts.
    shown.frame(&vec![[1e-38; 3]; stress.patches.len()], 5e37);
    assert!(shown.framebuffer.pixels.iter().all(|&word| word & 0xff > 20));
}

#[test]
fn light_that_is_no_number_is_refused_and_changes_nothing() {
    let stress = StressField::new(16, (20, 18), 0.004, &[Matter::Street], 1.0);
    let mut shown = Shown::new(&stress, Kernel::detect());
    let given = light::captured(&stress.patches, 3, 1.0);
    shown.frame(&given, 0.5);
    let before = shown.framebuffer.clone();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, -f32::MIN_POSITIVE] {
        let mut broken = light::times(&given, 2.0);
        broken[7][2] = bad;
        let refused = shown.relighter.set_weights(&sky(&broken), 0.5);
        assert!(matches!(refused, Err(WeightError::Radiance { patch: 7, .. })), "{bad}");
        shown.relighter.redraw();
        shown.relighter.draw(&shown.view, &mut shown.framebuffer);
        assert_eq!(shown.framebuffer, before, "{bad}");
    }
    for exposure in [f32::NAN, 0.0, -1.0, f32::INFINITY] {
        assert!(matches!(shown.relighter.set_weights(&sky(&given), exposure), Err(WeightError::Exposure(_))));
    }
}

/// A smooth ramp whose codes are all under 16, which compression gives the least weight: within two codes once rounded.
#[test]
fn dark_tiles_stay_near_their_codes() {
    for target in [0.008, 0.002] {
        let stress = StressField::new(64, (32, 32), target, &[Matter::Dim], 1.0);
        let (mut examiner, mut all) = (Examiner::new(&stress), TileFound::default());
        for seed in 0..6 {
            let given = light::captured(&stress.patches, seed, 1.0);
            let exposure = 0.0048 / brightest(&stress, &given);
            examiner.set(&given, exposure, &[]);
            for index in 0..4 {
                let found = examiner.tile(index, &given, exposure);
                (all.bound, all.error) = (all.bound.max(found.bound), all.error.max(found.error));
            }
            Shown::new(&stress, Kernel::detect()).frame(&given, exposure);
        }
        let (error, bound) = (all.error.codes, all.bound.codes);
        println!(
            "dark tiles, target {target}: error {error:.3} codes, bound {bound:.3}, looseness {:.2}",
            bound / error
        );
        assert!(error > 0.0 && error < 1.5, "{error}");
    }
}

/// Light that the factors hardly see, faint enough for a tile to stay dark: what it truly adds is within the tile's bound.
#[test]
fn tiles_that_stay_as_they_are_are_bound_in_the_new_light() {
    let stress = StressField::new(64, (16, 16), 0.5, &[Matter::Checkers], 1.0);
    let mut examiner = Examiner::new(&stress);
    let mut kept = 0;
    for at in (0..256 * 3).step_by(37) {
        let given = light::along(&examiner.residual(0, at), 1.0, false);
        let white = 1.0 / brightest(&stress, &given);
        for level in [1e-3, 3e-4, 1e-4, 3e-5] {
            let mut shown = Shown::new(&stress, Kernel::detect());
            shown.frame(&vec![[0.0; 3]; given.len()], 1.0);
            let counters = shown.frame(&given, white * level);
            let bound = shown.relighter.tile_bounds().next().flatten().unwrap();
            if counters.tiles_drawn == 0 {
                kept += 1;
                assert!(bound.0 >= level, "pixel {at}: {level} beyond {}", bound.0);
            }
        }
    }
    assert!(kept > 10, "{kept}");
}

/// Largest value of any pixel.
fn brightest(stress: &StressField, given: &PatchLight) -> f32 {
    let rows = stress.responses.iter().flat_map(|tile| tile.chunks_exact(given.len()).enumerate());
    rows.map(|(at, row)| row.iter().zip(given).map(|(r, rgb)| r * rgb[at % 3]).sum()).fold(0.0, f32::max)
}
