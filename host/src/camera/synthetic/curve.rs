//! Response curves of the simulated sensor, each with its inverse in closed form.

/// Share of the largest code (above black) by fraction of full well; 0 at 0, 1 at 1, rising.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Curve {
    /// code = fraction
    Linear,
    /// code = fraction^(1 / gamma)
    Power {
        /// Exponent of the inverse, above 0.
        gamma: f64,
    },
    /// IEC 61966-2-1: a power law with a straight toe.
    Srgb,
    /// S-shaped over the logarithm of light, as film (Naka & Rushton 1966):
    /// code = f^n (1 + k^n) / (f^n + k^n)
    Film {
        /// n: the toe's exponent, above 0.
        exponent: f64,
        /// k: the fraction around which the shoulder lies, above 0.
        half: f64,
    },
}

impl Curve {
    /// Share of the largest code at a fraction of full well (0..=1); odd below 0, so that noise around black has mean 0.
    pub fn code(&self, fraction: f64) -> f64 {
        let f = fraction.abs().min(1.0);
        let code = match *self {
            Curve::Linear => f,
            Curve::Power { gamma } => f.powf(1.0 / gamma),
            Curve::Srgb if f <= 0.003_130_8 => 12.92 * f,
            Curve::Srgb => 1.055 * f.powf(1.0 / 2.4) - 0.055,
            Curve::Film { exponent, half } => {
                let (light, knee) = (f.powf(exponent), half.powf(exponent));
                light * (1.0 + knee) / (light + knee)
            }
        };
        code.copysign(fraction)
    }

    /// Fraction of full well at a share of the largest code (0..=1).
    pub fn fraction(&self, code: f64) -> f64 {
        let z = code.clamp(0.0, 1.0);
        match *self {
            Curve::Linear => z,
            Curve::Power { gamma } => z.powf(gamma),
            Curve::Srgb if z <= 0.040_45 => z / 12.92,
            Curve::Srgb => ((z + 0.055) / 1.055).powf(2.4),
            Curve::Film { exponent, half } => {
                let knee = half.powf(exponent);
                (z * knee / (1.0 + knee - z)).powf(1.0 / exponent)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_rise_from_0_to_1_and_come_back() {
        let film = Curve::Film { exponent: 0.9, half: 0.3 };
        for curve in [Curve::Linear, Curve::Power { gamma: 2.2 }, Curve::Srgb, film] {
            assert_eq!(curve.code(0.0), 0.0);
            assert!((curve.code(1.0) - 1.0).abs() < 1e-12, "{curve:?}");
            let mut before = 0.0;
            for i in 1..=1000 {
                let fraction = f64::from(i) / 1000.0;
                let code = curve.code(fraction);
                assert!(code > before, "{curve:?} {fraction}");
                assert!((curve.fraction(code) - fraction).abs() < 1e-9, "{curve:?} {fraction}");
                assert_eq!(curve.code(-fraction), -code);
                before = code;
            }
        }
    }
}
