use super::*;
use crate::camera::CameraError;
use crate::config::ClockConfig;
use crate::display::DisplayError;
use crate::health::ViewState;
use crate::sky_source::{SeriesTimes, SkyFault};
use crate::view::live::ViewPicture;
use relume_firmware::patches::PatchSet;
use std::cell::RefCell;
use std::rc::Rc;

const START: f64 = 1_782_000_000.0;

/// One pixel that shows the first patch's radiance times exposure, as a code, plus the view's.
struct Pixel {
    pixels: Vec<u32>,
    brightness: f32,
    drawn: u32,
    /// As it was drawn last.
    relit: u32,
    /// Added to it.
    view: Vec<u32>,
}

impl Painter for Pixel {
    fn size(&self) -> (usize, usize) {
        (1, 1)
    }
    fn patch_set(&self) -> PatchSet {
        PatchSet::new(16).unwrap()
    }
    fn north_deg(&self) -> f64 {
        0.0
    }
    fn relight(&mut self, weights: &PatchWeights, exposure: f32) -> anyhow::Result<Option<String>> {
        anyhow::ensure!(weights.radiance[0][0].is_finite(), "weights are not finite");
        self.brightness = weights.radiance[0][0];
        self.drawn = (self.brightness * exposure * 100.0).round() as u32;
        Ok(None)
    }
    fn wanted_exposure(&mut self) -> Option<f64> {
        (self.brightness > 0.0).then(|| 0.8 / f64::from(self.brightness))
    }
    fn view_gain(&mut self) -> Option<ViewGain> {
        (self.view[0] > 0).then(|| ViewGain { gain: [f64::from(self.view[0]) / 1000.0; 3], scatter: 0.0 })
    }
    fn draw(&mut self, damage: &mut Damage) -> anyhow::Result<FrameCounters> {
        let changed = std::mem::replace(&mut self.relit, self.drawn) != self.drawn;
        let before = std::mem::replace(&mut self.pixels[0], self.relit + self.view[0]);
        if before != self.pixels[0] {
            damage.mark(0);
        }
        Ok(FrameCounters { tiles: 1, tiles_drawn: usize::from(changed), ..FrameCounters::default() })
    }
    fn show_view(&mut self, pixels_bgrx: &mut Vec<u32>) {
        std::mem::swap(&mut self.view, pixels_bgrx);
    }
    fn pixels_bgrx(&self) -> &[u32] {
        &self.pixels
    }
}

/// Radiances to give, frame by frame; `None` fails.
struct Script(Vec<Option<f32>>, usize);

impl SkySource for Script {
    fn read(&mut self, _moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        let step = self.0.get(self.1).ok_or(SkyFault::Ended)?;
        self.1 += 1;
        let radiance = step.ok_or_else(|| SkyFault::Failed("camera unplugged".into()))?;
        let weights = PatchWeights { radiance: vec![[radiance; 3]; 17], sun: None };
        *into = SkyReading { weights, ..SkyReading::default() };
        Ok(true)
    }
}

struct Seen(Rc<RefCell<Vec<u32>>>, bool);

/// Shows each picture with the next one, like a screen that flips.
struct Flipping {
    presented: Option<u64>,
    flipped: Option<(u64, Instant)>,
}

impl Display for Flipping {
    fn size(&self) -> (usize, usize) {
        (1, 1)
    }
    fn present(&mut self, frame: &Frame<'_>) -> Result<(), DisplayError> {
        std::thread::sleep(Duration::from_millis(20));
        self.flipped = self.presented.replace(frame.number).map(|shown| (shown, Instant::now()));
        Ok(())
    }
    fn when_shown(&mut self, number: u64) -> Option<Instant> {
        self.flipped.filter(|(shown, _)| *shown >= number).map(|(_, at)| at)
    }
}

/// Light that a camera took over 40 ms, of which the weights were ready 30 ms later.
struct Measured;

