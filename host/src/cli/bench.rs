//! `relume bench`: time against error on this machine.

use super::args::{Command, number, place, required};
use crate::bench::{Options, SkyMap, run};
use crate::failure::{Failure, OrFail};
use std::path::PathBuf;

pub(super) const COMMAND: Command = Command {
    name: "bench",
    help: "\
relume bench FIELD [--stack STACK_DIR] [--sky MAP[@DEG]]... [--error-codes N]... [--time-ms T]... [--in-cache-only]
             [--cache MIB] [--plot OUT.png] [--json]
relume bench FIELD --loop-only [--json]

Time per frame for several budgets against error, on one thread and two, beside rivals that make the same picture from the
same weights: the dense sum in f32 (OpenBLAS) and in int8, global principal components, and few lights chosen live from
the sky. Without OpenBLAS (apt: libopenblas0-pthread) only the int8 sum is left. Then the same beyond the caches; the
certified bounds against the true errors; arbitrary lights under an error budget of 4 codes; and what skipping saves. A
bound below the true error is a failure (exit code 1).

  --stack STACK_DIR   the uncompressed stack: measures errors too, over all skies (without it those keys are null)
  --sky MAP[@DEG]     a lat-long radiance map, turned about +Y by DEG; may be given more than once.
                      Nine simulated skies are added: six with the sun where the stack has it, three without.
                      A sun that stands elsewhere than the stack's is left out on both sides.
  --error-codes N     an error budget, 8-bit codes; may be given more than once (4, 2 and 1.5)
  --time-ms T         a time budget for a sky that clouds over, milliseconds a frame; may be given more than once (a quarter,
                      half, all and twice of what a full frame takes)
  --in-cache-only     leaves out the run beyond the caches: copies of the field in turn, four times the last-level cache
  --cache MIB         size of the last-level cache, where the system's own answer is not to be taken
  --loop-only         nothing but the loop of a post under a still sky at 30 frames a second, over a still and over a live
                      view, from the camera's codes to the display's memory. With --json: width_px, height_px, frames, and
                      still_view, live_view, live_view_by_curve, live_view_scaled, each cpu_ms_per_frame, share_of_core,
                      frames_composited; calm_sky, the sky camera alone while nothing moves; light_to_pixel, the time from
                      a series to its light in the display's memory while the sky changes
  --plot OUT.png      time against error as a picture (with --stack)
  --json              the figures as one JSON object on standard output:
    skies, skies_with_sun, width_px, height_px, covered_px
    bytes_per_covered_pixel          of the field, read for a full frame with the sun's layer
    bytes_stored_per_covered_pixel   of the whole file
    share_of_read_bandwidth          of this run's, at the last budget
    read_bandwidth_{one_thread,two_threads}_bytes_per_cpu_s, read_bandwidth_buffer_bytes
    sun_trace_cpu_ms                 once whenever the sun has moved; in no frame's time
    methods[]                        name, budget, cpu_ms_per_frame (one thread, in cache), rmse_{median,worst},
                                     rmse_worst_{with,without}_sun, worst_code, share_off_by_more_than_one,
                                     code_error_worst_without_sun (shown against the exact code before rounding),
                                     bound_codes_worst_without_sun (certified, of the sky's light),
                                     times_faster_than_dense_f32_openblas, errors_per_sky[]. An error budget starts
                                     every frame from scratch; the rows it takes are not among the bytes read
    in_cache, beyond_cache           field_copies, field_bytes, rivals_bytes, last_level_cache_bytes, sun_included, and
                                     timings[]: name, budget, threads, cpu_ms_per_frame (also _with_sun, _without_sun,
                                     _coefficients_reused), wall_ms_per_frame, bytes_read_per_covered_pixel,
                                     share_of_read_bandwidth, times_faster_... (also ..._coefficients_reused)
    bounds (with --stack)            of full frames under the skies without a sun, whose light they cover: looseness_worst
                                     (largest bound / largest error of a frame's tiles, linear), looseness_dark_worst
                                     (tiles under 16 codes), share_of_tiles_below_error (0, or the bench fails),
                                     {with,without}_bounds_cpu_ms, share_of_frame_time (at most: what skipping must
                                     remember is in it), per_sky[]: tiles, tiles_dark, {bound,error}_{linear,codes}, ...
    lights (with --stack)            budget_codes, full_frame_cpu_ms (ordinary), patches_unseen, single_patches: patches,
                                     patches_beyond_budget, worst_error, worst_bound, times_full_frame_{median,worst};
                                     torch, sun_left_in_sky. Each light: patches, error_codes, bound_codes, cpu_ms,
                                     times_full_frame, tiles_way_back, share_of_tiles_below_error
    skipping[]                       a clear sky without a sun, and with it: has_sun, tiles, full_frame_cpu_ms;
                                     nearest_patches[] (the 13 nearest to each of 12 directions, x factor):
                                     times_less_than_full_frame_{median,worst}, cpu_ms, tiles_drawn_by_oracle;
                                     clear_to_overcast (10 s, 30 frames a second): frames, tiles_drawn,
                                     tiles_drawn_by_oracle, times_oracle, cpu_ms; still_sky, and live_view (a view that
                                     changes with every frame before it): cpu_ms, share_of_full_frame; and in each
                                     counters: tiles_{drawn,composited,kept}, blocks_{projected,stepped},
                                     patches_changed (means of the frames);
                                     in_time[] (clear_to_overcast within a time): share_of_full_frame, allowed_ms, cpu_ms,
                                     cpu_ms_95th, tiles_waiting, {bound,error}_codes_worst, frames_until_finished
  rmse, shares and times faster are plain fractions; times are medians over frames
",
    act,
};

fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    use lexopt::prelude::{Long, Value};
    let (mut field, mut plot, mut json, mut loop_only) = (None::<PathBuf>, None::<PathBuf>, false, false);
    let mut options = Options::default();
    while let Some(arg) = parser.next()? {
        match arg {
            Long("stack") => options.stack = Some(parser.value()?.into()),
            Long("sky") => options.skies.push(SkyMap::parse(&parser.value()?)),
            Long("error-codes") => options.error_codes.push(number(&mut parser, "--error-codes", 0.6..=255.0)? as f32),
            Long("time-ms") => options.times_ms.push(number(&mut parser, "--time-ms", 0.01..=10_000.0)?),
            Long("in-cache-only") => options.in_cache_only = true,
            Long("loop-only") => loop_only = true,
            Long("cache") => {
                options.last_level_cache_bytes =
                    Some((number(&mut parser, "--cache", 1.0..=65536.0)? * f64::from(1 << 20)) as usize);
            }
            Long("plot" | "figure") => plot = Some(parser.value()?.into()),
            Long("json") => json = true,
            Value(value) => place(value, &mut [&mut field])?,
            other => return Err(other.unexpected().into()),
        }
    }
    options.field = required(field, "FIELD")?;
    if loop_only {
        let report = crate::bench::postloop::run(&options.field).or_bad()?;
        return if json { super::say_json(&report) } else { super::say(&report.to_string()) };
    }
    if let Some(path) = &plot {
        crate::outfile::check_writable(path)?;
    }
    let report = run(&options).or_bad()?;
    match (plot, crate::bench::figure(&report)) {
        (Some(path), Some(chart)) => chart.draw(1000, 600).save(&path).or_runtime()?,
        (Some(path), None) => eprintln!("bench: {}: not drawn; errors need --stack", path.display()),
        (None, _) => {}
    }
    if json { super::say_json(&report) } else { super::say(&report.to_string()) }?;
    report.broken_bound().map_or(Ok(()), |line| Err(Failure::runtime(line)))
}
