//! The material of glTF 2.0, appendix B, written down once more in f64 straight from its "full code", for tests alone: none of
//! it is shared with what is tested.

use std::f64::consts::PI;

type Vector = [f64; 3];

fn dot(a: Vector, b: Vector) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn unit(a: Vector) -> Vector {
    a.map(|c| c / dot(a, a).sqrt())
}

/// A material without textures.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Appendix {
    pub(crate) base: f64,
    pub(crate) metallic: f64,
    pub(crate) roughness: f64,
}

impl Appendix {
    /// The BRDF (1/sr) for unit vectors about the normal `n`.
    pub(crate) fn brdf(&self, n: Vector, v: Vector, l: Vector) -> f64 {
        let (n_v, n_l) = (dot(n, v), dot(n, l));
        if n_v <= 0.0 || n_l <= 0.0 {
            return 0.0;
        }
        let h = unit([v[0] + l[0], v[1] + l[1], v[2] + l[2]]);
        let (n_h, v_h) = (dot(n, h), dot(v, h));
        let a2 = self.roughness.powi(4);
        let d = a2 / (PI * (n_h * n_h * (a2 - 1.0) + 1.0).powi(2));
        let g =
            2.0 * n_l * n_v / (n_v * (a2 + (1.0 - a2) * n_l * n_l).sqrt() + n_l * (a2 + (1.0 - a2) * n_v * n_v).sqrt());
        let fresnel_w = (1.0 - v_h.abs()).powi(5);
        let diffuse_brdf = self.base / PI;
        let specular_brdf = d * g / (4.0 * n_v * n_l);
        let dielectric_fresnel = 0.04 + (1.0 - 0.04) * fresnel_w;
        let dielectric_brdf = diffuse_brdf * (1.0 - dielectric_fresnel) + specular_brdf * dielectric_fresnel;
        let metal_brdf = specular_brdf * (self.base + (1.0 - self.base) * fresnel_w);
        dielectric_brdf * (1.0 - self.metallic) + metal_brdf * self.metallic
    }

    /// Radiance towards `v` under radiance 1 from everywhere above the plane with the normal +Y. The integral runs over half
    /// vectors in steps that follow the lobe, and the diffuse part's over light directions.
    pub(crate) fn furnace(&self, v: Vector) -> f64 {
        let n = [0.0, 1.0, 0.0];
        let steps = 600;
        let share = |k: usize| (k as f64 + 0.5) / steps as f64;
        let alpha = self.roughness * self.roughness;
        let only = |metallic: f64, base: f64| Appendix { base, metallic, ..*self };
        // What is left without the specular part is even; the rest is a lobe.
        let specular_of = |l: Vector| {
            let diffuse = only(0.0, 0.0);
            let without = diffuse.brdf(n, v, l);
            let metal = only(1.0, self.base).brdf(n, v, l);
            without * (1.0 - self.metallic) + metal * self.metallic
        };
        let diffuse_of =
            |l: Vector| (only(0.0, self.base).brdf(n, v, l) - only(0.0, 0.0).brdf(n, v, l)) * (1.0 - self.metallic);
        let (mut specular, mut diffuse) = (0.0, 0.0);
        for row in 0..steps {
            for column in 0..steps {
                let azimuth = 2.0 * PI * share(column);
                // tan(theta) = alpha sqrt(u / (1 - u)) spreads steps as the distribution is spread.
                let u = share(row);
                let tangent = alpha * (u / (1.0 - u)).sqrt();
                let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
                let sine = tangent * cosine;
                let h = [sine * azimuth.cos(), cosine, sine * azimuth.sin()];
                let v_h = dot(v, h);
                let l = [0, 1, 2].map(|c| 2.0 * v_h * h[c] - v[c]);
                if v_h > 0.0 && l[1] > 0.0 {
                    // d(half) = D cos du dphi / ... : density of these half vectors, and 4 V.H to directions of light.
                    let density =
                        alpha.powi(2) / (PI * (cosine * cosine * (alpha.powi(2) - 1.0) + 1.0).powi(2)) * cosine;
                    specular += specular_of(l) * l[1] * 4.0 * v_h / density / (steps * steps) as f64;
                }
                let (height, radius) = (u.sqrt(), (1.0 - u).sqrt());
                let l = [radius * azimuth.cos(), height, radius * azimuth.sin()];
                diffuse += diffuse_of(l) * PI / (steps * steps) as f64;
            }
        }
        specular + diffuse
    }
}

#[test]
fn the_integral_knows_its_limits() {
    let v = unit([0.3, 0.8, 0.1]);
    // Without a specular part nothing but the base is left; a smooth white metal loses nothing.
    let mirror = Appendix { base: 1.0, metallic: 1.0, roughness: 0.05 };
    assert!((mirror.furnace(v) - 1.0).abs() < 1e-3);
    let rough = Appendix { base: 1.0, metallic: 1.0, roughness: 1.0 };
    assert!((0.3..0.8).contains(&rough.furnace(v)));
}
