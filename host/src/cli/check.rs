//! `relume check`: what is wrong with a post, in plain words, before it opens.

mod agreement;
mod clock;
mod lens;
mod machine;
mod receivers;
mod view;

use super::args::{Command, post_arguments};
use crate::camera::replay::ReplayCamera;
use crate::camera::{Camera, CameraLimits};
use crate::colour::CameraColour;
use crate::config::{Config, DisplayConfig, SkyKind};
use crate::display::headless::Headless;
use crate::failure::Failure;
use crate::relight::FieldFile;
use embedded_graphics::geometry::Size;
use relume_firmware::overlay::{Overlay, Words, first_unreadable};
use serde::Serialize;
use std::fmt::Display;
use std::path::Path;

pub(super) const COMMAND: Command = Command {
    name: "check",
    help: "\
relume check POST.toml [--json]

Reads the post's file and everything it names, and prints a table of what is well and what is not. Exit code 0 when the
post can open, 2 when something must be put right first.

Where there are a view, receivers in it and the sky's light, it compares the view with the receivers in that light: `see`
marks what is noticed beside the picture (exposure, colour, evenness, pose) and says what to calibrate; the post opens all
the same.

  --json    the same as one JSON object on standard output
",
    act,
};

/// One line of the table.
#[derive(Debug, Serialize)]
struct Row {
    what: &'static str,
    ok: bool,
    /// Nothing that keeps the post from opening, but worth a calibration.
    is_advice: bool,
    words: String,
}

#[derive(Debug, Default, Serialize)]
struct Table {
    rows: Vec<Row>,
}

impl Table {
    /// Adds a line; hands the value on when all is well.
    fn add<T>(&mut self, what: &'static str, found: Result<(T, String), impl Display>) -> Option<T> {
        let (ok, words, value) = match found {
            Ok((value, words)) => (true, words, Some(value)),
            Err(error) => (false, error.to_string(), None),
        };
        self.rows.push(Row { what, ok, is_advice: false, words });
        value
    }

    /// Adds a line about what is well, or cannot be told.
    fn say(&mut self, what: &'static str, words: String) {
        self.rows.push(Row { what, ok: true, is_advice: false, words });
    }

    /// Adds a line about what would be better otherwise.
    fn advise(&mut self, what: &'static str, words: String) {
        self.rows.push(Row { what, ok: true, is_advice: true, words });
    }

    fn text(&self) -> String {
        let mark = |row: &Row| match (row.ok, row.is_advice) {
            (false, _) => "BAD",
            (true, true) => "see",
            (true, false) => "ok ",
        };
        self.rows.iter().map(|row| format!("{}  {:<9}  {}\n", mark(row), row.what, row.words)).collect()
    }
}

fn act(mut parser: lexopt::Parser) -> Result<(), Failure> {
    let (file, json) = post_arguments(&mut parser)?;
    let table = check(&file);
    if json {
        super::say_json(&table)?
    } else {
        super::say(&table.text())?
    }
    match table.rows.iter().filter(|row| !row.ok).count() {
        0 => Ok(()),
        faults => Err(Failure::bad(format!("{}: {faults} to put right; see the table", file.display()))),
    }
}

fn check(file: &Path) -> Table {
    let mut table = Table::default();
    let config = Config::load(file).map(|config| (config, format!("{}: every key is known", file.display())));
    let Some(config) = table.add("file", config) else { return table };
    let size = field(&config, &mut table);
    table.add("words", Ok::<_, String>(((), words(&config, size))));
    let mut behind = view::behind(&config, size, &mut table);
    sky(&config, &mut table);
    receivers::receivers(&config, &mut behind, &mut table);
    drop(behind);
    display(&config, size.unwrap_or((1, 1)), &mut table);
    let state = crate::outfile::check_writable(&config.health);
    if config.additive {
        table.say(
            "additive",
            "the display only adds light: real ground takes no shadow, and nothing gets darker".into(),
        );
    }
    table.add("health", state.map(|()| ((), format!("{} can be written", config.health.display()))));
    table.add("clock", clock::clock(&config).map(|words| ((), words)));
    machine::disk(&config, &mut table);
    machine::heat(&mut table);
    table
}

