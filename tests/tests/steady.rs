//! The loop of a post in its steady state: no allocation in a frame, whatever the light does.

#![allow(clippy::unwrap_used)]

use relume::clock::{Moment, PostClock};
use relume::config::{ClockConfig, Config};
use relume::display::{Display, DisplayError, Frame};
use relume::painter::Painter;
use relume::painter::field::FieldPainter;
use relume::post::{Parts, Post, Signals};
use relume::relight::FieldFile;
use relume::sky_source::{SkyFault, SkyReading, SkySource, SunSource};
use relume::view::Still;
use relume::weights::{PatchWeights, SunWeight};
use relume_tests::counting::{Counting, allocations};
use relume_tests::files::{fresh_folder, put};
use relume_tests::program::bake_in;
use relume_tests::scene::write_courtyard;
use std::cell::RefCell;
use std::rc::Rc;
use std::time::Instant;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// A sky whose every frame differs a little; patches stand out and go; its readings reuse the buffer.
struct Drifting(u64);

impl SkySource for Drifting {
    fn read(&mut self, _moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        self.0 += 1;
        let frame = self.0 as f32;
        into.weights.radiance.resize(68, [0.0; 3]);
        for (patch, rgb) in into.weights.radiance.iter_mut().enumerate() {
            *rgb = [1.0, 1.1, 1.2].map(|v: f32| v + 0.2 * (0.1 * frame + patch as f32).sin());
        }
        into.weights.radiance[self.0 as usize / 7 % 60] = [9.0; 3];
        into.weights.sun = Some(SunWeight { dir_world: [0.6, 0.8, 0.0], irradiance: [2.0 + (0.3 * frame).sin(); 3] });
        into.sun = SunSource::Measured;
        Ok(true)
    }
}

/// Notes how much was allocated from frame to frame, in room that is there already.
struct Watching(Rc<RefCell<Vec<u64>>>, (usize, usize), u64);

impl Display for Watching {
    fn size(&self) -> (usize, usize) {
        self.1
    }

    fn present(&mut self, _frame: &Frame<'_>) -> Result<(), DisplayError> {
        let now = allocations();
        self.0.borrow_mut().push(now - self.2);
        self.2 = now;
        Ok(())
    }
}

/// Frames; more by `RELUME_STEADY_FRAMES`.
fn frames() -> usize {
    std::env::var("RELUME_STEADY_FRAMES").ok().and_then(|frames| frames.parse().ok()).unwrap_or(400)
}

#[test]
fn frames_of_a_drifting_sky_allocate_nothing() {
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "steady");
    write_courtyard(&folder);
    let args = ["scene", "scene.glb", "--camera", "camera.json", "--size", "64x48", "--directions", "64"];
    bake_in(&folder, &[&args[..], &["-o", "a.field"]].concat()).well();
    let post = "title = 'The yard'\nfield = 'a.field'\nsky = 'replay'\n[camera]\nframes = 'f'\nlens = 'l'\n\
                [display]\nkind = 'headless'\nfolder = '.'\n";
    let text = format!("{post}[run]\nstart = 2026-06-21T04:00:00Z\nstep_s = 0.03\nframes = {}\n", frames());
    put(&folder.join("POST.toml"), text);
    let config = Config::load(&folder.join("POST.toml")).unwrap();
    let file = FieldFile::open(&config.field).unwrap();
    // One thread: what rayon allocates to hand work over is its own.
    let mut painter = FieldPainter::new(file.field(), Still::black(64, 48), 1);
    let even = PatchWeights { radiance: vec![[1.0; 3]; 68], sun: None };
    painter.relight(&even, 1.0).unwrap();
    let (exact, sampled) = (painter.exact_exposure(), painter.wanted_exposure());
    assert!(exact.is_some() && exact == sampled, "a small picture is looked at as a whole: {exact:?}, {sampled:?}");
    let counts = Rc::new(RefCell::new(Vec::with_capacity(frames())));
    let parts = Parts {
        sky: Box::new(Drifting(0)),
        painter: Box::new(painter),
        display: Box::new(Watching(Rc::clone(&counts), (64, 48), 0)),
        clock: PostClock::start(
            ClockConfig::Simulated { start_unix_s: 1_782_000_000.0, step_s: 0.03, speed: None },
            None,
        ),
    };
    let begun = Instant::now();
    let report = Post::new(&config, parts).run(&Signals::default()).unwrap();
    assert!(report.frames_changed > frames() as u64 / 2, "the sky drifts: {}", report.frames_changed);
    let counts = counts.borrow();
    assert!(counts[0] > 0, "the first frame makes room; the counter counts");
    // The first hundred warm up. Once a second the state is put in words for the labels before a frame is presented, and
    // written after that: both allocate.
    let steady = &counts[100..];
    let busy = steady.iter().filter(|&&count| count > 0).count();
    let seconds = begun.elapsed().as_secs() as usize;
    eprintln!("{} frames in {seconds} s, {busy} with allocations", steady.len());
    assert!(busy <= 3 + 2 * seconds, "{busy} of {} frames in {seconds} s allocate", steady.len());
}
