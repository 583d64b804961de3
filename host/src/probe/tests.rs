use super::*;
use crate::lens::LensFile;
use crate::sun::{SunPosition, dir_world};

fn reading(horizontal: [f64; 3]) -> Probe {
    Probe { horizontal, relative_sigma: 0.01 }
}

fn rebuild(probe: &Probe, merged: &mut Merged, lens: &Lens, dir: [f32; 3]) -> Result<Rebuilt, ProbeError> {
    probe.rebuild(&mut Probed { merged, sigma: None, lens, colour: &CameraColour::default() }, dir)
}

#[test]
fn the_disc_makes_up_what_the_probe_shows_beyond_the_sky() {
    let lens = Lens::zenith_equidistant(240, 240, 184.0);
    let dir = dir_world(SunPosition { azimuth_deg: 200.0, altitude_deg: 30.0 }, 0.0);
    let count = 240 * 240;
    let mut merged = Merged {
        width: 240,
        height: 240,
        radiance: vec![[1.0, 2.0, 3.0]; count],
        state: vec![PixelState::Valid; count],
        captured_at_s: 0.0,
    };
    // A uniform sky's irradiance is pi x radiance; the sun adds 10 on a plane normal to it, a half of that below 30 degrees.
    let probe = reading([1.0, 2.0, 3.0].map(|v| v * std::f64::consts::PI + 5.0));
    assert_eq!(rebuild(&probe, &mut merged, &lens, dir).unwrap(), Rebuilt::NotClipped);
    let at = lens.project(dir.map(f64::from)).unwrap();
    merged.state[at[1] as usize * 240 + at[0] as usize] = PixelState::Clipped;
    let Rebuilt::Disc(normal) = rebuild(&probe, &mut merged, &lens, dir).unwrap() else { panic!("no disc") };
    assert!(normal.iter().all(|v| (v / 10.0 - 1.0).abs() < 0.02), "{normal:?}");
    let (mut sum, mut horizontal) = (0.0, 0.0);
    for (index, value) in merged.radiance.iter().enumerate() {
        let at = [(index % 240) as f64 + 0.5, (index / 240) as f64 + 0.5];
        let (Some(towards), Some(omega)) = (lens.unproject(at), lens.solid_angle_sr(at)) else { continue };
        if towards[1] > 0.0 {
            sum += (f64::from(value[1]) - 2.0) * omega;
            horizontal += f64::from(value[1]) * omega * towards[1];
        }
    }
    assert!((sum / normal[1] - 1.0).abs() < 1e-3, "{sum}");
    assert!((horizontal / probe.horizontal[1] - 1.0).abs() < 5e-3, "{horizontal}");
    assert!(merged.radiance.iter().flatten().all(|v| v.is_finite()));
    merged.state.fill(PixelState::Clipped);
    let dark = reading([0.1; 3]);
    assert_eq!(rebuild(&dark, &mut merged, &lens, dir).unwrap(), Rebuilt::NothingLeft);
    let narrow = Lens::zenith_equidistant(240, 240, 40.0);
    let narrow = Lens::turned(&narrow, [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]);
    assert!(matches!(rebuild(&dark, &mut merged, &narrow, dir), Err(ProbeError::Unseen(_))));
}

