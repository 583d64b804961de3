//! What the codes of a gain control mean.

use super::ControlRange;

/// The gain of a code.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GainModel {
    /// In proportion to the code.
    Proportional,
    /// `top / (top - code)`.
    Reciprocal {
        /// Sensor's constant.
        top: f64,
    },
    /// A step of so many decibels (20 dB are a factor of 10) per code.
    Decibels {
        /// Step.
        per_code: f64,
    },
    /// 1 at the smallest code, this much at the largest, straight in between.
    UpTo(f64),
}

/// Analogue gains as the sensors' data sheets give them.
const SENSORS: &[(&str, GainModel)] = &[
    ("imx219", GainModel::Reciprocal { top: 256.0 }),
    ("imx477", GainModel::Reciprocal { top: 1024.0 }),
    ("imx708", GainModel::Reciprocal { top: 1024.0 }),
    ("imx290", GainModel::Decibels { per_code: 0.3 }),
    ("imx296", GainModel::Decibels { per_code: 0.1 }),
    ("imx327", GainModel::Decibels { per_code: 0.3 }),
    ("imx462", GainModel::Decibels { per_code: 0.3 }),
    ("ov5647", GainModel::Proportional),
    ("ov9281", GainModel::Proportional),
];

impl GainModel {
    /// The model of a sensor whose name, as the kernel lists it, starts with a known one.
    pub fn of_sensor(name: &str) -> Option<Self> {
        SENSORS.iter().find(|(sensor, _)| name.starts_with(sensor)).map(|&(_, model)| model)
    }

    fn absolute(self, range: &ControlRange, code: f64) -> f64 {
        match self {
            GainModel::Proportional => code.max(1.0),
            GainModel::Reciprocal { top } => top / (top - code).max(1.0),
            GainModel::Decibels { per_code } => 10f64.powf(per_code * code / 20.0),
            GainModel::UpTo(most) => {
                let span = (range.max - range.min).max(1) as f64;
                1.0 + (most - 1.0) * (code - range.min as f64) / span
            }
        }
    }

    /// Gain over that of the smallest code.
    pub(super) fn gain(self, range: &ControlRange, code: i64) -> f64 {
        self.absolute(range, code as f64) / self.absolute(range, range.min as f64)
    }

    /// The code whose gain is nearest below or at `gain`.
    pub(super) fn code(self, range: &ControlRange, gain: f64) -> i64 {
        // Every model rises with the code: halve the range until one step is left.
        let step = range.step.max(1);
        let (mut low, mut high) = (0, (range.max - range.min) / step);
        while low < high {
            let middle = (low + high + 1) / 2;
            // A hair of tolerance, so that a gain that was read back gives its own code again.
            if self.gain(range, range.min + middle * step) <= gain * (1.0 + 1e-9) {
                low = middle
            } else {
                high = middle - 1
            }
        }
        range.min + low * step
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(min: i64, max: i64) -> ControlRange {
        ControlRange { min, max, step: 1, default: min, writable: true }
    }

    #[test]
    fn gains_are_the_data_sheets() {
        // IMX219: 256 / (256 - 232) = 10.67; OV5647: 16 is 1, 1023 is 63.9; IMX290: 240 x 0.3 dB = 72 dB = 3981.
        let (imx219, ov5647) = (range(0, 232), range(16, 1023));
        let model = GainModel::of_sensor("imx219 10-0010").unwrap();
        assert!((model.gain(&imx219, 232) - 10.667).abs() < 1e-3);
        assert_eq!(model.code(&imx219, 2.0), 128);
        let model = GainModel::of_sensor("ov5647 10-0036").unwrap();
        assert!((model.gain(&ov5647, 1023) - 63.94).abs() < 0.01);
        assert_eq!(model.code(&ov5647, 1.0), 16);
        let model = GainModel::of_sensor("imx290 1-001a").unwrap();
        assert!((model.gain(&range(0, 240), 240) - 3981.0).abs() < 1.0);
        assert_eq!(GainModel::of_sensor("Integrated Camera"), None);
    }

    #[test]
    fn every_code_is_found_again_by_its_gain() {
        for (model, range) in [
            (GainModel::UpTo(8.0), range(0, 100)),
            (GainModel::Reciprocal { top: 1024.0 }, range(0, 978)),
            (GainModel::Decibels { per_code: 0.3 }, range(0, 240)),
            (GainModel::Proportional, ControlRange { step: 16, ..range(16, 256) }),
        ] {
            for code in (range.min..=range.max).step_by(range.step as usize) {
                assert_eq!(model.code(&range, model.gain(&range, code)), code, "{model:?}");
            }
            assert_eq!(model.code(&range, 1e9), range.max);
            assert_eq!(model.code(&range, 0.0), range.min);
        }
    }
}
