//! Cameras that the kernel shows as V4L2 nodes: USB cameras and raw sensors, one plane per picture.
//!
//! Nothing here waits longer than the frame's timeout and two exposures. Errors sort into what a later call may cure
//! ([`CameraError::Timeout`], [`CameraError::Device`]) and what only opening again does ([`CameraError::Lost`]).

pub(crate) mod asked;
mod controls;
mod delay;
mod formats;
mod ioctl;
pub(crate) mod node;
mod stream;

use super::unpack::{Layout, UnpackError, Unpacker};
use super::{Camera, CameraError, CameraLimits, Exposure, Frame};
pub use controls::GainModel;
use controls::{ControlFault, DeviceControls, Manual, Wishes};
use delay::{Awaited, Stepped, Timeline, mean_share};
pub use delay::{Delay, UNKNOWN_EXPOSURE};
use formats::Agreed;
use node::Node;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
pub use stream::StreamCounters;
use stream::{Stream, Taken};

/// Timeouts in a row after which the stream is started anew: stalled cameras often come back by that.
const TIMEOUTS_UNTIL_LOST: u32 = 5;
/// Bad pictures in a row after which the format is looked at.
const DAMAGED_UNTIL_CHECK: u32 = 3;

/// Pause after a control was refused.
const REFUSED_PAUSE: Duration = Duration::from_millis(30);

/// Which camera, and how it is used.
#[derive(Clone, Debug, PartialEq)]
pub struct V4l2Settings {
    /// A path such as `/dev/video0`, or the beginning of the camera's name as the kernel lists it.
    pub device: String,
    /// The node that has the controls, where it is another: a sensor's `/dev/v4l-subdev0`.
    pub controls: Option<String>,
    /// Width and height; without, the largest that is not more than enough.
    pub size: Option<[u32; 2]>,
    /// Width and height to come near to, where no size is asked for.
    pub near_size: Option<[u32; 2]>,
    /// Pixel format; without, the one that measures light best.
    pub fourcc: Option<[u8; 4]>,
    /// How long a frame may take besides its exposure.
    pub frame_timeout: Duration,
    /// True for the sky: exposure, gain and white balance are ours. False for the view: the camera's.
    pub manual: bool,
    /// Longest exposure to use, seconds.
    pub max_exposure_s: f64,
    /// What the gain's codes mean. Without, known sensors have theirs and others stay at their least gain.
    pub gain: Option<GainModel>,
    /// Colour temperature that counts as white, kelvin.
    pub white_balance_k: u32,
    /// The delay from setting to effect, if it was measured before.
    pub delay: Option<Delay>,
}

impl Default for V4l2Settings {
    fn default() -> Self {
        V4l2Settings {
            device: "/dev/video0".into(),
            controls: None,
            size: None,
            near_size: None,
            fourcc: None,
            frame_timeout: Duration::from_secs(1),
            manual: true,
            max_exposure_s: 0.5,
            gain: None,
            white_balance_k: 5500,
            delay: None,
        }
    }
}

/// A camera that streams.
pub struct V4l2Camera {
    // Stops before the node is closed.
    stream: Stream,
    node: Node,
    controls_node: Node,
    controls: DeviceControls,
    manual: Manual,
    agreed: Agreed,
    unpacker: Unpacker,
    timeline: Timeline,
    awaited: Awaited,
    frame_timeout: Duration,
    timeouts: u32,
    damaged: u32,
}

impl V4l2Camera {
    /// Opens a camera, agrees on a format, takes the controls over, starts the stream. The delay is the settings', or a
    /// guess on the safe side until [`V4l2Camera::measure_delay`].
    ///
    /// # Errors
    /// [`CameraError::Lost`] when it is not there, [`CameraError::Busy`] when another program has it,
    /// [`CameraError::Device`] when it refuses something, [`CameraError::Timeout`] when its controls hang.
    pub fn open(settings: &V4l2Settings) -> Result<Self, CameraError> {
        let node = Node::open(&settings.device)?;
        node.check_captures()?;
        let agreed = formats::agree(&node, settings)?;
        let unpacker = Unpacker::new(agreed.layout).map_err(|error| node.refused(error.to_string()))?;
        let controls_node = settings.controls.as_deref().map_or_else(|| Ok(node.clone()), Node::open_controls)?;
        let mut controls = DeviceControls(Arc::clone(&controls_node.file));
        let manual = if settings.manual {
            let wishes = wishes(settings, &agreed, &controls_node);
            Manual::take_over(&mut controls, &wishes).map_err(|fault| control_fault(&controls_node, &fault))?
        } else {
            Manual::untouched(agreed.interval_s)
        };
        ioctl::subscribe_source_changes(&node.file);
        let stream = Stream::start(&node, agreed.layout.needed_bytes())?;
        let standing = manual.fixed().unwrap_or(UNKNOWN_EXPOSURE);
        Ok(V4l2Camera {
            stream,
            node,
            controls_node,
            controls,
            manual,
            agreed,
            unpacker,
            timeline: Timeline::new(settings.delay.unwrap_or_default(), standing),
            awaited: Awaited::default(),
            frame_timeout: settings.frame_timeout,
            timeouts: 0,
            damaged: 0,
        })
    }

