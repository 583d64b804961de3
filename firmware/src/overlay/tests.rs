extern crate std;
use super::*;
use crate::surface::rgb;
use crate::tone::{srgb_code, srgb_linear};
use embedded_graphics::Drawable;
use embedded_graphics::geometry::{OriginDimensions, Point};
use embedded_graphics::mock_display::MockDisplay;
use embedded_graphics::mono_font::{self, MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::BinaryColor;
use embedded_graphics::text::{Baseline, Text};
use std::vec;
use std::vec::Vec;

const WORDS: Words<'_> = Words {
    title: "Ναός - Храм - Tempel - Świątynia",
    caption: "As it stood in the year 120, with the colonnade of the forum before it and the hill behind",
};
const BADGE: Badge<'_> = Badge { well: false, text: "sky camera lost 12 s" };

fn all_labels() -> Labels<'static> {
    let compass = Compass::new(0.0, [1.0, 0.0, 0.0], Some([200.0, 40.0]));
    Labels { words: WORDS, badge: Some(BADGE), compass: Some(compass) }
}

/// A picture of all codes, no two neighbours alike.
fn picture(width: usize, height: usize) -> Vec<u32> {
    (0..width * height).map(|k| (k as u32).wrapping_mul(0x9e37_79b1) & 0x00ff_ffff).collect()
}

fn drawn(size: (usize, usize), labels: &Labels<'_>, under: &[u32]) -> (Vec<u32>, [Rectangle; 3]) {
    let (width, height) = size;
    let overlay = Overlay::new(Size::new(width as u32, height as u32));
    let mut shown = under.to_vec();
    let mut surface = Surface::new(&mut shown, width, height, width).unwrap();
    let whole = Rectangle::new(Point::zero(), surface.size());
    overlay.draw(labels, ViewPixels { pixels_xrgb: under, stride: width }, &mut surface, &whole);
    (shown, overlay.areas(labels))
}

/// The pixels that `embedded-graphics` itself sets for a letter.
fn reference(font: &MonoFont<'_>, c: char) -> Vec<Point> {
    let mut display = MockDisplay::<BinaryColor>::new();
    let mut bytes = [0; 4];
    let style = MonoTextStyle::new(font, BinaryColor::On);
    Text::with_baseline(c.encode_utf8(&mut bytes), Point::zero(), style, Baseline::Top).draw(&mut display).unwrap();
    (0..20).flat_map(|y| (0..10).map(move |x| Point::new(x, y))).filter(|&at| display.get_pixel(at).is_some()).collect()
}

#[test]
fn letters_of_each_script_are_the_fonts_own() {
    use mono_font::*;
    let face = Faces::of(Size::new(700, 500)).title;
    let own = |c| {
        let mut inked = Vec::new();
        face.ink(c, |at, coverage| {
            assert_eq!(coverage, 1.0);
            inked.push(at);
        });
        inked
    };
    for (font, letters) in [
        (iso_8859_1::FONT_10X20, "Aqñßçø«½°"),
        (iso_8859_2::FONT_10X20, "ŁąęšžřůďĺŐű"),
        (iso_8859_3::FONT_10X20, "ħĉŭ"),
        (iso_8859_4::FONT_10X20, "ŋŧ"),
        (iso_8859_5::FONT_10X20, "ЖдяЂїў№"),
        (iso_8859_7::FONT_10X20, "ΑαωΐΏς"),
        (iso_8859_9::FONT_10X20, "ğİış"),
        (iso_8859_13::FONT_10X20, "ĀėįŪ"),
        (iso_8859_14::FONT_10X20, "Ŵŷ"),
        (iso_8859_15::FONT_10X20, "€œŸ"),
        (iso_8859_16::FONT_10X20, "Șț„”"),
    ] {
        for c in letters.chars() {
            assert_eq!(own(c), reference(&font, c), "{c}");
            assert!(own(c) != own('?') && !own(c).is_empty(), "{c}");
        }
    }
    assert_eq!(own('神'), own('?'));
}

