//! The camera's controls and the class requests that read and set them (UVC 1.1, chapter 4).

use crate::descriptors::{CAMERA_TERMINAL, OUTPUT_TERMINAL, PROCESSING_UNIT};

/// Default of the white balance temperature, K: at it the channels are as the sensor gives them.
pub const NEUTRAL_K: i32 = 6500;
/// Largest value of the gain control; 0 is gain 1, this is [`MAX_GAIN`].
pub const GAIN_STEPS: i32 = 255;
/// Largest gain.
pub const MAX_GAIN: f64 = 8.0;

/// Manual and aperture priority, as bits of the exposure mode.
const MANUAL: i32 = 1;
const APERTURE_PRIORITY: i32 = 8;

/// The controls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// 1 manual, 8 aperture priority (automatic exposure time).
    ExposureMode,
    /// 1 lets automatic exposure slow the frames down.
    ExposurePriority,
    /// Exposure time, 100 us.
    ExposureTime,
    /// 0..=255.
    Gain,
    /// K.
    WhiteBalance,
    /// 1 is on.
    WhiteBalanceAuto,
}

/// A control's place, size and range.
struct Kind {
    control: Control,
    unit: u8,
    selector: u8,
    bytes: usize,
    min: i32,
    max: i32,
    /// Step; for the exposure mode the modes there are, as bits.
    step: i32,
    default: i32,
}

const KINDS: [Kind; 6] = [
    kind(Control::ExposureMode, CAMERA_TERMINAL, 0x02, 1, [1, 8, MANUAL | APERTURE_PRIORITY, APERTURE_PRIORITY]),
    kind(Control::ExposurePriority, CAMERA_TERMINAL, 0x03, 1, [0, 1, 1, 0]),
    kind(Control::ExposureTime, CAMERA_TERMINAL, 0x04, 4, [1, 100_000, 1, 156]),
    kind(Control::Gain, PROCESSING_UNIT, 0x04, 2, [0, GAIN_STEPS, 1, 0]),
    kind(Control::WhiteBalance, PROCESSING_UNIT, 0x0a, 2, [2800, 10_000, 10, NEUTRAL_K]),
    kind(Control::WhiteBalanceAuto, PROCESSING_UNIT, 0x0b, 1, [0, 1, 1, 1]),
];

const fn kind(control: Control, unit: u8, selector: u8, bytes: usize, range: [i32; 4]) -> Kind {
    let [min, max, step, default] = range;
    Kind { control, unit, selector, bytes, min, max, step, default }
}

const SET_CUR: u8 = 0x01;
const GET_CUR: u8 = 0x81;
const GET_MIN: u8 = 0x82;
const GET_MAX: u8 = 0x83;
const GET_RES: u8 = 0x84;
const GET_LEN: u8 = 0x85;
const GET_INFO: u8 = 0x86;
const GET_DEF: u8 = 0x87;

/// Why the camera stalls, as its error code control tells it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// Not now: an automatic mode holds the control.
    WrongState = 2,
    /// Outside of the range.
    OutOfRange = 4,
    /// No such unit.
    InvalidUnit = 5,
    /// The unit has no such control.
    InvalidControl = 6,
    /// The control does not know the request.
    InvalidRequest = 7,
    /// The data is no value.
    InvalidValue = 8,
}

/// What comes of a class request to the control interface.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Data for the host.
    Data(Vec<u8>),
    /// A control was set.
    Set {
        /// Which.
        control: Control,
        /// Its value before.
        old: i32,
        /// Its value now.
        new: i32,
    },
    /// The endpoint stalls; the error code.
    Stall(u8),
}

/// A class request: its code, the control's unit and selector, and the data of a SET.
#[derive(Clone, Copy, Debug)]
pub struct ClassRequest<'a> {
    /// SET_CUR, GET_CUR, ...
    pub code: u8,
    /// Unit or terminal; 0 is the interface itself.
    pub unit: u8,
    /// Control selector.
    pub selector: u8,
    /// Data of a SET.
    pub data: &'a [u8],
}

/// The controls' values.
#[derive(Clone, Debug)]
pub struct Controls {
    values: [i32; KINDS.len()],
    error: u8,
    /// Every SET_CUR stalls with this error code; 0 for none.
    pub refuse: u8,
}

