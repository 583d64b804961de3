//! Manual exposure, gain and white balance through whatever controls a device has.
//!
//! Order matters: automatics off first, values after, or drivers refuse them (EACCES) or ignore them. Every value is read
//! back, as drivers round and clamp.

mod device;
mod gain;
mod told;

use super::node::{Errno, errno};
use crate::camera::Exposure;
pub(super) use device::DeviceControls;
pub use gain::GainModel;
use std::io;
pub(super) use told::{listed, short};

/// Control numbers, from linux/v4l2-controls.h.
pub(super) mod id {
    pub const AUTO_WHITE_BALANCE: u32 = 0x0098_090c;
    pub const RED_BALANCE: u32 = 0x0098_090e;
    pub const BLUE_BALANCE: u32 = 0x0098_090f;
    pub const EXPOSURE_LINES: u32 = 0x0098_0911;
    pub const AUTO_GAIN: u32 = 0x0098_0912;
    pub const GAIN: u32 = 0x0098_0913;
    pub const POWER_LINE_FREQUENCY: u32 = 0x0098_0918;
    pub const WHITE_BALANCE_TEMPERATURE: u32 = 0x0098_091a;
    pub const BACKLIGHT_COMPENSATION: u32 = 0x0098_091c;
    pub const EXPOSURE_AUTO: u32 = 0x009a_0901;
    pub const EXPOSURE_ABSOLUTE: u32 = 0x009a_0902;
    pub const EXPOSURE_AUTO_PRIORITY: u32 = 0x009a_0903;
    pub const WIDE_DYNAMIC_RANGE: u32 = 0x009a_0915;
    pub const VBLANK: u32 = 0x009e_0901;
    pub const HBLANK: u32 = 0x009e_0902;
    pub const ANALOGUE_GAIN: u32 = 0x009e_0903;
    pub const PIXEL_RATE: u32 = 0x009f_0902;
    pub const DIGITAL_GAIN: u32 = 0x009f_0905;
}

/// Values of `EXPOSURE_AUTO` with which the exposure time is ours: manual, and priority for the time.
const MANUAL_MODES: [i64; 2] = [1, 2];
/// Unit of `EXPOSURE_ABSOLUTE`, seconds.
const ABSOLUTE_UNIT_S: f64 = 1e-4;
/// Time between frames where the driver tells none, seconds.
const USUAL_INTERVAL_S: f64 = 1.0 / 30.0;

/// What a control takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ControlRange {
    pub min: i64,
    pub max: i64,
    pub step: i64,
    pub default: i64,
    /// False for what is only told.
    pub writable: bool,
}

/// A device's controls, by number. A control that is not there gives EINVAL.
pub(super) trait Controls {
    fn query(&self, id: u32) -> io::Result<ControlRange>;
    /// Whether a menu has this entry.
    fn offers(&self, id: u32, entry: i64) -> bool;
    fn get(&self, id: u32) -> io::Result<i64>;
    fn set(&mut self, id: u32, value: i64) -> io::Result<()>;
}

/// A control that failed.
#[derive(Debug)]
pub(super) struct ControlFault {
    pub what: &'static str,
    pub error: io::Error,
}

fn failing(what: &'static str) -> impl Fn(io::Error) -> ControlFault {
    move |error| ControlFault { what, error }
}

/// What is wished of the controls, and what must be known to set them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Wishes {
    /// Samples per row and rows of the picture.
    pub size: (usize, usize),
    /// Time from frame to frame, seconds.
    pub interval_s: Option<f64>,
    /// Longest exposure, seconds.
    pub max_exposure_s: f64,
    /// What the gain's codes mean; unknown, the gain stays at its least.
    pub gain: Option<GainModel>,
    /// Colour temperature that is white, kelvin.
    pub white_balance_k: i64,
}

/// Vertical blanking: what a sensor's rows wait for, and what bounds their exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Blanking {
    height: i64,
    /// Lines of a frame that an exposure cannot take.
    margin: i64,
    usual: i64,
    max: i64,
    now: i64,
}

