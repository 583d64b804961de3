use super::*;
use crate::bracket::{MergeSettings, Merger};
use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use crate::camera::{Camera, take_series};
use crate::sun::SunPosition;

#[test]
fn the_planner_follows_from_noon_to_night_and_does_not_flap() {
    let settings = SyntheticSettings { width: 48, height: 48, delay_frames: 0, ..SyntheticSettings::default() };
    for altitude_deg in [60.0, 5.0, -4.0] {
        let sun = Some(SunPosition { azimuth_deg: 180.0, altitude_deg });
        let mut camera = SyntheticCamera::new(SyntheticSettings { sun, gamma: 1.0, ..settings.clone() });
        let mut planner = Planner::new(camera.limits(), 4);
        let mut merger = Merger::new(MergeSettings::default());
        let (mut frames, mut merged, mut plans) = (Vec::new(), Merged::default(), Vec::new());
        for _ in 0..10 {
            let plan = planner.exposures();
            assert!(plan.len() <= 4 && plan.windows(2).all(|w| w[0].product_s() < w[1].product_s()), "{plan:?}");
            take_series(&mut camera, &plan, &mut frames).unwrap();
            merger.merge(&frames, &mut merged).unwrap();
            planner.follow(&merged);
            plans.push(plan);
        }
        assert_eq!(plans[8], plans[9], "{altitude_deg}");
        let clipped = merged.state.iter().filter(|&&s| s == PixelState::Clipped).count();
        assert!(clipped < 48 * 48 / 50, "{altitude_deg}: {clipped}");
        assert!(merged.radiance.iter().any(|v| v[1] > 0.0));
    }
}
