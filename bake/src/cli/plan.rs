//! `relume-bake plan`: what a bake in shares will be made of.

use super::arguments::{Arguments, scene_and_camera, told};
use super::scene::tell;
use super::{HELP, print};
use crate::geometry::Geometry;
use crate::plan::Plan;
use crate::survey::survey;
use crate::viewpoint::check_shape;
use crate::write;
use relume_firmware::glue::failure::Failure;
use relume_firmware::glue::outfile::check_writable;
use std::path::Path;

/// What a plan is made of.
const OPTIONS: [&str; 17] = [
    "camera",
    "size",
    "out",
    "directions",
    "sphere",
    "adaptive",
    "materials",
    "max-hits",
    "site",
    "sun-paths",
    "error",
    "noise",
    "time",
    "test-sky",
    "seed",
    "threads",
    "json",
];

pub(super) fn act(parser: &mut lexopt::Parser) -> Result<(), Failure> {
    let Some(arguments) = Arguments::parse(parser)? else { return print(HELP) };
    arguments.only("plan", &OPTIONS, "it belongs to `relume-bake scene` or `relume-bake merge`")?;
    let (scene_file, out) = (arguments.scene("plan")?, arguments.out("plan")?);
    let options = arguments.options("plan")?;
    check_writable(out)?;
    let camera_file = arguments.camera.as_deref();
    let (scene, camera, names) = scene_and_camera(scene_file, camera_file, arguments.shading)?;
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    check_shape(&camera, options.size).map_err(|error| told(error.into(), &names))?;
    let options = arguments.sampled((&scene, &camera, &names), options)?;
    let plan = Plan::new((&scene, &camera), (scene_file, camera_file), &options, folder);
    let plan = plan.map_err(|error| told(error, &names))?;
    survey(
        &scene,
        &Geometry::new(&scene),
        &camera.view(options.size.0, options.size.1),
        (options.size, options.sphere),
    )
    .iter()
    .for_each(tell);
    write::save(out, plan.to_toml().as_bytes())?;
    print(&if arguments.json {
        format!("{{\"tiles\":{}}}\n", plan.tiles)
    } else {
        format!(
            "{} tiles: bake shares with `relume-bake scene --plan {} --tiles A..B -o SHARE`\n",
            plan.tiles,
            out.display()
        )
    })
}