impl Blanking {
    fn for_exposure(&self, lines: i64) -> i64 {
        (lines + self.margin - self.height).clamp(self.usual, self.max.max(self.usual))
    }
}

/// How exposure times are set.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Times {
    id: u32,
    unit_s: f64,
    min: i64,
    max: i64,
    step: i64,
    blanking: Option<Blanking>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Gains {
    id: u32,
    range: ControlRange,
    model: GainModel,
}

/// The controls in our hands.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Manual {
    times: Option<Times>,
    gains: Option<Gains>,
    nominal_s: f64,
    /// There is a gain control, and nobody knows what its codes mean.
    is_gain_unknown: bool,
    /// What the white balance's controls read since they were set: name, value, unit.
    white: Vec<(&'static str, i64, &'static str)>,
    /// What could not be done, for a person.
    pub notes: Vec<String>,
}

impl Manual {
    /// Leaves everything as it is: pictures for the eye are exposed by the camera.
    pub(super) fn untouched(interval_s: Option<f64>) -> Self {
        let nominal_s = interval_s.unwrap_or(USUAL_INTERVAL_S);
        Manual { times: None, gains: None, nominal_s, is_gain_unknown: false, white: Vec::new(), notes: Vec::new() }
    }

    /// Turns automatics off and finds out what can be set.
    ///
    /// # Errors
    /// A control that is there and yet does not answer.
    pub(super) fn take_over(controls: &mut impl Controls, wishes: &Wishes) -> Result<Self, ControlFault> {
        let mut manual = Manual::untouched(wishes.interval_s);
        let ours = manual.automatics_off(controls)?;
        manual.fix_colours(controls, wishes)?;
        manual.times = if ours { manual.find_times(controls, wishes) } else { None };
        if manual.times.is_none() {
            manual.notes.push(format!("no exposure control: every frame counts as exposed for {} s", manual.nominal_s));
        }
        manual.take_gain(controls, wishes)?;
        Ok(manual)
    }

    /// The exposure of every frame where nothing can be set.
    pub(super) fn fixed(&self) -> Option<Exposure> {
        let is_fixed = self.times.is_none() && self.gains.is_none();
        is_fixed.then_some(Exposure { exposure_s: self.nominal_s, gain: 1.0 })
    }

    /// Shortest and longest exposure and their step, seconds.
    pub(super) fn times_s(&self) -> (f64, f64, f64) {
        let of = |t: &Times| (t.min as f64 * t.unit_s, t.max as f64 * t.unit_s, t.step as f64 * t.unit_s);
        self.times.as_ref().map_or((self.nominal_s, self.nominal_s, 0.0), of)
    }

    /// Largest gain; the smallest is 1.
    pub(super) fn max_gain(&self) -> f64 {
        self.gains.map_or(1.0, |gains| gains.model.gain(&gains.range, gains.range.max))
    }

    /// Sets exposure and gain; returns what the device then says it has.
    ///
    /// # Errors
    /// The control that failed; what then stands is not known.
    pub(super) fn set(&mut self, controls: &mut impl Controls, wanted: Exposure) -> Result<Exposure, ControlFault> {
        let exposure_s = match self.times {
            None => self.nominal_s,
            Some(_) => self.set_time(controls, wanted.exposure_s)?,
        };
        let Some(gains) = self.gains else { return Ok(Exposure { exposure_s, gain: 1.0 }) };
        let what = "gain cannot be set";
        let code = gains.model.code(&gains.range, wanted.gain);
        controls.set(gains.id, code).map_err(failing(what))?;
        let code = controls.get(gains.id).map_err(failing(what))?;
        Ok(Exposure { exposure_s, gain: gains.model.gain(&gains.range, code) })
    }

