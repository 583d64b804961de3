//! Input that cannot be used, through the programs: exit code 2 (1 where the disk fills up), one line that names what is
//! at fault, no panic, and no file left behind.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, names, put};
use relume_tests::picture::write_exr;
use relume_tests::program::{bake_in, relume_in};
use relume_tests::scene::{
    Picture, checks_png, courtyard, cuboid, empty_glb, glb, ground, write_courtyard, write_gltf,
};
use relume_tests::skip::{is_root, skip};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// A folder of its own for a test, with the courtyard, its camera and its field.
fn folder(name: &str) -> PathBuf {
    static FIELD: OnceLock<Vec<u8>> = OnceLock::new();
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), &format!("bad-{name}"));
    write_courtyard(&folder);
    let field = FIELD.get_or_init(|| {
        bake_in(&folder, &bake("scene.glb", "camera.json", "20x12", "a.field")).well();
        std::fs::read(folder.join("a.field")).unwrap()
    });
    put(&folder.join("a.field"), field);
    folder
}

fn bake<'a>(scene: &'a str, camera: &'a str, size: &'a str, out: &'a str) -> Vec<&'a str> {
    vec!["scene", scene, "--camera", camera, "--size", size, "--directions", "16", "-o", out]
}

/// Bakes and expects a refusal that leaves nothing behind.
fn bake_refused(folder: &Path, args: &[&str], code: i32, parts: &[&str]) {
    let before = names(folder);
    bake_in(folder, args).refused(code, parts);
    assert_eq!(names(folder), before, "{args:?}");
}

/// Runs `relume` and expects a refusal that leaves nothing behind.
fn relume_refused(folder: &Path, args: &[&str], code: i32, parts: &[&str]) {
    let before = names(folder);
    relume_in(folder, args).refused(code, parts);
    assert_eq!(names(folder), before, "{args:?}");
}

#[test]
fn sky_pixels_that_are_no_light() {
    let folder = folder("pixels");
    for (name, value) in
        [("nan.exr", f32::NAN), ("minus.exr", -1.0), ("inf.exr", f32::INFINITY), ("-inf.exr", -f32::INFINITY)]
    {
        write_exr(&folder.join(name), (64, 32), |x, y| [1.0, if (x, y) == (41, 7) { value } else { 0.5 }, 0.2]);
        let path = format!("./{name}");
        relume_refused(&folder, &["relight", "a.field", "--sky", &path, "-o", "o.exr"], 2, &[name, "41", "7"]);
        relume_refused(&folder, &["relight", "a.field", "--sky", &path, "-o", "o.png"], 2, &[name]);
        relume_refused(&folder, &["sky", "weights", &path, "--field", "a.field", "-o", "w.csv"], 2, &[name]);
    }
}

#[test]
fn maps_that_are_no_maps() {
    let folder = folder("maps");
    for (name, size) in [("square.exr", (32, 32)), ("narrow.exr", (30, 60)), ("tiny.exr", (2, 1))] {
        write_exr(&folder.join(name), size, |_, _| [1.0; 3]);
        let shape = format!("{}x{}", size.0, size.1);
        relume_refused(&folder, &["relight", "a.field", "--sky", name, "-o", "o.exr"], 2, &[name, &shape]);
    }
    write_exr(&folder.join("whole.exr"), (64, 32), |_, _| [1.0; 3]);
    let whole = std::fs::read(folder.join("whole.exr")).unwrap();
    put(&folder.join("cut.exr"), &whole[..whole.len() / 2]);
    put(&folder.join("text.hdr"), "no picture at all");
    put(&folder.join("empty.hdr"), "");
    for name in ["cut.exr", "text.hdr", "empty.hdr", "nowhere.hdr"] {
        relume_refused(&folder, &["relight", "a.field", "--sky", name, "-o", "o.exr"], 2, &[name]);
    }
}

