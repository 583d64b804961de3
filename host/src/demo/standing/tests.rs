use super::*;

const SMALL: Effort = Effort { size: (96, 64), samples: 48, bake_paths: (2, 10) };

#[test]
fn what_a_post_shows_is_the_site_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let (report, rows) = study(folder.path(), SMALL, 4.0 * 3600.0, 31, None).unwrap();
    assert_eq!((report.moments.len(), rows.len()), (6, 6));
    for (moment, row) in report.moments.iter().zip(&rows) {
        let Compared { camera, noise_of_blocks, gain_error, .. } = &moment.own;
        eprintln!("{} {}: {camera}, noise {noise_of_blocks:.2}, gain {gain_error:.3?}", moment.day, moment.time_utc);
        assert!(camera.median_of_blocks <= 1.0 && camera.high_of_blocks <= 3.0, "{moment:?}");
        assert!(gain_error.iter().all(|error| error.abs() <= 0.03), "{moment:?}");
        // As it is the site is no match.
        let before = row.real.iter().zip(&row.truth).filter(|(a, b)| a != b).count();
        assert!(before > 1000, "{before}");
    }
    assert!(report.moments.iter().any(|moment| moment.clipped > 0.0), "nothing is clipped");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "something is left behind");
}