impl Default for Controls {
    fn default() -> Self {
        Controls { values: std::array::from_fn(|index| KINDS[index].default), error: 0, refuse: 0 }
    }
}

impl Controls {
    /// A control's value.
    pub fn get(&self, control: Control) -> i32 {
        KINDS.iter().zip(self.values).find(|(kind, _)| kind.control == control).map_or(0, |(_, value)| value)
    }

    /// Sets a control from inside, as a camera that falls back does; the host is not told.
    pub fn force(&mut self, control: Control, value: i32) {
        for (kind, place) in KINDS.iter().zip(&mut self.values).filter(|(kind, _)| kind.control == control) {
            *place = value.clamp(kind.min, kind.max);
        }
    }

    /// Whether the exposure time is the host's.
    pub fn is_manual(&self) -> bool {
        self.get(Control::ExposureMode) == MANUAL
    }

    /// Back to automatic exposure.
    pub fn force_automatic(&mut self) {
        self.force(Control::ExposureMode, APERTURE_PRIORITY);
    }

    /// Gain of a value of the gain control: 1 + 7 x value / 255.
    pub fn gain_of(value: i32) -> f64 {
        1.0 + (MAX_GAIN - 1.0) * f64::from(value) / f64::from(GAIN_STEPS)
    }

    /// Answers a class request to the control interface.
    pub fn answer(&mut self, request: ClassRequest) -> Answer {
        let answer = self.try_answer(request);
        match answer {
            Ok(answer) => answer,
            Err(code) => {
                self.error = code;
                Answer::Stall(code)
            }
        }
    }

    fn try_answer(&mut self, request: ClassRequest) -> Result<Answer, u8> {
        if request.unit == 0 {
            // The interface's own control 2 is the error code of the last stall.
            let known = request.code == GET_CUR && request.selector == 2;
            return if known { Ok(Answer::Data(vec![self.error])) } else { Err(Refusal::InvalidControl as u8) };
        }
        let found = KINDS.iter().position(|k| k.unit == request.unit && k.selector == request.selector);
        let missing = if request.unit > OUTPUT_TERMINAL { Refusal::InvalidUnit } else { Refusal::InvalidControl };
        let index = found.ok_or(missing as u8)?;
        let kind = &KINDS[index];
        let data = |value: i32| Ok(Answer::Data(value.to_le_bytes()[..kind.bytes].to_vec()));
        match request.code {
            SET_CUR => self.set(index, request.data),
            GET_CUR => data(self.values[index]),
            GET_MIN => data(kind.min),
            GET_MAX => data(kind.max),
            GET_RES => data(kind.step),
            GET_DEF => data(kind.default),
            GET_LEN => Ok(Answer::Data(vec![kind.bytes as u8, 0])),
            // Get and set; and, for what an automatic mode holds, "disabled by it".
            GET_INFO => Ok(Answer::Data(vec![if self.is_held(kind.control) { 7 } else { 3 }])),
            _ => Err(Refusal::InvalidRequest as u8),
        }
    }

    fn is_held(&self, control: Control) -> bool {
        match control {
            Control::ExposureTime => !self.is_manual(),
            Control::WhiteBalance => self.get(Control::WhiteBalanceAuto) == 1,
            _ => false,
        }
    }

