use super::*;
use std::cell::RefCell;
use std::collections::BTreeMap;

/// Controls in memory that behave as drivers do.
#[derive(Default)]
struct Fake {
    controls: BTreeMap<u32, (ControlRange, i64)>,
    menu: Vec<i64>,
    /// Writes in their order.
    log: Vec<(u32, i64)>,
    /// Errors that the next writes of a control give.
    faults: RefCell<Vec<(u32, Errno)>>,
    /// Times are multiples of this.
    rounding: i64,
    /// Controls that take every value and keep their own.
    deaf: Vec<u32>,
}

const fn range(min: i64, max: i64, default: i64) -> ControlRange {
    ControlRange { min, max, step: 1, default, writable: true }
}

impl Fake {
    fn with(mut self, id: u32, range: ControlRange) -> Self {
        self.controls.insert(id, (range, range.default));
        self
    }

    fn value(&self, id: u32) -> i64 {
        self.controls[&id].1
    }

    /// A USB camera as uvcvideo shows it: manual and aperture priority only.
    fn webcam() -> Self {
        Fake { menu: vec![1, 3], rounding: 1, ..Fake::default() }
            .with(id::EXPOSURE_AUTO, range(0, 3, 3))
            .with(id::EXPOSURE_ABSOLUTE, range(1, 100_000, 156))
            .with(id::EXPOSURE_AUTO_PRIORITY, range(0, 1, 1))
            .with(id::AUTO_WHITE_BALANCE, range(0, 1, 1))
            .with(id::WHITE_BALANCE_TEMPERATURE, range(2800, 6500, 4600))
            .with(id::POWER_LINE_FREQUENCY, range(0, 2, 1))
            .with(id::GAIN, range(0, 100, 30))
    }

    /// An IMX219 at 1640x1232: 182.4 MHz, 3448 pixels per line, margin of 4 lines.
    fn sensor() -> Self {
        let told = |value| ControlRange { writable: false, ..range(value, value, value) };
        Fake { rounding: 1, ..Fake::default() }
            .with(id::EXPOSURE_LINES, range(4, 1232 + 531 - 4, 1600))
            .with(id::VBLANK, range(4, 65535 - 1232, 531))
            .with(id::HBLANK, told(1808))
            .with(id::PIXEL_RATE, told(182_400_000))
            .with(id::ANALOGUE_GAIN, range(0, 232, 0))
            .with(id::DIGITAL_GAIN, range(256, 4095, 256))
    }
}

impl Controls for Fake {
    fn query(&self, id: u32) -> io::Result<ControlRange> {
        self.controls.get(&id).map(|control| control.0).ok_or_else(|| Errno::INVAL.into())
    }

    fn offers(&self, _: u32, entry: i64) -> bool {
        self.menu.contains(&entry)
    }

    fn get(&self, id: u32) -> io::Result<i64> {
        self.controls.get(&id).map(|control| control.1).ok_or_else(|| Errno::INVAL.into())
    }

    fn set(&mut self, id: u32, value: i64) -> io::Result<()> {
        self.log.push((id, value));
        let mut faults = self.faults.borrow_mut();
        if let Some(at) = faults.iter().position(|fault| fault.0 == id) {
            return Err(faults.remove(at).1.into());
        }
        let automatic = |auto, off| self.controls.get(&auto).is_some_and(|control| control.1 != off);
        let inactive = match id {
            id::EXPOSURE_ABSOLUTE => automatic(id::EXPOSURE_AUTO, 1),
            id::WHITE_BALANCE_TEMPERATURE => automatic(id::AUTO_WHITE_BALANCE, 0),
            _ => false,
        };
        if inactive {
            return Err(Errno::ACCESS.into());
        }
        if self.deaf.contains(&id) {
            return Ok(());
        }
        let control = self.controls.get_mut(&id).ok_or_else(|| io::Error::from(Errno::INVAL))?;
        let rounded = if id == id::EXPOSURE_ABSOLUTE { value / self.rounding * self.rounding } else { value };
        control.1 = rounded.clamp(control.0.min, control.0.max);
        if id == id::VBLANK {
            let exposure = self.controls.get_mut(&id::EXPOSURE_LINES).unwrap();
            exposure.0.max = 1232 + value - 4;
            exposure.1 = exposure.1.min(exposure.0.max);
        }
        Ok(())
    }
}