fn field(config: &Config, table: &mut Table) -> Option<(usize, usize)> {
    let opened = FieldFile::open(&config.field).map(|file| {
        let field = file.field();
        let size = (field.width(), field.height());
        let patches = field.patch_set().len();
        (size, format!("{}: {}x{}, {patches} patches", config.field.display(), size.0, size.1))
    });
    table.add("field", opened)
}

/// How title and caption are shown. A post opens with any, so this is no fault.
fn words(config: &Config, size: Option<(usize, usize)>) -> String {
    for (key, text) in [("title", &config.title), ("caption", &config.caption)] {
        if let Some(stranger) = first_unreadable(text) {
            return format!("{key}: no font has `{stranger}`, it is shown as ?; write it another way");
        }
    }
    let words = Words { title: &config.title, caption: &config.caption };
    match size {
        Some((width, height)) if !Overlay::new(Size::new(width as u32, height as u32)).has_room(&words) => {
            format!("title and caption are cut off at {width}x{height}; shorten them")
        }
        _ => "title and caption can be read".into(),
    }
}

fn sky(config: &Config, table: &mut Table) {
    let lens = config.camera.lens.as_ref().and_then(|path| lens::lens(path, table));
    if let Some(path) = &config.camera.response {
        let curve = crate::response::Response::load(path);
        table.add("response", curve.map(|_| ((), format!("{} is a response curve", path.display()))));
    }
    colour(config, table);
    let words = match (config.sky, &config.camera.frames) {
        (SkyKind::Replay, Some(frames)) => {
            let camera = ReplayCamera::open(frames, false);
            let words = format!("frames from {}", frames.display());
            if let Some(mut camera) = table.add("camera", camera.map(|camera| (camera, words))) {
                let CameraLimits { width, height, .. } = camera.limits();
                lens::fits(lens.as_ref(), (width, height), "name the lens of these frames in camera.lens", table);
                let series = camera.series();
                agreement::exposures(config, lens.as_ref(), (&mut camera, &series), agreement::RECORDED, table);
            }
            return;
        }
        (SkyKind::Logged, _) => {
            let log = config.camera.light_log.as_deref().unwrap_or(&config.file);
            let opened = crate::lightlog::LightLogReader::open(log);
            table.add("light", opened.map(|_| ((), format!("light from {}", log.display()))));
            return;
        }
        #[cfg(feature = "board")]
        (SkyKind::Camera, _) => return machine::camera(config, lens.as_ref(), table),
        #[cfg(not(feature = "board"))]
        (SkyKind::Camera, _) => {
            table.add("camera", Err::<((), String), _>(super::run::no_drivers(config, "sky = \"camera\"")));
            return;
        }
        (SkyKind::Simulated, _) => "simulated from time and place",
        _ => "a simulated camera",
    };
    table.add("sky", Ok::<_, String>(((), words.to_string())));
}

fn colour(config: &Config, table: &mut Table) {
    let has_camera = matches!(config.sky, SkyKind::Synthetic | SkyKind::Replay | SkyKind::Camera);
    let found = match &config.camera.colour {
        Some(path) => CameraColour::load(path).map(|_| format!("{} tells the camera's colours", path.display())),
        None if has_camera => Ok("no camera.colour: the camera's colours are taken for Rec.709".into()),
        None => return,
    };
    table.add("colour", found.map(|words| ((), words)));
}

fn display(config: &Config, picture: (usize, usize), table: &mut Table) {
    let failed: Failure = match &config.display {
        DisplayConfig::Headless { folder, every } => match Headless::open(folder, *every, picture) {
            Ok(_) => return table.say("display", format!("pictures go to {}", folder.display())),
            Err(error) => error.into(),
        },
        #[cfg(feature = "board")]
        DisplayConfig::Kms(screen) => match crate::display::kms::Kms::open(screen, picture) {
            Ok(display) => return machine::screen(display.outlook(), table),
            Err(error) => error.into(),
        },
        #[cfg(not(feature = "board"))]
        DisplayConfig::Kms(_) => super::run::no_drivers(config, "display.kind = \"kms\""),
    };
    table.add("display", Err::<((), String), _>(failed));
}