#[test]
fn a_scaled_letter_keeps_its_strokes_and_its_weight() {
    let (small, large) = (Faces::of(Size::new(700, 500)).title, Faces::of(Size::new(1920, 1080)).title);
    assert_eq!(large.cell(), small.cell() * 3);
    for c in "HЖωąg8".chars() {
        let (mut weight, mut scaled) = (0.0, 0.0);
        small.ink(c, |_, coverage| weight += coverage);
        large.ink(c, |at, coverage| {
            assert!((0.0..=1.0).contains(&coverage) && at.x < 30 && at.y < 60, "{c} {at} {coverage}");
            scaled += coverage;
        });
        // A cut corner takes or gives an eighth of one of the font's pixels, and turns come in both senses.
        assert!((scaled / 9.0 - weight).abs() < 0.15 * weight, "{c}: {scaled} {weight}");
    }
}

#[test]
fn a_scaled_stem_stays_straight_and_sharp() {
    let mut inked = Vec::new();
    Faces::of(Size::new(1920, 1080)).title.ink('H', |at, coverage| inked.push((at, coverage)));
    // Two stems of two of the font's pixels, between the top and the bar.
    let stems = reference(&mono_font::iso_8859_1::FONT_10X20, 'H').into_iter().filter(|at| at.y == 6).count();
    let rows: Vec<_> = inked.iter().filter(|(at, _)| (18..21).contains(&at.y)).collect();
    assert_eq!((stems, rows.len()), (4, 4 * 9));
    assert!(rows.iter().all(|(_, coverage)| *coverage == 1.0), "{rows:?}");
}

#[test]
fn light_is_blended_as_light() {
    let light = ViewLight::new();
    for coverage in [0.0, 0.125, 0.5, 0.875, 1.0f32] {
        for below in 0..=255u8 {
            let under = [crate::surface::xrgb([below, 255 - below, 77])];
            let mut pixel = under;
            let mut surface = Surface::new(&mut pixel, 1, 1, 1).unwrap();
            let view = ViewPixels { pixels_xrgb: &under, stride: 1 };
            let one = Rectangle::new(Point::zero(), Size::new(1, 1));
            Paint::new(&light, view, &mut surface, &one).blend(Point::zero(), paint::ORANGE, coverage);
            for (c, shown) in rgb(pixel[0]).into_iter().enumerate() {
                let (below, ink) = (rgb(under[0])[c], paint::ORANGE[c]);
                let (below, ink) = (srgb_linear(below.into()), srgb_linear(ink.into()));
                let exact = srgb_code(below + (ink - below) * f64::from(coverage));
                assert!((f64::from(shown) - exact).abs() < 0.6, "{below} {coverage}: {shown} {exact}");
            }
        }
    }
}

#[test]
fn the_strip_and_its_letters_are_within_a_code_of_the_exact_blend() {
    let size = (1280, 720);
    let under = picture(size.0, size.1);
    let (shown, [area, ..]) = drawn(size, &Labels { words: WORDS, ..Labels::default() }, &under);
    let cell = Faces::of(Size::new(1280, 720)).text.cell().height as usize;
    let (mut plain, mut letters) = (0, 0);
    for y in area.rows().start as usize + cell / 2..720 {
        for x in 0..size.0 {
            let (below, found) = (rgb(under[y * size.0 + x]), rgb(shown[y * size.0 + x]));
            // Letters cover a multiple of an eighth of a pixel; nothing else does.
            let is_near = |ink: [u8; 3], part: u32| {
                (0..3).all(|c| {
                    let (dim, ink) = (0.1 * srgb_linear(below[c].into()), srgb_linear(ink[c].into()));
                    let exact = srgb_code(dim + (ink - dim) * f64::from(part) / 8.0);
                    (f64::from(found[c]) - exact).abs() <= 1.1
                })
            };
            let part = (0..=8).find(|&part| is_near(paint::WHITE, part) || is_near(paint::PALE, part));
            match part {
                Some(0) => plain += 1,
                Some(_) => letters += 1,
                None => panic!("{x},{y}: {found:?} over {below:?}"),
            }
        }
    }
    assert!(plain > 8 * letters && letters > 3000, "{plain} {letters}");
}

