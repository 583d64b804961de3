//! The C library as a display maker has it: built and installed by `firmware/capi/install`, compiled against by gcc,
//! linked shared and static, its pictures compared with the program's.
//!
//! For another processor under emulation, `tests/run` names in the environment `RELUME_CAPI_TARGET` (Rust's name of the
//! target), `RELUME_CAPI_CROSS` (what its gcc's name begins with), `RELUME_CAPI_RUSTC` (a Rust compiler that has it) and `RELUME_CAPI_RUNNER` (the
//! emulator's command).

#![allow(clippy::unwrap_used)]

#[path = "capi/field.rs"]
mod field;

use field::{bare_bytes, bare_field, coverage, field, folder, light};
use relume::relight::{Budget, FrameCounters, Framebuffer, Relighter, View};
use relume_firmware::field::Field;
use relume_tests::files::{fresh_folder, names, put};
use relume_tests::program::{Outcome, relume_in, run};
use relume_tests::skip::skip;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

fn setting(name: &str, otherwise: &str) -> String {
    std::env::var(name).unwrap_or_else(|_| otherwise.to_owned())
}

/// A tool of the C compiler for the target: `aarch64-linux-gnu-` has an `aarch64-linux-gnu-nm`.
fn tool(name: &str) -> Command {
    Command::new(setting("RELUME_CAPI_CROSS", "") + name)
}

/// Where the library is installed.
fn installed() -> &'static Path {
    static PREFIX: OnceLock<PathBuf> = OnceLock::new();
    PREFIX.get_or_init(|| {
        let prefix = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "capi-installed");
        run(install().arg(&prefix)).well();
        prefix
    })
}

/// The installing script for the target.
fn install() -> Command {
    let target_dir = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let mut install = Command::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../firmware/capi/install"));
    install.env_remove("DESTDIR").env_remove("TARGET").env("CARGO_TARGET_DIR", target_dir);
    if let Ok(target) = std::env::var("RELUME_CAPI_TARGET") {
        install.env("TARGET", &target).env("CROSS_COMPILE", setting("RELUME_CAPI_CROSS", ""));
        // Two compilers would drop each other's files from one folder.
        install.env("CARGO_TARGET_DIR", target_dir.join("capi-cross"));
    }
    if let Ok(rustc) = std::env::var("RELUME_CAPI_RUSTC") {
        install.env("RUSTC", rustc);
    }
    install
}

/// Compiles C files as strictly as gcc can; `link` is what they are linked with.
fn compile(name: &str, sources: &[&str], link: &[&str]) -> PathBuf {
    let program = fresh_folder(env!("CARGO_TARGET_TMPDIR"), &format!("capi-{name}")).join(name);
    let mut command = tool("gcc");
    command.args(["-std=c11", "-D_POSIX_C_SOURCE=200809L", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]);
    command.current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).arg("-o").arg(&program);
    command.args(sources).arg("-I").arg(installed().join("include"));
    run(command.args(link).args(["-lm", "-pthread"])).well();
    program
}

fn shared(name: &str, sources: &[&str]) -> PathBuf {
    compile(name, sources, &[&format!("-L{}", installed().join("lib").display()), "-lrelume"])
}

/// Runs a compiled program, under the emulator if there is one.
fn started(program: &Path, args: &[&str]) -> Outcome {
    let runner = setting("RELUME_CAPI_RUNNER", "");
    let mut words = runner.split_whitespace().map(PathBuf::from).chain([program.to_owned()]);
    let mut command = Command::new(words.next().unwrap());
    command.args(words).args(args).env("LD_LIBRARY_PATH", installed().join("lib"));
    run(command.current_dir(folder()))
}

const CHECK: [&str; 4] = [
    "tests/tests/capi/check.c",
    "tests/tests/capi/errors.c",
    "tests/tests/capi/frames.c",
    "tests/tests/capi/threads.c",
];

/// The checks in C, linked to the shared library.
fn check() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| shared("check", &CHECK))
}

/// What the program shows of a light, over `check.c`'s view or black, and how right that is.
fn shown_of(field: Field<'_>, seed: usize, with_view: bool) -> (Vec<u32>, FrameCounters) {
    let (width, height) = (field.width(), field.height());
    let mut relighter = Relighter::new(field, 1);
    relighter.set_weights(&light(seed), 0.5).unwrap();
    let view = (0..(width * height) as u32).map(|k| if with_view { (k * 7919) & 0xff_ffff } else { 0 }).collect();
    let mut framebuffer = Framebuffer::new(width, height);
    let counters = relighter.draw(&View::new(width, height, view), &mut framebuffer);
    (framebuffer.pixels, counters)
}

/// What the program shows of light 1.
fn shown(with_view: bool) -> Vec<u32> {
    shown_of(field(), 1, with_view).0
}

