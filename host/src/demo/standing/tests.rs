use super::passing::{Frame, Taken};
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

#[test]
fn the_temple_keeps_to_the_ground_while_a_cloud_passes_the_sun() {
    let folder = tempfile::tempdir().unwrap();
    let tiny = Effort { size: (60, 40), samples: 12, bake_paths: (1, 6) };
    let site = Vanished::bake(folder.path(), &tiny, Lens::Pinhole, 1).unwrap();
    let taken = Taken::of(&site, tiny, 7.5, 7000).unwrap();
    let frames = taken.shown(folder.path(), &site, SkyKind::Synthetic).unwrap();
    assert!(frames.iter().any(|frame| frame.beam < 0.05) && frames.iter().any(|frame| frame.beam > 0.99));
    let worst = |pick: fn(&Frame) -> f64| frames.iter().map(pick).map(|over| (over - 1.0).abs()).fold(0.0, f64::max);
    let (shown, at_true_gain) = (worst(|frame| frame.temple), worst(|frame| frame.temple_at_true_gain));
    eprintln!("temple's light off by {shown:.3} at most, at the true gain by {at_true_gain:.3}");
    assert!(shown < 0.25, "{frames:#?}");
    // What the sky camera tells of the sun is far enough off for the gain to matter.
    assert!(at_true_gain > 0.5, "{frames:#?}");
}
