//! Arguments.

use crate::ctl::{Operator, order};
use crate::device::Device;
use crate::faults::{Faults, ORDERS, Order};
use crate::log::Log;
use crate::offer::{FrameSize, Offer};
use crate::optics::{Scene, camera_toml, lens_json, response, sensor};
use crate::sky::Sky;
use anyhow::Context;
use lexopt::prelude::{Long, Value, ValueExt};
use relume::sun::{Place, parse_utc};
use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

const HELP: &str = "\
usbcam run [OPTIONS]        a USB sky camera at the kernel's vhci-hcd, until killed
  --size WxH                sensor (320x320)
  --fps N                   frames per second, at most (30)
  --latency N               frames from setting to effect (2)
  --start UTC               time of day at the sensor (2026-06-21T06:00:00Z)
  --speed F                 simulated seconds per real second (600)
  --site LAT,LON            where it stands, degrees (48.0,11.0)
  --clouds SHARE            of the sky, 0 to 1 (0)
  --seed N                  clouds and noise (1)
  --look-every MS           how often the sky is looked at (500)
  --lens-out FILE           writes LENS.json
  --response-out FILE       writes the response curve and, with the ending .toml, the table [camera] of POST.toml
  --log FILE                a line per change (standard error)
  --ctl PATH                socket for orders (/tmp/usbcam.sock)
  --stamp                   frames carry their number, settings and time of day in their first 32 bytes
  --unplugged               waits for the order to plug
usbcam ctl [--ctl PATH] ORDER";

/// Socket for orders.
const SOCKET: &str = "/tmp/usbcam.sock";

struct Options {
    scene: Scene,
    fps: u32,
    latency: usize,
    speed: f64,
    look_every: Duration,
    lens_out: Option<PathBuf>,
    response_out: Option<PathBuf>,
    log: Option<PathBuf>,
    ctl: PathBuf,
    stamped: bool,
    plugged: bool,
}

impl Default for Options {
    fn default() -> Self {
        let scene = Scene {
            size: FrameSize { width: 320, height: 320 },
            place: Place { latitude_deg: 48.0, longitude_deg: 11.0 },
            cloud_cover: 0.0,
            seed: 1,
            // 2026-06-21T06:00:00Z
            start_unix_s: 1_782_021_600.0,
        };
        Options {
            scene,
            fps: 30,
            latency: 2,
            speed: 600.0,
            look_every: Duration::from_millis(500),
            lens_out: None,
            response_out: None,
            log: None,
            ctl: SOCKET.into(),
            stamped: false,
            plugged: true,
        }
    }
}

/// Runs the program.
///
/// # Errors
/// One line that says what is wrong and what to do.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> anyhow::Result<()> {
    let mut parser = lexopt::Parser::from_args(arguments);
    match parser.next()? {
        Some(Value(verb)) if verb == "run" => serve(options(&mut parser)?),
        Some(Value(verb)) if verb == "ctl" => send(&mut parser),
        Some(Long("help")) => {
            println!("{HELP}\norders: {ORDERS}");
            Ok(())
        }
        _ => anyhow::bail!("say `usbcam run`, `usbcam ctl ORDER` or `usbcam --help`"),
    }
}

fn options(parser: &mut lexopt::Parser) -> anyhow::Result<Options> {
    let mut options = Options::default();
    while let Some(argument) = parser.next()? {
        let Long(flag) = argument else { return Err(argument.unexpected().into()) };
        let flag = flag.to_string();
        match flag.as_str() {
            "stamp" => options.stamped = true,
            "unplugged" => options.plugged = false,
            flag => {
                let value = parser.value()?.string()?;
                set(&mut options, flag, &value).with_context(|| format!("--{flag} {value}"))?;
            }
        }
    }
    Ok(options)
}