impl SkySource for Measured {
    fn read(&mut self, _moment: Moment, into: &mut SkyReading) -> Result<bool, SkyFault> {
        let ready = Instant::now();
        let ago = |ms: u64| ready.checked_sub(Duration::from_millis(ms)).unwrap();
        let times = SeriesTimes { first: ago(70), last: ago(30), ready };
        let weights = PatchWeights { radiance: vec![[0.5; 3]; 17], sun: None };
        *into = SkyReading { weights, times: Some(times), ..SkyReading::default() };
        Ok(true)
    }
}

#[test]
fn light_is_on_its_way_until_the_display_says_that_it_is_shown() {
    let (_folder, config) = post_file("[run]\nframes = 6\n");
    let parts = Parts {
        sky: Box::new(Measured),
        view: None,
        painter: Box::new(Pixel { pixels: vec![0], brightness: 0.0, drawn: 0, relit: 0, view: vec![0] }),
        display: Box::new(Flipping { presented: None, flipped: None }),
        clock: PostClock::start(ClockConfig::Simulated { start_unix_s: START, step_s: 60.0, speed: None }, None),
    };
    let health = Post::new(&config, parts).run(&Signals::default()).unwrap().health;
    let (parts, mean) = (health.latency_parts.unwrap(), health.latency_mean_parts.unwrap());
    assert!((parts.bracket_ms - 40.0).abs() < 0.01 && (parts.weights_ms - 30.0).abs() < 0.01, "{parts:?}");
    // The picture's own presentation and that of the next, which shows it, take 20 ms each.
    assert!(parts.display_ms >= 39.0 && mean.display_ms >= 39.0, "{parts:?} {mean:?}");
    let sum = parts.weights_ms + parts.relight_ms + parts.display_ms;
    assert!((health.latency_ms.unwrap() - sum).abs() < 0.01 && health.latency_worst_ms >= health.latency_ms);
}

impl Display for Seen {
    fn size(&self) -> (usize, usize) {
        (1, 1)
    }
    fn present(&mut self, frame: &Frame<'_>) -> Result<(), DisplayError> {
        if self.1 {
            return Err(DisplayError::Size { frame: (1, 1), display: (2, 2) });
        }
        self.0.borrow_mut().push(frame.pixels_bgrx[0]);
        Ok(())
    }
}

/// The same for a view: codes of its one pixel; `None` fails.
struct Behind(Vec<Option<u32>>, usize);

impl ViewSource for Behind {
    fn read(&mut self, into: &mut ViewPicture) -> Result<bool, CameraError> {
        let step = self.0.get(self.1).copied();
        self.1 += 1;
        let Some(step) = step else { return Ok(false) };
        into.pixels_bgrx = vec![step.ok_or(CameraError::Lost)?];
        into.taken = Some(Instant::now());
        Ok(true)
    }
}

fn post_file(extra: &str) -> (tempfile::TempDir, Config) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("POST.toml");
    let text = format!(
        "field = 'a'\nsky = 'replay'\n[camera]\nframes = 'f'\nlens = 'l'\n[display]\nkind = 'headless'\nfolder = '.'\n{extra}"
    );
    std::fs::write(&file, text).unwrap();
    let config = Config::load(&file).unwrap();
    (folder, config)
}

fn run(extra: &str, script: &[Option<f32>], broken: bool) -> (Result<PostReport, Failure>, Vec<u32>, String) {
    run_with(extra, script, None, broken, |_| {})
}

fn run_over(
    extra: &str,
    script: &[Option<f32>],
    view: Option<&[Option<u32>]>,
    broken: bool,
) -> (Result<PostReport, Failure>, Vec<u32>, String) {
    run_with(extra, script, view, broken, |_| {})
}