    /// A function that opens the camera again and again, and measures its delay as long as the light has not allowed it.
    pub fn opener(settings: V4l2Settings) -> impl FnMut() -> Result<Self, CameraError> + Send {
        let known = settings.delay;
        let open = move |delay| Self::open(&V4l2Settings { delay, ..settings.clone() });
        delay::measuring(known, open, Self::measure_delay)
    }

    /// Measures the delay from setting to effect and uses it from now on; takes one to three seconds and leaves another
    /// exposure standing. Where the light shows no difference (dark, or all white), [`Delay::measured`] is false.
    ///
    /// # Errors
    /// [`CameraError`] when frames or controls fail.
    pub fn measure_delay(&mut self) -> Result<Delay, CameraError> {
        if self.manual.fixed().is_some() {
            self.timeline.delay = Delay { unchanged_frames: 0, settled_frames: 1, measured: false };
            return Ok(self.timeline.delay);
        }
        let delay = delay::measure(&mut Stepping { camera: self, frame: Frame::default() })?;
        self.timeline.delay = delay;
        Ok(delay)
    }

    /// Device node.
    pub fn path(&self) -> &str {
        &self.node.path
    }

    /// Pixel format.
    pub fn fourcc(&self) -> [u8; 4] {
        self.agreed.fourcc
    }

    /// The picture as the driver gives it.
    pub fn layout(&self) -> &Layout {
        &self.agreed.layout
    }

    /// Time from frame to frame that the driver tells, seconds.
    pub fn interval_s(&self) -> Option<f64> {
        self.agreed.interval_s
    }

    /// Least and most frames a second that it offers with its format and size, where it tells.
    pub fn rates_hz(&self) -> Option<[f64; 2]> {
        let Layout { width, height, .. } = self.agreed.layout;
        formats::rates_hz(&self.node, self.agreed.fourcc, [width as u32, height as u32])
    }

    /// What exposure and gain can be set to and what the white balance reads, for a person.
    pub fn controls_told(&self) -> Vec<String> {
        self.manual.told()
    }

    /// The delay from setting to effect in use.
    pub fn delay(&self) -> Delay {
        self.timeline.delay
    }

    /// What could not be set, for a person.
    pub fn notes(&self) -> &[String] {
        &self.manual.notes
    }

    /// What became of the frames.
    pub fn counters(&self) -> StreamCounters {
        self.stream.counters
    }

    /// Throws away what is ready; the number of the newest complete frame.
    fn drain(&mut self) -> Result<i64, CameraError> {
        let timeline = &mut self.timeline;
        self.stream.drain(&mut |sequence| timeline.saw(sequence))?;
        Ok(self.timeline.newest())
    }

    /// Sets an exposure; what the camera took, and the newest frames complete before and after.
    fn apply(&mut self, exposure: Exposure) -> Result<(Exposure, [i64; 2]), CameraError> {
        let before = self.drain()?;
        let set = self.manual.set(&mut self.controls, exposure);
        let after = self.drain()?;
        match set {
            Ok(accepted) => {
                self.timeline.requested(accepted, before);
                Ok((accepted, [before, after]))
            }
            Err(fault) => {
                self.timeline.requested(UNKNOWN_EXPOSURE, before);
                // A caller that tries again at once must not spin.
                std::thread::sleep(REFUSED_PAUSE);
                Err(control_fault(&self.controls_node, &fault))
            }
        }
    }