fn set(options: &mut Options, flag: &str, value: &str) -> anyhow::Result<()> {
    let scene = &mut options.scene;
    match flag {
        "size" => scene.size = value.parse()?,
        "fps" => options.fps = value.parse()?,
        "latency" => options.latency = value.parse()?,
        "start" => scene.start_unix_s = parse_utc(value)?,
        "speed" => options.speed = value.parse()?,
        "site" => scene.place = place(value).context("write LAT,LON in degrees, as 48.0,11.0")?,
        "clouds" => scene.cloud_cover = value.parse()?,
        "seed" => scene.seed = value.parse()?,
        "look-every" => options.look_every = Duration::from_millis(value.parse()?),
        "lens-out" => options.lens_out = Some(value.into()),
        "response-out" => options.response_out = Some(value.into()),
        "log" => options.log = Some(value.into()),
        "ctl" => options.ctl = value.into(),
        _ => anyhow::bail!("no such option; see `usbcam --help`"),
    }
    Ok(())
}

fn place(text: &str) -> Option<Place> {
    let (latitude, longitude) = text.split_once(',')?;
    let (latitude_deg, longitude_deg) = (latitude.trim().parse().ok()?, longitude.trim().parse().ok()?);
    let on_earth = (-90.0..=90.0).contains(&latitude_deg) && (-180.0..=180.0).contains(&longitude_deg);
    on_earth.then_some(Place { latitude_deg, longitude_deg })
}

fn serve(options: Options) -> anyhow::Result<()> {
    let sensor = sensor(&options.scene);
    let log = Log::open(options.log.as_deref()).context("--log")?;
    if let Some(path) = &options.lens_out {
        std::fs::write(path, lens_json(options.scene.size)).with_context(|| path.display().to_string())?;
    }
    if let Some(path) = &options.response_out {
        response(&sensor)?.save(path)?;
        let toml = path.with_extension("toml");
        std::fs::write(&toml, camera_toml(&sensor, options.lens_out.as_deref(), path))
            .with_context(|| toml.display().to_string())?;
    }
    log.line(format_args!(
        "radiance_scale {}; gain = 1 + 7 x control / 255; white balance neutral at 6500 K: red x T / 6500, \
         blue x (6500 / T)^1.7; YUYV by BT.601, limited range",
        sensor.full_well_radiance_s
    ));
    let sky = Sky::start(sensor.clone(), options.speed, options.look_every);
    let offer = Offer::new(options.scene.size, options.fps);
    let device = Device::new(offer, Faults::none(options.latency, options.scene.seed), sky, log);
    let mut operator = Operator::new(device, sensor, options.stamped);
    if options.plugged {
        operator.obey(Order::Plug, "plug")?;
    }
    operator.serve(&options.ctl).with_context(|| options.ctl.display().to_string())
}

fn send(parser: &mut lexopt::Parser) -> anyhow::Result<()> {
    let (mut path, mut words) = (PathBuf::from(SOCKET), Vec::new());
    while let Some(argument) = parser.next()? {
        match argument {
            Long("ctl") => path = parser.value()?.into(),
            Value(word) => words.push(word.string()?),
            other => return Err(other.unexpected().into()),
        }
    }
    println!("{}", order(&path, &words.join(" "))?);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(line: &str) -> anyhow::Result<Options> {
        options(&mut lexopt::Parser::from_args(line.split_whitespace()))
    }

    #[test]
    fn options_are_read_and_faults_named() {
        let o = read("--size 64x48 --start 2026-06-21T06:00:00Z --site -33.5,151 --stamp --unplugged --clouds 0.4")
            .unwrap();
        assert_eq!((o.scene.size.to_string(), o.stamped, o.plugged), ("64x48".into(), true, false));
        assert_eq!(o.scene.start_unix_s, Options::default().scene.start_unix_s);
        assert_eq!(o.scene.place, Place { latitude_deg: -33.5, longitude_deg: 151.0 });
        for (line, named) in [("--size 3x3", "--size 3x3"), ("--site 99,0", "LAT,LON"), ("--colour 1", "--colour")] {
            let error = format!("{:#}", read(line).err().unwrap());
            assert!(error.contains(named) && !error.contains('\n'), "{error}");
        }
    }
}
