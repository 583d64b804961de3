//! Time against error as a picture.

use super::report::{BenchReport, MethodReport, RELUME_NAME};
use crate::plot::{Axis, Chart, Series};

/// CPU time per frame (one thread, in cache) against the worst relative RMSE under the sky's light alone, both logarithmic,
/// each method a line over its budgets; Relume's ranks with the sun up as well, its error budgets as points.
/// `None` if no error was measured.
pub fn figure(report: &BenchReport) -> Option<Chart> {
    let timing = |m: &MethodReport| report.in_cache.timing(&m.name, m.budget.as_deref(), 1);
    let point = |ms: Option<f64>, m: &MethodReport, rmse: Option<f64>| {
        rmse.map(|rmse| (ms.unwrap_or(m.cpu_ms_per_frame), 100.0 * rmse))
    };
    let sky_alone = |m: &MethodReport| {
        let ms = timing(m).and_then(|timing| timing.cpu_ms_per_frame_without_sun);
        point(ms, m, m.rmse_worst_without_sun.or(m.rmse_worst))
    };
    let sun_up = |m: &MethodReport| {
        point(timing(m).and_then(|timing| timing.cpu_ms_per_frame_with_sun), m, m.rmse_worst_with_sun)
    };
    let of = |name: &str| report.methods.iter().filter(move |m| series_name(m) == name).collect::<Vec<_>>();
    let mut names: Vec<String> = report.methods.iter().map(series_name).collect();
    names.sort_by_key(|name| !name.starts_with(RELUME_NAME));
    names.dedup();
    let mut all: Vec<(String, Vec<(f64, f64)>)> =
        names.iter().map(|name| (name.clone(), of(name).into_iter().filter_map(sky_alone).collect())).collect();
    let sunny = of(RELUME_NAME).into_iter().filter_map(sun_up).collect();
    all.push((SUN_UP.to_owned(), sunny));
    all.retain(|(_, points)| !points.is_empty());
    let (x, y) = (Axis::log("CPU ms per frame"), Axis::log("relative RMSE, worst sky, %"));
    let chart = Chart::new("Time against error: one thread, in cache", x, y);
    (!all.is_empty()).then(|| {
        all.into_iter().fold(chart, |chart, (name, points)| {
            chart.with(match name.as_str() {
                BY_ERROR => Series::scatter(name, points),
                SUN_UP => Series::line(name, points).with_markers().with_color(0x7a, 0xb8, 0x00),
                _ => Series::line(name, points).with_markers(),
            })
        })
    })
}

const SUN_UP: &str = "relume, sun up";
const BY_ERROR: &str = "relume, error budgets";

/// The series that a method at its budget belongs to.
fn series_name(method: &MethodReport) -> String {
    let kind = method.budget.as_deref().and_then(|budget| budget.split(' ').next());
    match kind {
        Some("error") => BY_ERROR.to_owned(),
        _ => method.name.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::report::tests::report;
    use super::*;

    #[test]
    fn each_kind_of_budget_has_its_own_series() {
        use super::super::budget::Budget;
        let mut method = report().methods[1].clone();
        let mut name = |budget: Budget| {
            method.budget = Some(budget.to_string());
            series_name(&method)
        };
        assert!(Budget::RANKS.iter().all(|budget| name(*budget) == RELUME_NAME));
        assert!(Budget::ERRORS.iter().all(|budget| name(*budget) == BY_ERROR));
    }

    #[test]
    fn nothing_is_drawn_without_errors() {
        let mut report = report();
        assert!(figure(&report).is_some());
        for m in &mut report.methods {
            (m.rmse_worst, m.rmse_worst_without_sun, m.rmse_worst_with_sun) = (None, None, None);
        }
        assert!(figure(&report).is_none());
    }
}
