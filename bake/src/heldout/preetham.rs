//! Clear and hazy skies after Preetham, Shirley and Smits, "A practical analytic model for daylight", SIGGRAPH 1999,
//! appendix A.2: Perez' five-parameter distribution for luminance and chromaticity, by turbidity.

/// Perez' A, B, C, D, E as slope and offset over turbidity; for Y, x, y.
const PEREZ: [[[f64; 2]; 5]; 3] = [
    [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
    [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
    [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
];
/// Chromaticity x and y of the zenith: rows by turbidity squared, turbidity, 1; columns by the sun's zenith angle cubed
/// down to 1.
const ZENITH: [[[f64; 4]; 3]; 2] = [
    [[0.00166, -0.00375, 0.00209, 0.0], [-0.02903, 0.06377, -0.03202, 0.00394], [0.11693, -0.21196, 0.06052, 0.25886]],
    [[0.00275, -0.00610, 0.00317, 0.0], [-0.04214, 0.08970, -0.04153, 0.00516], [0.15346, -0.26756, 0.06670, 0.26688]],
];

/// Rec.709 luminance.
pub(super) fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// A sky without clouds and without the sun's disc.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClearSky {
    /// Unit direction towards the sun.
    pub(super) sun: [f64; 3],
    perez: [[f64; 5]; 3],
    /// Y, x, y of the zenith over the distribution's value there.
    zenith: [f64; 3],
}

impl ClearSky {
    /// For a turbidity of 2 to 10 and a sun at azimuth (from +X towards +Z) and altitude, radians.
    pub(super) fn new(turbidity: f64, [azimuth, altitude]: [f64; 2]) -> Self {
        let sun = [altitude.cos() * azimuth.cos(), altitude.sin(), altitude.cos() * azimuth.sin()];
        let angle = std::f64::consts::FRAC_PI_2 - altitude;
        let chi = (4.0 / 9.0 - turbidity / 120.0) * (std::f64::consts::PI - 2.0 * angle);
        let light = (4.0453 * turbidity - 4.9710) * chi.tan() - 0.2155 * turbidity + 2.4192;
        let chromaticity = ZENITH.map(|rows| {
            let of = |row: [f64; 4]| row.into_iter().fold(0.0, |sum, factor| sum * angle + factor);
            rows.into_iter().fold(0.0, |sum, row| sum * turbidity + of(row))
        });
        let perez = PEREZ.map(|five| five.map(|[slope, offset]| slope * turbidity + offset));
        let at_zenith = [light, chromaticity[0], chromaticity[1]];
        let zenith = std::array::from_fn(|k| at_zenith[k] / distribution(&perez[k], 1.0, angle));
        ClearSky { sun, perez, zenith }
    }

    /// Luminance (kcd/m2) and chromaticity towards a unit direction of the upper hemisphere.
    fn luminance_xy(&self, dir: [f64; 3]) -> [f64; 3] {
        let cosine: f64 = dir.iter().zip(&self.sun).map(|(d, s)| d * s).sum();
        let angle = cosine.clamp(-1.0, 1.0).acos();
        std::array::from_fn(|k| self.zenith[k] * distribution(&self.perez[k], dir[1].max(0.01), angle))
    }

    /// Linear Rec.709 radiance towards a unit direction of the upper hemisphere.
    pub(super) fn radiance(&self, dir: [f64; 3]) -> [f64; 3] {
        let [light, x, y] = self.luminance_xy(dir);
        let (big_x, big_z) = (light * x / y, light * (1.0 - x - y) / y);
        [
            3.2406 * big_x - 1.5372 * light - 0.4986 * big_z,
            -0.9689 * big_x + 1.8758 * light + 0.0415 * big_z,
            0.0557 * big_x - 0.2040 * light + 1.0570 * big_z,
        ]
        .map(|v| v.max(0.0))
    }
}

/// Perez' function of the cosine to the zenith and the angle to the sun.
fn distribution([a, b, c, d, e]: &[f64; 5], up: f64, angle: f64) -> f64 {
    (1.0 + a * (b / up).exp()) * (1.0 + c * (d * angle).exp() + e * angle.cos().powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_zenith_is_the_papers() {
        // Turbidity 3, the sun 60 degrees from the zenith: the formulas of appendix A.2 by hand.
        let sky = ClearSky::new(3.0, [0.3, 30f64.to_radians()]);
        let [light, x, y] = sky.luminance_xy([0.0, 1.0, 0.0]);
        assert!((light - 5.1392).abs() < 1e-3, "{light}");
        assert!((x - 0.24493).abs() < 1e-4 && (y - 0.25257).abs() < 1e-4, "{x} {y}");
        let [red, _, blue] = sky.radiance([0.0, 1.0, 0.0]);
        assert!(blue > 1.5 * red, "a clear zenith is blue: {red} {blue}");
    }

    #[test]
    fn the_sun_is_where_it_should_be() {
        let sky = ClearSky::new(2.5, [2.0, 0.7]);
        let at_sun = luminance(sky.radiance(sky.sun));
        assert!(at_sun > 3.0 * luminance(sky.radiance([0.0, 1.0, 0.0])));
        let opposite = [-sky.sun[0], sky.sun[1], -sky.sun[2]];
        assert!(at_sun > 5.0 * luminance(sky.radiance(opposite)));
    }
}