const WISHES: Wishes =
    Wishes { size: (1640, 1232), interval_s: Some(0.04), max_exposure_s: 0.5, gain: None, white_balance_k: 5500 };

fn at(exposure_s: f64) -> Exposure {
    Exposure { exposure_s, gain: 1.0 }
}

#[test]
fn automatics_go_off_before_values_are_set() {
    let mut webcam = Fake::webcam();
    let mut manual = Manual::take_over(&mut webcam, &WISHES).unwrap();
    assert_eq!(manual.notes, [""; 0]);
    let auto: Vec<(u32, i64)> =
        vec![(id::EXPOSURE_AUTO, 1), (id::EXPOSURE_AUTO_PRIORITY, 0), (id::AUTO_WHITE_BALANCE, 0)];
    assert_eq!(webcam.log[..3], auto);
    assert_eq!(webcam.value(id::POWER_LINE_FREQUENCY), 0);
    assert_eq!(webcam.value(id::WHITE_BALANCE_TEMPERATURE), 5500);
    assert_eq!(webcam.value(id::GAIN), 0, "what a code of gain means is not known");
    assert_eq!(manual.times_s(), (1e-4, 0.5, 1e-4));
    assert_eq!(manual.max_gain(), 1.0);
    // 1/120 s is 83 units of 100 us.
    let accepted = manual.set(&mut webcam, at(1.0 / 120.0)).unwrap();
    assert!((accepted.exposure_s - 83e-4).abs() < 1e-12, "{accepted:?}");
    assert_eq!(webcam.value(id::EXPOSURE_ABSOLUTE), 83);
}

#[test]
fn the_accepted_exposure_is_the_one_read_back() {
    let mut webcam = Fake { rounding: 10, ..Fake::webcam() };
    let mut manual = Manual::take_over(&mut webcam, &Wishes { gain: Some(GainModel::UpTo(8.0)), ..WISHES }).unwrap();
    let accepted = manual.set(&mut webcam, Exposure { exposure_s: 0.0157, gain: 4.5 }).unwrap();
    assert!((accepted.exposure_s - 0.0150).abs() < 1e-12, "{accepted:?}");
    assert!((accepted.gain - 4.5).abs() < 1e-12);
    assert_eq!(webcam.value(id::GAIN), 50);
    assert!((manual.set(&mut webcam, at(9.0)).unwrap().exposure_s - 0.5).abs() < 1e-12);
    assert_eq!(manual.max_gain(), 8.0);
}

#[test]
fn a_camera_that_fell_back_to_automatic_is_taken_over_again() {
    let mut webcam = Fake::webcam();
    let mut manual = Manual::take_over(&mut webcam, &WISHES).unwrap();
    webcam.controls.get_mut(&id::EXPOSURE_AUTO).unwrap().1 = 3;
    webcam.log.clear();
    let accepted = manual.set(&mut webcam, at(0.01)).unwrap();
    assert!((accepted.exposure_s - 0.01).abs() < 1e-12);
    assert_eq!(webcam.log[..2], [(id::EXPOSURE_ABSOLUTE, 100), (id::EXPOSURE_AUTO, 1)]);
    assert_eq!(*webcam.log.last().unwrap(), (id::EXPOSURE_ABSOLUTE, 100));
    // Linux 6.1 says it thus when the camera has forgotten but the kernel has not.
    webcam.faults.borrow_mut().push((id::EXPOSURE_ABSOLUTE, Errno::ILSEQ));
    webcam.log.clear();
    manual.set(&mut webcam, at(0.02)).unwrap();
    assert!(webcam.log.contains(&(id::EXPOSURE_AUTO, 1)));
    // Twice in a row is an error, and a hanging camera is not asked again.
    for (faults, errno) in [(2, Errno::BUSY), (1, Errno::TIMEDOUT)] {
        webcam.faults.borrow_mut().extend((0..faults).map(|_| (id::EXPOSURE_ABSOLUTE, errno)));
        let fault = manual.set(&mut webcam, at(0.01)).unwrap_err();
        assert_eq!(super::errno(&fault.error), Some(errno));
    }
    manual.set(&mut webcam, at(0.01)).unwrap();
}

