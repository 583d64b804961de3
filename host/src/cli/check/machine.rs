//! What the machine under a post must have: a camera that answers, room, and no fever.

use super::Table;
#[cfg(feature = "board")]
use crate::camera::{Camera, CameraError, Exposure, Frame, v4l2::V4l2Camera};
use crate::config::Config;
#[cfg(feature = "board")]
use crate::config::ViewCamera;
#[cfg(feature = "board")]
use crate::display::kms::Outlook;
#[cfg(feature = "board")]
use crate::lens::Lens;
use rustix::fs::statvfs;
use std::fs;
use std::path::Path;

/// Less room than this for the state and screenshots is worth a word, bytes.
const LITTLE_ROOM: u64 = 50 << 20;
/// Boards slow down from about here, degrees Celsius.
const HOT_C: f64 = 80.0;
/// What a view's camera is asked for where the field's size is not known.
#[cfg(feature = "board")]
const VIEW_SIZE: (usize, usize) = (1280, 720);

/// Room where the state is written.
pub(super) fn disk(config: &Config, table: &mut Table) {
    let folder = config.health.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    let room = statvfs(folder).map(|disk| disk.f_bavail * disk.f_frsize);
    let words = room.map_err(|error| format!("{}: {error}", folder.display())).and_then(|room| {
        let words = format!("{} MB free in {}", room >> 20, folder.display());
        if room < LITTLE_ROOM {
            Err(format!("{words}; make room, or the state cannot be told"))
        } else {
            Ok(((), words))
        }
    });
    table.add("disk", words);
}

/// The hottest sensor, where there is one.
pub(super) fn heat(table: &mut Table) {
    let zones = fs::read_dir("/sys/class/thermal").into_iter().flatten().flatten();
    let degrees = zones.filter_map(|zone| {
        let milli: f64 = fs::read_to_string(zone.path().join("temp")).ok()?.trim().parse().ok()?;
        Some(milli / 1000.0)
    });
    let Some(hottest) = degrees.reduce(f64::max) else { return };
    let words = format!("{hottest:.0} degrees Celsius");
    let found =
        if hottest >= HOT_C { Err(format!("{words}: too hot; give the board air or shade")) } else { Ok(((), words)) };
    table.add("heat", found);
}

/// What the screen would show. Without a monitor the post opens and waits for one.
#[cfg(feature = "board")]
pub(super) fn screen(outlook: Outlook, table: &mut Table) {
    match outlook {
        Outlook::Shown(words) => table.say("display", words),
        Outlook::Unplugged(words) => {
            table.advise(
                "display",
                format!("{words}: nobody will see the picture; plug the display in and switch it on"),
            );
        }
        Outlook::Unfit(words) => {
            table.add("display", Err::<((), String), _>(words));
        }
    }
}

/// Opens the camera, measures its delay and its pace.
#[cfg(feature = "board")]
pub(super) fn camera(config: &Config, lens: Option<&Lens>, table: &mut Table) {
    let settings = crate::sky_source::live::v4l2_settings(config);
    let opened = settings.and_then(|settings| {
        let mut camera = V4l2Camera::open(&settings)?;
        let delay = camera.measure_delay()?;
        let layout = *camera.layout();
        let format = String::from_utf8_lossy(&camera.fourcc()).into_owned();
        let words = format!("{}: {format} {}x{}", camera.path(), layout.width, layout.height);
        Ok(((camera, delay), words))
    });
    let Some((mut camera, delay)) = table.add("camera", opened.map_err(|error| unopened(config, &error))) else {
        return;
    };
    super::lens::fits(lens, camera.layout().output_size(), super::lens::ASK_FOR_SIZE, table);
    let shows = format!("a new exposure shows after {} frames", delay.settled_frames);
    let words = if delay.measured { shows } else { format!("{shows}, a guess: too dark or too bright to measure") };
    table.add("delay", Ok::<_, String>(((), words)));
    let offered =
        camera.rates_hz().map(|rates| format!("; the camera offers {}", crate::camera::v4l2::asked::words(rates)));
    let offered = offered.unwrap_or_default();
    table.add("frames", pace(&mut camera).map(|words| ((), format!("{words}{offered}"))));
    if let Some(exposures) = table.add("series", series(&mut camera)) {
        super::agreement::exposures(config, lens, (&mut camera, &exposures), super::agreement::TAKEN, table);
    }
    table.say("controls", camera.controls_told().join("; "));
    for note in camera.notes() {
        table.advise("controls", note.clone());
    }
}

