use super::*;

const LEAST: &str = "field = 'a.field'\nsky = 'simulated'\n[site]\nlatitude = 41.9\nlongitude = 12.5\n\
                     [display]\nkind = 'headless'\nfolder = 'out'\n";

fn load(text: &str) -> Result<Config, String> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("POST.toml");
    std::fs::write(&file, text).unwrap();
    Config::load(&file).map_err(|e| {
        let text = e.to_string();
        assert!(!text.contains('\n'), "{text}");
        assert!(text.contains("POST.toml: "), "{text}");
        text
    })
}

fn refused(text: &str, parts: &[&str]) {
    let error = load(text).unwrap_err();
    assert!(parts.iter().all(|part| error.contains(part)), "{error} lacks one of {parts:?}");
}

#[test]
fn the_least_file_has_sensible_defaults() {
    let config = load(LEAST).unwrap();
    assert_eq!(config.clock, ClockConfig::System { interval_s: 1.0 });
    assert_eq!(config.exposure, ExposureMode::Auto);
    assert!(config.field.is_absolute() && config.field.ends_with("a.field"), "relative to the file");
    assert!(config.health.ends_with("out/health.json"));
}

#[test]
fn a_screen_is_asked_for_by_socket_mode_and_rotation() {
    let kms = LEAST.replace("kind = 'headless'\nfolder = 'out'", "kind = 'kms'");
    let config = load(&kms).unwrap();
    assert_eq!(config.display, DisplayConfig::Kms(Default::default()));
    assert_eq!(config.clock, ClockConfig::System { interval_s: 1.0 / 30.0 });
    assert!(config.health.ends_with("health.json"));
    let config = load(&format!("{kms}connector = 'HDMI-A-1'\nmode = '1920x1080@60'\nrotation_deg = 90\n")).unwrap();
    let DisplayConfig::Kms(screen) = config.display else { panic!("{:?}", config.display) };
    assert_eq!(screen.mode.unwrap().to_string(), "1920x1080@60");
    assert_eq!(screen.rotation, crate::display::config::Rotation::Quarter);
    let DisplayConfig::Kms(legacy) = load(&format!("{kms}modesetting = 'legacy'\n")).unwrap().display else { panic!() };
    assert_eq!(
        (screen.modesetting, legacy.modesetting),
        (crate::display::config::Modesetting::Auto, crate::display::config::Modesetting::Legacy)
    );
    refused(&format!("{kms}rotation_deg = 45\n"), &["display.rotation_deg = 45", "0, 90, 180 or 270"]);
    refused(&format!("{kms}mode = 'big'\n"), &["display.mode = \"big\"", "1920x1080"]);
    refused(&format!("{kms}folder = 'out'\n"), &["display.folder", "\"kms\""]);
    refused(&format!("{LEAST}mode = '1x1'\n"), &["display.mode", "\"headless\""]);
}

#[test]
fn a_view_is_a_still_a_camera_or_pictures_in_turn() {
    let with = |keys: &str| format!("view = 's.png'\n{LEAST}[view_camera]\n{keys}");
    assert_eq!(load(LEAST).unwrap().view_camera, None);
    let config = load(&with("device = '/dev/video2'\nsize = '1280x720'\n")).unwrap();
    let (device, size) = ("/dev/video2".to_string(), Some((1280, 720)));
    assert_eq!(config.view_camera, Some(ViewCamera::Device { device, size, pixel_format: None }));
    assert!(config.view.is_some_and(|still| still.ends_with("s.png")), "it stands until the camera's first picture");
    let config = load(&with("frames = 'pictures'\n")).unwrap();
    assert!(matches!(config.view_camera, Some(ViewCamera::Frames(folder)) if folder.ends_with("pictures")));
    let both =
        load(&format!("view_response = 's.csv'\n{}", with("frames = 'pictures'\nresponse = 'c.csv'\n"))).unwrap();
    let ends = |path: Option<PathBuf>, name: &str| path.is_some_and(|path| path.ends_with(name));
    assert!(ends(both.view_response, "s.csv") && ends(both.view_camera_response, "c.csv"));
    refused(&format!("view_response = 's.csv'\n{LEAST}"), &["view_response", "view_camera.response"]);
    refused(&with(""), &["view_camera.device is missing", "relume devices"]);
    refused(&with("device = 'a'\nframes = 'b'\n"), &["exclude each other"]);
    refused(&with("frames = 'b'\nsize = '4x3'\n"), &["view_camera.size is only used with view_camera.device"]);
    refused(&with("device = 'a'\nsize = 'large'\n"), &["view_camera.size = \"large\"", "1280x960"]);
    let sky = "[camera]\ndevice = 'a'\nlens = 'l'\n";
    let both = with(&format!("device = 'a'\n{sky}")).replace("simulated", "camera");
    refused(&both, &["view_camera.device = \"a\"", "the sky camera"]);
}