#[test]
fn what_fails_is_an_error_a_note_or_nothing() {
    let mut webcam = Fake::webcam();
    webcam.faults.borrow_mut().push((id::POWER_LINE_FREQUENCY, Errno::IO));
    let manual = Manual::take_over(&mut webcam, &WISHES).unwrap();
    assert!(manual.notes[0].starts_with("the flicker filter cannot be turned off: "), "{:?}", manual.notes);
    for (id, errno) in [(id::POWER_LINE_FREQUENCY, Errno::NODEV), (id::EXPOSURE_AUTO, Errno::BUSY)] {
        let mut webcam = Fake::webcam();
        webcam.faults.borrow_mut().push((id, errno));
        let fault = Manual::take_over(&mut webcam, &WISHES).unwrap_err();
        assert_eq!(super::errno(&fault.error), Some(errno), "{}", fault.what);
    }
}

#[test]
fn without_controls_the_exposure_is_the_frames_time() {
    let mut vivid = Fake::default().with(id::GAIN, range(0, 255, 100)).with(id::AUTO_GAIN, range(0, 1, 1));
    let mut manual = Manual::take_over(&mut vivid, &WISHES).unwrap();
    assert_eq!(vivid.log[0], (id::AUTO_GAIN, 0));
    assert_eq!(manual.times_s(), (0.04, 0.04, 0.0));
    assert_eq!(manual.set(&mut vivid, Exposure { exposure_s: 0.001, gain: 3.0 }).unwrap(), at(0.04));
    assert_eq!(manual.notes.len(), 1);
    // A camera that offers automatic exposure only is one of these.
    let mut webcam = Fake { menu: vec![0, 3], ..Fake::webcam() };
    let manual = Manual::take_over(&mut webcam, &WISHES).unwrap();
    assert_eq!(manual.times_s(), (0.04, 0.04, 0.0));
}

#[test]
fn a_sensor_counts_lines_and_its_frame_makes_room_for_long_ones() {
    let mut sensor = Fake::sensor();
    let wishes = Wishes { gain: GainModel::of_sensor("imx219 10-0010"), ..WISHES };
    let mut manual = Manual::take_over(&mut sensor, &wishes).unwrap();
    let line_s = (1640.0 + 1808.0) / 182.4e6;
    let (min, max, step) = manual.times_s();
    assert!((min - 4.0 * line_s).abs() < 1e-12 && (step - line_s).abs() < 1e-15, "{min} {step}");
    assert!(max <= 0.5 && max > 0.5 - line_s, "{max}");
    // 10 ms are 529 lines and fit; 100 ms are 5290 and need blanking of 5290 + 4 - 1232.
    let accepted = manual.set(&mut sensor, at(0.01)).unwrap();
    assert!((accepted.exposure_s - 529.0 * line_s).abs() < 1e-12, "{accepted:?}");
    assert_eq!(sensor.value(id::VBLANK), 531);
    sensor.log.clear();
    let accepted = manual.set(&mut sensor, Exposure { exposure_s: 0.1, gain: 2.0 }).unwrap();
    assert!((accepted.exposure_s - 5290.0 * line_s).abs() < 1e-12, "{accepted:?}");
    assert_eq!(accepted.gain, 2.0);
    assert_eq!(sensor.log, [(id::VBLANK, 4062), (id::EXPOSURE_LINES, 5290), (id::ANALOGUE_GAIN, 128)]);
    sensor.log.clear();
    manual.set(&mut sensor, at(0.01)).unwrap();
    assert_eq!(sensor.log, [(id::EXPOSURE_LINES, 529), (id::VBLANK, 531), (id::ANALOGUE_GAIN, 0)]);
}