#[test]
fn weights_that_are_no_weights() {
    let folder = folder("weights");
    let rows = |row: &str, count: usize| format!("{row}\n").repeat(count);
    for (name, text) in [
        ("few.csv", rows("1 1 1", 3)),
        ("many.csv", rows("1 1 1", 18)),
        ("nan.csv", rows("1 NaN 1", 17)),
        ("minus.csv", rows("1 1 -1", 17)),
        ("words.csv", rows("all is light", 17)),
        ("huge.csv", rows("1e999 1 1", 17)),
        ("empty.csv", String::new()),
    ] {
        put(&folder.join(name), text);
        relume_refused(&folder, &["relight", "a.field", "--weights", name, "-o", "o.exr"], 2, &[name]);
    }
    put(&folder.join("binary.csv"), [0xff, 0xfe, 0, 1]);
    relume_refused(&folder, &["relight", "a.field", "--weights", "binary.csv", "-o", "o.exr"], 2, &["binary.csv"]);
}

#[test]
fn scenes_without_anything_to_see() {
    let folder = folder("scenes");
    put(&folder.join("empty.glb"), empty_glb());
    bake_refused(&folder, &bake("empty.glb", "camera.json", "20x12", "o.field"), 2, &["empty.glb", "no triangles"]);
    let mut broken = ground(3.0, 0.0, [0.5; 3]);
    broken.positions[2][1] = f32::NAN;
    put(&folder.join("nan.glb"), glb(&[cuboid([-1.0; 3], [1.0; 3], [0.5; 3]), broken.clone()], None));
    bake_refused(&folder, &bake("nan.glb", "camera.json", "20x12", "o.field"), 2, &["nan.glb", "vertex"]);
    broken.positions[2][1] = f32::INFINITY;
    put(&folder.join("inf.glb"), glb(&[broken], None));
    bake_refused(&folder, &bake("inf.glb", "camera.json", "20x12", "o.field"), 2, &["inf.glb", "vertex"]);
    let whole = glb(&courtyard(), Some(Picture::Inside(&checks_png())));
    put(&folder.join("cut.glb"), &whole[..whole.len() / 2]);
    put(&folder.join("text.glb"), "no scene at all");
    for name in ["cut.glb", "text.glb", "nowhere.glb"] {
        bake_refused(&folder, &bake(name, "camera.json", "20x12", "o.field"), 2, &[name]);
    }
}

#[test]
fn a_texture_that_is_missing_or_broken() {
    let folder = folder("texture");
    write_gltf(&folder, &courtyard(), Some(Picture::Beside("bricks.png")));
    bake_refused(&folder, &bake("scene.gltf", "camera.json", "20x12", "o.field"), 2, &["scene.gltf", "bricks.png"]);
    put(&folder.join("bricks.png"), &checks_png()[..60]);
    bake_refused(&folder, &bake("scene.gltf", "camera.json", "20x12", "o.field"), 2, &["scene.gltf", "image"]);
    // The same scene with the same picture, whole, is a scene.
    put(&folder.join("bricks.png"), checks_png());
    bake_in(&folder, &bake("scene.gltf", "camera.json", "20x12", "o.field")).well();
    let [inside, beside] = ["a.field", "o.field"].map(|name| std::fs::read(folder.join(name)).unwrap());
    assert!(inside == beside, "a texture in the file and one beside it bake differently");
    std::fs::remove_file(folder.join("o.field")).unwrap();
    std::fs::remove_file(folder.join("scene.bin")).unwrap();
    bake_refused(&folder, &bake("scene.gltf", "camera.json", "20x12", "o.field"), 2, &["scene.gltf", "scene.bin"]);
}

