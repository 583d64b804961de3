//! Pictures known in closed form, through bake, field and relighting; and the vector kernel of this machine against the
//! scalar one on them. No programs and no files of others, so that an emulator can run it.

#![allow(clippy::unwrap_used)]

use relume::relight::{Framebuffer, Picture, Relighter, View};
use relume::weights::{PatchWeights, SunWeight};
use relume_bake::bake::{BakeOptions, bake};
use relume_bake::camera::Camera;
use relume_bake::scene;
use relume_firmware::field::{Field, FieldError, HEADER, LAYER_ALIGN, LAYER_CRITICAL, LAYER_ENTRY, Layer};
use relume_firmware::kernel::Kernel;
use relume_firmware::patches::PatchSet;
use relume_tests::files::{fresh_folder, put};
use relume_tests::scene::{Mesh, Picture as Texture, checks_png, courtyard, cuboid, glb, ground};
use std::f64::consts::PI;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

fn baked(
    name: &str,
    meshes: &[Mesh],
    (position, target): ([f64; 3], [f64; 3]),
    size: (u32, u32),
    directions: usize,
) -> Vec<u8> {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), name);
    let png = checks_png();
    put(&folder.join("scene.glb"), glb(meshes, Some(Texture::Inside(&png))));
    let scene = scene::load(&folder.join("scene.glb"), scene::Shading::Lambert).unwrap().scene;
    let camera = Camera { position, target, up: [0.0, 1.0, 0.0], fov_y_deg: 40.0, north_deg: 0.0, optics: None };
    let options = BakeOptions { size, directions, progress: false, ..BakeOptions::default() };
    bake(&scene, &camera, &options).unwrap().bytes
}

const ALBEDO: [f64; 3] = [0.5, 0.25, 0.8];

/// A level plane that fills the picture.
fn plane() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let plane = ground(500.0, 0.0, ALBEDO.map(|v| v as f32));
        baked("golden-plane", &[plane], ([0.0, 9.0, 4.0], [0.0, 0.0, 0.0]), (20, 18), 16)
    })
}

/// Something of everything: shadow, texture, edges, sky.
fn yard() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| baked("golden-yard", &courtyard(), ([2.5, 2.6, 6.5], [-0.4, 0.8, 0.0]), (36, 28), 16))
}

fn relit(bytes: &[u8], weights: &PatchWeights) -> Picture {
    let mut relighter = Relighter::new(Field::new(bytes).unwrap(), 1);
    relighter.set_weights(weights, 1.0).unwrap();
    relighter.radiance()
}

fn mean(picture: &Picture) -> [f64; 3] {
    std::array::from_fn(|c| picture.rgb.iter().map(|p| f64::from(p[c])).sum::<f64>() / picture.rgb.len() as f64)
}

fn assert_near(found: [f64; 3], expected: [f64; 3], tolerance: f64, what: &str) {
    let near = (0..3).all(|c| (found[c] - expected[c]).abs() <= tolerance * expected[c].abs());
    assert!(near, "{what}: {found:?} instead of {expected:?}");
}

#[test]
fn a_plane_under_an_even_sky_has_its_albedo() {
    let set = PatchSet::new(16).unwrap();
    let radiance = (0..set.len()).map(|patch| if patch < set.upper() { [1.0; 3] } else { [0.0; 3] }).collect();
    let picture = relit(plane(), &PatchWeights { radiance, sun: None });
    assert_eq!((picture.width, picture.height), (20, 18));
    assert!(picture.alpha.iter().all(|&a| a == 1.0));
    for rgb in &picture.rgb {
        assert_near(rgb.map(f64::from), ALBEDO, 0.02, "one pixel");
    }
    assert_near(mean(&picture), ALBEDO, 0.002, "their mean");
}

#[test]
fn a_plane_under_one_patch_has_albedo_over_pi_times_its_cosine() {
    // The integral of the cosine over each patch, by counting a fine grid of directions.
    let set = PatchSet::new(16).unwrap();
    let (rows, columns) = (400, 800);
    let mut cosines = vec![0.0; set.len()];
    for row in 0..rows {
        let theta = 0.5 * PI * (row as f64 + 0.5) / rows as f64;
        let omega = 0.5 * PI / rows as f64 * 2.0 * PI / columns as f64 * theta.sin();
        for column in 0..columns {
            let azimuth = 2.0 * PI * (column as f64 + 0.5) / columns as f64;
            let dir = [theta.sin() * azimuth.cos(), theta.cos(), theta.sin() * azimuth.sin()].map(|v| v as f32);
            cosines[set.patch_of(dir)] += omega * theta.cos();
        }
    }
    assert!((cosines.iter().sum::<f64>() / PI - 1.0).abs() < 1e-3);
    for (patch, cosine) in cosines.iter().enumerate() {
        let mut radiance = vec![[0.0; 3]; set.len()];
        radiance[patch] = [3.0, 2.0, 1.0];
        let picture = relit(plane(), &PatchWeights { radiance, sun: None });
        let expected = std::array::from_fn(|c| ALBEDO[c] / PI * cosine * [3.0, 2.0, 1.0][c]);
        // Below the horizon nothing reaches the plane, and the field must say so exactly.
        assert_near(mean(&picture), expected, if patch < set.upper() { 0.02 } else { 0.0 }, &format!("patch {patch}"));
    }
}