#[test]
fn bad_readings_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.json");
    for (text, told) in [
        ("{}", "E_horizontal"),
        (r#"{"E_horizontal":[1,2,-3]}"#, "-3"),
        (r#"{"E_horizontal":[1,2,3],"relative_sigma":2}"#, "relative_sigma"),
        ("nonsense", "p.json"),
    ] {
        std::fs::write(&path, text).unwrap();
        let error = Probe::load(&path).unwrap_err().to_string();
        assert!(error.contains(told) && error.contains("p.json") && !error.contains('\n'), "{error}");
    }
}

/// An even sky of radiance 1 through a lens that darkens its edge, in colours of its own, with a disc of irradiance 40 that clips.
#[test]
fn what_the_lens_takes_and_the_cameras_colours_do_not_change_the_sun() {
    let file = LensFile { vignetting: [-0.5, 0.1, 0.0], ..Lens::zenith_equidistant(240, 240, 184.0).file() };
    let lens = file.lens("lens").unwrap();
    let colour = CameraColour {
        white_balance: [1.8, 1.0, 1.4],
        matrix: [[1.5, -0.4, -0.1], [-0.2, 1.3, -0.1], [0.1, -0.6, 1.5]],
    };
    let dir = dir_world(SunPosition { azimuth_deg: 200.0, altitude_deg: 30.0 }, 35.0);
    let at = |index: usize| [(index % 240) as f64 + 0.5, (index / 240) as f64 + 0.5];
    let grey = colour.white_balance.map(|w| 1.0 / w);
    let passed = |index: usize| lens.transmission(at(index)).unwrap_or(1.0);
    let radiance = (0..240 * 240).map(|index| grey.map(|v| (v * passed(index)) as f32)).collect();
    let state = vec![PixelState::Clipped; 240 * 240];
    let mut merged = Merged { width: 240, height: 240, radiance, state, captured_at_s: 0.0 };
    let before = merged.radiance.clone();
    let probe = reading([std::f64::consts::PI + 20.0; 3]);
    let found = probe.rebuild(&mut Probed { merged: &mut merged, sigma: None, lens: &lens, colour: &colour }, dir);
    let Rebuilt::Disc(normal) = found.unwrap() else { panic!("no disc") };
    assert!(normal.iter().all(|v| (v / 40.0 - 1.0).abs() < 0.02), "{normal:?}");
    let mut added = [0.0; 3];
    for (index, (now, before)) in merged.radiance.iter().zip(&before).enumerate().filter(|(_, (a, b))| a != b) {
        let light = lens.solid_angle_sr(at(index)).unwrap() / passed(index);
        (0..3).for_each(|k| added[k] += f64::from(now[k] - before[k]) * light * colour.white_balance[k]);
    }
    assert!((0..3).all(|k| (added[k] / normal[k] - 1.0).abs() < 1e-3), "{added:?} {normal:?}");
}

/// Against readings drawn with the stated error.
#[test]
fn the_discs_sigma_is_the_spread_over_readings() {
    let lens = Lens::zenith_equidistant(120, 120, 184.0);
    let dir = dir_world(SunPosition { azimuth_deg: 120.0, altitude_deg: 40.0 }, 0.0);
    let pixels = 120 * 120;
    let (radiance, state) = (vec![[0.5f32; 3]; pixels], vec![PixelState::Clipped; pixels]);
    let sky = Merged { width: 120, height: 120, radiance, state, captured_at_s: 0.0 };
    let colour = CameraColour { white_balance: [2.0, 1.0, 1.5], ..CameraColour::default() };
    let truth = [0.5 * std::f64::consts::PI + 30.0; 3];
    let at = lens.project(dir.map(f64::from)).unwrap();
    let centre = at[1] as usize * 120 + at[0] as usize;
    let look = |horizontal: [f64; 3]| {
        let (mut merged, mut sigma) = (sky.clone(), vec![[0.0f32; 3]; pixels]);
        let probe = Probe { horizontal, relative_sigma: 0.03 };
        let mut picture = Probed { merged: &mut merged, sigma: Some(&mut sigma), lens: &lens, colour: &colour };
        assert!(matches!(probe.rebuild(&mut picture, dir), Ok(Rebuilt::Disc(_))));
        (merged.radiance[centre].map(f64::from), sigma[centre].map(f64::from), sigma[0])
    };
    let (mean, told, elsewhere) = look(truth);
    assert_eq!(elsewhere, [0.0; 3], "only what the disc covers is less certain");
    let mut random = 6451u64;
    let mut uniform = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let mut square = [0.0; 3];
    let draws = 200;
    for _ in 0..draws {
        let found = look(truth.map(|v| v * (1.0 + 0.03 * 12f64.sqrt() * uniform()))).0;
        (0..3).for_each(|k| square[k] += (found[k] - mean[k]).powi(2) / f64::from(draws));
    }
    assert!((0..3).all(|k| (told[k] / square[k].sqrt() - 1.0).abs() < 0.15), "{told:?} {square:?}");
}
