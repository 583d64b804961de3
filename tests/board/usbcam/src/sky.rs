//! The sky over the sensor: the synthetic camera's, seen anew as its time of day goes on, by a thread of its own.

use crate::codes::{UNSEEN, step};
use crate::offer::FrameSize;
use relume::camera::synthetic::{SyntheticCamera, SyntheticSettings};
use std::ops::Range;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Simulated time that changes nothing one could see, seconds.
const STILL_S: f64 = 0.1;

/// The time of day at the sensor: simulated seconds go by `speed` times as fast as real ones.
#[derive(Clone, Copy, Debug)]
pub struct SkyClock {
    unix_s: f64,
    at: Instant,
    speed: f64,
}

impl SkyClock {
    /// A clock that starts now at a time, unix seconds.
    pub fn new(unix_s: f64, speed: f64) -> Self {
        SkyClock { unix_s, at: Instant::now(), speed }
    }

    /// The time, unix seconds.
    pub fn now_unix_s(&self) -> f64 {
        self.unix_s + self.at.elapsed().as_secs_f64() * self.speed
    }

    /// Simulated seconds per real second.
    pub fn speed(&self) -> f64 {
        self.speed
    }
}

/// Radiance steps of a picture of the sky.
#[derive(Clone, Debug)]
pub struct SkyPicture {
    /// Time of day, unix seconds.
    pub unix_s: f64,
    /// Size, pixels.
    pub size: FrameSize,
    /// Radiance steps, RGB, row by row; [`UNSEEN`] where the lens images nothing.
    pub steps: Vec<[u16; 3]>,
    /// Per row the columns with something to see, from and to even ones.
    pub spans: Vec<Range<usize>>,
}

/// Shared with the thread that looks at the sky.
struct Shown {
    clock: SkyClock,
    size: FrameSize,
    /// Whether anybody looks at pictures now.
    wanted: bool,
    over: bool,
    picture: Arc<SkyPicture>,
    look_time: Duration,
}

/// The sky as it is now. Clones are the same sky.
#[derive(Clone)]
pub struct Sky {
    shared: Arc<(Mutex<Shown>, Condvar)>,
}

impl Sky {
    /// A sky that is looked at every `interval` of real time while pictures are [`Self::want`]ed.
    pub fn start(settings: SyntheticSettings, speed: f64, interval: Duration) -> Self {
        let size = FrameSize { width: settings.width as u16, height: settings.height as u16 };
        let mut looker = Looker::new(settings.clone());
        let shown = Shown {
            clock: SkyClock::new(settings.start_unix_s, speed),
            size,
            wanted: false,
            over: false,
            picture: Arc::new(looker.look(settings.start_unix_s, size)),
            look_time: Duration::ZERO,
        };
        let sky = Sky { shared: Arc::new((Mutex::new(shown), Condvar::new())) };
        let own = sky.clone();
        std::thread::spawn(move || own.look_on(looker, interval));
        sky
    }

    fn lock(&self) -> MutexGuard<'_, Shown> {
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn look_on(&self, mut looker: Looker, interval: Duration) {
        loop {
            let (unix_s, size) = {
                let mut shown = self.lock();
                while !shown.over && !shown.needs_a_look() {
                    let waited = self.shared.1.wait_timeout(shown, interval.max(Duration::from_millis(1)));
                    shown = waited.unwrap_or_else(PoisonError::into_inner).0;
                }
                if shown.over {
                    return;
                }
                (shown.clock.now_unix_s(), shown.size)
            };
            let begun = Instant::now();
            let picture = Arc::new(looker.look(unix_s, size));
            let mut shown = self.lock();
            (shown.picture, shown.look_time) = (picture, begun.elapsed());
            drop(shown);
            self.shared.1.notify_all();
            std::thread::sleep(interval.saturating_sub(begun.elapsed()));
        }
    }

    /// Begins (with the size of pictures) or ends looking.
    pub fn want(&self, size: Option<FrameSize>) {
        let mut shown = self.lock();
        shown.wanted = size.is_some();
        shown.size = size.unwrap_or(shown.size);
        self.shared.1.notify_all();
    }

    /// The newest picture.
    pub fn picture(&self) -> Arc<SkyPicture> {
        Arc::clone(&self.lock().picture)
    }