#[test]
fn a_sensor_without_a_line_time_says_so() {
    let mut sensor = Fake::sensor();
    sensor.controls.remove(&id::PIXEL_RATE);
    let manual = Manual::take_over(&mut sensor, &WISHES).unwrap();
    assert!(manual.notes[0].contains("line time"), "{:?}", manual.notes);
    assert!((manual.times_s().2 - 0.04 / (1232.0 + 531.0)).abs() < 1e-12);
}

#[test]
fn colours_are_fixed_by_the_channels_too_and_read_back() {
    let balanced = Fake::webcam().with(id::RED_BALANCE, range(0, 255, 128)).with(id::BLUE_BALANCE, range(0, 255, 120));
    let mut camera = Fake { deaf: vec![id::BLUE_BALANCE, id::POWER_LINE_FREQUENCY], ..balanced };
    for (control, left) in [(id::RED_BALANCE, 200), (id::BLUE_BALANCE, 90)] {
        camera.controls.get_mut(&control).unwrap().1 = left;
    }
    let manual = Manual::take_over(&mut camera, &WISHES).unwrap();
    assert_eq!(camera.value(id::RED_BALANCE), 128, "its default, whatever automatics left");
    assert_eq!(manual.told()[2], "white balance 5500 K, red balance 128, blue balance 90");
    let notes = [
        "the flicker filter cannot be turned off: set to 0, it reads 1",
        "the white balance cannot be fixed: set to 120, it reads 90",
    ];
    assert_eq!(manual.notes, notes);
    // What a driver rounds to its step has been done.
    let stepped = ControlRange { step: 100, ..range(2800, 6500, 4600) };
    let mut camera = Fake::webcam().with(id::WHITE_BALANCE_TEMPERATURE, stepped);
    camera.deaf.push(id::WHITE_BALANCE_TEMPERATURE);
    camera.controls.get_mut(&id::WHITE_BALANCE_TEMPERATURE).unwrap().1 = 5450;
    assert_eq!(Manual::take_over(&mut camera, &WISHES).unwrap().notes, [""; 0]);
}

#[test]
fn what_can_be_set_is_told_in_seconds_and_gains() {
    let mut webcam = Fake::webcam();
    let manual = Manual::take_over(&mut webcam, &WISHES).unwrap();
    let told = manual.told();
    assert_eq!(told[0], "exposure 0.0001 to 0.5 s in steps of 0.0001 s");
    assert!(told[1].starts_with("gain stays at its least: give camera.max_gain"), "{told:?}");
    assert_eq!(told[2], "white balance 5500 K");
    let wishes = Wishes { gain: Some(GainModel::UpTo(8.0)), ..WISHES };
    assert_eq!(Manual::take_over(&mut webcam, &wishes).unwrap().told()[1], "gain 1 to 8");
    // A line of the sensor is 3448 pixels at 182.4 MHz.
    let wishes = Wishes { gain: GainModel::of_sensor("imx219 10-0010"), ..WISHES };
    let told = Manual::take_over(&mut Fake::sensor(), &wishes).unwrap().told();
    assert_eq!(told[0], "exposure 0.0000756 to 0.5 s in steps of 0.0000189 s");
    assert_eq!(told[1..], ["gain 1 to 10.7", "no white balance control"]);
    let told = Manual::take_over(&mut Fake::default(), &WISHES).unwrap().told();
    assert_eq!(told[..2], ["exposure 0.04 s, which cannot be set", "no gain control"]);
}

#[test]
fn listing_controls_changes_none() {
    let webcam = Fake::webcam();
    let lines = ["exposure 0.0001 to 10 s", "gain, codes 0 to 100, now 30", "white balance 2800 to 6500 K, now 4600"];
    assert_eq!(listed(&webcam), lines);
    assert_eq!(webcam.log, []);
    let automatic = Fake { menu: vec![0, 3], ..Fake::webcam() };
    assert_eq!(listed(&automatic)[0], "exposure 0.0001 to 10 s, automatic only");
    let sensor = listed(&Fake::sensor());
    assert_eq!(sensor, ["exposure 4 to 1759 lines, now 1600", "analogue gain, codes 0 to 232, now 0"]);
    assert_eq!([0.0, 1234.5, 30.0, 29.97, 7.5].map(short), ["0", "1234", "30", "30", "7.5"]);
}
