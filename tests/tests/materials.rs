//! Glossy materials through the programs: a bronze and a marble sphere, their field against their stack, under skies and suns.

use relume_tests::files::{fresh_folder, put};
use relume_tests::light::{Light, patches};
use relume_tests::picture::{Linear, read_exr, relative_rmse};
use relume_tests::program::{bake_in, relume_in};
use relume_tests::scene::write_polished;
use std::path::Path;
use std::sync::OnceLock;

/// Behind the camera's left, high enough for highlights on both spheres.
const SUN: &str = "215,40";

/// A folder with the spheres baked both ways, and the stack of the glossy bake.
fn baked() -> &'static Path {
    static FOLDER: OnceLock<std::path::PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "materials");
        write_polished(&folder);
        bake_in(&folder, &args("glossy.field", &["--stack", "stack", "--sun", SUN])).well();
        bake_in(&folder, &args("lambert.field", &["--materials", "lambert"])).well();
        folder
    })
}

fn args<'a>(out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let args =
        ["scene", "scene.glb", "--camera", "camera.json", "--size", "96x64", "--directions", "64", "--max-hits", "3"];
    [&args[..], &["-o", out], more].concat()
}

fn relit(light: &Light, field: &str, name: &str) -> Linear {
    let (weights, out) = (format!("{name}.csv"), format!("{name}.exr"));
    put(&baked().join(&weights), light.csv(&baked().join("stack")));
    relume_in(baked(), &["relight", field, "--weights", &weights, "-o", &out]).well();
    read_exr(&baked().join(out))
}

/// An even sky, and nothing but the sun.
fn lights() -> [Light; 2] {
    let count = patches(&baked().join("stack")).0.len();
    let all = |radiance: f64, sun| Light { radiance: vec![[radiance; 3]; count], sun };
    [all(1.0, None), all(0.0, Some([3.0; 3]))]
}

#[test]
fn a_field_of_glossy_things_shows_what_its_stack_shows() {
    for (light, (name, most)) in lights().iter().zip([("even", 0.004), ("sun", 0.02)]) {
        let mut exact = light.sum(&baked().join("stack"));
        // The sun's plane ends at a response of 2.
        let top = light.sun.map_or(f64::INFINITY, |sun| 65535.0 / 32768.0 * sun[0]);
        exact.rgb.iter_mut().flatten().for_each(|value| *value = value.min(top));
        let error = relative_rmse(&relit(light, "glossy.field", name).rgb, &exact.rgb, &exact.alpha);
        eprintln!("{name}: {:.3} %", 100.0 * error);
        assert!(error <= most, "{name}: relative RMSE {error}");
    }
}

#[test]
fn metal_gleams_only_where_materials_are_read() {
    let [_, sun] = lights();
    let brightest = |field: &str| {
        let picture = relit(&sun, field, field);
        picture.rgb.iter().map(|rgb| rgb[0]).fold(0.0, f64::max)
    };
    // Lambert: at most the albedo over pi, and some light from around.
    let (lambert, glossy) = (brightest("lambert.field"), brightest("glossy.field"));
    assert!(lambert < 3.0 * 0.8 / std::f64::consts::PI * 1.5, "{lambert}");
    assert!(glossy > 2.0 * lambert, "{glossy} and {lambert}");
}

#[test]
fn only_a_glossy_field_has_the_gloss_layers() {
    for (field, has) in [("glossy.field", true), ("lambert.field", false)] {
        let told = bake_in(baked(), &["info", field]).well().stdout;
        assert_eq!(told.contains("layer     GLSS") && told.contains("layer     GLST"), has, "{told}");
        assert_eq!(told.contains("with highlights"), has, "{told}");
    }
}
