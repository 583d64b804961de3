use super::chart::{COLORCHECKER_LAB_D50, ChartError, Sample, colorchecker, fit, read_patches, sample};
use super::difference::delta_e_2000;
use super::spaces::{D50, D65, REC709_OF_XYZ, Triple, XYZ_OF_REC709, adapt, apply, daylight, lab, xyz_of_lab};
use super::*;
use crate::camera::Frame;
use crate::response::Response;

/// A camera whose primaries and white are not Rec.709's: what it makes of linear Rec.709.
const CAMERA_OF_REC709: [Triple; 3] = [[0.42, 0.31, 0.05], [0.14, 0.78, 0.16], [0.02, 0.20, 0.52]];

fn noise(state: &mut u64) -> f64 {
    let mut uniform = || {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((*state >> 33) as f64 + 0.5) / f64::from(1u32 << 31)
    };
    (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()
}

/// Linear Rec.709 of a surface under daylight of a temperature.
fn rec709_under(lab_d50: Triple, light_k: f64) -> Triple {
    apply(&REC709_OF_XYZ, adapt(xyz_of_lab(lab_d50, D50), D50, daylight(light_k)))
}

fn samples(light_k: f64, exposure: f64) -> Vec<Sample> {
    let of = |lab: &Triple| Sample {
        camera: apply(&CAMERA_OF_REC709, rec709_under(*lab, light_k)).map(|v| v * exposure),
        xyz_d50: xyz_of_lab(*lab, D50),
    };
    COLORCHECKER_LAB_D50.iter().map(of).collect()
}

#[test]
fn spaces_agree_with_published_values() {
    // White of Rec.709 is D65; D65 as daylight of 6504 K has x = 0.3127, y = 0.3290.
    let white = apply(&XYZ_OF_REC709, [1.0; 3]);
    assert!((0..3).all(|k| (white[k] - D65[k]).abs() < 1e-6), "{white:?}");
    let [x, y, z] = daylight(6504.0);
    assert!((x / (x + y + z) - 0.3127).abs() < 2e-4 && (y / (x + y + z) - 0.3290).abs() < 2e-4);
    // sRGB red is L*a*b* 54.29, 80.80, 69.89 under D50 (ICC's sRGB profile, Lindbloom's calculator).
    let red = lab(adapt(apply(&XYZ_OF_REC709, [1.0, 0.0, 0.0]), D65, D50), D50);
    assert!((0..3).all(|k| (red[k] - [54.29, 80.80, 69.89][k]).abs() < 0.05), "{red:?}");
    let back = lab(xyz_of_lab([43.0, -17.0, 5.0], D50), D50);
    assert!((back[0] - 43.0).abs() < 1e-9 && (back[1] + 17.0).abs() < 1e-9 && (back[2] - 5.0).abs() < 1e-9);
}

#[test]
fn a_known_matrix_comes_back_whatever_daylight_the_chart_stood_in() {
    for light_k in [5000.0, 6504.0, 9000.0] {
        let fitted = fit(&samples(light_k, 0.7), light_k).unwrap();
        let worst = fitted.fitted.iter().copied().fold(0.0, f64::max);
        assert!(worst < 0.05, "{light_k}: {:?}", fitted.fitted);
        assert!(fitted.balanced_only.iter().copied().fold(0.0, f64::max) > 5.0, "{:?}", fitted.balanced_only);
        // The white of D65 comes out grey with its green kept.
        let camera = apply(&CAMERA_OF_REC709, [0.5; 3]);
        let [r, g, b] = fitted.colour.to_rec709().map(|row| (0..3).map(|k| f64::from(row[k]) * camera[k]).sum::<f64>());
        let green = camera[1];
        assert!(
            (g / green - 1.0).abs() < 1e-3 && (r / g - 1.0).abs() < 1e-3 && (b / g - 1.0).abs() < 1e-3,
            "{light_k}: {r} {g} {b}"
        );
    }
}

#[test]
fn a_noisy_8_bit_photograph_gives_colours_that_the_chart_does_not_hold() {
    let corners = [[30.0, 25.0], [182.0, 28.0], [180.0, 121.0], [28.0, 118.0]];
    let patches = colorchecker(corners);
    let gamma = 2.2f64;
    let mut worst_of_all = 0.0f64;
    for seed in 901..906 {
        let mut state = seed;
        let mut frame = Frame::default();
        let codes = frame.codes_u8(210, 150);
        for pixel in 0..210 * 150 {
            let at = [(pixel % 210) as f64 + 0.5, (pixel / 210) as f64 + 0.5];
            let near = patches.iter().enumerate().min_by(|a, b| {
                let off = |p: &super::chart::Patch| (p.center_px[0] - at[0]).hypot(p.center_px[1] - at[1]);
                off(a.1).total_cmp(&off(b.1))
            });
            let lab = COLORCHECKER_LAB_D50[near.unwrap().0];
            let camera = apply(&CAMERA_OF_REC709, rec709_under(lab, 6504.0)).map(|v| 0.7 * v);
            for k in 0..3 {
                // Shot noise of a well of 10,000 electrons, read noise of 5.
                let noisy = camera[k] + noise(&mut state) * (camera[k] / 1e4 + 2.5e-7).sqrt();
                codes[3 * pixel + k] = (255.0 * noisy.clamp(0.0, 1.0).powf(1.0 / gamma)).round() as u8;
            }
        }
        let rows = (0..=255).map(|i| f64::from(i) / 255.0).map(|c| [c, c.powf(gamma), c.powf(gamma), c.powf(gamma)]);
        let response = Response::from_rows(rows.collect(), "r").unwrap();
        let fitted = fit(&sample(&frame, &response, &patches).unwrap(), 6504.0).unwrap();
        // Colours within Rec.709 and bluish skies, none of the chart's.
        let mut off = Vec::new();
        for i in 0..216 {
            let rgb = [i % 6, i / 6 % 6, i / 36].map(|v| 0.03 + 0.17 * v as f64);
            let camera = apply(&CAMERA_OF_REC709, rgb);
            let green = apply(&CAMERA_OF_REC709, [1.0; 3])[1];
            let found =
                fitted.colour.to_rec709().map(|row| (0..3).map(|k| f64::from(row[k]) * camera[k]).sum::<f64>() / green);
            off.push(delta_e_2000(lab(apply(&XYZ_OF_REC709, found), D65), lab(apply(&XYZ_OF_REC709, rgb), D65)));
        }
        off.sort_by(f64::total_cmp);
        println!("seed {seed}: dE2000 median {:.3}, worst {:.3}", off[108], off[215]);
        worst_of_all = worst_of_all.max(off[215]);
        assert!(off[108] < 0.4, "{}", off[108]);
    }
    assert!(worst_of_all < 1.5, "{worst_of_all}");
}

#[test]
fn charts_that_tell_nothing_are_refused_with_the_patch() {
    let all = samples(6504.0, 0.7);
    assert_eq!(fit(&all[..18], 6504.0), Err(ChartError::NoGrey));
    assert_eq!(fit(&all[14..], 6504.0), Err(ChartError::TooFew(4)));
    let mut frame = Frame::default();
    frame.codes_u8(60, 40).fill(255);
    let patches = read_patches("x,y,R,G,B\n10,10,.5,.5,.5\n30, 20,.1,.2,.3\n", "p.csv").unwrap();
    assert_eq!(sample(&frame, &Response::default(), &patches), Err(ChartError::Clipped(1)));
    frame.codes_u8(60, 40).fill(0);
    assert_eq!(sample(&frame, &Response::default(), &patches), Err(ChartError::Black(1)));
    let outside = colorchecker([[5.0, 5.0], [70.0, 5.0], [70.0, 35.0], [5.0, 35.0]]);
    assert!(matches!(
        sample(&frame, &Response::default(), &outside),
        Err(ChartError::Outside(_) | ChartError::Black(_))
    ));
    for (text, line) in
        [("", "line 1"), ("a,b\n", "line 1"), ("x,y,L,a,b\n1,2,3,4\n", "line 2"), ("x,y,L,a,b\n1,2,3,4,x\n", "line 2")]
    {
        let error = read_patches(text, "p.csv").unwrap_err().to_string();
        assert!(error.contains("p.csv") && error.contains(line) && !error.contains('\n'), "{error}");
    }
}

#[test]
fn a_file_comes_back_and_bad_ones_name_the_field() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera.json");
    let colour = fit(&samples(6504.0, 0.7), 6504.0).unwrap().colour;
    colour.save(&path).unwrap();
    let back = CameraColour::load(&path).unwrap();
    let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
    assert!((0..9).all(|i| near(back.matrix[i / 3][i % 3], colour.matrix[i / 3][i % 3])), "{back:?}");
    assert!((0..3).all(|k| near(back.white_balance[k], colour.white_balance[k])), "{back:?}");
    for (text, part) in [
        (r#"{"white_balance":[1,1,0],"matrix":[[1,0,0],[0,1,0],[0,0,1]]}"#, "white_balance"),
        (r#"{"white_balance":[1,1,1],"matrix":[[1,0,0],[0,1,0],[0,0,2]]}"#, "sum to 1"),
        (r#"{"white_balance":[1,1,1]}"#, "matrix"),
    ] {
        std::fs::write(&path, text).unwrap();
        let error = CameraColour::load(&path).unwrap_err().to_string();
        assert!(error.contains("camera.json") && error.contains(part) && !error.contains('\n'), "{error}");
    }
}
