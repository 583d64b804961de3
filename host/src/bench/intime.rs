//! Time budgets while a sky clouds over: what a frame takes, and how far off it is because tiles wait.

use serde::Serialize;

use super::clock::median;
use super::skipping::{Trial, mix};
use super::stage::Stage;
use crate::relight::Budget;
use crate::weights::PatchWeights;
use relume_firmware::field::Field;
use std::time::Duration;

/// Time allowed, of what a full frame takes, unless other times are asked for.
const SHARES: [f64; 4] = [0.25, 0.5, 1.0, 2.0];
/// Frames of the change; a frame in so many is compared with one in which nothing waits.
const FRAMES: usize = 300;
const COMPARED: usize = 10;

/// One time budget.
#[derive(Clone, Debug, Serialize)]
pub struct InTime {
    /// Time allowed, of what a full frame takes.
    pub share_of_full_frame: f64,
    /// The same, milliseconds.
    pub allowed_ms: f64,
    /// CPU time of a frame, median, milliseconds.
    pub cpu_ms: f64,
    /// The frame that took longer than 95 % of the others.
    pub cpu_ms_95th: f64,
    /// Tiles that waited, mean of the frames.
    pub tiles_waiting: f64,
    /// Largest bound in codes that any frame gave, waiting included; `None` where the field has no bounds.
    pub bound_codes_worst: Option<f32>,
    /// Largest distance of any code shown from the code before rounding of the field's full picture.
    pub error_codes_worst: f64,
    /// Frames of the last light until no tile waits.
    pub frames_until_finished: usize,
}

/// The change from `clear` to `overcast` under every time budget: `times_ms`, or [`SHARES`] of `full_s`.
///
/// # Errors
/// If the field refuses the weights or a budget.
pub(super) fn run(
    trial: &mut Trial<'_>,
    field: Field<'_>,
    (clear, overcast): (&PatchWeights, &PatchWeights),
    (full_s, times_ms): (f64, &[f64]),
) -> anyhow::Result<Vec<InTime>> {
    let asked = times_ms.iter().map(|ms| 1e-3 * ms / full_s);
    let shares: Vec<f64> = if times_ms.is_empty() { SHARES.to_vec() } else { asked.collect() };
    let one = |share: f64| in_time(trial, Stage::new(field), (clear, overcast), (share, share * full_s));
    shares.into_iter().map(one).collect()
}

fn in_time(
    trial: &mut Trial<'_>,
    mut stage: Stage<'_>,
    (clear, overcast): (&PatchWeights, &PatchWeights),
    (share, allowed_s): (f64, f64),
) -> anyhow::Result<InTime> {
    let exposure = trial.exposure;
    stage.relighter.set_budget(Budget::Time(Duration::from_secs_f64(allowed_s)))?;
    // The time of a tile is learned from whole frames.
    for _ in 0..5 {
        stage.full_frame(clear, exposure)?;
    }
    let (mut took_s, mut waited, mut bound, mut error) = (Vec::new(), 0usize, None::<f32>, 0.0f64);
    for frame in 1..=FRAMES {
        let sky = mix(clear, overcast, frame as f32 / FRAMES as f32);
        let (took, counters) = stage.frame(&sky, exposure)?;
        took_s.push(took);
        waited += counters.tiles_waiting;
        bound = bound.into_iter().chain(counters.bound_codes).reduce(f32::max);
        if frame % COMPARED == 0 {
            error = error.max(trial.code_error(&sky, &stage.framebuffer.pixels)?);
        }
    }
    let mut frames_until_finished = 0;
    while stage.frame(overcast, exposure)?.1.tiles_waiting > 0 && frames_until_finished < FRAMES {
        frames_until_finished += 1;
    }
    took_s.sort_by(f64::total_cmp);
    Ok(InTime {
        share_of_full_frame: share,
        allowed_ms: 1e3 * allowed_s,
        cpu_ms: 1e3 * median(&took_s),
        cpu_ms_95th: 1e3 * took_s[FRAMES * 95 / 100],
        tiles_waiting: waited as f64 / FRAMES as f64,
        bound_codes_worst: bound,
        error_codes_worst: error,
        frames_until_finished,
    })
}

impl std::fmt::Display for InTime {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let bound = self.bound_codes_worst.map_or("no bound".to_owned(), |codes| format!("bound {codes:.2} codes"));
        writeln!(
            f,
            "the same in {:.3} ms ({:.2} of a full frame): {:.3} ms, 95 % within {:.3}; tiles waiting {:.1}; {bound}, true {:.2}; \
             finished after {} frames more",
            self.allowed_ms,
            self.share_of_full_frame,
            self.cpu_ms,
            self.cpu_ms_95th,
            self.tiles_waiting,
            self.error_codes_worst,
            self.frames_until_finished
        )
    }
}