#[test]
fn a_plane_under_a_sun_has_albedo_over_pi_times_its_cosine() {
    for (dir_world, cosine) in [([0.0, 1.0, 0.0], 1.0), ([0.6, 0.8, 0.0], 0.8), ([0.0, 0.28, -0.96], 0.28)] {
        let sun = Some(SunWeight { dir_world, irradiance: [10.0, 9.0, 4.0] });
        let picture = relit(plane(), &PatchWeights { radiance: vec![[0.0; 3]; 17], sun });
        let expected = std::array::from_fn(|c| ALBEDO[c] / PI * cosine * [10.0, 9.0, 4.0][c]);
        for rgb in &picture.rgb {
            assert_near(rgb.map(f64::from), expected, 0.008, "one pixel");
        }
        assert_near(mean(&picture), expected, 0.002, "their mean");
    }
}

#[test]
fn a_white_body_in_even_light_vanishes() {
    // The furnace: albedo 1 under radiance 1 from everywhere shows radiance 1, times coverage at its edges.
    let body = cuboid([-1.0, 0.0, -1.0], [1.0, 2.0, 1.0], [1.0; 3]);
    let bytes = baked("golden-furnace", &[body], ([4.0, 3.0, 5.0], [0.0, 1.0, 0.0]), (20, 18), 128);
    let picture = relit(&bytes, &PatchWeights { radiance: vec![[1.0; 3]; 136], sun: None });
    let inside: Vec<[f64; 3]> =
        picture.rgb.iter().zip(&picture.alpha).filter(|(_, a)| **a == 1.0).map(|(p, _)| p.map(f64::from)).collect();
    assert!(inside.len() > 40 && picture.alpha.contains(&0.0));
    let mean = std::array::from_fn(|c| inside.iter().map(|p| p[c]).sum::<f64>() / inside.len() as f64);
    assert_near(mean, [1.0; 3], 0.005, "mean inside");
    for (rgb, alpha) in picture.rgb.iter().zip(&picture.alpha) {
        assert!((rgb[0] - alpha).abs() <= 0.02 + 0.05 * alpha, "{rgb:?} at coverage {alpha}");
    }
}

/// Whole-numbered noise that is the same everywhere.
fn random_weights(seed: u64, patches: usize) -> PatchWeights {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / 256.0
    };
    let radiance = (0..patches).map(|_| [next(), next(), next()]).collect();
    let dir = [0.48, 0.64, if seed.is_multiple_of(2) { 0.6 } else { -0.6 }];
    let sun = (!seed.is_multiple_of(3)).then(|| SunWeight { dir_world: dir, irradiance: [next(), next(), next()] });
    PatchWeights { radiance, sun }
}

#[test]
fn this_machines_kernel_draws_what_the_scalar_one_draws() {
    for bytes in [plane(), yard()] {
        let field = Field::new(bytes).unwrap();
        let (width, height) = (field.width(), field.height());
        let mut scalar = Relighter::with_kernel(field, 1, Kernel::SCALAR);
        let mut vector = Relighter::with_kernel(field, 2, Kernel::detect());
        let view = View::new(width, height, (0..(width * height) as u32).map(|k| (k * 7919) & 0xff_ffff).collect());
        let [mut a, mut b] = [(); 2].map(|()| Framebuffer::new(width, height));
        for seed in 0..6 {
            let weights = random_weights(seed, field.patch_set().len());
            let exposure = 2f32.powi(-14 + 3 * seed as i32);
            for relighter in [&mut scalar, &mut vector] {
                relighter.set_weights(&weights, exposure).unwrap();
            }
            let counters = [scalar.draw(&view, &mut a), vector.draw(&view, &mut b)];
            assert_eq!(counters[0], counters[1]);
            assert!(a == b, "{}: pictures differ at seed {seed}", vector.kernel().name());
            let [a, b] = [scalar.radiance(), vector.radiance()];
            assert!(a.rgb.iter().flatten().zip(b.rgb.iter().flatten()).all(|(a, b)| a.to_bits() == b.to_bits()));
            assert!(a.rgb.iter().flatten().any(|&v| v > 0.0));
        }
    }
}

