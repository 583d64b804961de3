//! Figures of the sun's beam through passing clouds while its disc saturates the camera: `cargo run --release -p relume-tests
//! --example beam_figures -- [FIRST_SEED [COUNT]]`.
//!
//! Per seed ten minutes of a drifting sky, a series every ten seconds, 480x480: the beam that the sky camera tells over the clear
//! sky's, against the true one, over the moments with the sun behind a cloud (less than .02 of its beam), in the clear (more than
//! .98) and between; and the longest time for which it was off by more than .3. Haze and cover differ from seed to seed; the
//! lens is clean or scatters light. `new`: each seed's camera has seen no sky before; `used`: one camera sees them all, after
//! another clear one.

use relume::bracket::{MergeSettings, Merged, Merger};
use relume::camera::synthetic::{Glare, SyntheticCamera, SyntheticSettings};
use relume::camera::take_series;
use relume::capture::{Capture, CaptureSettings};
use relume::map::luminance;
use relume::response::Response;
use relume::skymodel::{Atmosphere, clear_beam};
use relume::sun::SunPosition;
use relume_firmware::patches::PatchSet;
use relume_tests::skycamera::exposures;

const MOMENTS: u32 = 60;
const STEP_S: f64 = 10.0;
const SIZE: usize = 480;
/// A share that is off by more than this is plainly wrong.
const WRONG: f64 = 0.3;
const TURBIDITIES: [f32; 4] = [3.0, 2.2, 3.0, 4.5];
const COVERS: [f32; 3] = [0.35, 0.2, 0.5];

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut args = std::env::args().skip(1).filter_map(|a| a.parse::<u64>().ok());
    let (first, count) = (args.next().unwrap_or(100), args.next().unwrap_or(6));
    let lenses = [
        ("clean lens", Glare::default()),
        ("faint halo", Glare { veil: 0.002, halo: 0.002, halo_px: 9.0 }),
        ("halo", Glare { veil: 0.005, halo: 0.01, halo_px: 5.0 }),
    ];
    for (lens, glare) in lenses {
        for is_used in [false, true] {
            let mut figures = Figures::default();
            let mut used = is_used.then(|| experienced(glare)).transpose()?;
            for seed in first..first + count {
                let mut new = capture()?;
                figures.add(&day(seed, glare, used.as_mut().unwrap_or(&mut new))?);
            }
            figures.print(&format!("{lens}, {}", if is_used { "used" } else { "new" }));
        }
    }
    Ok(())
}

#[derive(Default)]
struct Figures {
    shares: Vec<[f64; 2]>,
    longest_s: f64,
}

impl Figures {
    fn add(&mut self, shares: &[[f64; 2]]) {
        let mut wrong_s = 0.0;
        for [found, truth] in shares {
            wrong_s = if (found - truth).abs() > WRONG { wrong_s + STEP_S } else { 0.0 };
            self.longest_s = self.longest_s.max(wrong_s);
        }
        self.shares.extend(shares);
    }

    fn print(&self, name: &str) {
        print!("{name}: {} moments", self.shares.len());
        let parts =
            [("behind a cloud", -1.0, 0.02), ("between", 0.02, 0.98), ("in the clear", 0.98, 2.0), ("all", -1.0, 2.0)];
        for (name, low, high) in parts {
            let part = self.shares.iter().filter(|[_, truth]| (low..high).contains(truth));
            let off: Vec<f64> = part.map(|[found, truth]| (found - truth).abs()).collect();
            let wrong = off.iter().filter(|&&off| off > WRONG).count() as f64;
            let of = off.len().max(1) as f64;
            print!("; {name} mean {:.3}, plainly wrong {:.1} %", off.iter().sum::<f64>() / of, 100.0 * wrong / of);
        }
        println!("; longest {:.0} s", self.longest_s);
    }
}

fn capture() -> Result<Capture, Failure> {
    let camera = SyntheticCamera::new(SyntheticSettings::default());
    let settings = CaptureSettings { radiance_scale: camera.radiance_scale(), ..CaptureSettings::default() };
    Ok(Capture::new(camera.lens(), (SIZE, SIZE), PatchSet::new(256)?, settings, None)?)
}

/// A camera that has seen half an hour of a clear sky.
fn experienced(glare: Glare) -> Result<Capture, Failure> {
    let mut capture = capture()?;
    let sun = SunPosition { azimuth_deg: 100.0, altitude_deg: 33.0 };
    let settings = SyntheticSettings { sun: Some(sun), glare, seed: 1, ..SyntheticSettings::default() };
    let mut camera = SyntheticCamera::new(settings);
    for moment in 0..30 {
        look(&mut camera, f64::from(moment) * 60.0, sun, &mut capture)?;
    }
    Ok(capture)
}

/// The sun's luminance that the camera tells at a moment.
fn look(camera: &mut SyntheticCamera, time_s: f64, sun: SunPosition, capture: &mut Capture) -> Result<f64, Failure> {
    let response = Response::from_rows(camera.response_rows(), "response")?;
    let mut merger = Merger::new(MergeSettings { response, ..MergeSettings::default() });
    let (mut frames, mut merged) = (Vec::new(), Merged::default());
    camera.set_time(time_s);
    take_series(camera, &exposures(1e-4, 8.0, 4), &mut frames)?;
    merger.merge(&frames, &mut merged)?;
    let found = capture.weights(&merged, Some(sun))?;
    Ok(found.weights.sun.map_or(0.0, |sun| f64::from(luminance(sun.irradiance))))
}

/// Found and true sun over the clear sky's, moment by moment.
fn day(seed: u64, glare: Glare, capture: &mut Capture) -> Result<Vec<[f64; 2]>, Failure> {
    let sun =
        SunPosition { azimuth_deg: (seed as f64 * 137.5) % 360.0, altitude_deg: 12.0 + (seed as f64 * 37.3) % 50.0 };
    let turbidity = TURBIDITIES[seed as usize % TURBIDITIES.len()];
    let cloud_cover = COVERS[seed as usize % COVERS.len()];
    let atmosphere = Atmosphere { turbidity, cloud_cover, cloud_seed: seed, ..Atmosphere::default() };
    let settings = SyntheticSettings { sun: Some(sun), atmosphere, glare, seed, ..SyntheticSettings::default() };
    let mut camera = SyntheticCamera::new(settings);
    let beam = f64::from(luminance(clear_beam(sun.altitude_deg as f32, turbidity)));
    let mut shares = Vec::new();
    for moment in 0..MOMENTS {
        let found = look(&mut camera, f64::from(moment) * STEP_S, sun, capture)?;
        let truth = camera.sky().sun().map_or(0.0, |sun| f64::from(luminance(sun.irradiance)));
        shares.push([found / beam, truth / beam]);
    }
    Ok(shares)
}