    fn set_time(&mut self, controls: &mut impl Controls, wanted_s: f64) -> Result<f64, ControlFault> {
        let Some(mut times) = self.times else { return Ok(self.nominal_s) };
        let what = "exposure cannot be set";
        let steps = (wanted_s / times.unit_s / times.step as f64).round() as i64;
        let code = steps.saturating_mul(times.step).clamp(times.min, times.max);
        let before = times.blanking.map_or(0, |blanking| blanking.now);
        let after = times.blanking.map_or(0, |blanking| blanking.for_exposure(code));
        // A frame must have room for an exposure before it comes, and may shrink only after a long one has gone.
        if after > before {
            controls.set(id::VBLANK, after).map_err(failing(what))?;
        }
        match controls.set(times.id, code) {
            // A camera that fell back to automatic by itself says so by one of several errors, by kernel version.
            Err(error) if !is_fatal(&error) => {
                self.automatics_off(controls)?;
                controls.set(times.id, code)
            }
            other => other,
        }
        .map_err(failing(what))?;
        if after < before {
            controls.set(id::VBLANK, after).map_err(failing(what))?;
        }
        if let Some(blanking) = &mut times.blanking {
            blanking.now = after;
        }
        self.times = Some(times);
        Ok(controls.get(times.id).map_err(failing(what))? as f64 * times.unit_s)
    }

    /// False when the exposure cannot be had.
    fn automatics_off(&mut self, controls: &mut impl Controls) -> Result<bool, ControlFault> {
        let what = "automatic exposure cannot be turned off";
        let mut ours = true;
        if present(controls, id::EXPOSURE_AUTO, what)?.is_some() {
            let mode = MANUAL_MODES.into_iter().find(|&mode| controls.offers(id::EXPOSURE_AUTO, mode));
            ours = mode.is_some();
            if let Some(mode) = mode {
                controls.set(id::EXPOSURE_AUTO, mode).map_err(failing(what))?;
            }
        }
        self.lesser(controls, id::AUTO_GAIN, 0, "automatic gain cannot be turned off")?;
        self.lesser(controls, id::EXPOSURE_AUTO_PRIORITY, 0, "the frame rate cannot be kept from following the light")?;
        self.lesser(controls, id::AUTO_WHITE_BALANCE, 0, "automatic white balance cannot be turned off")?;
        Ok(ours)
    }

    fn fix_colours(&mut self, controls: &mut impl Controls, wishes: &Wishes) -> Result<(), ControlFault> {
        // Both change the exposure behind our back.
        self.lesser(controls, id::POWER_LINE_FREQUENCY, 0, "the flicker filter cannot be turned off")?;
        self.lesser(controls, id::BACKLIGHT_COMPENSATION, i64::MIN, "backlight compensation cannot be turned off")?;
        self.lesser(controls, id::WIDE_DYNAMIC_RANGE, 0, "dynamic range compression cannot be turned off")?;
        let kelvin = Some(wishes.white_balance_k);
        self.fix_white(controls, id::WHITE_BALANCE_TEMPERATURE, ("white balance", " K"), kelvin)?;
        // Amplifications of two channels, where automatic white balance may have left them.
        self.fix_white(controls, id::RED_BALANCE, ("red balance", ""), None)?;
        self.fix_white(controls, id::BLUE_BALANCE, ("blue balance", ""), None)
    }

    /// Fixes one control of the white balance, at its default where no value is wished.
    fn fix_white(
        &mut self,
        controls: &mut impl Controls,
        id: u32,
        (name, unit): (&'static str, &'static str),
        value: Option<i64>,
    ) -> Result<(), ControlFault> {
        let what = "the white balance cannot be fixed";
        let Some(range) = present(controls, id, what)? else { return Ok(()) };
        if let Some(stands) = self.lesser(controls, id, value.unwrap_or(range.default), what)? {
            self.white.push((name, stands, unit));
        }
        Ok(())
    }

