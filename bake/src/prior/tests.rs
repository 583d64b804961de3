use super::*;

fn set() -> PatchSet {
    PatchSet::new(64).unwrap()
}

#[test]
fn the_basis_carries_the_second_moment_of_fresh_skies() {
    let prior = Prior::skies(&set());
    let fresh = draw_skies(&set(), &Mixture { seed: 77, skies: 400, ..Mixture::default() });
    // A linear functional's energy over new skies equals its energy in the basis.
    for patch in [0, 20, 63, 66] {
        let direct = fresh.iter().map(|w| (w[patch] + w[1]).powi(2)).sum::<f64>() / fresh.len() as f64;
        let basis = prior.basis();
        let modelled: f64 = (0..prior.modes()).map(|m| f64::from(basis[(patch, m)] + basis[(1, m)]).powi(2)).sum();
        assert!((0.6..2.0).contains(&(modelled / direct)), "{patch}: {modelled} {direct}");
    }
}

#[test]
fn no_azimuth_is_preferred() {
    let set = PatchSet::new(256).unwrap();
    let prior = Prior::skies(&set);
    let energy = |patch: usize| prior.basis().row(patch).norm();
    // A whole ring of the partition: patches of equal height.
    let height = set.dir_world(100)[1];
    let ring: Vec<f32> =
        (0..set.upper()).filter(|&p| (set.dir_world(p)[1] - height).abs() < 1e-4).map(energy).collect();
    let mean = ring.iter().sum::<f32>() / ring.len() as f32;
    assert!(ring.len() > 10 && ring.iter().all(|e| (e / mean - 1.0).abs() < 0.3), "{ring:?}");
}

#[test]
fn drawn_skies_are_radiances_of_mean_one() {
    for sky in draw_skies(&set(), &Mixture { skies: 200, ..Mixture::default() }) {
        assert!(sky.iter().all(|w| w.is_finite() && *w >= 0.0));
        let mean = sky.iter().take(64).sum::<f64>() / 64.0;
        assert!((mean - 1.0).abs() < 1e-9);
    }
}

#[test]
fn the_same_prior_every_time() {
    assert_eq!(Prior::skies(&set()), Prior::skies(&set()));
}