#[test]
fn a_raw_sensor_names_the_node_of_its_controls() {
    let camera = "[camera]\ndevice = '/dev/video0'\nlens = 'l.json'\ncontrols = '/dev/v4l-subdev0'\n";
    let config = load(&format!("{}{camera}", LEAST.replace("simulated", "camera"))).unwrap();
    assert_eq!(config.camera.controls.as_deref(), Some("/dev/v4l-subdev0"));
    #[cfg(feature = "board")]
    {
        let settings = crate::sky_source::live::v4l2_settings(&config).unwrap();
        assert_eq!((settings.device.as_str(), settings.controls), ("/dev/video0", config.camera.controls));
    }
    let replay =
        format!("{}[camera]\nframes = 'f'\nlens = 'l'\ncontrols = 'c'\n", LEAST.replace("simulated", "replay"));
    refused(&replay, &["camera.controls is only used with sky = \"camera\""]);
}

#[test]
fn unknown_keys_are_refused_with_the_nearest_name() {
    refused(&LEAST.replace("latitude", "latitute"), &["unknown key site.latitute", "did you mean site.latitude?"]);
    refused(&format!("titel = 'x'\n{LEAST}"), &["unknown key titel", "did you mean title?"]);
    // A key in the wrong table is told where it belongs.
    refused(&format!("turbidity = 3\n{LEAST}"), &["unknown key turbidity", "did you mean weather.turbidity?"]);
    refused(&format!("{LEAST}[wether]\nx = 1\n"), &["unknown key wether"]);
    refused(&format!("run = 3\n{LEAST}"), &["run must be a table", "[run]"]);
}

#[test]
fn values_out_of_range_name_key_value_and_range() {
    refused(&LEAST.replace("41.9", "95"), &["site.latitude = 95", "from -90 to 90"]);
    refused(&LEAST.replace("41.9", "nan"), &["site.latitude = nan", "from -90 to 90"]);
    refused(&LEAST.replace("41.9", "'north'"), &["site.latitude = \"north\"", "a number"]);
    refused(&LEAST.replace("'simulated'", "'sumilated'"), &["sky = \"sumilated\"", "\"simulated\", \"synthetic\""]);
    refused(&format!("{LEAST}[run]\nframes = 0\n"), &["run.frames = 0", "from 1 to"]);
    refused(&format!("{LEAST}[run]\nframes = -1\n"), &["run.frames = -1"]);
    refused(&format!("{LEAST}[run]\nstart = 2026-06-21T04:00:00\n"), &["run.start", "offset"]);
}

#[test]
fn missing_and_contradicting_keys_are_named() {
    refused("sky = 'simulated'\n[display]\nkind = 'headless'\nfolder = 'o'\n", &["field is missing"]);
    refused(&LEAST.replace("latitude = 41.9\n", ""), &["site.latitude is missing"]);
    refused(&LEAST.replace("simulated", "replay"), &["camera.frames is missing", "frames.json"]);
    refused(
        &format!("{}[camera]\nframes = 'f'\n", LEAST.replace("simulated", "replay")),
        &["camera.lens is missing", "replay"],
    );
    refused(&format!("{LEAST}[camera]\nlens = 'l.json'\n"), &["no camera"]);
    refused(&format!("{LEAST}[exposure]\nev = 2\n"), &["exposure.ev"]);
    refused(&format!("{LEAST}[run]\nspeed = 2\n"), &["run.start"]);
    refused("field = 'a'\nfield = 'b'\n", &["line 2", "not valid TOML"]);
    let error = Config::load(Path::new("none/POST.toml")).unwrap_err().to_string();
    assert!(error.starts_with("none/POST.toml: cannot be read"), "{error}");
}

