//! Writes small stacks and reads them back with the EXR library.

use super::*;

const SIZE: (u32, u32) = (20, 3);

fn set() -> PatchSet {
    PatchSet::new(16).unwrap_or_else(|error| panic!("{error}"))
}

fn manifest() -> Manifest {
    let sun = Some(ManifestSun::new(180.0, 30.0, [0.0, 0.5, 0.866]));
    Manifest { sun, ..Manifest::new(&set(), SIZE, 8, 3, 12.0) }
}

/// A tile of columns `x0..x0 + w` in which every second pixel is covered.
fn tile(x0: u32, w: u32) -> TileResponse {
    let patches = set().len();
    let covered: Vec<u16> = (0..(w * 3) as u16).step_by(2).collect();
    let response = (0..covered.len() * 3 * patches).map(|k| x0 as f32 + k as f32).collect();
    let coverage = (0..w * 3).map(|k| if k % 2 == 0 { 0.75 } else { 0.0 }).collect();
    let fragments = vec![Vec::new(); covered.len()];
    TileResponse { x0, y0: 0, w, h: 3, patches, coverage, covered, response, indirect: Vec::new(), fragments }
}

fn write(dir: &Path) -> Result<(), StackError> {
    let writer = StackWriter::create(dir, manifest())?;
    for (x0, w) in [(16, 4), (0, 16)] {
        let sun: Vec<f32> = (0..w * 9).map(|k| (x0 * 100 + k) as f32).collect();
        writer.write_tile(&tile(x0, w), Some(&sun))?;
    }
    writer.finish()
}

fn read_rgb(path: &Path) -> Vec<[f32; 3]> {
    use exr::prelude::*;
    let picture = read_first_rgba_layer_from_file(
        path,
        |size, _| (size.width(), vec![[0.0f32; 3]; size.area()]),
        |(width, pixels), at, (r, g, b, _): (f32, f32, f32, f32)| pixels[at.y() * *width + at.x()] = [r, g, b],
    );
    picture.unwrap().layer_data.channel_data.pixels.1
}

#[test]
fn pictures_hold_the_tiles_bit_for_bit() {
    let dir = tempfile::tempdir().unwrap();
    let stack = dir.path().join("stack");
    write(&stack).unwrap();
    let patches = set().len();
    for patch in [0, 5, patches - 1] {
        let picture = read_rgb(&stack.join(format!("patch_{patch:03}.exr")));
        for (x0, w) in [(0u32, 16u32), (16, 4)] {
            for index in 0..w * 3 {
                let at = (index / w * SIZE.0 + x0 + index % w) as usize;
                let first = x0 as f32 + (index / 2 * 3 * patches as u32) as f32 + patch as f32;
                let covered = [0, 1, 2].map(|channel| first + (channel * patches) as f32);
                assert_eq!(picture[at], if index % 2 == 0 { covered } else { [0.0; 3] });
            }
        }
    }
    assert_eq!(read_rgb(&stack.join("sun.exr"))[SIZE.0 as usize + 17], [1615.0, 1616.0, 1617.0]);
    let text = fs::read_to_string(stack.join("manifest.toml")).unwrap();
    assert_eq!(toml::from_str::<Manifest>(&text).unwrap(), manifest());
    let names = file_names(&stack).unwrap();
    assert_eq!(names.len(), patches + 3, "{names:?}");
}

#[test]
fn an_older_stack_is_replaced_and_foreign_files_are_not() {
    let dir = tempfile::tempdir().unwrap();
    let stack = dir.path().join("stack");
    write(&stack).unwrap();
    fs::write(stack.join("patch_999.exr"), "older").unwrap();
    write(&stack).unwrap();
    assert!(!stack.join("patch_999.exr").exists());
    fs::write(stack.join("notes.txt"), "mine").unwrap();
    let text = write(&stack).unwrap_err().to_string();
    assert!(text.contains("notes.txt") && !text.contains('\n'), "{text}");
    fs::remove_file(stack.join("manifest.toml")).unwrap();
    fs::remove_file(stack.join("notes.txt")).unwrap();
    assert!(matches!(write(&stack), Err(StackError::Foreign { .. })), "pictures alone may be someone's");
}

#[test]
fn given_up_it_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let stack = dir.path().join("stack");
    let writer = StackWriter::create(&stack, manifest()).unwrap();
    writer.write_tile(&tile(0, 16), None).unwrap();
    drop(writer);
    assert!(!stack.exists());
    let text = write(&dir.path().join("no/such/stack")).unwrap_err().to_string();
    assert!(text.contains("no/such/stack"), "{text}");
}

#[test]
fn a_full_disk_is_told_in_one_line() {
    // The device that is always full stands in for the spool's disk.
    let Ok(full) = File::options().read(true).write(true).open("/dev/full") else { return };
    let dir = tempfile::tempdir().unwrap();
    let stack = dir.path().join("stack");
    let writer = StackWriter::create(&stack, manifest()).unwrap();
    writer.spool.lock().unwrap().file = full;
    let text = writer.write_tile(&tile(0, 16), None).unwrap_err().to_string();
    assert!(text.contains("cannot write") && !text.contains('\n'), "{text}");
    drop(writer);
    assert!(!stack.exists());
}
