//! Time against error as a picture.

use super::report::{BenchReport, RELUME_NAME};
use crate::plot::{Axis, Chart, Series};

/// CPU time per frame against the worst relative RMSE, both logarithmic; `None` if no error was measured.
pub fn figure(report: &BenchReport) -> Option<Chart> {
    let point = |m: &super::MethodReport| m.rmse_worst.map(|rmse| (m.cpu_ms_per_frame, 100.0 * rmse));
    let own = report.methods.iter().filter(|m| m.name == RELUME_NAME).filter_map(point).collect::<Vec<_>>();
    let rivals = report.methods.iter().filter(|m| m.name != RELUME_NAME);
    let mut chart =
        Chart::new("Time against error", Axis::log("CPU ms per frame"), Axis::log("relative RMSE, worst sky, %"));
    let mut points = own.len();
    chart = chart.with(Series::line(RELUME_NAME, own).with_markers());
    for rival in rivals {
        let place: Vec<_> = point(rival).into_iter().collect();
        points += place.len();
        chart = chart.with(Series::scatter(rival.name.clone(), place));
    }
    (points > 0).then_some(chart)
}