    /// A picture, unpacked; bad ones are passed over.
    fn take(&mut self, newest: bool, into: &mut Frame) -> Result<(), CameraError> {
        let exposures = Duration::try_from_secs_f64(2.0 * self.timeline.longest_s()).unwrap_or_default();
        let deadline = Instant::now() + self.frame_timeout + exposures;
        loop {
            let timeline = &mut self.timeline;
            let taken = match self.stream.take(deadline, newest, &mut |sequence| timeline.saw(sequence)) {
                Err(CameraError::Timeout) => return Err(self.late()),
                other => other?,
            };
            let unpacked = self.unpacker.unpack(self.stream.bytes(&taken), into);
            self.stream.give_back(taken.index);
            match unpacked {
                Ok(()) => {
                    (self.timeouts, self.damaged) = (0, 0);
                    self.sign(&taken, into);
                    return Ok(());
                }
                // The format has changed under us.
                Err(UnpackError::Size { .. }) => return Err(CameraError::Lost),
                Err(_) => self.pass_over()?,
            }
            if Instant::now() >= deadline {
                return Err(self.late());
            }
        }
    }

    fn sign(&mut self, taken: &Taken, into: &mut Frame) {
        into.sequence = taken.sequence;
        into.captured_at_s = taken.monotonic_s + stream::unix_offset_s();
        let mean = mean_share(into);
        into.exposure = self.timeline.exposure_of(taken.sequence, mean);
        self.awaited.saw(into.exposure, mean);
    }

    fn pass_over(&mut self) -> Result<(), CameraError> {
        self.stream.counters.damaged += 1;
        self.stream.counters.delivered -= 1;
        self.damaged += 1;
        if self.damaged.is_multiple_of(DAMAGED_UNTIL_CHECK) && !formats::still_stands(&self.node, &self.agreed) {
            return Err(CameraError::Lost);
        }
        Ok(())
    }

    fn late(&mut self) -> CameraError {
        self.timeouts += 1;
        let stands = self.timeouts < TIMEOUTS_UNTIL_LOST && formats::still_stands(&self.node, &self.agreed);
        if stands { CameraError::Timeout } else { CameraError::Lost }
    }
}

impl Camera for V4l2Camera {
    fn stand_frames(&self) -> u32 {
        if self.manual.fixed().is_some() { 1 } else { self.timeline.stand_frames() }
    }

    fn limits(&self) -> CameraLimits {
        let (width, height) = self.agreed.layout.output_size();
        let (min_exposure_s, max_exposure_s, exposure_step_s) = self.manual.times_s();
        let is_fixed = self.manual.fixed().is_some();
        let delay_frames = if is_fixed { 0 } else { self.timeline.delay.settled_frames + delay::MOST_HELD };
        let max_gain = self.manual.max_gain();
        CameraLimits { width, height, min_exposure_s, max_exposure_s, exposure_step_s, max_gain, delay_frames }
    }

    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        if self.manual.fixed().is_none() && self.awaited.take_turn(self.timeline.delay, Instant::now()) {
            self.measure_delay()?;
        }
        self.apply(exposure).map(|(accepted, _)| accepted)
    }

    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
        self.take(true, into)
    }
}

fn wishes(settings: &V4l2Settings, agreed: &Agreed, controls: &Node) -> Wishes {
    let sensor = || {
        // A link, such as one of /dev/v4l/by-path, has another name than the node has in /sys.
        let path = std::fs::canonicalize(&controls.path).ok()?;
        let listed = Path::new(node::CLASS).join(path.file_name()?);
        GainModel::of_sensor(&node::name(&listed))
    };
    Wishes {
        size: (agreed.layout.width, agreed.layout.height),
        interval_s: agreed.interval_s,
        max_exposure_s: settings.max_exposure_s,
        gain: settings.gain.or_else(sensor),
        white_balance_k: i64::from(settings.white_balance_k),
    }
}

fn control_fault(node: &Node, fault: &ControlFault) -> CameraError {
    node.fault(fault.what, &fault.error)
}

/// A camera while its delay is measured.
struct Stepping<'a> {
    camera: &'a mut V4l2Camera,
    frame: Frame,
}

impl Stepped for Stepping<'_> {
    fn limits(&self) -> CameraLimits {
        self.camera.limits()
    }

    fn pause(&mut self, share: f64) {
        let interval_s = self.camera.agreed.interval_s.unwrap_or(1.0 / 30.0);
        std::thread::sleep(Duration::try_from_secs_f64(share * interval_s.min(0.2)).unwrap_or_default());
    }

    fn set(&mut self, exposure: Exposure) -> Result<[i64; 2], CameraError> {
        self.camera.apply(exposure).map(|(_, frames)| frames)
    }

    fn next(&mut self) -> Result<(u64, f64), CameraError> {
        self.camera.take(false, &mut self.frame)?;
        Ok((self.frame.sequence, mean_share(&self.frame)))
    }
}
