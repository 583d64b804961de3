//! Orders to the running camera: what is to go wrong, and when it plugs and unplugs.

use crate::offer::FrameSize;
use crate::picture::Random;
use std::str::FromStr;
use std::time::{Duration, Instant};

/// An order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Order {
    /// Plugs in.
    Plug,
    /// Closes the link, as a pulled cable does.
    Cut,
    /// Unplugs through the host controller.
    Detach,
    /// Frames from setting to effect.
    Latency(usize),
    /// The next frames come with the UVC error bit.
    Error(u32),
    /// The next frames come with half of their bytes.
    Short(u32),
    /// No frame for this long.
    Freeze(Duration),
    /// The same picture again and again.
    Stuck(bool),
    /// Pictures without any light.
    Black(bool),
    /// Pictures of noise.
    Noise(bool),
    /// Settings stall with this UVC error code; 0 ends it.
    Refuse(u8),
    /// Settings are answered this late.
    Delay(Duration),
    /// The camera falls back to automatic exposure.
    Auto,
    /// Share of frames, percent, that never come.
    Drop(u8),
    /// The one size that is offered from the next plug on.
    Size(FrameSize),
    /// Time of day, unix seconds.
    Time(f64),
    /// Simulated seconds per real one.
    Speed(f64),
    /// Tells how it goes.
    Stat,
}

/// What an order's text may be.
pub const ORDERS: &str = "plug | cut | detach | latency N | error N | short N | freeze MS | stuck on|off | black on|off | \
                          noise on|off | refuse CODE | delay MS | auto | drop PERCENT | size WxH | time UTC | speed F | stat";

/// A text that is no order.
#[derive(Debug, thiserror::Error)]
#[error("`{0}` is no order; orders: {ORDERS}")]
pub struct BadOrder(String);

impl FromStr for Order {
    type Err = BadOrder;

    fn from_str(text: &str) -> Result<Self, BadOrder> {
        let words: Vec<&str> = text.split_whitespace().collect();
        read(&words).ok_or_else(|| BadOrder(text.trim().into()))
    }
}

fn read(words: &[&str]) -> Option<Order> {
    let order = match *words {
        ["plug"] => Order::Plug,
        ["cut"] => Order::Cut,
        ["detach"] => Order::Detach,
        ["auto"] => Order::Auto,
        ["stat"] => Order::Stat,
        ["latency", n] => Order::Latency(n.parse().ok().filter(|n| *n <= 60)?),
        ["error", n] => Order::Error(n.parse().ok()?),
        ["short", n] => Order::Short(n.parse().ok()?),
        ["freeze", ms] => Order::Freeze(Duration::from_millis(ms.parse().ok()?)),
        ["stuck", state] => Order::Stuck(on_or_off(state)?),
        ["black", state] => Order::Black(on_or_off(state)?),
        ["noise", state] => Order::Noise(on_or_off(state)?),
        ["refuse", code] => Order::Refuse(code.parse().ok()?),
        ["delay", ms] => Order::Delay(Duration::from_millis(ms.parse().ok()?)),
        ["drop", percent] => Order::Drop(percent.parse().ok().filter(|p| *p <= 100)?),
        ["size", size] => Order::Size(size.parse().ok()?),
        ["time", utc] => Order::Time(relume::sun::parse_utc(utc).ok()?),
        ["speed", factor] => Order::Speed(factor.parse().ok().filter(|f: &f64| f.is_finite())?),
        _ => return None,
    };
    Some(order)
}

fn on_or_off(text: &str) -> Option<bool> {
    match text {
        "on" => Some(true),
        "off" => Some(false),
        _ => None,
    }
}

/// Faults that stand.
#[derive(Clone, Debug)]
pub struct Faults {
    /// Frames from setting to effect.
    pub latency: usize,
    /// Frames still to come with the error bit.
    pub error_frames: u32,
    /// Frames still to come with half of their bytes.
    pub short_frames: u32,
    /// No frame until then.
    pub frozen_until: Option<Instant>,
    /// The same picture again and again.
    pub stuck: bool,
    /// Pictures without any light.
    pub black: bool,
    /// Pictures of noise.
    pub noise: bool,
    /// How late settings are answered.
    pub answer_delay: Duration,
    /// Share of frames that never come, percent.
    pub drop_percent: u8,
    random: Random,
}

/// What is wrong with one frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameFaults {
    /// With the error bit.
    pub error: bool,
    /// With half of its bytes.
    pub short: bool,
    /// Never sent.
    pub lost: bool,
}

impl Faults {
    /// No faults, but a latency.
    pub fn none(latency: usize, seed: u64) -> Self {
        Faults {
            latency,
            error_frames: 0,
            short_frames: 0,
            frozen_until: None,
            stuck: false,
            black: false,
            noise: false,
            answer_delay: Duration::ZERO,
            drop_percent: 0,
            random: Random(seed),
        }
    }

    /// What is wrong with the frame that is sent next; counts it.
    pub fn next_frame(&mut self) -> FrameFaults {
        let lost = self.random.next_bits() % 100 < u64::from(self.drop_percent);
        let take = |left: &mut u32| {
            let hit = !lost && *left > 0;
            *left -= u32::from(hit);
            hit
        };
        FrameFaults { error: take(&mut self.error_frames), short: take(&mut self.short_frames), lost }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_read() {
        let cases = [
            ("plug", Order::Plug),
            (" freeze  250\n", Order::Freeze(Duration::from_millis(250))),
            ("stuck on", Order::Stuck(true)),
            ("black off", Order::Black(false)),
            ("drop 50", Order::Drop(50)),
            ("size 160x120", Order::Size(FrameSize { width: 160, height: 120 })),
            ("time 1970-01-02T00:00:00Z", Order::Time(86_400.0)),
            ("speed 0", Order::Speed(0.0)),
        ];
        for (text, order) in cases {
            assert_eq!(text.parse::<Order>().unwrap(), order, "{text}");
        }
        for bad in ["", "plug in", "freeze", "drop 101", "stuck maybe", "size 13x13", "speed nan", "error -1"] {
            let told = bad.parse::<Order>().unwrap_err().to_string();
            assert!(told.contains("orders: plug") && !told.contains('\n'), "{told}");
        }
    }

    #[test]
    fn frames_are_counted_down_and_dropped_by_their_share() {
        let mut faults = Faults { error_frames: 2, short_frames: 1, ..Faults::none(2, 1) };
        let seen: Vec<_> = (0..3).map(|_| faults.next_frame()).map(|f| (f.error, f.short)).collect();
        assert_eq!(seen, [(true, true), (true, false), (false, false)]);
        let lost = |percent| {
            let mut faults = Faults { drop_percent: percent, ..Faults::none(2, 1) };
            (0..10_000).filter(|_| faults.next_frame().lost).count()
        };
        assert_eq!((lost(0), lost(100)), (0, 10_000));
        assert!((4800..5200).contains(&lost(50)));
    }
}