    fn set(&mut self, index: usize, data: &[u8]) -> Result<Answer, u8> {
        let kind = &KINDS[index];
        if self.refuse != 0 {
            return Err(self.refuse);
        }
        let bytes = data.get(..kind.bytes).ok_or(Refusal::InvalidValue as u8)?;
        let mut wide = [0; 4];
        wide[..kind.bytes].copy_from_slice(bytes);
        let new = i32::from_le_bytes(wide);
        let is_mode = kind.control == Control::ExposureMode;
        if !(kind.min..=kind.max).contains(&new) || (is_mode && new != MANUAL && new != APERTURE_PRIORITY) {
            return Err(Refusal::OutOfRange as u8);
        }
        if self.is_held(kind.control) {
            return Err(Refusal::WrongState as u8);
        }
        let old = std::mem::replace(&mut self.values[index], new);
        self.error = 0;
        Ok(Answer::Set { control: kind.control, old, new })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(controls: &mut Controls, code: u8, unit: u8, selector: u8, data: &[u8]) -> Answer {
        controls.answer(ClassRequest { code, unit, selector, data })
    }

    #[test]
    fn the_exposure_time_is_the_hosts_in_manual_mode_only() {
        let mut c = Controls::default();
        let time = 450u32.to_le_bytes();
        assert_eq!(ask(&mut c, GET_CUR, 1, 2, &[]), Answer::Data(vec![8]), "aperture priority at first");
        assert_eq!(ask(&mut c, GET_INFO, 1, 4, &[]), Answer::Data(vec![7]));
        assert_eq!(ask(&mut c, SET_CUR, 1, 4, &time), Answer::Stall(2));
        assert_eq!(ask(&mut c, GET_CUR, 0, 2, &[]), Answer::Data(vec![2]), "the error code");
        let set = Answer::Set { control: Control::ExposureMode, old: 8, new: 1 };
        assert_eq!(ask(&mut c, SET_CUR, 1, 2, &[1]), set);
        assert_eq!(ask(&mut c, GET_INFO, 1, 4, &[]), Answer::Data(vec![3]));
        let set = Answer::Set { control: Control::ExposureTime, old: 156, new: 450 };
        assert_eq!(ask(&mut c, SET_CUR, 1, 4, &time), set);
        assert_eq!(ask(&mut c, GET_CUR, 0, 2, &[]), Answer::Data(vec![0]));
        c.force_automatic();
        assert!(!c.is_manual());
    }

    #[test]
    fn ranges_are_told_and_kept() {
        let mut c = Controls::default();
        assert_eq!(ask(&mut c, GET_MIN, 1, 4, &[]), Answer::Data(vec![1, 0, 0, 0]));
        assert_eq!(ask(&mut c, GET_MAX, 1, 4, &[]), Answer::Data(100_000u32.to_le_bytes().to_vec()));
        assert_eq!(ask(&mut c, GET_RES, 1, 2, &[]), Answer::Data(vec![9]), "the modes there are");
        assert_eq!(ask(&mut c, GET_LEN, 2, 4, &[]), Answer::Data(vec![2, 0]));
        for mode in [0, 2, 4, 9] {
            assert_eq!(ask(&mut c, SET_CUR, 1, 2, &[mode]), Answer::Stall(4), "{mode}");
        }
        assert_eq!(ask(&mut c, SET_CUR, 2, 4, &[0, 1]), Answer::Stall(4), "gain 256");
        assert_eq!(ask(&mut c, SET_CUR, 2, 4, &[1]), Answer::Stall(8), "a byte too few");
        assert_eq!(ask(&mut c, GET_CUR, 2, 2, &[]), Answer::Stall(6), "brightness is not there");
        assert_eq!(ask(&mut c, GET_CUR, 9, 2, &[]), Answer::Stall(5));
        assert_eq!(ask(&mut c, 0x11, 2, 4, &[]), Answer::Stall(7));
    }

    #[test]
    fn white_balance_is_held_while_automatic_and_refusals_hit_every_set() {
        let mut c = Controls::default();
        let daylight = 5500u16.to_le_bytes();
        assert_eq!(ask(&mut c, SET_CUR, 2, 10, &daylight), Answer::Stall(2));
        ask(&mut c, SET_CUR, 2, 11, &[0]);
        let set = Answer::Set { control: Control::WhiteBalance, old: 6500, new: 5500 };
        assert_eq!(ask(&mut c, SET_CUR, 2, 10, &daylight), set);
        c.refuse = 3;
        assert_eq!(ask(&mut c, SET_CUR, 2, 4, &[9, 0]), Answer::Stall(3));
        assert_eq!((c.get(Control::Gain), c.get(Control::WhiteBalance)), (0, 5500));
    }

    #[test]
    fn gain_runs_from_one_to_eight() {
        assert_eq!((Controls::gain_of(0), Controls::gain_of(255)), (1.0, 8.0));
        assert!((Controls::gain_of(51) - 2.4).abs() < 1e-12);
    }
}