fn raw(name: &str) -> Vec<u8> {
    std::fs::read(folder().join("frames").join(name)).unwrap()
}

fn words(name: &str) -> Vec<u32> {
    raw(name).chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

/// Runs the checks of frames once; their pictures lie in `frames`.
fn frames() {
    static RUN: OnceLock<()> = OnceLock::new();
    RUN.get_or_init(|| {
        std::fs::create_dir(folder().join("frames")).unwrap();
        started(check(), &["frames", "a.field", "frames"]).well();
    });
}

fn channels(word: u32) -> [f64; 3] {
    [word >> 16 & 255, word >> 8 & 255, word & 255].map(f64::from)
}

#[test]
fn refuses_what_is_wrong_and_changes_nothing() {
    started(check(), &["errors", "a.field", "."]).well();
}

#[test]
fn skips_what_does_not_change_and_tells_what_does() {
    started(check(), &["skipping", "a.field", "."]).well();
}

#[test]
fn threads_show_what_one_thread_shows() {
    started(check(), &["threads", "a.field", "."]).well();
}

#[test]
fn shows_what_the_program_shows() {
    frames();
    for (name, with_view) in [("xrgb8888.raw", false), ("xrgb8888-view.raw", true)] {
        assert!(words(name) == shown(with_view), "{name} differs from the program's picture");
    }
    assert!(shown(true) != shown(false) && shown(false).iter().any(|&word| word != 0));
}

#[test]
fn patches_that_outshine_the_sky_are_shown_by_their_own_rows() {
    frames();
    let (exact, counters) = shown_of(field(), 4, true);
    assert!(counters.patches_apart > 0 && words("light-4.raw") == exact);
    assert!(shown_of(bare_field(), 4, true).0 != exact, "rows show something else than factors");
}

#[test]
fn bounds_are_those_of_the_program() {
    frames();
    for seed in [1, 4] {
        let counters = shown_of(field(), seed, true).1;
        let (linear, codes) = (counters.bound_linear.unwrap(), counters.bound_codes.unwrap());
        assert!(linear > 0.0 && codes > 0.55);
        let found = words(&format!("bound-{seed}.raw"));
        assert_eq!(found[0] as usize, counters.patches_apart);
        assert_eq!([found[1], found[2]].map(f32::from_bits), [linear, codes]);
    }
}

/// More of the field where a budget needs it, and less again: step by step the pictures and bounds of the program.
#[test]
fn error_budgets_are_kept_to_as_by_the_program() {
    frames();
    let (width, height) = (field().width(), field().height());
    let mut relighter = Relighter::new(field(), 1);
    relighter.set_budget(Budget::ErrorCodes(2.0)).unwrap();
    let (view, mut framebuffer) = (View::new(width, height, Vec::new()), Framebuffer::new(width, height));
    let (mut rounds, mut way_back) = (0, Vec::new());
    for (step, seed) in [1, 4, 4, 3, 1].into_iter().enumerate() {
        relighter.set_weights(&light(seed), 0.5).unwrap();
        let counters = relighter.draw(&view, &mut framebuffer);
        assert!(words(&format!("budget-{step}.raw")) == framebuffer.pixels, "step {step}");
        let found = words(&format!("budget-bound-{step}.raw"));
        let bound = [counters.bound_linear, counters.bound_codes].map(Option::unwrap);
        assert_eq!([found[1], found[2]].map(f32::from_bits), bound, "step {step}");
        rounds += found[0];
        way_back.push(counters.tiles_way_back);
    }
    assert!(rounds > 5 && way_back[0] > 0, "nothing was restored: {way_back:?}");
    let plain = shown_of(field(), 1, false).1.bound_codes.unwrap();
    assert!(plain > 2.0 && f32::from_bits(words("budget-bound-0.raw")[2]) < plain, "{plain}");
}

#[test]
fn a_field_without_bounds_and_rows_is_shown_without_them() {
    put(&folder().join("bare.field"), bare_bytes());
    std::fs::create_dir(folder().join("frames-bare")).unwrap();
    started(check(), &["frames", "bare.field", "frames-bare"]).well();
    let raw = |name: &str| std::fs::read(folder().join("frames-bare").join(name)).unwrap();
    let shown: Vec<u8> = shown_of(bare_field(), 4, true).0.into_iter().flat_map(u32::to_le_bytes).collect();
    assert!(raw("light-4.raw") == shown);
    let bound: Vec<u32> =
        raw("bound-4.raw").chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    assert!(bound[0] == 0 && bound[1..].iter().all(|&bits| f32::from_bits(bits).is_nan()));
}

#[test]
fn small_formats_hold_the_nearest_codes() {
    frames();
    let exact = shown(true);
    let small: Vec<u16> = raw("rgb565-view.raw").chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
    let wide = words("xrgb2101010-view.raw");
    assert_eq!((small.len(), wide.len()), (exact.len(), exact.len()));
    for ((word, small), wide) in exact.into_iter().zip(small).zip(wide) {
        let [r, g, b] = channels(word);
        let nearest = |code: f64, most: f64| (code / 255.0 * most).round() as u16;
        assert_eq!(small, nearest(r, 31.0) << 11 | nearest(g, 63.0) << 5 | nearest(b, 31.0), "{word:06x}");
        let ten = [wide >> 20 & 1023, wide >> 10 & 1023, wide & 1023].map(f64::from);
        assert!([r, g, b].iter().zip(ten).all(|(code, ten)| (code / 255.0 * 1023.0 - ten).abs() < 1.0), "{wide:08x}");
    }
}

#[test]
fn premultiplied_colours_blend_by_coverage() {
    frames();
    let mut relighter = Relighter::new(field(), 1);
    relighter.set_weights(&light(1), 0.5).unwrap();
    let (coverage, linear, premultiplied) = (coverage(), relighter.radiance().rgb, words("argb8888.raw"));
    let curve = |v: f64| if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    let mut edges = 0;
    for ((&alpha, linear), &word) in coverage.iter().zip(&linear).zip(&premultiplied) {
        assert_eq!(word >> 24, u32::from(alpha));
        let share = f64::from(alpha) / 255.0;
        for (code, linear) in channels(word).into_iter().zip(linear) {
            let colour = if alpha == 0 { 0.0 } else { 255.0 * curve((f64::from(*linear) * 0.5 / share).min(1.0)) };
            // The colour is rounded, then its share.
            let rounding = 0.5 * share + 0.5 + 0.05;
            assert!((code - share * colour).abs() <= rounding, "{code} instead of {} at {alpha}", share * colour);
        }
        edges += usize::from(alpha > 0 && alpha < 255);
    }
    assert!(edges > 10 && coverage.contains(&0) && coverage.contains(&255));
}

#[test]
fn facts_are_the_fields() {
    frames();
    let field = field();
    let (width, height) = (field.width(), field.height());
    let rows: Vec<u8> = raw("coverage.raw").chunks_exact(width + 3).flat_map(|row| row[..width].to_vec()).collect();
    assert_eq!(rows.len(), width * height);
    assert!(rows == coverage());
    assert!(raw("coverage.raw").chunks_exact(width + 3).all(|row| row[width..] == [0x5a; 3]));
    let floats = |name: &str| words(name).into_iter().map(f32::from_bits).collect::<Vec<f32>>();
    let set = field.patch_set();
    let cells = (0..set.len()).flat_map(|p| set.dir_world(p).into_iter().chain([set.solid_angle_sr(p)]));
    assert!(floats("patches.raw").into_iter().eq(cells));
    let covered = coverage().iter().filter(|&&share| share > 0).count() as u32;
    assert_eq!(words("info.raw")[..8], [70, 50, 4, 5, 3, 34, 32, covered]);
    let camera = [12.5, 45.0, 2.5, 2.6, 6.5, -0.4, 0.8, 0.0, 0.0, 1.0, 0.0];
    assert_eq!(floats("info.raw")[9..20], camera);
    assert!(floats("info.raw")[20..].iter().all(|site| site.is_nan()) && words("info.raw").len() == 22);
}

#[test]
fn the_example_shows_what_relume_relight_shows() {
    let weights = light(1);
    let sun = weights.sun.unwrap();
    assert_eq!(sun.dir_world.iter().map(|c| c * c).sum::<f32>().sqrt(), 1.0, "else the program turns it a little");
    put(&folder().join("w.csv"), weights.to_csv(field().patch_set()));
    let (width, height) = (field().width() as u32, field().height() as u32);
    let view = image::RgbImage::from_fn(width, height, |x, y| image::Rgb([(3 * x) as u8, (5 * y) as u8, 77]));
    view.save(folder().join("view.png")).unwrap();
    let header = format!("P6\n{width} {height}\n255\n");
    put(&folder().join("view.ppm"), [header.as_bytes(), view.as_raw()].concat());
    let lib = installed().join("lib/librelume.a");
    let example = "firmware/capi/example/relight.c";
    let programs = [shared("relight", &[example]), compile("relight-static", &[example], &[lib.to_str().unwrap()])];
    for (ev, with_view) in [("-1", true), ("2", false)] {
        let args = ["relight", "a.field", "--weights", "w.csv", "--exposure", ev, "-o", "program.png"];
        let more: &[&str] = if with_view { &["--view", "view.png"] } else { &[] };
        relume_in(folder(), &[&args, more].concat()).well();
        let exact = image::open(folder().join("program.png")).unwrap().into_rgb8();
        for program in &programs {
            let out = program.with_extension("ppm");
            let args = ["a.field", "w.csv", ev, out.to_str().unwrap(), "view.ppm"];
            let told = started(program, &args[..if with_view { 5 } else { 4 }]).well().stdout;
            assert!(told.starts_with("70x50 px, ") && told.ends_with(" empty\n"), "{told}");
            let expected = [header.as_bytes(), exact.as_raw()].concat();
            assert!(std::fs::read(&out).unwrap() == expected, "{} differs", out.display());
        }
    }
    let outcome = started(&programs[0], &["w.csv", "w.csv", "0", "none.ppm"]);
    assert_eq!((outcome.code, outcome.stderr.lines().count()), (Some(2), 1), "{}", outcome.stderr);
    assert!(outcome.stderr.contains("w.csv: not a Relume field"), "{}", outcome.stderr);
}

#[test]
fn the_program_on_the_page_compiles() {
    let page = include_str!("../../firmware/capi/README.md");
    let program = page.split("```c\n").nth(1).unwrap().split("```").next().unwrap();
    let source = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "capi-page-source").join("page.c");
    put(&source, program);
    compile("page", &[source.to_str().unwrap()], &["-c"]);
}

