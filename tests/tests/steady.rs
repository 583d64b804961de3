//! The loop of a post in its steady state: no allocation in a frame, whatever light and view do, and no memory kept.

#![allow(clippy::unwrap_used)]

use relume::camera::unpack::{Layout, Matrix, PixelFormat, Range, Unpacker, YuvCoding};
use relume::camera::{Camera, CameraError, CameraLimits, Exposure, Frame as CameraFrame};
use relume::clock::{Moment, PostClock};
use relume::config::{ClockConfig, Config};
use relume::display::{Display, DisplayError, Frame};
use relume::painter::Painter;
use relume::painter::field::FieldPainter;
use relume::post::{Parts, Post, Signals};
use relume::relight::FieldFile;
use relume::response::Response;
use relume::sky_source::{SkyFault, SkyReading, SkySource, SunSource};
use relume::view::Still;
use relume::view::curve::ViewCurve;
use relume::view::live::{CameraView, ViewSource};
use relume::weights::{PatchWeights, SunWeight};
use relume_tests::counting::{Counting, allocations, held_bytes};
use relume_tests::files::{fresh_folder, put};
use relume_tests::program::bake_in;
use relume_tests::scene::write_courtyard;
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::{Mutex, OnceLock, PoisonError};
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

/// A view's camera whose every picture differs, of another size than the field.
struct Moving(u64);

impl Camera for Moving {
    fn limits(&self) -> CameraLimits {
        CameraLimits::nothing_to_set((96, 72))
    }

    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        Ok(exposure)
    }

    fn frame(&mut self, into: &mut CameraFrame) -> Result<(), CameraError> {
        self.0 += 1;
        into.codes_u8(96, 72).iter_mut().enumerate().for_each(|(at, code)| *code = (at as u64 * 7 + self.0) as u8);
        Ok(())
    }
}

/// Notes how often memory was asked for from frame to frame, and the bytes held, in room that is there already.
struct Watching(Rc<RefCell<Vec<(u64, i64)>>>, (usize, usize), u64);

impl Display for Watching {
    fn size(&self) -> (usize, usize) {
        self.1
    }

    fn present(&mut self, _frame: &Frame<'_>) -> Result<(), DisplayError> {
        let now = allocations();
        self.0.borrow_mut().push((now - self.2, held_bytes()));
        self.2 = now;
        Ok(())
    }
}

/// Bytes that the last frame may hold more than the hundredth: less than one each of 100,000 frames could leave.
const MOST_GAINED_BYTES: i64 = 4096;

/// Frames; more by `RELUME_STEADY_FRAMES`.
fn frames() -> usize {
    std::env::var("RELUME_STEADY_FRAMES").ok().and_then(|frames| frames.parse().ok()).unwrap_or(400)
}

fn field_folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "steady");
        write_courtyard(&folder);
        let args = ["scene", "scene.glb", "--camera", "camera.json", "--size", "64x48", "--directions", "64"];
        bake_in(&folder, &[&args[..], &["-o", "a.field"]].concat()).well();
        folder
    })
}

/// A post whose state goes to the folder `name`.
fn config(folder: &Path, name: &str) -> Config {
    std::fs::create_dir(folder.join(name)).unwrap();
    let post = format!(
        "title = 'The yard'\nfield = 'a.field'\nsky = 'replay'\n[camera]\nframes = 'f'\nlens = 'l'\n\
         [display]\nkind = 'headless'\nfolder = '{name}'\n"
    );
    let text = format!("{post}[run]\nstart = 2026-06-21T04:00:00Z\nstep_s = 0.03\nframes = {}\n", frames());
    put(&folder.join(format!("{name}.toml")), text);
    Config::load(&folder.join(format!("{name}.toml"))).unwrap()
}