fn run_with(
    extra: &str,
    script: &[Option<f32>],
    view: Option<&[Option<u32>]>,
    broken: bool,
    prepare: impl FnOnce(&mut Post<'_>),
) -> (Result<PostReport, Failure>, Vec<u32>, String) {
    let (_folder, config) = post_file(extra);
    let seen = Rc::new(RefCell::new(Vec::new()));
    let parts = Parts {
        sky: Box::new(Script(script.to_vec(), 0)),
        view: view.map(|view| Box::new(Behind(view.to_vec(), 0)) as Box<dyn ViewSource>),
        painter: Box::new(Pixel { pixels: vec![0], brightness: 0.0, drawn: 0, relit: 0, view: vec![0] }),
        display: Box::new(Seen(seen.clone(), broken)),
        clock: PostClock::start(ClockConfig::Simulated { start_unix_s: START, step_s: 60.0, speed: None }, None),
    };
    let mut post = Post::new(&config, parts);
    prepare(&mut post);
    // As programs that were killed leave them.
    let left = [".health.json.a1B2c3.tmp", ".screenshot.png.a1B2c3.tmp"].map(|name| config.health.with_file_name(name));
    left.iter().for_each(|file| std::fs::write(file, "").unwrap());
    let report = post.run(&Signals::default());
    assert!(!left.iter().any(|file| file.exists()), "leftovers stay");
    let health = std::fs::read_to_string(&config.health).unwrap_or_default();
    let seen = seen.borrow().clone();
    (report, seen, health)
}

const FIXED: &str = "[exposure]\nmode = 'fixed'\nev = 0\n";

#[test]
fn a_failing_sky_holds_the_last_weights_and_says_so() {
    let (report, seen, _) = run(FIXED, &[Some(0.5), None, None, Some(0.7)], false);
    let report = report.unwrap();
    assert_eq!(seen, [50, 50, 50, 70]);
    assert_eq!((report.frames, report.frames_changed, report.sky_faults), (4, 2, 2));
    assert_eq!((report.ended, report.health.weights), ("replay ended", WeightsState::Fresh));

    let (report, seen, health) = run(FIXED, &[Some(0.5), None], false);
    assert_eq!(seen, [50, 50]);
    assert_eq!(report.unwrap().health.weights, WeightsState::Held);
    let health: serde_json::Value = serde_json::from_str(&health).unwrap();
    assert_eq!(health["weights"], "held");
    assert!(health["state"].as_str().unwrap().contains("camera unplugged"), "{health}");
}

#[test]
fn a_sky_that_never_came_is_stood_in_for() {
    let (report, seen, _) = run(FIXED, &[None, None], false);
    assert_eq!(seen, [100, 100], "an even sky of radiance 1");
    assert_eq!(report.unwrap().health.weights, WeightsState::StandIn);
}

#[test]
fn weights_that_do_not_fit_leave_the_picture() {
    let (report, seen, _) = run(FIXED, &[Some(0.5), Some(f32::NAN), Some(0.6)], false);
    assert_eq!(seen, [50, 50, 60]);
    assert_eq!(report.unwrap().sky_faults, 1);
}

#[test]
fn exposure_follows_the_light_within_half_a_stop() {
    let script: Vec<Option<f32>> = (0..40).map(|i| Some(2f32.powf(i as f32 * 0.25 - 5.0))).collect();
    let (report, seen, _) = run("", &script, false);
    let (dark, bright) = (80.0 * 2f64.powf(-0.5) - 1.0, 80.0 * 2f64.powf(0.5) + 1.0);
    assert!(seen.iter().all(|&code| (dark..bright).contains(&f64::from(code))), "{seen:?}");
    let changes = report.unwrap().exposure_changes;
    assert!((10..=20).contains(&changes), "{changes} changes over ten stops");
}

#[test]
fn a_lost_view_is_held_and_told_and_its_new_pictures_are_only_composited() {
    let script = vec![Some(0.5); 8];
    let views = [Some(1000), Some(2000), None, None, Some(3000), Some(4000)];
    let (report, seen, _) = run_over(FIXED, &script, Some(&views), false);
    assert_eq!(seen, [1050, 2050, 2050, 2050, 3050, 4050, 4050, 4050]);
    let report = report.unwrap();
    let view = report.health.view.unwrap();
    assert_eq!((view.state, view.pictures, view.faults), (ViewState::Fresh, 4, 2));
    assert_eq!((report.frames_changed, view.frames_composited), (4, 3), "the first is drawn");
    assert!(view.latency_ms.is_some() && view.latency_ms <= view.latency_worst_ms, "{view:?}");
    assert_eq!(report.health.state, "ok");

    // Light that changes draws, whatever the view does.
    let (report, ..) = run_over(FIXED, &[Some(0.5), Some(0.6), Some(0.7)], Some(&views), false);
    let health = report.unwrap().health;
    assert_eq!(health.view.unwrap().frames_composited, 0);
    assert_eq!(health.state, "view fails, last picture held: the camera is gone");

    let (report, seen, _) = run_over(FIXED, &[Some(0.5)], Some(&[None]), false);
    assert_eq!((report.unwrap().health.state.as_str(), seen[0]), ("no view yet: the camera is gone", 50));
}

#[test]
fn the_picture_is_exposed_as_the_view_is_in_the_frame_that_shows_it() {
    let by_view = "[view_camera]\nframes = 'v'\n[exposure]\nmode = 'view'\n";
    // New light comes once only; the last view trembles.
    let views = [Some(1000), Some(1000), Some(2000), Some(2010)];
    let (report, seen, _) = run_over(by_view, &[Some(0.5), None, None, None], Some(&views), false);
    assert_eq!(seen, [1050, 1050, 2100, 2110]);
    let health = report.unwrap().health;
    assert_eq!((health.exposure_ev, health.view_gain.map(|seen| seen.gain)), (1.0, Some([2.01; 3])));
    // Without a view the picture itself tells.
    let (_, seen, _) = run_over(by_view, &[Some(0.5), None], Some(&[None]), false);
    assert!((56..114).contains(&seen[0]), "{seen:?}");
}

#[test]
fn limits_end_the_post() {
    let script = vec![Some(1.0); 100];
    let (report, seen, _) = run("[run]\nframes = 7\n", &script, false);
    assert_eq!((report.unwrap().ended, seen.len()), ("frames", 7));
    let (report, seen, _) = run("[run]\nduration_s = 600\n", &script, false);
    assert_eq!((report.unwrap().ended, seen.len()), ("duration", 10));
}

#[test]
fn a_broken_display_ends_the_post() {
    assert!(run("", &[Some(1.0)], true).0.is_err());
}

#[test]
fn light_held_for_too_long_fades_to_a_model() {
    use crate::config::{Site, Weather};
    use crate::sun::Place;
    let place = Place { latitude_deg: 48.0, longitude_deg: 60.0 };
    let site = Site { place, elevation_m: 0.0, ground_albedo: 0.2 };
    let weather = Weather { turbidity: 3.0, cloud_cover: 0.0, seed: 1 };
    let fade = |post: &mut Post<'_>| {
        post.fade_by(crate::fading::Fading::new(site, weather, PatchSet::new(16).unwrap(), 0.0));
    };
    // A minute from frame to frame; START is 0:00 UTC in June: at 48 N, 60 E the sun rises, and the light with it.
    let mut script = vec![None; 16];
    (script[0], script[15]) = (Some(0.5), Some(0.7));
    let (report, seen, _) = run_with(FIXED, &script, None, false, fade);
    assert_eq!(seen[..3], [50; 3], "held for two minutes");
    assert!(seen.windows(2).skip(2).take(12).all(|pair| pair[1] >= pair[0]) && seen[14] > 55, "{seen:?}");
    assert!(seen.windows(2).take(14).all(|pair| pair[1] - pair[0] < 40), "no jump: {seen:?}");
    assert_eq!((seen[15], report.unwrap().health.weights), (70, WeightsState::Fresh));
    let (report, _, health) = run_with(FIXED, &script[..7], None, false, fade);
    assert_eq!(report.unwrap().health.weights, WeightsState::Fading);
    assert!(health.contains("fades to a model: camera unplugged"), "{health}");
    let (report, ..) = run_with(FIXED, &script[..15], None, false, fade);
    assert_eq!(report.unwrap().health.weights, WeightsState::Modelled);
}
