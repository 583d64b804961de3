//! The loop of a post: sky -> weights -> picture -> display, and nothing of it may stop the picture but the display.

use crate::bell::Bell;
use crate::clock::{Moment, PostClock};
use crate::config::{Config, Limits};
use crate::damage::Damage;
use crate::display::{Display, Frame};
use crate::exposure::ExposureControl;
use crate::fading::Fading;
use crate::failure::{Failure, OrFail};
use crate::health::{Health, WeightsState};
use crate::labels::{Labels, News};
use crate::lightlog::LightLog;
use crate::outfile::clear_leftovers;
use crate::painter::Painter;
use crate::relight::{CounterTotals, FrameCounters};
use crate::sky_source::{SkyReading, SkySource};
use crate::sun::{SunPosition, position_of};
use crate::view::gain::ViewGain;
use crate::view::live::ViewSource;
use crate::watchdog::Watchdog;
use crate::weights::PatchWeights;
use behind::Behind;
use latency::Latency;
pub use latency::LatencyParts;
use relume_firmware::field::CameraRecord;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use telling::{PICTURES, Vital};

/// How often the state is written, and shown where it is, when nothing in it changes.
const HEALTH_INTERVAL: Duration = Duration::from_secs(1);

/// What a post did, when it has ended.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PostReport {
    /// Frames shown.
    pub frames: u64,
    /// Frames in which anything was drawn anew.
    pub frames_changed: u64,
    /// Times the exposure changed.
    pub exposure_changes: u64,
    /// Times the sky source failed.
    pub sky_faults: u64,
    /// Why it ended: `frames`, `duration`, `replay ended`, or `told to stop`.
    pub ended: &'static str,
    /// The state at the end.
    pub health: Health,
}

/// The parts a post is made of.
pub struct Parts<'p> {
    /// Where the light comes from.
    pub sky: Box<dyn SkySource + 'p>,
    /// Where a live view comes from; `None` for a still.
    pub view: Option<Box<dyn ViewSource + 'p>>,
    /// Turns weights into the picture.
    pub painter: Box<dyn Painter + 'p>,
    /// Where the picture goes.
    pub display: Box<dyn Display + 'p>,
    /// Which time it is.
    pub clock: PostClock,
}

/// What a post is told while it runs.
#[derive(Clone, Debug, Default)]
pub struct Signals {
    /// End at the next frame.
    pub stop: Arc<AtomicBool>,
    /// Write a screenshot at the next frame.
    pub picture: Arc<AtomicBool>,
}

/// A running post.
pub struct Post<'p> {
    parts: Parts<'p>,
    exposure: ExposureControl,
    limits: Limits,
    labels: Labels,
    shown: Vec<u32>,
    damage: Damage,
    held: SkyReading,
    next: SkyReading,
    /// The held weights in the view's colours, where those are known.
    balanced: PatchWeights,
    /// How the view shows receivers, where that is asked for.
    view_gain: Option<ViewGain>,
    /// Do the weights wait to be relit?
    is_new: bool,
    /// From the last picture of a sky that was relit to its being shown.
    latency: Latency,
    behind: Option<Behind<'p>>,
    light_log: Option<LightLog>,
    fading: Option<Fading>,
    watchdog: Option<Watchdog>,
    held_since_unix_s: Option<f64>,
    weights: WeightsState,
    health_file: PathBuf,
    told: Option<Vital>,
    told_state: String,
    /// Is the state to be told with this frame?
    is_due: bool,
    told_at: Instant,
    last_fault: Option<String>,
    note: Option<String>,
    sky_name: &'static str,
    colour: &'static str,
    /// Does the post's file name the sky camera's response?
    has_response: bool,
    frames: u64,
    frames_changed: u64,
    counters: FrameCounters,
    totals: CounterTotals,
    /// Was the newest light exposed anew?
    is_exposed_anew: bool,
    exposure_changes: u64,
    sky_faults: u64,
}

/// An even sky of radiance 1: what stands in until there is a first measurement.
fn even_sky(patches: usize) -> SkyReading {
    SkyReading { weights: PatchWeights { radiance: vec![[1.0; 3]; patches], sun: None }, ..SkyReading::default() }
}

impl<'p> Post<'p> {
    /// Puts a post together; nothing is shown yet.
    pub fn new(config: &Config, mut parts: Parts<'p>) -> Self {
        Post {
            exposure: ExposureControl::new(config.exposure),
            limits: config.limits,
            labels: Labels::new(config, parts.painter.size()),
            shown: vec![0; parts.painter.size().0 * parts.painter.size().1],
            damage: Damage::whole(parts.painter.size().0, parts.painter.size().1),
            held: even_sky(parts.painter.patch_set().len()),
            next: SkyReading::default(),
            balanced: PatchWeights { radiance: Vec::new(), sun: None },
            view_gain: None,
            is_new: true,
            latency: Latency::default(),
            behind: parts.view.take().map(Behind::new),
            light_log: None,
            fading: None,
            watchdog: None,
            held_since_unix_s: None,
            weights: WeightsState::StandIn,
            health_file: config.health.clone(),
            told: None,
            told_state: String::new(),
            is_due: true,
            told_at: Instant::now(),
            last_fault: None,
            note: None,
            sky_name: config.sky.name(),
            colour: config.camera.colour_state(config.sky),
            has_response: config.camera.response.is_some(),
            frames: 0,
            frames_changed: 0,
            counters: FrameCounters::default(),
            totals: CounterTotals::default(),
            is_exposed_anew: false,
            exposure_changes: 0,
            sky_faults: 0,
            parts,
        }
    }

    /// Shows the installer's labels too: a compass for the view of `camera`, and the state even when it is well.
    pub fn set_up(&mut self, camera: &CameraRecord) {
        self.labels.set_up(camera);
    }

