use super::*;

fn lens(model: LensModel, k: [f64; 4]) -> Lens {
    let file = LensFile {
        model,
        focal_px: 150.0,
        center_px: [240.3, 239.1],
        k,
        camera_to_world: ZENITH_NORTH_UP,
        width: Some(480),
        height: Some(480),
        vignetting: [0.0; 3],
        mask: None,
    };
    file.lens("l.json").unwrap()
}

fn all() -> [Lens; 3] {
    [
        lens(LensModel::Equidistant, [0.0; 4]),
        lens(LensModel::Equisolid, [0.0; 4]),
        lens(LensModel::KannalaBrandt, [-0.02, 0.004, -0.001, 0.0]),
    ]
}

#[test]
fn projection_and_back_agree() {
    for lens in all() {
        for (x, y) in [(240.3, 239.1), (10.0, 200.0), (400.5, 300.5), (240.0, 470.0)] {
            let dir = lens.unproject([x, y]).unwrap();
            let back = lens.project(dir).unwrap();
            assert!((back[0] - x).hypot(back[1] - y) < 1e-6, "{lens:?} {back:?}");
        }
    }
}

#[test]
fn the_whole_sphere_cap_has_its_solid_angle() {
    for lens in all() {
        let (theta, mut sum) = (1.3f64, 0.0);
        for i in 0..480 * 480 * 4 {
            let at = [(i % 960) as f64 * 0.5 + 0.25, (i / 960) as f64 * 0.5 + 0.25];
            if lens.unproject(at).is_some_and(|d| d[1] > theta.cos()) {
                sum += 0.25 * lens.solid_angle_sr(at).unwrap();
            }
        }
        let expected = 2.0 * PI * (1.0 - theta.cos());
        assert!((sum / expected - 1.0).abs() < 2e-3, "{lens:?}: {sum} {expected}");
    }
}

#[test]
fn looking_up_north_is_at_the_top_and_west_on_the_right() {
    let lens = Lens::zenith_equidistant(480, 480, 180.0);
    let north = lens.project([0.0, 0.5, -0.866]).unwrap();
    let west = lens.project([-0.866, 0.5, 0.0]).unwrap();
    assert!((north[0] - 240.0).abs() < 1e-6 && north[1] < 100.0, "{north:?}");
    assert!((west[1] - 240.0).abs() < 1e-6 && west[0] > 380.0, "{west:?}");
    assert!((lens.project([1.0, 1e-9, 0.0]).unwrap()[0] - 0.0).abs() < 1e-3);
}

/// From first principles: someone lies on the back, head to the north, and looks up. The picture's top is towards the head,
/// so the camera's down is south; forward is up; and the right hand, as seen by eyes that look up, points west.
#[test]
fn the_matrix_of_a_level_camera_with_north_up_follows_from_its_axes() {
    let (north, up) = ([0.0, 0.0, -1.0], [0.0, 1.0, 0.0]);
    let down = north.map(|c: f64| 0.0 - c);
    // A right-handed camera: right = down x forward.
    let right: [f64; 3] =
        std::array::from_fn(|i| down[(i + 1) % 3] * up[(i + 2) % 3] - down[(i + 2) % 3] * up[(i + 1) % 3]);
    assert_eq!(right, [-1.0, 0.0, 0.0], "west is on the right");
    let columns = [right, down, up];
    let matrix: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]));
    assert_eq!(matrix, ZENITH_NORTH_UP);
}

#[test]
fn what_vignetting_takes_is_told_and_checked() {
    let file = LensFile { vignetting: [-0.3, 0.1, 0.0], ..lens(LensModel::Equidistant, [0.0; 4]).file() };
    let lens = file.lens("l.json").unwrap();
    let at = |theta: f64| lens.transmission([240.3 + 150.0 * theta, 239.1]).unwrap();
    assert!((at(0.0) - 1.0).abs() < 1e-12);
    // 45 degrees: q = 1/4.
    assert!((at(PI / 4.0) - (1.0 - 0.075 + 0.1 / 16.0)).abs() < 1e-9);
    assert_eq!(at(2.0), at(2.1), "held beyond 100 degrees");
    let dark = LensFile { vignetting: [-1.0, 0.0, 0.0], ..file };
    let error = dark.lens("l.json").unwrap_err().to_string();
    assert!(error.contains("vignetting") && error.contains("90 degrees"), "{error}");
}

#[test]
fn a_file_comes_back_as_it_went_with_its_mask() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("l.json");
    let mask = mask::SkyMask::from_fn(480, 480, |pixel| pixel % 480 < 100);
    mask.save(&folder.path().join("mask.png")).unwrap();
    let plain = lens(LensModel::KannalaBrandt, [-0.02, 0.004, -0.001, 0.0]);
    let file = LensFile { vignetting: [-0.2, 0.0, 0.01], mask: Some("mask.png".into()), ..plain.file() };
    file.save(&path).unwrap();
    let back = Lens::load(&path).unwrap();
    assert_eq!(back.mask(), Some(&mask));
    assert_eq!(LensFile { mask: Some("mask.png".into()), ..back.file() }, file);
    mask::SkyMask::from_fn(480, 479, |_| true).save(&folder.path().join("mask.png")).unwrap();
    let error = Lens::load(&path).unwrap_err().to_string();
    assert!(error.contains("mask") && error.contains("480x479") && !error.contains('\n'), "{error}");
    mask::SkyMask::from_fn(480, 480, |_| false).save(&folder.path().join("mask.png")).unwrap();
    assert!(Lens::load(&path).unwrap_err().to_string().contains("paint the sky white"));
}

#[test]
fn bad_files_name_the_field() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("l.json");
    let good =
        r#"{"model":"equisolid","focal_px":100,"center_px":[10,20],"camera_to_world":[[1,0,0],[0,1,0],[0,0,1]]}"#;
    let cases = [
        (good.replace("100", "-1"), "focal_px"),
        (good.replace("[0,0,1]", "[0,0,-1]"), "camera_to_world"),
        (good.replace("\"focal_px\"", "\"fokal\""), "fokal"),
        (good.replace("equisolid", "pinhole"), "pinhole"),
        (good.replace("\"focal_px\"", "\"k\":[1,0,0,0],\"focal_px\""), "k"),
        (good.replace("\"focal_px\"", "\"mask\":\"none.png\",\"focal_px\""), "none.png"),
    ];
    std::fs::write(&path, good).unwrap();
    Lens::load(&path).unwrap();
    for (text, field) in cases {
        std::fs::write(&path, text).unwrap();
        let error = Lens::load(&path).unwrap_err().to_string();
        assert!(error.contains(field) && error.contains("l.json") && !error.contains('\n'), "{error}");
    }
}