#[test]
fn cameras_that_see_nothing_of_it() {
    let folder = folder("cameras");
    let cameras = [
        ("buried.json", r#"{"position":[1,0.8,-0.4],"target":[0,0.8,0],"up":[0,1,0],"fov_y_deg":45}"#, "inside a wall"),
        ("away.json", r#"{"position":[0,3,6],"target":[0,9,9],"up":[0,1,0],"fov_y_deg":20}"#, "sees nothing"),
        ("nan.json", r#"{"position":[0,1e999,6],"target":[0,9,9],"up":[0,1,0],"fov_y_deg":20}"#, "nan.json"),
        ("flat.json", r#"{"position":[0,3,6],"target":[0,0,0],"up":[0,1,0],"fov_y_deg":0}"#, "fov_y_deg"),
        ("wide.json", r#"{"position":[0,3,6],"target":[0,0,0],"up":[0,1,0],"fov_y_deg":180}"#, "fov_y_deg"),
        ("same.json", r#"{"position":[0,3,6],"target":[0,3,6],"up":[0,1,0],"fov_y_deg":45}"#, "target"),
        ("up.json", r#"{"position":[0,3,6],"target":[0,3,0],"up":[0,0,1],"fov_y_deg":45}"#, "up"),
        ("key.json", r#"{"position":[0,3,6],"target":[0,3,0],"fov_y_deg":45,"fovy":45}"#, "fovy"),
        ("text.json", "a camera", "text.json"),
    ];
    for (name, text, part) in cameras {
        put(&folder.join(name), text);
        bake_refused(&folder, &bake("scene.glb", name, "20x12", "o.field"), 2, &[name, part]);
    }
    bake_refused(&folder, &bake("scene.glb", "nowhere.json", "20x12", "o.field"), 2, &["nowhere.json"]);
}

#[test]
fn sizes_and_numbers_out_of_range() {
    let folder = folder("numbers");
    for size in ["0x12", "20x0", "0x0", "20", "20x-1", "axb", "99999999999x2", "20000x2", ""] {
        bake_refused(&folder, &bake("scene.glb", "camera.json", size, "o.field"), 2, &["size"]);
    }
    let bad = |more: &[&str], part: &str| {
        bake_refused(&folder, &[&bake("scene.glb", "camera.json", "20x12", "o.field")[..], more].concat(), 2, &[part]);
    };
    bad(&["--directions", "0"], "--directions");
    bad(&["--directions", "5000"], "--directions");
    bad(&["--max-hits", "-1"], "--max-hits");
    bad(&["--materials", "velvet"], "velvet");
    bad(&["--site", "91,0"], "--site");
    bad(&["--site", "nan,0"], "--site");
    bad(&["--sun", "10,20"], "--stack");
    bad(&["--stack", "s", "--sun", "10,91"], "--sun");
    bad(&["--error", "0%"], "--error");
    bad(&["--test-sky", "no/such/sky.hdr"], "no/such/sky.hdr");
    bad(&["--frobnicate"], "frobnicate");
    for light in ["0,-1,0", "0,0,0", "nan,1,0", "1,2", "a,b,c"] {
        relume_refused(&folder, &["relight", "a.field", "--light", light, "-o", "o.exr"], 2, &["--light"]);
    }
    relume_refused(&folder, &["relight", "a.field", "-o", "o.exr"], 2, &["--sky"]);
    relume_refused(&folder, &["relight", "a.field", "--light", "0,1,0", "-o", "o.jpg"], 2, &["o.jpg"]);
}

#[test]
fn views_of_another_size_and_stacks_of_another_bake() {
    let folder = folder("views");
    image::RgbImage::new(30, 12).save(folder.join("wide.png")).unwrap();
    put(&folder.join("text.png"), "no picture");
    for name in ["wide.png", "text.png", "nowhere.png"] {
        relume_refused(&folder, &["relight", "a.field", "--light", "0,1,0", "--view", name, "-o", "o.png"], 2, &[name]);
    }
    let mut other = bake("scene.glb", "camera.json", "24x12", "b.field");
    other.extend(["--stack", "stack"]);
    bake_in(&folder, &other).well();
    let exact = ["relight", "a.field", "--weights", "w.csv", "--exact", "stack", "-o", "o.exr"];
    put(&folder.join("w.csv"), "1 1 1\n".repeat(17));
    relume_refused(&folder, &exact, 2, &["stack", "24x12", "20x12"]);
    std::fs::remove_file(folder.join("stack/patch_003.exr")).unwrap();
    let exact = ["relight", "b.field", "--weights", "w.csv", "--exact", "stack", "-o", "o.exr"];
    relume_refused(&folder, &exact, 2, &["patch_003.exr"]);
    std::fs::remove_file(folder.join("stack/manifest.toml")).unwrap();
    relume_refused(&folder, &exact, 2, &["manifest.toml"]);
    // A folder of other things is never turned into a stack.
    let mut foreign = bake("scene.glb", "camera.json", "20x12", "c.field");
    foreign.extend(["--stack", "."]);
    bake_refused(&folder, &foreign, 2, &["not a stack"]);
}

#[test]
fn output_folders_that_do_not_exist() {
    let folder = folder("missing");
    let light = ["relight", "a.field", "--light", "0,1,0", "-o"];
    bake_refused(&folder, &bake("scene.glb", "camera.json", "20x12", "no/o.field"), 2, &["no/o.field"]);
    relume_refused(&folder, &[&light[..], &["no/o.exr"]].concat(), 2, &["no/o.exr"]);
    relume_refused(&folder, &[&light[..], &["no/o.png"]].concat(), 2, &["no/o.png"]);
    let mut stack = bake("scene.glb", "camera.json", "20x12", "o.field");
    stack.extend(["--stack", "no/stack"]);
    bake_refused(&folder, &stack, 2, &["no/stack"]);
}

#[test]
fn output_folders_that_are_read_only() {
    let folder = folder("read-only");
    // Root passes every permission; /proc refuses new files even to root.
    let mut places = vec![PathBuf::from("/proc")];
    if !is_root() {
        let locked = folder.join("locked");
        std::fs::create_dir(&locked).unwrap();
        std::fs::set_permissions(&locked, std::os::unix::fs::PermissionsExt::from_mode(0o555)).unwrap();
        places.push(locked);
    }
    let mounted = ReadOnly::mount(&folder);
    places.extend(mounted.iter().map(|m| m.0.clone()));
    for place in &places {
        let out = |name: &str| place.join(name).display().to_string();
        bake_refused(&folder, &bake("scene.glb", "camera.json", "20x12", &out("o.field")), 2, &["o.field"]);
        relume_refused(&folder, &["relight", "a.field", "--light", "0,1,0", "-o", &out("o.exr")], 2, &["o.exr"]);
        relume_refused(&folder, &["relight", "a.field", "--light", "0,1,0", "-o", &out("o.png")], 2, &["o.png"]);
        let stack = out("stack");
        let mut args = bake("scene.glb", "camera.json", "20x12", "o.field");
        args.extend(["--stack", &stack]);
        bake_refused(&folder, &args, 2, &["stack"]);
        relume_refused(&folder, &["demo", "--out", &out("demo")], 2, &["demo"]);
    }
}

/// A small file system, taken away again at the end.
struct Mounted(PathBuf);

impl Mounted {
    fn new(folder: &Path, name: &str, options: &str) -> Option<Self> {
        let place = folder.join(name);
        std::fs::create_dir_all(&place).unwrap();
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(&place);
        let done = mount.output().is_ok_and(|out| out.status.success());
        if done { Some(Mounted(place)) } else { None }
    }
}

impl Drop for Mounted {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(&self.0).output();
    }
}

struct ReadOnly;

impl ReadOnly {
    fn mount(folder: &Path) -> Option<Mounted> {
        Mounted::new(folder, "mounted", "ro,size=64k")
    }
}

#[test]
fn disks_that_fill_up() {
    let folder = folder("full");
    let Some(small) = Mounted::new(&folder, "small", "size=8k") else {
        return skip("a full disk", "only root may mount a small file system");
    };
    let out = |name: &str| small.0.join(name).display().to_string();
    let left = |what: &str| assert!(names(&small.0).is_empty(), "{what} left {:?}", names(&small.0));
    bake_refused(&folder, &bake("scene.glb", "camera.json", "64x48", &out("o.field")), 1, &["o.field", "full"]);
    left("a field");
    let mut args = bake("scene.glb", "camera.json", "64x48", "o.field");
    let stack = out("stack");
    args.extend(["--stack", &stack]);
    bake_refused(&folder, &args, 1, &["stack"]);
    left("a stack");
    // A picture with noise does not pack into 8 KiB.
    bake_in(&folder, &bake("scene.glb", "camera.json", "64x48", "big.field")).well();
    put(&folder.join("w.csv"), "1 0.7 0.4\n".repeat(17));
    relume_refused(
        &folder,
        &["relight", "big.field", "--weights", "w.csv", "-o", &out("o.exr")],
        1,
        &["o.exr", "full"],
    );
    left("an EXR");
    put(&folder.join("camera.toml"), post("").replace("simulated", "synthetic"));
    let args = ["sky", "capture", "camera.toml", "--series", "3", "-o", &out("frames")];
    relume_refused(&folder, &args, 1, &["00000.png", "full"]);
    left("a recording");
    write_exr(&folder.join("sky.exr"), (64, 32), |x, y| [x as f32, y as f32, 1.0]);
    let filler = small.0.join("filler");
    put(&filler, [0u8; 8192]);
    relume_refused(&folder, &["relight", "a.field", "--light", "0,1,0", "-o", &out("o.png")], 1, &["o.png", "full"]);
    relume_refused(
        &folder,
        &["sky", "weights", "sky.exr", "--field", "a.field", "-o", &out("w.csv")],
        1,
        &["w.csv", "full"],
    );
    assert_eq!(names(&small.0), ["filler"]);
}

#[test]
fn a_device_that_is_full() {
    let folder = folder("device");
    bake_refused(&folder, &bake("scene.glb", "camera.json", "20x12", "/dev/full"), 1, &["/dev/full", "full"]);
}

fn post(more: &str) -> String {
    format!(
        "field = 'a.field'\nsky = 'simulated'\n[site]\nlatitude = 41.9\nlongitude = 12.5\n\
         [display]\nkind = 'headless'\nfolder = 'pictures'\n[run]\nstart = 2026-06-21T10:00:00Z\nframes = 1\n{more}"
    )
}

#[test]
fn posts_with_unknown_or_wrong_keys() {
    let folder = folder("post");
    for (name, text, parts) in [
        ("key.toml", post("framez = 3"), ["framez", "frames"]),
        ("table.toml", post("[wether]\nseed = 1"), ["wether", "weather"]),
        ("range.toml", post("[weather]\ncloud_cover = 1.5"), ["cloud_cover", "1.5"]),
        ("type.toml", post("step_s = 'long'"), ["step_s", "type.toml"]),
        ("field.toml", post("").replace("a.field", "none.field"), ["none.field", ""]),
        ("sky.toml", post("").replace("simulated", "stimulated"), ["stimulated", "simulated"]),
        ("site.toml", post("").replace("41.9", "141.9"), ["latitude", "141.9"]),
        ("folder.toml", post("").replace("pictures", "no/such"), ["no/such", ""]),
        ("text.toml", "a post".into(), ["text.toml", ""]),
    ] {
        put(&folder.join(name), text);
        relume_refused(&folder, &["run", name], 2, &parts);
        let checked = relume_in(&folder, &["check", name]);
        checked.refused(2, &[name]);
        let told = format!("{}{}", checked.stdout, checked.stderr);
        assert!(told.contains(parts[0]) && told.contains(parts[1]), "{told}");
    }
    relume_refused(&folder, &["run", "nowhere.toml"], 2, &["nowhere.toml"]);
}