    /// A picture of a size, at most `age_s` simulated seconds old; waits for it for `patience`, then takes what is there.
    pub fn fresh(&self, size: FrameSize, age_s: f64, patience: Duration) -> Arc<SkyPicture> {
        let asked = Instant::now();
        let mut shown = self.lock();
        loop {
            let age = (shown.clock.now_unix_s() - shown.picture.unix_s).abs();
            let left = patience.saturating_sub(asked.elapsed());
            if (shown.picture.size == size && age <= age_s) || left.is_zero() {
                return Arc::clone(&shown.picture);
            }
            shown = self.shared.1.wait_timeout(shown, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// How long the last look took.
    pub fn look_time(&self) -> Duration {
        self.lock().look_time
    }

    /// The clock.
    pub fn clock(&self) -> SkyClock {
        self.lock().clock
    }

    /// Sets the clock.
    pub fn set_clock(&self, unix_s: f64, speed: f64) {
        self.lock().clock = SkyClock::new(unix_s, speed);
        self.shared.1.notify_all();
    }

    /// Ends the thread.
    pub fn end(&self) {
        self.lock().over = true;
        self.shared.1.notify_all();
    }
}

impl Shown {
    fn needs_a_look(&self) -> bool {
        let old = (self.clock.now_unix_s() - self.picture.unix_s).abs() >= STILL_S;
        self.wanted && (old || self.size != self.picture.size)
    }
}

/// Looks at the sky through the synthetic camera's lens.
pub struct Looker {
    camera: SyntheticCamera,
    sensor: FrameSize,
    full: Vec<[u16; 3]>,
}

impl Looker {
    /// A looker at a sensor's size.
    pub fn new(settings: SyntheticSettings) -> Self {
        let sensor = FrameSize { width: settings.width as u16, height: settings.height as u16 };
        Looker { camera: SyntheticCamera::new(settings), sensor, full: vec![[UNSEEN; 3]; sensor.pixels()] }
    }

    /// The sky at a time (unix seconds) as a picture of a size: the sensor's pixels, thinned out or repeated, in the middle.
    pub fn look(&mut self, unix_s: f64, size: FrameSize) -> SkyPicture {
        self.camera.see(unix_s);
        for (index, radiance) in self.camera.seen() {
            self.full[index] = radiance.map(step);
        }
        let steps = if size == self.sensor { self.full.clone() } else { self.resized(size) };
        let spans = steps.chunks_exact(usize::from(size.width)).map(span).collect();
        SkyPicture { unix_s, size, steps, spans }
    }

    fn resized(&self, size: FrameSize) -> Vec<[u16; 3]> {
        let (width, height) = (i64::from(size.width), i64::from(size.height));
        let (own_width, own_height) = (i64::from(self.sensor.width), i64::from(self.sensor.height));
        // Sensor pixels per picture pixel, as a fraction of the side that fits.
        let (over, under) =
            if width * own_height < height * own_width { (own_width, width) } else { (own_height, height) };
        let from = |at: i64, side: i64, own: i64| ((2 * at + 1 - side) * over).div_euclid(2 * under) + own / 2;
        let mut steps = Vec::with_capacity(size.pixels());
        for row in 0..height {
            let own_row = from(row, height, own_height);
            for col in 0..width {
                let own_col = from(col, width, own_width);
                let inside = (0..own_height).contains(&own_row) && (0..own_width).contains(&own_col);
                steps.push(if inside { self.full[(own_row * own_width + own_col) as usize] } else { [UNSEEN; 3] });
            }
        }
        steps
    }
}

fn span(row: &[[u16; 3]]) -> Range<usize> {
    let seen = |pixel: &[u16; 3]| pixel[0] != UNSEEN;
    let first = row.iter().position(seen).unwrap_or(0);
    let end = row.iter().rposition(seen).map_or(first, |last| last + 1);
    first / 2 * 2..end.div_ceil(2) * 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codes::radiance;

    fn settings() -> SyntheticSettings {
        SyntheticSettings { width: 64, height: 64, sky_rows: 32, ..SyntheticSettings::default() }
    }

    #[test]
    fn the_picture_is_the_synthetic_cameras_truth() {
        let mut looker = Looker::new(settings());
        let size = "64x64".parse().unwrap();
        let unix_s = settings().start_unix_s + 3600.0;
        let picture = looker.look(unix_s, size);
        let mut camera = SyntheticCamera::new(SyntheticSettings { start_unix_s: unix_s, ..settings() });
        relume::camera::Camera::frame(&mut camera, &mut relume::camera::Frame::default()).unwrap();
        let mut seen = 0;
        for (steps, truth) in picture.steps.iter().zip(camera.truth()) {
            for (step, truth) in steps.iter().zip(truth) {
                let found = if *step == UNSEEN { 0.0 } else { radiance(*step) };
                assert!((found - truth).abs() <= 0.0025 * truth, "{found} {truth}");
                seen += usize::from(truth > 0.0);
            }
        }
        assert!(seen > 3 * 3000, "{seen}");
        assert!(picture.spans[32] == (0..64) && picture.spans[0].len() < 30, "{:?}", picture.spans);
    }

    #[test]
    fn other_sizes_show_the_same_sky_in_the_middle() {
        let mut looker = Looker::new(settings());
        let full = looker.look(settings().start_unix_s, "64x64".parse().unwrap());
        let half = looker.look(settings().start_unix_s, "32x32".parse().unwrap());
        let wide = looker.look(settings().start_unix_s, "96x64".parse().unwrap());
        for (row, col) in [(3, 16), (16, 16), (20, 7)] {
            let original = full.steps[(2 * row + 1) * 64 + 2 * col + 1];
            assert_eq!(half.steps[row * 32 + col], original);
            assert_eq!(wide.steps[(2 * row + 1) * 96 + 16 + 2 * col + 1], original);
        }
        assert_eq!(wide.steps[32 * 96 + 10], [UNSEEN; 3]);
    }

    #[test]
    fn the_sky_goes_on_only_while_somebody_looks() {
        let sky = Sky::start(settings(), 36_000.0, Duration::from_millis(5));
        let first = sky.picture().unix_s;
        std::thread::sleep(Duration::from_millis(60));
        assert_eq!(sky.picture().unix_s, first);
        let half = "32x32".parse().unwrap();
        sky.want(Some(half));
        let later = sky.fresh(half, f64::INFINITY, Duration::from_secs(10));
        assert!(later.size == half && later.unix_s > first + 600.0, "{} {first}", later.unix_s);
        sky.end();
    }
}
