//! Cameras for the sky and the view behind one trait: real, replayed, synthetic, and any of them with faults.
//!
//! A camera takes a request for an exposure, which may take effect some frames later, and hands out frames that carry
//! the exposure they were really taken with. A series is gathered by matching frames against that value.

pub mod demosaic;
pub mod fault;
pub mod plausible;
pub mod recording;
pub mod reopen;
pub mod replay;
pub mod series;
pub mod synthetic;
pub mod unpack;
#[cfg(feature = "board")]
pub mod v4l2;

pub use series::take_series;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Stamps further back than this are a recording's, or a clock's that has jumped.
const LONGEST_AGE: Duration = Duration::from_secs(60);

/// Exposure time and gain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Exposure time, seconds.
    pub exposure_s: f64,
    /// Gain; 1 is the sensor's base gain.
    pub gain: f64,
}

impl Exposure {
    /// Exposure time x gain, seconds: what the signal is proportional to.
    pub fn product_s(&self) -> f64 {
        self.exposure_s * self.gain
    }

    /// Whether two exposures are the same within one part in a thousand.
    pub fn same_as(&self, other: &Exposure) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-3 * a.abs().max(b.abs());
        near(self.exposure_s, other.exposure_s) && near(self.gain, other.gain)
    }
}

/// Codes of a picture, RGB interleaved, row 0 at the top.
#[derive(Clone, Debug, PartialEq)]
pub enum Codes {
    /// 0..=255
    U8(Vec<u8>),
    /// 0..=65535
    U16(Vec<u16>),
}

impl Codes {
    /// Number of codes (3 x pixels).
    pub fn len(&self) -> usize {
        match self {
            Codes::U8(codes) => codes.len(),
            Codes::U16(codes) => codes.len(),
        }
    }

    /// Whether there are no codes.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The largest code of the format.
    pub fn max(&self) -> u16 {
        match self {
            Codes::U8(_) => 255,
            Codes::U16(_) => 65535,
        }
    }

    /// One code.
    pub fn get(&self, index: usize) -> u16 {
        match self {
            Codes::U8(codes) => u16::from(codes[index]),
            Codes::U16(codes) => codes[index],
        }
    }
}

/// One picture of a camera. Reused as the buffer of the next one.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height * 3` codes.
    pub codes: Codes,
    /// The exposure the frame was taken with, as read back.
    pub exposure: Exposure,
    /// Counts up with every frame the sensor made; gaps are lost frames.
    pub sequence: u64,
    /// When it was taken, unix seconds.
    pub captured_at_s: f64,
}

impl Default for Frame {
    fn default() -> Self {
        let exposure = Exposure { exposure_s: 0.0, gain: 1.0 };
        Frame { width: 0, height: 0, codes: Codes::U8(Vec::new()), exposure, sequence: 0, captured_at_s: 0.0 }
    }
}

impl Frame {
    /// When it was taken, for frames of the last minute that are stamped with the system's clock.
    pub fn taken(&self) -> Option<Instant> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).ok()?;
        let age = Duration::try_from_secs_f64(now.as_secs_f64() - self.captured_at_s).ok()?;
        Instant::now().checked_sub(age).filter(|_| age < LONGEST_AGE)
    }

    /// Sizes the buffer for 8-bit codes and hands it out; allocates only when the size changed.
    pub fn codes_u8(&mut self, width: usize, height: usize) -> &mut [u8] {
        (self.width, self.height) = (width, height);
        if !matches!(self.codes, Codes::U8(_)) {
            self.codes = Codes::U8(Vec::new());
        }
        match &mut self.codes {
            Codes::U8(codes) => {
                codes.resize(width * height * 3, 0);
                codes
            }
            Codes::U16(_) => &mut [],
        }
    }

    /// Sizes the buffer for 16-bit codes and hands it out; allocates only when the size changed.
    pub fn codes_u16(&mut self, width: usize, height: usize) -> &mut [u16] {
        (self.width, self.height) = (width, height);
        if !matches!(self.codes, Codes::U16(_)) {
            self.codes = Codes::U16(Vec::new());
        }
        match &mut self.codes {
            Codes::U16(codes) => {
                codes.resize(width * height * 3, 0);
                codes
            }
            Codes::U8(_) => &mut [],
        }
    }
}

