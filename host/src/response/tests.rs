use super::*;

#[test]
fn a_curve_is_read_written_and_interpolated() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.csv");
    let rows = (0..=255).map(|i| f64::from(i) / 255.0).map(|c| [c, c.powf(2.2), c * c, c]).collect();
    let response = Response::from_rows(rows, "c").unwrap();
    response.save(&path).unwrap();
    assert_eq!(Response::load(&path).unwrap(), response);
    assert!((response.fraction(0.5, 1) - 0.25).abs() < 1e-5);
    assert_eq!((response.fraction(0.0, 0), response.fraction(1.0, 0)), (0.0, 1.0));
    assert_eq!(Response::default().fraction(0.37, 2), 0.37);
}

#[test]
fn bad_curves_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.csv");
    for (text, expected) in [
        ("", "no rows"),
        ("0,0,0,0\n0.5,.5,.5,.5\n0.7,.4,.6,.7\n1,1,1,1", "line 3"),
        ("code/max,R,G,B\n\n0,0,0,0\n0.5,.5,.5,.5\n0.7,.4,.6,.7\n1,1,1,1", "line 5"),
        ("0,0,0,0\n0.5,.5,x,.5\n1,1,1,1", "line 2"),
        ("0,0,0,0\n0.5,.5,NaN,.5\n1,1,1,1", "line 2"),
        ("0,0,0,0\n0.5,1,1,1", "from 0 to 1"),
        ("0,0,0.5,0\n1,1,0.5,1", "level"),
        ("0,0,0,0\n1,2,1,1", "full well"),
    ] {
        std::fs::write(&path, text).unwrap();
        let error = Response::load(&path).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("c.csv"), "{error}");
    }
}