/// Why the camera does not open.
#[cfg(feature = "board")]
fn unopened(config: &Config, error: &anyhow::Error) -> String {
    let device = config.camera.device.as_deref().unwrap_or_default();
    match error.downcast_ref() {
        Some(CameraError::Lost) => {
            format!("camera.device = \"{device}\" is not there; plug it in, or see `relume devices` for its name")
        }
        _ => format!("{error:#}"),
    }
}

/// Opens the camera of a live view behind a field of `size` and measures its pace.
#[cfg(feature = "board")]
pub(super) fn view_camera(
    wanted: &ViewCamera,
    size: Option<(usize, usize)>,
    table: &mut Table,
) -> Option<Box<dyn Camera>> {
    let settings = crate::view::device::v4l2_settings(wanted, size.unwrap_or(VIEW_SIZE));
    let opened = V4l2Camera::open(&settings).map_err(|error| format!("{}: {error}", settings.device));
    let found = opened.and_then(|mut camera| {
        let format = String::from_utf8_lossy(&camera.fourcc()).into_owned();
        let shown = super::view::fitted(camera.layout().output_size(), size);
        let shown = shown.map_err(|what| format!("{}: {what}", camera.path()))?;
        let pace = pace(&mut camera)?;
        let words = format!("{}: {format} {shown}, {pace}", camera.path());
        Ok((Box::new(camera) as Box<dyn Camera>, words))
    });
    table.add("live", found)
}

/// Frames per second over twenty of them.
#[cfg(feature = "board")]
fn pace(camera: &mut V4l2Camera) -> Result<String, String> {
    const FRAMES: u32 = 20;
    let mut frame = Frame::default();
    let mut next = || camera.frame(&mut frame).map_err(|error| error.to_string());
    next()?;
    let begun = std::time::Instant::now();
    for _ in 0..FRAMES {
        next()?;
    }
    let rate = f64::from(FRAMES) / begun.elapsed().as_secs_f64();
    Ok(format!("{rate:.1} a second; {} missing, {} damaged", camera.counters().missing, camera.counters().damaged))
}

/// The exposures that the planner chooses for the light that is there, and how long a series takes.
#[cfg(feature = "board")]
fn series(camera: &mut V4l2Camera) -> Result<(Vec<Exposure>, String), String> {
    use crate::sky_source::calm::{SERIES_S, WATCH_S};
    let mut meter = crate::lightmeter::LightMeter::new(camera.limits());
    meter.look(camera, |camera| camera).map_err(|error| error.to_string())?;
    let (plan, took) = meter.plan();
    let [shortest, longest] = plan.exposure_s;
    let (frames, gain, took_s) = (plan.frames, plan.gain, took.as_secs_f64());
    let words = format!(
        "{frames} exposures of {shortest:.4} to {longest:.4} s at gain {gain:.1} at most, in {took_s:.2} s; \
         under a calm sky a frame every {WATCH_S} s and a series every {SERIES_S} s"
    );
    Ok((meter.exposures().to_vec(), words))
}

#[cfg(all(test, feature = "board"))]
mod tests {
    use super::*;

    #[test]
    fn a_camera_that_is_not_there_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("POST.toml");
        let text = "field = 'a'\nsky = 'camera'\n[site]\nlatitude = 48.0\nlongitude = 11.0\n[camera]\n\
                    device = '/dev/video-none'\nlens = 'l'\n[display]\nkind = 'headless'\nfolder = 'o'\n";
        fs::write(&file, text).unwrap();
        let mut table = Table::default();
        camera(&Config::load(&file).unwrap(), None, &mut table);
        assert!(table.text().starts_with("BAD  camera     camera.device = \"/dev/video-none\""), "{}", table.text());
    }

    #[test]
    fn only_a_picture_that_is_shown_is_well() {
        let row = |outlook| {
            let mut table = Table::default();
            screen(outlook, &mut table);
            table.text()
        };
        assert_eq!(row(Outlook::Shown("HDMI-A-1 640x480".into())), "ok   display    HDMI-A-1 640x480\n");
        let unplugged = row(Outlook::Unplugged("nothing is plugged into HDMI-A-1".into()));
        assert!(unplugged.starts_with("see  display    nothing is plugged into HDMI-A-1"), "{unplugged}");
        assert_eq!(row(Outlook::Unfit("no such mode".into())), "BAD  display    no such mode\n");
    }
}
