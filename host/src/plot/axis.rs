//! Axes: range, scale and ticks.

/// How values are spread along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Equal steps for equal differences.
    Linear,
    /// Equal steps for equal ratios; values that are not positive cannot be shown and are left out.
    Log,
}

/// One axis of a chart.
#[derive(Clone, Debug)]
pub struct Axis {
    pub(super) label: String,
    pub(super) scale: Scale,
    range: Option<(f64, f64)>,
    ticks: Option<Vec<(f64, String)>>,
}

/// An axis with its range decided: what places points and ticks.
#[derive(Clone, Debug)]
pub(super) struct Span {
    pub scale: Scale,
    pub low: f64,
    pub high: f64,
    pub ticks: Vec<(f64, String)>,
}

impl Axis {
    /// A linear axis that fits its data.
    pub fn linear(label: impl Into<String>) -> Self {
        Axis { label: label.into(), scale: Scale::Linear, range: None, ticks: None }
    }

    /// A logarithmic axis that fits its data.
    pub fn log(label: impl Into<String>) -> Self {
        Axis { scale: Scale::Log, ..Axis::linear(label) }
    }

    /// Fixes the range instead of fitting it. Ignored when it is empty, or not positive on a logarithmic axis.
    pub fn with_range(mut self, low: f64, high: f64) -> Self {
        let fits = low < high && low.is_finite() && high.is_finite() && (self.scale == Scale::Linear || low > 0.0);
        self.range = fits.then_some((low, high)).or(self.range);
        self
    }

    /// Sets the ticks (value, text) instead of choosing them.
    pub fn with_ticks(mut self, ticks: Vec<(f64, String)>) -> Self {
        self.ticks = Some(ticks);
        self
    }

    /// Hours of the day as `06:00`, a tick every `step_h` hours of `low_h..=high_h`.
    pub fn hours(label: impl Into<String>, low_h: f64, high_h: f64, step_h: f64) -> Self {
        let first = (low_h / step_h).ceil() as i64;
        let last = (high_h / step_h).floor() as i64;
        let ticks = (first..=last).take(200).map(|n| {
            let hour = n as f64 * step_h;
            let minutes = (hour * 60.0).round() as i64;
            (hour, format!("{:02}:{:02}", minutes.div_euclid(60), minutes.rem_euclid(60)))
        });
        Axis::linear(label).with_range(low_h, high_h).with_ticks(ticks.collect())
    }

    pub(super) fn shows(&self, value: f64) -> bool {
        value.is_finite() && (self.scale == Scale::Linear || value > 0.0)
    }

    /// Decides the range from `values` unless it is fixed, and the ticks; at most about `most_ticks` of them.
    pub(super) fn span(&self, values: impl Iterator<Item = f64>, most_ticks: usize) -> Span {
        let (low, high) = self.range.unwrap_or_else(|| self.fitted(values, most_ticks));
        let ticks = match &self.ticks {
            Some(ticks) => ticks.iter().filter(|tick| tick.0 >= low && tick.0 <= high).cloned().collect(),
            None if self.scale == Scale::Log => log_ticks(low, high, most_ticks),
            None => linear_ticks(low, high, most_ticks),
        };
        Span { scale: self.scale, low, high, ticks }
    }

    fn fitted(&self, values: impl Iterator<Item = f64>, most_ticks: usize) -> (f64, f64) {
        let (low, high) = values
            .filter(|&value| self.shows(value))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        match self.scale {
            _ if low > high => (if self.scale == Scale::Log { 0.1 } else { 0.0 }, 1.0),
            // Half a decade of air, at least one decade in all.
            Scale::Log => (low / 1.6, (high * 1.6).max(low / 1.6 * 10.0)),
            Scale::Linear => {
                let low = if low > 0.0 && low < 0.5 * high { 0.0 } else { low };
                let high = if high > low { high } else { low + low.abs().max(1.0) };
                let step = step_for(low, high, most_ticks);
                ((low / step).floor() * step, (high / step).ceil() * step)
            }
        }
    }
}