#[test]
fn nothing_is_drawn_outside_the_areas_nor_beside_the_surface() {
    for (width, height) in
        [(1, 1), (10, 4), (3, 200), (200, 3), (64, 48), (240, 160), (512, 384), (700, 1300), (1900, 300), (1920, 1080)]
    {
        let overlay = Overlay::new(Size::new(width as u32, height as u32));
        let (stride, labels) = (width + 5, all_labels());
        let under = picture(stride, height + 2);
        let mut pixels = under.clone();
        let mut surface = Surface::new(&mut pixels[stride..], width, height, stride).unwrap();
        let view = ViewPixels { pixels_xrgb: &under[stride..], stride };
        let beyond = Rectangle::new(Point::new(-50, -50), Size::new(5000, 5000));
        overlay.draw(&labels, view, &mut surface, &beyond);
        let areas = overlay.areas(&labels);
        let surface = Rectangle::new(Point::zero(), Size::new(width as u32, height as u32));
        for area in areas.iter().filter(|area| !area.is_zero_sized()) {
            assert_eq!(surface.intersection(area), *area, "{width}x{height}");
        }
        for (at, (shown, under)) in pixels.iter().zip(&under).enumerate() {
            let place = Point::new((at % stride) as i32, (at / stride) as i32 - 1);
            let may = areas.iter().any(|area| area.contains(place));
            assert!(may || shown == under, "{width}x{height}: {place}");
        }
        if width >= 240 && height >= 160 {
            assert!(areas.iter().all(|area| !area.is_zero_sized()), "{width}x{height}: {areas:?}");
            assert!(areas[0].intersection(&areas[1]).is_zero_sized());
        }
    }
}

#[test]
fn drawing_again_or_part_by_part_changes_nothing() {
    let (width, height) = (512, 384);
    let (under, labels) = (picture(width, height), all_labels());
    let (once, _) = drawn((width, height), &labels, &under);
    let overlay = Overlay::new(Size::new(512, 384));
    let view = ViewPixels { pixels_xrgb: &under, stride: width };
    let mut shown = once.clone();
    let mut surface = Surface::new(&mut shown, width, height, width).unwrap();
    overlay.draw(&labels, view, &mut surface, &Rectangle::new(Point::zero(), Size::new(512, 384)));
    assert!(shown == once, "nothing is darkened twice");
    // Half of the tiles are drawn anew, without labels, then labelled alone.
    let mut surface = Surface::new(&mut shown, width, height, width).unwrap();
    for tile in (0..32 * 24).step_by(2) {
        let (x0, y0) = (tile % 32 * 16, tile / 32 * 16);
        for y in y0..y0 + 16 {
            surface.row_mut(y)[x0..x0 + 16].copy_from_slice(&under[y * width + x0..][..16]);
        }
        let clip = Rectangle::new(Point::new(x0 as i32, y0 as i32), Size::new(16, 16));
        overlay.draw(&labels, view, &mut surface, &clip);
    }
    assert!(shown == once);
    // Nothing beside the clip, and in it what it should be.
    let mut shown = under.clone();
    let clip = Rectangle::new(Point::new(100, 20), Size::new(90, 350));
    overlay.draw(&labels, view, &mut Surface::new(&mut shown, width, height, width).unwrap(), &clip);
    for at in 0..width * height {
        let inside = clip.contains(Point::new((at % width) as i32, (at / width) as i32));
        assert_eq!(shown[at], if inside { once[at] } else { under[at] });
    }
}