/// Symbols of a library that `nm` lists with these options.
fn symbols(library: &str, options: &[&str]) -> BTreeSet<String> {
    let listed = run(tool("nm").args(options).arg(installed().join("lib").join(library))).well().stdout;
    let lines = listed.lines().filter(|line| line.contains(' '));
    lines.filter_map(|line| line.split_whitespace().last()).map(|name| name.trim_end_matches('@').to_owned()).collect()
}

/// All that the library asks of the program it is linked to; any C library and every freestanding gcc program has them.
const ASKED_FOR: [&str; 5] = ["memcpy", "memmove", "memset", "memcmp", "bcmp"];

#[test]
fn needs_no_allocator_and_no_standard_library() {
    for (library, options) in [("librelume.so", ["-D", "-u"]), ("librelume.a", ["-g", "-u"])] {
        let own = symbols(library, &[options[0], "--defined-only"]);
        assert!(own.contains("relume_open"), "{own:?}");
        let weak = ["__cxa_finalize", "__gmon_start__", "_ITM_deregisterTMCloneTable", "_ITM_registerTMCloneTable"];
        let asked: Vec<String> = symbols(library, &options).into_iter().filter(|name| !own.contains(name)).collect();
        let foreign = |name: &&String| !ASKED_FOR.contains(&name.as_str()) && !weak.contains(&name.as_str());
        assert_eq!(asked.iter().find(foreign), None, "{library} asks for more than it may");
    }
    let public = symbols("librelume.so", &["-D", "--defined-only"]);
    assert!(public.iter().all(|name| name.starts_with("relume_")) && public.len() == 15, "{public:?}");
    let dynamic = run(tool("readelf").arg("-d").arg(installed().join("lib/librelume.so"))).well().stdout;
    assert!(dynamic.contains("soname: [librelume.so.1]") && !dynamic.contains("NEEDED"), "{dynamic}");
}