#[test]
fn what_is_behind_the_picture_is_one_thing() {
    let view = |keys: &str, tables: &str| format!("{keys}\n{LEAST}{tables}");
    refused(&view("view_light = 'w.csv'", ""), &["view_light", "view = "]);
    let camera = "[view_camera]\nframes = 'f'\n";
    refused(&view("view = 'a.png'\nview_light = 'w.csv'", camera), &["view_light", "remove it"]);
    refused(&view("", "[exposure]\nmode = 'view'\n"), &["exposure.mode = \"view\" needs a view"]);
    refused(&view("view = 'a.png'\nview_light = 'w.csv'", "[exposure]\nmode = 'view'\n"), &["exclude each other"]);
    assert_eq!(load(&view("", &format!("{camera}[exposure]\nmode = 'view'\n"))).unwrap().exposure, ExposureMode::View);
}

#[test]
fn a_display_that_is_looked_through_has_no_view_and_a_fixed_exposure() {
    let least = LEAST.replace("kind = 'headless'", "kind = 'headless'\nmode = 'additive'");
    assert_ne!(least, LEAST);
    let fixed = "[exposure]\nmode = 'fixed'\nev = -3\n";
    let config = load(&format!("{least}{fixed}")).unwrap();
    assert!(config.additive && !load(LEAST).unwrap().additive);
    refused(&least, &["exposure.mode", "\"fixed\"", "additive"]);
    refused(&format!("view = 'a.png'\n{least}{fixed}"), &["view is not used", "additive"]);
    refused(&least.replace("additive", "640x480"), &["display.mode is not used"]);
    let screen = LEAST.replace("kind = 'headless'\nfolder = 'out'", "kind = 'kms'\nmode = '1280x720@60 additive'");
    let DisplayConfig::Kms(kms) = load(&format!("{screen}{fixed}")).unwrap().display else { panic!("{screen}") };
    assert_eq!(kms.mode.map(|mode| (mode.width, mode.height)), Some((1280, 720)));
}

#[test]
fn both_forms_of_time_are_taken() {
    for start in ["2026-06-21T06:00:00+02:00", "'2026-06-21T04:00:00Z'"] {
        let config = load(&format!("{LEAST}[run]\nstart = {start}\nstep_s = 600\n")).unwrap();
        let start_unix_s = 1_782_014_400.0;
        assert_eq!(config.clock, ClockConfig::Simulated { start_unix_s, step_s: 600.0, speed: None });
    }
}

#[test]
fn the_documented_example_parses_and_shows_every_key() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("POST.toml");
    Config::load(&file).unwrap();
    let text = std::fs::read_to_string(&file).unwrap();
    let mut table = String::new();
    let mut shown = Vec::new();
    for line in text.lines() {
        let line = line.trim_start_matches('#').trim();
        if let Some(name) = line.strip_prefix('[').and_then(|l| l.split(']').next()) {
            table = format!("{name}.");
        } else if let Some((key, _)) = line.split_once(" = ") {
            shown.push(format!("{table}{key}"));
        }
    }
    for key in KEYS {
        assert!(shown.iter().any(|s| s == key), "{key} is not documented in POST.toml");
    }
}

#[test]
fn the_documented_colour_file_is_known_and_a_lens_may_be_yet_to_come() {
    let camera = LEAST.replace("simulated", "camera") + "[camera]\ndevice = '/dev/video0'\ncolour = 'camera.json'\n";
    refused(&camera, &["camera.lens is missing"]);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("POST.toml");
    std::fs::write(&file, &camera).unwrap();
    let config = Config::load_uncalibrated(&file).unwrap();
    assert!(config.camera.lens.is_none() && config.camera.colour.unwrap().ends_with("camera.json"));
    std::fs::write(&file, camera.replace("device = '/dev/video0'\n", "")).unwrap();
    let error = Config::load_uncalibrated(&file).unwrap_err().to_string();
    assert!(error.contains("camera.device is missing"), "{error}");
}