#[test]
fn words_that_do_not_fit_are_left_off_and_told() {
    let rows = |size, words| Overlay::new(size).areas(&Labels { words, ..Labels::default() })[0].size.height;
    let title = Words { caption: "", ..WORDS };
    let (one, three) = (rows(Size::new(512, 384), title), rows(Size::new(512, 384), WORDS));
    assert_eq!(three - one, 2 * 13);
    assert!(three <= 384 / 4 && rows(Size::new(64, 48), WORDS) <= 48 / 4);
    assert_eq!((rows(Size::new(512, 384), Words::default()), rows(Size::new(10, 4), WORDS)), (0, 0));
    assert!(Overlay::new(Size::new(512, 384)).has_room(&WORDS));
    assert!(!Overlay::new(Size::new(240, 160)).has_room(&WORDS));
    assert!(Overlay::new(Size::new(10, 4)).has_room(&Words::default()));
    assert_eq!(first_unreadable("Ναός – Храм…\nᾠδή"), None);
    assert_eq!(first_unreadable("Temple 神殿"), Some('神'));
}

/// The middle of the pixels that are nearly `ink`, relative to the dial's middle, as degrees clockwise from up.
fn bearing(shown: &[u32], width: usize, area: &Rectangle, ink: [u8; 3]) -> f64 {
    let side = area.size.height as i32;
    let (mut sum, mut found) = ((0.0, 0.0), 0);
    for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
        let at = (area.top_left.y + y) as usize * width + (area.top_left.x + x) as usize;
        if rgb(shown[at]).iter().zip(ink).all(|(a, b)| a.abs_diff(b) < 20) {
            sum = (
                sum.0 + f64::from(x) + 0.5 - f64::from(side) / 2.0,
                sum.1 + f64::from(y) + 0.5 - f64::from(side) / 2.0,
            );
            found += 1;
        }
    }
    assert!(found > 50, "{found}");
    sum.0.atan2(-sum.1).to_degrees().rem_euclid(360.0)
}

#[test]
fn the_compass_points_where_north_and_sun_are() {
    let (width, height) = (1280, 720);
    let under = vec![0; width * height];
    // Where north lies, where the view looks, the sun's azimuth; bearings of north and sun from the view.
    for (north_deg, forward, sun, expected) in [
        (0.0, [0.0, 0.0, -2.0], 180.0, (0.0, 180.0)),
        (0.0, [1.0, 0.2, 0.0], 180.0, (270.0, 90.0)),
        (90.0, [1.0, 0.0, 0.0], 30.0, (0.0, 30.0)),
        (-30.0, [0.0, -0.5, 1.0], 300.0, (150.0, 90.0)),
    ] {
        let compass = Some(Compass::new(north_deg, forward, Some([sun, 40.0])));
        let (shown, [.., area]) = drawn((width, height), &Labels { compass, ..Labels::default() }, &under);
        let found = (bearing(&shown, width, &area, paint::VERMILLION), bearing(&shown, width, &area, paint::YELLOW));
        let off = |a: f64, b: f64| (a - b + 180.0).rem_euclid(360.0) - 180.0;
        assert!(off(found.0, expected.0).abs() < 3.0 && off(found.1, expected.1).abs() < 2.0, "{found:?} {expected:?}");
    }
}

#[test]
fn the_badge_shows_by_its_shape_whether_all_is_well() {
    let mask = |well| {
        let labels = Labels { badge: Some(Badge { well, text: "" }), ..Labels::default() };
        let (shown, [_, area, _]) = drawn((512, 384), &labels, &vec![0; 512 * 384]);
        assert!(area.top_left.x < 20 && area.rows().end > 384 - 20, "{area:?}");
        shown.iter().map(|&word| rgb(word)[1] > 60).collect::<Vec<bool>>()
    };
    let (well, ill) = (mask(true), mask(false));
    let apart = well.iter().zip(&ill).filter(|(a, b)| a != b).count();
    assert!(apart > 40, "{apart} pixels tell one sign from the other");
}