/// What a camera can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraLimits {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Shortest exposure, seconds.
    pub min_exposure_s: f64,
    /// Longest exposure, seconds.
    pub max_exposure_s: f64,
    /// Exposure times are multiples of this, seconds; 0 if any value goes.
    pub exposure_step_s: f64,
    /// Largest gain; the smallest is 1.
    pub max_gain: f64,
    /// A request shows after at most this many frames.
    pub delay_frames: u32,
}

impl CameraLimits {
    /// A camera of `size` = width and height that sets its exposure itself.
    pub fn nothing_to_set((width, height): (usize, usize)) -> Self {
        CameraLimits {
            width,
            height,
            min_exposure_s: 0.0,
            max_exposure_s: 0.0,
            exposure_step_s: 0.0,
            max_gain: 1.0,
            delay_frames: 0,
        }
    }

    /// The exposure a camera with these limits takes when asked for another.
    pub fn nearest(&self, wanted: Exposure) -> Exposure {
        let clamped = wanted.exposure_s.clamp(self.min_exposure_s, self.max_exposure_s);
        let step = self.exposure_step_s;
        let stepped = if step > 0.0 { (clamped / step).round().max(1.0) * step } else { clamped };
        Exposure { exposure_s: stepped, gain: wanted.gain.clamp(1.0, self.max_gain) }
    }
}

/// Why a camera gave no frame; one line.
#[derive(Debug, thiserror::Error)]
pub enum CameraError {
    /// No frame or answer came in time; the next one may.
    #[error("the camera did not answer in time")]
    Timeout,
    /// The camera is gone; open it again.
    #[error("the camera is gone")]
    Lost,
    /// Another program holds the camera.
    #[error("{path} is in use by another program: stop that one, or name another camera")]
    Busy {
        /// Device node.
        path: String,
    },
    /// The device refused something; trying again may help.
    #[error("{path}: {what}")]
    Device {
        /// Device node, or what the post's file calls it.
        path: String,
        /// What was refused and why.
        what: String,
    },
    /// Frames come, but they are no pictures of a sky.
    #[error("the camera's pictures are {0}")]
    Implausible(plausible::PictureFault),
    /// A recording has no more frames.
    #[error("the recording has no more frames")]
    Ended,
    /// No frame with a requested exposure came.
    #[error("no frame of {} s at gain {} came within {frames} frames", exposure.exposure_s, exposure.gain)]
    NoSuchExposure {
        /// What was asked for.
        exposure: Exposure,
        /// Frames waited for.
        frames: u32,
    },
    /// A recording cannot be read.
    #[error("{name}: {what}")]
    Recording {
        /// File name.
        name: String,
        /// What is wrong and where.
        what: String,
    },
}

/// A sky camera.
pub trait Camera: Send {
    /// What the camera can do.
    fn limits(&self) -> CameraLimits;

    /// Asks for an exposure from the next possible frame on; returns the one the camera took.
    ///
    /// # Errors
    /// [`CameraError`] when the camera does not answer.
    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError>;

    /// The next frame, into a buffer that is reused.
    ///
    /// # Errors
    /// [`CameraError::Timeout`] where a later frame may come, another where none will.
    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError>;

    /// Frames for which the newest request must stand before another may be written, so that one of them is sure to have
    /// it: 1 where a request always shows after the same number of frames.
    fn stand_frames(&self) -> u32 {
        1
    }
}

impl<C: Camera + ?Sized> Camera for Box<C> {
    fn limits(&self) -> CameraLimits {
        (**self).limits()
    }

    fn request(&mut self, exposure: Exposure) -> Result<Exposure, CameraError> {
        (**self).request(exposure)
    }

    fn frame(&mut self, into: &mut Frame) -> Result<(), CameraError> {
        (**self).frame(into)
    }

    fn stand_frames(&self) -> u32 {
        (**self).stand_frames()
    }
}
