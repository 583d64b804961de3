//! What the bench found: one JSON object, or a table for people.

use serde::Serialize;

/// The whole finding. Shares and errors are fractions, not per cent.
#[derive(Clone, Debug, Serialize)]
pub struct BenchReport {
    /// Names of the skies that were used.
    pub skies: Vec<String>,
    /// Bytes of the field read for a full frame, per covered pixel.
    pub bytes_per_covered_pixel: f64,
    /// Bytes of the whole file, per covered pixel.
    pub bytes_stored_per_covered_pixel: f64,
    /// Bytes of the field read per second of CPU time, as a share of this run's read bandwidth.
    pub share_of_read_bandwidth: f64,
    /// One entry per method and budget.
    pub methods: Vec<MethodReport>,
}

/// One method at one budget. Error values are `None` without a stack.
#[derive(Clone, Debug, Serialize)]
pub struct MethodReport {
    /// Name; `relume` or `dense_f32_openblas`.
    pub name: String,
    /// The budget it was given; `None`: it takes none.
    pub budget: Option<String>,
    /// Median CPU time of a full frame: weights to 8-bit picture, milliseconds.
    pub cpu_ms_per_frame: f64,
    /// Relative RMSE, median of the skies.
    pub rmse_median: Option<f64>,
    /// Relative RMSE, worst sky.
    pub rmse_worst: Option<f64>,
    /// Largest error of an 8-bit value under any sky.
    pub worst_code: Option<u8>,
    /// Share of 8-bit values off by more than one, worst sky.
    pub share_off_by_more_than_one: Option<f64>,
    /// The dense sum's CPU time / this one's; `None` where OpenBLAS is missing.
    pub times_faster_than_dense_f32_openblas: Option<f64>,
}

/// Name of the rival in reports.
pub const DENSE_NAME: &str = "dense_f32_openblas";
/// Name of Relume's own way in reports.
pub const RELUME_NAME: &str = "relume";

impl BenchReport {
    /// Fills in how many times faster each method is than the dense sum, where that was measured.
    pub fn compare_with_dense(&mut self) {
        let Some(dense) = self.methods.iter().find(|m| m.name == DENSE_NAME).map(|m| m.cpu_ms_per_frame) else {
            return;
        };
        for method in &mut self.methods {
            method.times_faster_than_dense_f32_openblas = Some(dense / method.cpu_ms_per_frame);
        }
    }
}

fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{:.3} %", 100.0 * v))
}

impl std::fmt::Display for BenchReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "skies: {}", self.skies.join(", "))?;
        writeln!(
            f,
            "bytes per covered pixel: {:.1} read, {:.1} stored; {:.0} % of the read bandwidth",
            self.bytes_per_covered_pixel,
            self.bytes_stored_per_covered_pixel,
            100.0 * self.share_of_read_bandwidth
        )?;
        writeln!(
            f,
            "{:<20} {:<12} {:>10} {:>10} {:>10} {:>6} {:>10} {:>8}",
            "method", "budget", "ms/frame", "RMSE med", "worst", "code", "off > 1", "faster"
        )?;
        for m in &self.methods {
            writeln!(
                f,
                "{:<20} {:<12} {:>10.3} {:>10} {:>10} {:>6} {:>10} {:>8}",
                m.name,
                m.budget.as_deref().unwrap_or("-"),
                m.cpu_ms_per_frame,
                percent(m.rmse_median),
                percent(m.rmse_worst),
                m.worst_code.map_or_else(|| "-".to_owned(), |code| code.to_string()),
                percent(m.share_off_by_more_than_one),
                m.times_faster_than_dense_f32_openblas.map_or_else(|| "-".to_owned(), |times| format!("{times:.1}x")),
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> BenchReport {
        let method = |name: &str, ms| MethodReport {
            name: name.to_owned(),
            budget: None,
            cpu_ms_per_frame: ms,
            rmse_median: Some(0.0025),
            rmse_worst: None,
            worst_code: Some(7),
            share_off_by_more_than_one: None,
            times_faster_than_dense_f32_openblas: None,
        };
        BenchReport {
            skies: vec!["a".into(), "b".into()],
            bytes_per_covered_pixel: 24.0,
            bytes_stored_per_covered_pixel: 31.5,
            share_of_read_bandwidth: 0.75,
            methods: vec![method(DENSE_NAME, 42.0), method(RELUME_NAME, 0.5)],
        }
    }

    #[test]
    fn json_has_exactly_the_documented_keys() {
        let json = serde_json::to_value(report()).unwrap();
        let keys = |value: &serde_json::Value| {
            let mut keys: Vec<String> = value.as_object().unwrap().keys().cloned().collect();
            keys.sort();
            keys
        };
        let mut top = [
            "skies",
            "bytes_per_covered_pixel",
            "bytes_stored_per_covered_pixel",
            "share_of_read_bandwidth",
            "methods",
        ];
        top.sort_unstable();
        assert_eq!(keys(&json), top);
        let mut method = [
            "name",
            "budget",
            "cpu_ms_per_frame",
            "rmse_median",
            "rmse_worst",
            "worst_code",
            "share_off_by_more_than_one",
            "times_faster_than_dense_f32_openblas",
        ];
        method.sort_unstable();
        assert_eq!(keys(&json["methods"][0]), method);
        assert!(json["methods"][1]["rmse_worst"].is_null());
        assert_eq!(json["methods"][0]["rmse_median"], 0.0025);
    }

    #[test]
    fn times_faster_is_against_the_dense_sum() {
        let mut report = report();
        report.compare_with_dense();
        let times: Vec<_> = report.methods.iter().map(|m| m.times_faster_than_dense_f32_openblas).collect();
        assert_eq!(times, [Some(1.0), Some(84.0)]);
        report.methods.remove(0);
        report.methods[0].times_faster_than_dense_f32_openblas = None;
        report.compare_with_dense();
        assert_eq!(report.methods[0].times_faster_than_dense_f32_openblas, None);
    }

    #[test]
    fn the_table_shows_what_was_measured() {
        let text = report().to_string();
        assert!(text.contains("0.250 %") && text.contains("42.000") && text.contains("75 %"), "{text}");
    }
}