    /// Logs the light of every frame that brings new one.
    pub fn log_light(&mut self, log: LightLog) {
        self.light_log = Some(log);
    }

    /// Lets light that is held for too long fade to a model.
    pub fn fade_by(&mut self, fading: Fading) {
        self.fading = Some(fading);
    }

    /// Tells the service manager that frames are presented.
    pub fn feed(&mut self, watchdog: Watchdog) {
        self.watchdog = Some(watchdog);
    }

    /// Runs until a limit is reached, the sky source has ended, or it is told to stop.
    ///
    /// # Errors
    /// When the display or the painter fails for good; a failing sky only shows in the state.
    pub fn run(mut self, told: &Signals) -> Result<PostReport, Failure> {
        let pictures = PICTURES.map(|name| self.picture_file(name));
        [&self.health_file].into_iter().chain(&pictures).for_each(|file| clear_leftovers(file));
        let first = self.parts.clock.now(0).unix_s;
        let bell = Bell::for_this_thread();
        self.parts.sky.ring(&bell);
        let (ended, moment) = loop {
            let moment = self.parts.clock.now(self.frames);
            if let Some(why) = self.is_over(moment.unix_s - first, &told.stop) {
                break (why, moment);
            }
            let has_ended = self.look(moment);
            if has_ended && self.frames > 0 {
                break ("replay ended", moment);
            }
            self.look_behind();
            self.show(moment)?;
            self.watchdog.iter_mut().for_each(Watchdog::frame);
            self.tell(moment, false);
            if told.picture.swap(false, Ordering::Relaxed) {
                self.take_picture();
            }
            self.parts.clock.wait_or_ring(&told.stop, &bell);
        };
        self.watchdog.iter_mut().for_each(Watchdog::stopping);
        self.parts.sky.stop();
        self.behind.iter_mut().for_each(Behind::stop);
        self.tell(moment, true);
        Ok(PostReport {
            frames: self.frames,
            frames_changed: self.frames_changed,
            exposure_changes: self.exposure_changes,
            sky_faults: self.sky_faults,
            ended,
            health: self.health(moment),
        })
    }

    fn is_over(&self, elapsed_s: f64, stop: &AtomicBool) -> Option<&'static str> {
        if stop.load(Ordering::Relaxed) {
            return Some("told to stop");
        }
        if self.limits.frames.is_some_and(|most| self.frames >= most) {
            return Some("frames");
        }
        self.limits.duration_s.is_some_and(|most| elapsed_s >= most).then_some("duration")
    }

    /// Relights, draws and presents one frame.
    fn show(&mut self, moment: Moment) -> Result<(), Failure> {
        let is_new = std::mem::take(&mut self.is_new);
        let has_news = is_new | self.parts.painter.has_news();
        if has_news || self.behind.as_ref().is_some_and(Behind::is_new) && self.follow_view() {
            self.relight(moment);
        }
        if self.frames > 0 {
            self.damage.clear();
        }
        self.counters = self.parts.painter.draw(&mut self.damage).or_runtime()?;
        self.totals.add(&self.counters, std::mem::take(&mut self.is_exposed_anew));
        let (width, height) = self.parts.painter.size();
        self.copy_damaged(width);
        self.label(moment)?;
        self.frames_changed += u64::from(!self.damage.is_empty());
        let frame = Frame { width, height, pixels_bgrx: &self.shown, number: self.frames, damage: &self.damage };
        let handed_over = Instant::now();
        self.parts.display.present(&frame)?;
        // A display that waited for the frame before knows only now when that was shown.
        self.ask_when_shown();
        if let (true, Some(times)) = (is_new, self.held.times) {
            self.latency.queue_series(self.frames, times, handed_over);
        }
        if let Some(behind) = &mut self.behind {
            behind.queue(self.frames, self.counters.tiles_drawn, handed_over);
        }
        self.ask_when_shown();
        self.frames += 1;
        Ok(())
    }

    /// Asks the display when what was on its way was shown.
    fn ask_when_shown(&mut self) {
        let display = &mut self.parts.display;
        self.latency.ask(|frame| display.when_shown(frame));
        if let Some(behind) = &mut self.behind {
            behind.latency.ask(|frame| display.when_shown(frame));
        }
    }

    /// What was drawn, to the picture shown.
    fn copy_damaged(&mut self, width: usize) {
        let picture = self.parts.painter.pixels_bgrx();
        for (rows, columns) in self.damage.areas() {
            for row in rows {
                let place = row * width + columns.start..row * width + columns.end;
                self.shown[place.clone()].copy_from_slice(&picture[place]);
            }
        }
    }

    /// Draws the labels that have changed, and those over which the picture was copied.
    fn label(&mut self, moment: Moment) -> Result<(), Failure> {
        self.is_due = self.told != Some(self.vital(moment)) || self.told_at.elapsed() >= HEALTH_INTERVAL;
        if self.is_due {
            let held = self.held_since_unix_s.filter(|_| self.weights.is_stale());
            let held_s = held.map(|since| moment.unix_s - since);
            let (state, sun) = (self.state(moment), self.sun());
            self.labels.tell(&News { moment, state: &state, held_s, sun });
        }
        self.labels.draw(self.parts.painter.pixels_bgrx(), &mut self.shown, &mut self.damage).or_runtime()
    }

    /// Where the sun stands that shines in the picture.
    fn sun(&self) -> Option<SunPosition> {
        self.held.weights.sun.map(|sun| position_of(sun.dir_world, self.parts.painter.north_deg()))
    }
}

mod behind;
mod latency;
mod light;
mod telling;
#[cfg(test)]
mod tests;
