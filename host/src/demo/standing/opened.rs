//! A post that is opened at the site, from files as an installer writes them, and what it shows.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::vanished::FIELD;
use super::{Day, film};
use crate::cli;
use crate::config::{Config, SkyKind};
use crate::demo::site::Site;
use crate::failure::{Failure, OrFail};
use crate::lightlog::LightLogReader;
use crate::outfile::write_whole;
use crate::picture::write_png;
use crate::post::Signals;
use crate::sun::format_utc;
use crate::view::Still;

const VIEWS: &str = "views";
const RESPONSE: &str = "response.csv";
const SHOWN: &str = "shown";
const LIGHT_LOG: &str = "light.jsonl";

/// A frame of the post.
pub(super) struct Shown {
    pub(super) pixels_bgrx: Vec<u32>,
    /// What its virtual part was multiplied by, green.
    pub(super) exposure: f64,
    /// Sum of the light's colours over the patches, as relit.
    pub(super) light: [f64; 3],
}

/// When a post runs: its first moment (Unix seconds), and the seconds from frame to frame.
#[derive(Clone, Copy)]
pub(super) struct Running {
    pub(super) start_unix_s: f64,
    pub(super) step_s: f64,
}

/// Runs a post in `folder`, which holds the site's field: one frame per picture of `views`, which are a view camera's own codes of
/// `size` (width, height). `sky` is the simulated camera under the day's sky (`Synthetic`), or that sky itself (`Simulated`).
pub(super) fn shown(
    folder: &Path,
    (day, sky): (&Day, SkyKind),
    running: Running,
    (views, size): (&[Vec<u32>], (u32, u32)),
) -> Result<Vec<Shown>, Failure> {
    let post = write_post(folder, (day, sky), running, views.len())?;
    write_views(&folder.join(VIEWS), views, size)?;
    let config = Config::load(&post).or_runtime()?;
    cli::run::open(&config, false, &Signals::default())?;
    let log: Result<Vec<_>, _> = LightLogReader::open(&folder.join(LIGHT_LOG)).or_runtime()?.collect();
    let frame = |(number, light): (usize, crate::lightlog::LoggedLight<'_>)| {
        let still = Still::load(&folder.join(SHOWN).join(format!("frame_{number:06}.png")), None).or_runtime()?;
        let sum = |channel: usize| light.radiance.iter().map(|rgb| f64::from(rgb[channel])).sum();
        let exposure = light.exposures.last().copied().map_or(f64::NAN, f64::from);
        Ok(Shown { pixels_bgrx: still.pixels_bgrx, exposure, light: [0, 1, 2].map(sum) })
    };
    let log = log.or_runtime()?;
    if log.iter().map(|light| light.frame).ne(0..views.len() as u64) {
        return Err(Failure::Runtime(anyhow::anyhow!(
            "{LIGHT_LOG}: not every frame of the study's post had new light"
        )));
    }
    log.into_iter().enumerate().map(frame).collect()
}

/// Writes the pictures of a view camera, and their list.
fn write_views(folder: &Path, views: &[Vec<u32>], (width, height): (u32, u32)) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).or_runtime()?;
    let mut list = Vec::new();
    for (number, codes) in views.iter().enumerate() {
        let file = format!("{number}.png");
        write_png(&folder.join(&file), width as usize, height as usize, codes)?;
        // The exposure is the camera's own, and told to nobody.
        list.push(serde_json::json!({ "file": file, "time_s": 0.01 }));
    }
    write_whole(&folder.join("frames.json"), |file| Ok(serde_json::to_writer(file, &list)?))?;
    Ok(())
}

fn write_post(folder: &Path, (day, sky): (&Day, SkyKind), running: Running, frames: usize) -> Result<PathBuf, Failure> {
    film::save(&folder.join(RESPONSE))?;
    let place = Site::place();
    let mut text = format!("field = '{FIELD}'\nsky = '{}'\n", sky.name());
    // A String takes all that is written.
    let _ = write!(
        text,
        "[site]\nlatitude = {:?}\nlongitude = {:?}\n[weather]\nturbidity = {:?}\ncloud_cover = {:?}\nseed = {}\n\
         [view_camera]\nframes = '{VIEWS}'\nresponse = '{RESPONSE}'\n[exposure]\nmode = 'view'\n\
         [display]\nkind = 'headless'\nfolder = '{SHOWN}'\n\
         [run]\nstart = {}\nstep_s = {:?}\nframes = {frames}\nlight_log = '{LIGHT_LOG}'\n",
        place.latitude_deg,
        place.longitude_deg,
        day.weather.turbidity,
        day.weather.cloud_cover,
        day.weather.seed,
        format_utc(running.start_unix_s),
        running.step_s,
    );
    let path = folder.join("post.toml");
    write_whole(&path, |file| std::io::Write::write_all(file, text.as_bytes()))?;
    Ok(path)
}
