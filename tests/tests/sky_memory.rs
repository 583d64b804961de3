//! A sky camera's light in its steady state: exposures, merge and weights use the memory of the first series.

#![allow(clippy::unwrap_used)]

use relume::clock::Moment;
use relume::config::Config;
use relume::sky_source::captured::CapturedSky;
use relume::sky_source::{SkyReading, SkySource};
use relume_firmware::patches::PatchSet;
use relume_tests::counting::{Counting, allocations};
use relume_tests::files::{fresh_folder, put};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// 21 June 2026, 14:00 UTC: the sun is up at 48 N, 11 E.
const AFTERNOON_UNIX_S: f64 = 1_782_050_400.0;

#[test]
fn a_series_allocates_nothing_after_the_first_ones() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "sky_memory");
    let post = "field = 'a.field'\nsky = 'synthetic'\n[site]\nlatitude = 48.0\nlongitude = 11.0\n\
                [weather]\ncloud_cover = 0.4\nseed = 7\n[display]\nkind = 'headless'\nfolder = '.'\n\
                [run]\nstart = 2026-06-21T14:00:00Z\n";
    put(&folder.join("POST.toml"), post);
    let config = Config::load(&folder.join("POST.toml")).unwrap();
    let mut sky = CapturedSky::open(&config, PatchSet::new(256).unwrap(), 0.0).unwrap();
    let (mut reading, mut most) = (SkyReading::default(), 0);
    for number in 0..60 {
        let before = allocations();
        // The simulated sky makes room when it changes, which it does not within a tenth of a second: only noise does.
        let moment = Moment { unix_s: AFTERNOON_UNIX_S + f64::from(number) * 1e-4, trusted: true };
        assert!(sky.read(moment, &mut reading).unwrap());
        let made = allocations() - before;
        match number {
            0 => assert!(made > 0, "the first series makes room; the counter counts"),
            30.. => most = most.max(made),
            _ => {}
        }
    }
    assert_eq!(most, 0, "allocations in a series");
    assert!(reading.weights.radiance.iter().take(256).all(|rgb| rgb[1] > 0.0));
}
