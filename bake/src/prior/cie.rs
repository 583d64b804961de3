//! Smooth skies: the CIE general sky (ISO 15469:2004; Darula & Kittler 2002) with an aureole and a tint per channel.

use crate::random::Random;

/// Gradation `a`, `b` and scattering indicatrix `c`, `d`, `e` of the 15 standard sky types.
const TYPES: [[f64; 5]; 15] = [
    [4.0, -0.70, 0.0, -1.0, 0.0],
    [4.0, -0.70, 2.0, -1.5, 0.15],
    [1.1, -0.80, 0.0, -1.0, 0.0],
    [1.1, -0.80, 2.0, -1.5, 0.15],
    [0.0, -1.00, 0.0, -1.0, 0.0],
    [0.0, -1.00, 2.0, -1.5, 0.15],
    [0.0, -1.00, 5.0, -2.5, 0.30],
    [0.0, -1.00, 10.0, -3.0, 0.45],
    [-1.0, -0.55, 2.0, -1.5, 0.15],
    [-1.0, -0.55, 5.0, -2.5, 0.30],
    [-1.0, -0.55, 10.0, -3.0, 0.45],
    [-1.0, -0.32, 10.0, -3.0, 0.45],
    [-1.0, -0.32, 16.0, -3.0, 0.30],
    [-1.0, -0.15, 16.0, -3.0, 0.30],
    [-1.0, -0.15, 24.0, -2.8, 0.15],
];

/// One smooth sky in one colour channel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SmoothSky {
    pub(crate) sun: [f64; 3],
    shape: [f64; 5],
    /// Radiance added at the sun, and the angle (radians) in which it falls by e.
    aureole: f64,
    aureole_width: f64,
    /// Radiance added towards the horizon, relative to the gradation: blue skies lose it, orange ones gain it.
    tint: f64,
}

impl SmoothSky {
    /// Sky type, aureole and tint by chance; the sun at `azimuth` and `altitude` (radians).
    pub(crate) fn draw(random: &mut Random, azimuth: f64, altitude: f64) -> Self {
        let sun = [altitude.cos() * azimuth.cos(), altitude.sin(), altitude.cos() * azimuth.sin()];
        // Between two neighbouring types: nature does not know fifteen.
        let kind = random.between(0.0, 14.0);
        let (low, share) = (kind.floor() as usize, kind.fract());
        let shape = std::array::from_fn(|k| TYPES[low][k] * (1.0 - share) + TYPES[(low + 1).min(14)][k] * share);
        // Haze and thin cloud gather up to some tenths of the sky's light within a few degrees of the sun.
        let aureole_width = random.between(1.0f64, 10.0).to_radians();
        let share = if random.unit() < 0.6 { 0.35 * random.unit().powi(2) } else { 0.0 };
        let tint = random.between(-0.5, 1.0);
        let clear = SmoothSky { sun, shape, aureole: 0.0, aureole_width, tint };
        SmoothSky { aureole: share * clear.mean() / aureole_width.powi(2), ..clear }
    }

    /// Mean radiance of the upper hemisphere, to a few per cent.
    fn mean(&self) -> f64 {
        let at = |k: i32| {
            let (y, azimuth) = ((f64::from(k) + 0.5) / 64.0, f64::from(k) * 2.399_963_229_728_653);
            let radius = (1.0 - y * y).sqrt();
            self.radiance([radius * azimuth.cos(), y, radius * azimuth.sin()])
        };
        (0..64).map(at).sum::<f64>() / 64.0
    }

    /// Radiance towards a unit direction of the upper hemisphere, relative.
    pub(crate) fn radiance(&self, [x, y, z]: [f64; 3]) -> f64 {
        let [a, b, c, d, e] = self.shape;
        let up = y.max(0.01);
        let angle = (x * self.sun[0] + y * self.sun[1] + z * self.sun[2]).clamp(-1.0, 1.0).acos();
        let gradation = 1.0 + a * (b / up).exp();
        let far = (d * std::f64::consts::FRAC_PI_2).exp();
        let indicatrix = 1.0 + c * ((d * angle).exp() - far) + e * angle.cos().powi(2);
        let aureole = self.aureole * (-angle / self.aureole_width).exp();
        (gradation * indicatrix * (1.0 + self.tint * (-4.0 * up).exp())).max(0.0) + aureole
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overcast_type_is_three_times_brighter_at_the_zenith() {
        // CIE type 1 is the standard overcast sky, in which zenith to horizon is about 3.
        let sky = SmoothSky { sun: [1.0, 0.0, 0.0], shape: TYPES[0], aureole: 0.0, aureole_width: 1.0, tint: 0.0 };
        let ratio = sky.radiance([0.0, 1.0, 0.0]) / sky.radiance([0.0, 0.0, 1.0]);
        assert!((2.8..3.2).contains(&ratio), "{ratio}");
    }

    #[test]
    fn clear_type_is_bright_around_the_sun_and_at_the_horizon() {
        let sky = SmoothSky { sun: [0.6, 0.8, 0.0], shape: TYPES[11], aureole: 0.0, aureole_width: 1.0, tint: 0.0 };
        assert!(sky.radiance([0.6, 0.8, 0.0]) > 3.0 * sky.radiance([0.0, 1.0, 0.0]));
        assert!(sky.radiance([-0.995, 0.1, 0.0]) > sky.radiance([-0.6, 0.8, 0.0]));
    }
}