/// Runs a post, over a live view if there is one; its state goes to the folder `name`.
fn run_steadily(name: &str, view: Option<Box<dyn ViewSource>>) {
    // The bytes that are held are those of all threads: one post at a time.
    static ONE_POST: Mutex<()> = Mutex::new(());
    let _one = ONE_POST.lock().unwrap_or_else(PoisonError::into_inner);
    let config = config(field_folder(), name);
    let file = FieldFile::open(&config.field).unwrap();
    // One thread: what rayon allocates to hand work over is its own.
    let mut painter = FieldPainter::new(file.field(), Still::black(64, 48), 1);
    if view.is_some() {
        painter.expect_live_view();
    }
    let even = PatchWeights { radiance: vec![[1.0; 3]; 68], sun: None };
    painter.relight(&even, 1.0).unwrap();
    let (exact, sampled) = (painter.exact_exposure(), painter.wanted_exposure());
    assert!(exact.is_some() && exact == sampled, "a small picture is looked at as a whole: {exact:?}, {sampled:?}");
    let counts = Rc::new(RefCell::new(Vec::with_capacity(frames())));
    let parts = Parts {
        sky: Box::new(Drifting(0)),
        view,
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
    assert!(report.health.view.is_none_or(|view| view.pictures == frames() as u64));
    let counts = counts.borrow();
    assert!(counts[0].0 > 0, "the first frame makes room; the counter counts");
    // The first hundred warm up. Once a second the state is put in words for the labels before a frame is presented, and
    // written after that: both allocate.
    let steady = &counts[100..];
    let busy = steady.iter().filter(|&&(count, _)| count > 0).count();
    let seconds = begun.elapsed().as_secs() as usize;
    eprintln!("{name}: {} frames in {seconds} s, {busy} with allocations", steady.len());
    assert!(busy <= 3 + 2 * seconds, "{name}: {busy} of {} frames in {seconds} s allocate", steady.len());
    // Words of other lengths in the state, and no more.
    let (first, last) = (steady[0].1, steady[steady.len() - 1].1);
    eprintln!("bytes held: {first} after the first hundred frames, {last} at the end");
    assert!(last - first < MOST_GAINED_BYTES, "{} bytes more are held at the end", last - first);
}

#[test]
fn frames_of_a_drifting_sky_allocate_nothing() {
    run_steadily("still", None);
}

/// The camera's pictures are taken and scaled on this thread, so that they count.
#[test]
fn frames_of_a_live_view_allocate_nothing() {
    let view = || CameraView::new("camera", Box::new(Moving(0)), (64, 48));
    run_steadily("live", Some(Box::new(view())));
    let curve = ViewCurve::new(Response::default(), "a linear camera").unwrap();
    run_steadily("by_curve", Some(Box::new(view().with_curve(Some(curve)))));
}

/// MJPG is the one format whose unpacking asks for memory: that of the decoder (zune-jpeg by `image`), which makes its tables
/// and rows for every picture and gives them back. Nothing of ours comes on top.
#[test]
fn a_jpeg_picture_allocates_in_its_decoder_alone() {
    use image::ImageDecoder;
    use image::codecs::jpeg::{JpegDecoder, JpegEncoder};
    let (width, height) = (96, 72);
    let picture = image::RgbImage::from_fn(width, height, |x, y| image::Rgb([(2 * x) as u8, (3 * y) as u8, 77]));
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, 90).encode_image(&picture).unwrap();
    let coding = YuvCoding { range: Range::Limited, matrix: Matrix::Bt601 };
    let size = (width as usize, height as usize);
    let layout = Layout { format: PixelFormat::Jpeg, width: size.0, height: size.1, stride: 0, coding };
    let (mut unpacker, mut frame) = (Unpacker::new(layout).unwrap(), CameraFrame::default());
    let mut codes = vec![0; 3 * size.0 * size.1];
    let mut decode = || JpegDecoder::new(std::io::Cursor::new(&bytes[..])).unwrap().read_image(&mut codes).unwrap();
    unpacker.unpack(&bytes, &mut frame).unwrap();
    decode();
    let before = allocations();
    decode();
    let decoders = allocations() - before;
    for _ in 0..20 {
        let before = allocations();
        unpacker.unpack(&bytes, &mut frame).unwrap();
        assert_eq!(allocations() - before, decoders, "beside the decoder's");
    }
    eprintln!("an MJPG picture: {decoders} allocations, all of them the decoder's");
    assert!(decoders > 0, "the counter counts");
}