#[test]
fn a_sun_that_is_traced_behind_frames_is_shown_once_it_is_traced() {
    let field = Field::new(yard()).unwrap();
    let mut weights = random_weights(1, field.patch_set().len());
    let mut behind = Relighter::new(field, 1);
    behind.trace_behind().unwrap();
    let mut frame = |weights: &PatchWeights| {
        behind.set_weights(weights, 1.0).unwrap();
        (behind.radiance(), behind.sun_dir_world(), behind.awaits_sun())
    };
    let (first, ..) = frame(&weights);
    let sky = PatchWeights { sun: None, ..weights.clone() };
    assert!(first == relit(yard(), &sky), "the first frame waits for no sun");
    let (whole, begun) = (relit(yard(), &weights), Instant::now());
    assert!(whole != first);
    // The thread takes the direction that it was given first; then the one that the sun has gone on to.
    for step in 0..2 {
        let shown = loop {
            match frame(&weights) {
                (_, None, waits) => assert!(waits && begun.elapsed().as_secs() < 100),
                (shown, dir, _) if dir == weights.sun.map(|sun| sun.dir_world) => break shown,
                _ => assert!(step == 1 && begun.elapsed().as_secs() < 100),
            }
            std::thread::sleep(Duration::from_millis(1));
        };
        assert!(shown == relit(yard(), &weights), "direction {step}");
        weights.sun = weights.sun.map(|sun| SunWeight { dir_world: [0.48, 0.6, 0.64], ..sun });
    }
}

/// Pictures of frames that wait for a tracer can be made again from what they showed alone, bit for bit, so that they also skip
/// the same tiles: in a sun that goes on, stands still, and is moved as by a clock that is set.
#[test]
fn frames_of_a_sun_traced_behind_them_can_be_made_again() {
    let field = Field::new(yard()).unwrap();
    let (width, height) = (field.width(), field.height());
    let view = View::new(width, height, vec![0x30_4050; width * height]);
    let [mut behind, mut again] = [(); 2].map(|()| Relighter::new(field, 1));
    behind.trace_behind().unwrap();
    behind.set_sun_step_deg(0.05);
    let [mut shown, mut replayed] = [(); 2].map(|()| Framebuffer::new(width, height));
    let (mut seen, mut kept) = ([0; 2], 0);
    for frame in 0..600u32 {
        let turn = f64::from(frame % 100) * 0.002 + f64::from(frame / 100 % 3);
        let drift = 1.0 + 2e-4 * (frame % 90) as f32;
        let mut weights = random_weights(1, field.patch_set().len());
        weights.radiance.iter_mut().flatten().for_each(|v| *v *= drift * 5e-4);
        let dir_world = [0.8 * turn.cos() as f32, 0.6, 0.8 * turn.sin() as f32];
        weights.sun =
            weights.sun.map(|sun| SunWeight { dir_world, irradiance: sun.irradiance.map(|v| v * 1e-3 * drift) });
        behind.set_weights(&weights, 1.0).unwrap();
        let sun = weights.sun.zip(behind.sun_dir_world());
        seen[usize::from(sun.is_some())] += 1;
        weights.sun = sun.map(|(sun, dir_world)| SunWeight { dir_world, ..sun });
        again.set_weights(&weights, 1.0).unwrap();
        kept += behind.draw(&view, &mut shown).tiles_kept;
        again.draw(&view, &mut replayed);
        assert!(shown == replayed, "frame {frame}");
        std::thread::sleep(Duration::from_micros(300));
    }
    assert!(seen.iter().all(|&frames| frames > 3) && kept > 300, "{seen:?} {kept}");
}

/// The field with one more layer at its end.
fn with_layer(bytes: &[u8], kind: [u8; 4], flags: u32) -> Vec<u8> {
    let field = Field::new(bytes).unwrap();
    let mut layers: Vec<(Layer, Vec<u8>)> = field
        .layers()
        .map(|layer| (layer, bytes[layer.offset as usize..(layer.offset + layer.length) as usize].to_vec()))
        .collect();
    let extra = b"from a later release".to_vec();
    let crc32 = field.layers().next().unwrap().crc32 ^ 1;
    layers.push((Layer { kind, flags, offset: 0, length: extra.len() as u64, crc32 }, extra));
    let mut offset = (HEADER + layers.len() * LAYER_ENTRY).next_multiple_of(LAYER_ALIGN);
    for (layer, data) in &mut layers {
        layer.offset = offset as u64;
        offset = (offset + data.len()).next_multiple_of(LAYER_ALIGN);
    }
    let table: Vec<u8> = layers.iter().flat_map(|(layer, _)| layer.encode()).collect();
    let mut file = field.header().encode(offset as u64, &table).to_vec();
    file.extend_from_slice(&table);
    for (layer, data) in &layers {
        file.resize(layer.offset as usize, 0);
        file.extend_from_slice(data);
    }
    file.resize(offset, 0);
    file
}

#[test]
fn a_later_layer_is_passed_over_unless_it_must_be_understood() {
    let weights = random_weights(1, 17);
    let later = with_layer(yard(), *b"RECV", 0);
    let field = Field::new(&later).unwrap();
    assert!(field.layers().any(|layer| layer.kind == *b"RECV"));
    assert_eq!(relit(&later, &weights), relit(yard(), &weights));
    let needed = with_layer(yard(), *b"RECV", LAYER_CRITICAL);
    assert_eq!(Field::new(&needed).unwrap_err(), FieldError::UnknownLayer(*b"RECV"));
}
