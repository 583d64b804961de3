//! Order statistics of measured values.

use std::cmp::Ordering;

/// Numbers that sort, NaN last.
pub trait Number: Copy {
    /// As `f64::total_cmp`.
    fn order(&self, other: &Self) -> Ordering;
}

impl Number for f32 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl Number for f64 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

/// The value that a share (0..=1) of the values are below, without interpolation; `None` of nothing. Their order changes.
pub fn quantile<T: Number>(values: &mut [T], share: f64) -> Option<T> {
    let last = values.len().checked_sub(1)?;
    let place = (share * values.len() as f64) as usize;
    Some(*values.select_nth_unstable_by(place.min(last), T::order).1)
}

/// The middle one; the upper one of two.
pub fn median<T: Number>(values: &mut [T]) -> Option<T> {
    quantile(values, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_by_hand() {
        let mut values = [5.0f32, 1.0, 4.0, 2.0, 3.0, 0.0];
        assert_eq!(median(&mut values), Some(3.0));
        assert_eq!([0.0, 0.2, 0.9, 1.0].map(|share| quantile(&mut values, share)), [0.0, 1.0, 5.0, 5.0].map(Some));
        assert_eq!(median::<f64>(&mut []), None);
        assert_eq!(median(&mut [7.0f64, f64::NAN, 1.0]), Some(7.0));
    }
}