    /// Sets what a picture can do without, and reads it back: a refusal and another value are noted. The value that stands,
    /// where it is known. Only a device that is gone or hangs is an error.
    fn lesser(
        &mut self,
        controls: &mut impl Controls,
        id: u32,
        value: i64,
        what: &'static str,
    ) -> Result<Option<i64>, ControlFault> {
        let Some(range) = present(controls, id, what)? else { return Ok(None) };
        let wanted = value.clamp(range.min, range.max);
        match controls.set(id, wanted).and_then(|()| controls.get(id)) {
            Err(error) if is_fatal(&error) => Err(ControlFault { what, error }),
            Err(error) => {
                self.note(format!("{what}: {error}"));
                Ok(None)
            }
            Ok(stands) => {
                // Less than a step is rounding.
                if (stands - wanted).abs() >= range.step.max(1) {
                    self.note(format!("{what}: set to {wanted}, it reads {stands}"));
                }
                Ok(Some(stands))
            }
        }
    }

    fn note(&mut self, note: String) {
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }

    fn find_times(&mut self, controls: &impl Controls, wishes: &Wishes) -> Option<Times> {
        let writable = |id| controls.query(id).ok().filter(|range| range.writable && range.max > range.min);
        let (id, range) =
            [id::EXPOSURE_ABSOLUTE, id::EXPOSURE_LINES].into_iter().find_map(|id| Some((id, writable(id)?)))?;
        let unit_s = if id == id::EXPOSURE_ABSOLUTE { ABSOLUTE_UNIT_S } else { self.line_s(controls, wishes) };
        let mut max = range.max;
        let mut blanking = None;
        if id == id::EXPOSURE_LINES
            && let (Some(vertical), Ok(now)) = (writable(id::VBLANK), controls.get(id::VBLANK))
        {
            let height = wishes.size.1 as i64;
            let margin = height + now - range.max;
            blanking = Some(Blanking { height, margin, usual: vertical.default, max: vertical.max, now });
            max = height + vertical.max - margin;
        }
        let min = range.min.max(1);
        let max = max.min((wishes.max_exposure_s / unit_s) as i64).max(min);
        Some(Times { id, unit_s, min, max, step: range.step.max(1), blanking })
    }

    /// Time of a sensor's line, seconds.
    fn line_s(&mut self, controls: &impl Controls, wishes: &Wishes) -> f64 {
        let (width, height) = wishes.size;
        let told = |id| controls.get(id).ok().filter(|&value| value > 0).map(|value| value as f64);
        if let (Some(blank), Some(rate)) = (told(id::HBLANK), told(id::PIXEL_RATE)) {
            return (width as f64 + blank) / rate;
        }
        let lines = height as f64 + told(id::VBLANK).unwrap_or(0.0);
        self.notes.push("the sensor does not tell its line time: exposures are in proportion, not in seconds".into());
        self.nominal_s / lines.max(1.0)
    }

    fn take_gain(&mut self, controls: &mut impl Controls, wishes: &Wishes) -> Result<(), ControlFault> {
        let what = "gain cannot be set";
        if let Some(range) = present(controls, id::DIGITAL_GAIN, what)? {
            self.lesser(controls, id::DIGITAL_GAIN, range.default, what)?;
        }
        for id in [id::ANALOGUE_GAIN, id::GAIN] {
            let Some(range) = present(controls, id, what)? else { continue };
            self.lesser(controls, id, range.min, what)?;
            self.gains = wishes.gain.map(|model| Gains { id, range, model });
            self.is_gain_unknown = self.gains.is_none();
            break;
        }
        Ok(())
    }
}

/// The range of a control that is there and may be written.
fn present(controls: &impl Controls, id: u32, what: &'static str) -> Result<Option<ControlRange>, ControlFault> {
    match controls.query(id) {
        Ok(range) => Ok(Some(range).filter(|range| range.writable)),
        Err(error) if is_fatal(&error) => Err(ControlFault { what, error }),
        Err(_) => Ok(None),
    }
}

fn is_fatal(error: &io::Error) -> bool {
    matches!(errno(error), Some(Errno::NODEV | Errno::NXIO | Errno::TIMEDOUT))
}

#[cfg(test)]
mod tests;
