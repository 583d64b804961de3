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
fn a_cloud_that_passes_does_not_move_the_exposure() {
    let folder = tempfile::tempdir().unwrap();
    let site = Vanished::bake(folder.path(), &SMALL, Lens::Pinhole, 1).unwrap();
    let day = Day::all().nth(1).unwrap();
    let (step_s, count) = (10.0, 16);
    let start_unix_s = passing(&day, step_s, count);
    let skies: Vec<SkyModel> = (0..count).map(|k| day.sky(start_unix_s + step_s * k as f64).unwrap()).collect();
    // One exposure for all of them, by the clock of the first.
    let gains = ViewCamera::exposed(skies[0].clone(), &site.camera, 7).gains;
    let views: Vec<Vec<u32>> = skies
        .into_iter()
        .zip(1..)
        .map(|(sky, seed)| {
            let mut camera = ViewCamera::exposed(sky, &site.camera, seed);
            camera.gains = gains;
            camera.picture(&camera.trace(&site.real, (SMALL.size, SMALL.samples), 0).unwrap())
        })
        .collect();
    let running = Running { start_unix_s, step_s };
    let shown = shown(folder.path(), (&day, SkyKind::Synthetic), running, (&views, SMALL.size)).unwrap();
    let off: Vec<f64> = shown.iter().map(|shown| shown.exposure / gains[1]).collect();
    eprintln!("exposure over the view's: {off:.3?}");
    let (least, most) = off.iter().fold((f64::INFINITY, 0.0f64), |(a, b), &v| (a.min(v), b.max(v)));
    assert!(most / least <= 1.02, "{off:?}");
}

/// When, in the middle of a day, a cloud comes before the sun and goes: a run of `count` moments that begins and ends in sunshine.
fn passing(day: &Day, step_s: f64, count: usize) -> f64 {
    let beam = |unix_s: f64| day.sky(unix_s).unwrap().sun().map_or(0.0, |sun| f64::from(sun.irradiance[1]));
    let noon = parse_utc("2026-10-02T10:00:00Z").unwrap();
    let clear = Day { weather: Weather { cloud_cover: 0.0, ..day.weather }, ..*day };
    let full = f64::from(clear.sky(noon).unwrap().sun().unwrap().irradiance[1]);
    let run = |start: &f64| {
        let share = |k: usize| beam(start + step_s * k as f64) / full;
        share(0) > 0.8 && share(count / 2) < 0.3 && share(count - 1) > 0.8
    };
    let starts = (0..720).map(|k| noon - 7200.0 + 20.0 * f64::from(k));
    starts.into_iter().find(|start| run(start)).expect("a cloud that passes")
}