impl Span {
    /// Place of a value along the axis: 0 at the low end, 1 at the high end.
    pub fn place(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            Scale::Log => (value / self.low).ln() / (self.high / self.low).ln(),
        }
    }
}

/// The step 1, 2 or 5 times a power of ten that gives at most `most` steps.
fn step_for(low: f64, high: f64, most: usize) -> f64 {
    let raw = (high - low) / most.max(1) as f64;
    let power = 10f64.powf(raw.log10().floor());
    let nice = [1.0, 2.0, 5.0, 10.0].into_iter().find(|nice| nice * power >= raw * 0.999).unwrap_or(10.0);
    nice * power
}

fn linear_ticks(low: f64, high: f64, most: usize) -> Vec<(f64, String)> {
    let step = step_for(low, high, most);
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let (first, last) = ((low / step - 1e-6).ceil() as i64, (high / step + 1e-6).floor() as i64);
    (first..=last)
        .take(100)
        .map(|n| {
            let value = n as f64 * step;
            (value, if n == 0 { "0".to_owned() } else { format!("{value:.decimals$}") })
        })
        .collect()
}

fn log_ticks(low: f64, high: f64, most: usize) -> Vec<(f64, String)> {
    let decades = (high / low).log10();
    let every = (decades / most.max(1) as f64).ceil().max(1.0) as i32;
    let multiples: &[f64] = if decades < 2.2 { &[1.0, 2.0, 5.0] } else { &[1.0] };
    let mut ticks = Vec::new();
    for power in (low.log10().floor() as i32..=high.log10().ceil() as i32).filter(|power| power % every == 0) {
        for value in multiples.iter().map(|multiple| multiple * 10f64.powi(power)) {
            if value >= low * 0.999 && value <= high * 1.001 {
                ticks.push((value, plain_number(value)));
            }
        }
    }
    ticks
}

/// `0.002`, `50`, `1e-6`: whichever is short.
fn plain_number(value: f64) -> String {
    if (0.000_99..99_999.0).contains(&value) {
        let decimals = (-(value * 1.001).log10().floor()).max(0.0) as usize;
        format!("{value:.decimals$}")
    } else {
        format!("{value:.0e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_ticks_are_round_and_inside() {
        let span = Axis::linear("y").span([0.13, 0.97].into_iter(), 5);
        let texts: Vec<_> = span.ticks.iter().map(|tick| tick.1.as_str()).collect();
        assert_eq!(texts, ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!((span.place(0.0), span.place(1.0)), (0.0, 1.0));
    }

    #[test]
    fn log_ticks_are_powers_and_equal_ratios_are_equal_steps() {
        let span = Axis::log("x").with_range(1e-4, 10.0).span(std::iter::empty(), 6);
        let texts: Vec<_> = span.ticks.iter().map(|tick| tick.1.as_str()).collect();
        assert_eq!(texts, ["1e-4", "0.001", "0.01", "0.1", "1", "10"]);
        assert!((span.place(0.01) - 0.4).abs() < 1e-12);
    }

    #[test]
    fn odd_data_still_give_a_range() {
        for axis in [Axis::linear("a"), Axis::log("a")] {
            for values in [vec![], vec![f64::NAN], vec![0.0], vec![3.0], vec![-1.0, -1.0], vec![f64::INFINITY]] {
                let span = axis.span(values.iter().copied(), 5);
                assert!(span.low < span.high && span.low.is_finite() && span.high.is_finite(), "{values:?} {span:?}");
            }
        }
        assert_eq!(Axis::log("a").with_range(-1.0, 2.0).span([1.0, 100.0].into_iter(), 5).low, 1.0 / 1.6);
    }

    #[test]
    fn hours_are_written_as_a_clock() {
        let span = Axis::hours("time", 5.5, 12.0, 3.0).span(std::iter::empty(), 5);
        assert_eq!(span.ticks, [(6.0, "06:00".to_owned()), (9.0, "09:00".to_owned()), (12.0, "12:00".to_owned())]);
    }
}