#[test]
fn installs_what_a_linker_looks_for() {
    let version = env!("CARGO_PKG_VERSION");
    let lib = installed().join("lib");
    let full = format!("librelume.so.{version}");
    assert_eq!(names(&lib), ["librelume.a", "librelume.so", &full, "librelume.so.1", "pkgconfig"]);
    assert_eq!(names(&installed().join("include")), ["relume.h"]);
    let stage = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "capi-stage");
    run(install().arg("/usr").env("DESTDIR", "package").current_dir(&stage)).well();
    let staged = std::fs::read_to_string(stage.join("package/usr/lib/pkgconfig/relume.pc")).unwrap();
    assert!(staged.starts_with("prefix=/usr\n"), "{staged}");
    let query = |option: &str| {
        let mut command = Command::new("pkg-config");
        command.args([option, "relume"]).env("PKG_CONFIG_PATH", lib.join("pkgconfig")).output()
    };
    let prefix = installed().display();
    let expected = [
        ("--cflags", format!("-I{prefix}/include")),
        ("--libs", format!("-L{prefix}/lib -lrelume")),
        ("--modversion", version.into()),
    ];
    for (option, expected) in expected {
        let Ok(found) = query(option) else { return skip("relume.pc", "pkg-config is missing") };
        assert_eq!(String::from_utf8_lossy(&found.stdout).trim(), expected, "{found:?}");
    }
}

#[test]
fn the_header_is_cpp_too() {
    let mut check = Command::new("g++");
    check.args(["-std=c++11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-x", "c++"]);
    check.arg(installed().join("include/relume.h"));
    match check.output() {
        Ok(output) => assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr)),
        Err(_) => skip("relume.h in C++", "g++ is missing"),
    }
}
