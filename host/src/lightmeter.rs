//! The exposures that the light asks for, found by the planner of the live loop, where nothing else waits meanwhile.

use crate::bracket::{MergeSettings, Merged, Merger};
use crate::camera::series::Series;
use crate::camera::{Camera, CameraLimits, Exposure};
use crate::planner::{PlanReport, Planner};
use crate::sky_source::captured::SERIES;
use std::time::{Duration, Instant};

/// Series until the exposures fit the light; they climb by 3 stops each.
const ATTEMPTS: usize = 8;
/// The longest frame of a calibration over the longest of a plan: its dark end then comes near full well, and every code
/// between is seen of every part of the sky.
const LONGER: f64 = 4.0;

/// Follows the light of a sky camera.
pub struct LightMeter {
    limits: CameraLimits,
    planner: Planner,
    merger: Merger,
    series: Series,
    merged: Merged,
    took: Duration,
}

impl LightMeter {
    /// A meter for a camera that counts as linear: for exposures the factor that a curve makes does not matter.
    pub fn new(limits: CameraLimits) -> Self {
        Self::merging(limits, MergeSettings::default())
    }

    /// A meter whose merged series are of use, too.
    pub fn merging(limits: CameraLimits, settings: MergeSettings) -> Self {
        LightMeter {
            limits,
            planner: Planner::new(limits, SERIES),
            merger: Merger::new(settings),
            series: Series::default(),
            merged: Merged::default(),
            took: Duration::ZERO,
        }
    }

    /// Looks at the light by series of a camera, until the exposures fit it; `ready` makes `of` ready for a series.
    ///
    /// # Errors
    /// Why the camera gave nothing, or nothing that can be merged.
    pub fn look<C>(&mut self, of: &mut C, ready: impl Fn(&mut C) -> &mut dyn Camera) -> anyhow::Result<&Merged> {
        for _ in 0..ATTEMPTS {
            let camera = ready(of);
            let begun = Instant::now();
            self.series.take(camera, self.planner.exposures())?;
            self.took = begun.elapsed();
            self.merger.merge(self.series.frames(), &mut self.merged)?;
            if !self.planner.follow(&self.merged) {
                break;
            }
        }
        Ok(&self.merged)
    }

    /// What is planned for the light that was seen, and how long the last series took.
    pub fn plan(&self) -> (PlanReport, Duration) {
        (self.planner.report(), self.took)
    }

    /// The exposures that are planned for it.
    pub fn exposures(&self) -> &[Exposure] {
        self.planner.exposures()
    }

    /// `count` exposures, `step_stops` apart, rising, at gain 1, over the light that is there; fewer where the camera's
    /// times do not reach so far.
    pub fn calibration(&self, count: usize, step_stops: f64) -> Vec<Exposure> {
        let CameraLimits { min_exposure_s, max_exposure_s, .. } = self.limits;
        let step = step_stops.exp2();
        let planned_s = self.planner.exposures().last().map_or(max_exposure_s, Exposure::product_s);
        let all_above_s = min_exposure_s * step.powi(count as i32 - 1);
        let longest_s = (LONGER * planned_s).max(all_above_s).min(max_exposure_s);
        let mut exposures: Vec<Exposure> = Vec::new();
        for number in (0..count).rev() {
            let exposure_s = longest_s / step.powi(number as i32);
            let nearest = self.limits.nearest(Exposure { exposure_s, gain: 1.0 });
            let is_new = exposures.last().is_none_or(|last| !last.same_as(&nearest));
            if exposure_s >= 0.999 * min_exposure_s && is_new {
                exposures.push(nearest);
            }
        }
        exposures
    }

    /// For the sun's path: the shortest that the camera has, whose disc spreads least, and one that shows the sky and what
    /// stands before it.
    pub fn sun_path(&self) -> Vec<Exposure> {
        let shortest = self.limits.nearest(Exposure { exposure_s: self.limits.min_exposure_s, gain: 1.0 });
        let sky = self.planner.watch();
        if sky.same_as(&shortest) { vec![shortest] } else { vec![shortest, sky] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::synthetic::{SyntheticCamera, SyntheticSettings};

    fn meter(max_exposure_s: f64) -> LightMeter {
        let (width, height) = (48, 48);
        let settings =
            SyntheticSettings { width, height, max_exposure_s, sky_rows: 32, ..SyntheticSettings::default() };
        let mut camera = SyntheticCamera::new(settings);
        let mut meter = LightMeter::new(camera.limits());
        camera.set_time(1_782_043_200.0);
        meter.look(&mut camera, |camera| camera).unwrap();
        meter
    }

    #[test]
    fn a_calibration_keeps_its_step_and_the_cameras_times() {
        let meter = meter(0.5);
        let exposures = meter.calibration(6, 1.0);
        assert_eq!(exposures.len(), 6);
        for pair in exposures.windows(2) {
            // Times are multiples of 0.1 ms.
            let off_s = (pair[1].exposure_s - 2.0 * pair[0].exposure_s).abs();
            assert!(off_s <= 1.6e-4 && pair[1].gain == 1.0, "{exposures:?}");
        }
        let all = meter.calibration(30, 1.0);
        assert_eq!(all.len(), 13, "0.1 ms to 0.5 s are 12.3 stops: {all:?}");
        assert!(all.iter().all(|e| (1e-4..=0.5).contains(&e.exposure_s)));
    }

    #[test]
    fn a_camera_of_one_time_makes_no_series() {
        assert_eq!(meter(1e-4).calibration(10, 1.0).len(), 1);
    }

    #[test]
    fn the_suns_frame_is_the_shortest() {
        let path = meter(0.5).sun_path();
        assert!(path.len() == 2 && path[0].exposure_s == 1e-4 && path[1].product_s() > 1e-4, "{path:?}");
    }
}
