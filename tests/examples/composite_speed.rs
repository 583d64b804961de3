//! What a live view costs: `cargo run --release -p relume-tests --example composite_speed -- [WIDTHxHEIGHT]` (1920x1080).
//!
//! The demo's site, its ground as receivers, before a new view in every frame, one thread, under a sky that stands still. The
//! views and the framebuffer are more than the caches hold. Prints CPU time, medians of 60 frames, for each kernel path; bytes
//! that must move, and their share of what the same run reads from memory at best; the same for copying the view as it is.
//! Compares the pictures of all paths.

use relume::bench::{cpu_s, median, read_bandwidth};
use relume::relight::{Backdrop, Framebuffer, ReceiverLight, Relighter, View};
use relume::weights::PatchWeights;
use relume_bake::bake::{BakeOptions, bake};
use relume_bake::demo_scene;
use relume_bake::response::TransportOptions;
use relume_firmware::edge::Edges;
use relume_firmware::field::Field;
use relume_firmware::kernel::Kernel;
use relume_firmware::receivers::Receivers;
use relume_firmware::tile::{TILE_PIXELS, TILE_PX};

/// Views that take turns.
const VIEWS: usize = 8;
const FRAMES: usize = 60;
/// More than any cache at hand.
const CACHE_BYTES: usize = 64 << 20;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let size = std::env::args().nth(1).unwrap_or_else(|| "1920x1080".into());
    let (width, height) = size.split_once('x').ok_or("a size is WIDTHxHEIGHT")?;
    let bytes = baked((width.parse()?, height.parse()?))?;
    let field = Field::new(&bytes)?;
    let receivers = Receivers::of(&field)?.ok_or("the site has no receivers")?;
    let bandwidth = read_bandwidth(CACHE_BYTES)?.one_thread_bytes_per_cpu_s;
    println!("memory: {:.1} GB/s read by one thread", bandwidth / 1e9);

    let views: Vec<Vec<u32>> = (0..VIEWS as u32).map(|seed| noise(field.width() * field.height(), seed)).collect();
    let copied = copy_s(&views);
    let copied_bytes = 8 * views[0].len();
    println!("copying the view: {:.2} ms, {:.0} % of that", 1e3 * copied, share(copied_bytes, copied, bandwidth));
    let moved = moved_bytes(&field, &receivers);
    let mut normative = None;
    for kernel in Kernel::paths() {
        let (seconds, picture) = composite_s(field, receivers, kernel, &views)?;
        let percent = share(moved, seconds, bandwidth);
        println!("{}: {:.2} ms, {:.1} MB, {percent:.0} %", kernel.name(), 1e3 * seconds, moved as f64 / 1e6);
        let alike = *normative.get_or_insert_with(|| picture.clone()) == picture;
        println!("    {}", if alike { "its picture is the scalar path's" } else { "ITS PICTURE IS ANOTHER" });
    }
    Ok(())
}

/// The site's field: how good its light is does not matter here.
fn baked(size: (u32, u32)) -> Result<Vec<u8>, Box<dyn std::error::Error>> {
    let (scene, camera) = demo_scene::site();
    let transport = TransportOptions { paths: 1, sun_paths: 1, max_hits: 2, ..TransportOptions::default() };
    let options = BakeOptions { size, transport, directions: 64, ..BakeOptions::default() };
    Ok(bake(&scene, &camera, &options)?.bytes)
}

fn noise(length: usize, seed: u32) -> Vec<u32> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state >> 8
    };
    (0..length).map(|_| next()).collect()
}

fn share(bytes: usize, seconds: f64, bandwidth: f64) -> f64 {
    100.0 * bytes as f64 / seconds / bandwidth
}

fn copy_s(views: &[Vec<u32>]) -> f64 {
    let mut to = vec![0u32; views[0].len()];
    let times: Vec<f64> = (0..FRAMES)
        .map(|frame| {
            let start = cpu_s();
            to.copy_from_slice(std::hint::black_box(&views[frame % VIEWS]));
            std::hint::black_box(&mut to);
            cpu_s() - start
        })
        .collect();
    median(&times)
}

/// Bytes that a frame cannot do without: the view where it shows, and the picture there; factors of tiles with receivers; light
/// and coverage of edge pixels. What the field says of a tile is not counted.
fn moved_bytes(field: &Field<'_>, receivers: &Receivers<'_>) -> usize {
    let (own, real) = (field.response(), receivers.with.response());
    let columns = own.grid().0;
    (0..own.tiles())
        .map(|index| {
            let (tile, corner) = (own.tile(index), (index % columns * TILE_PX, index / columns * TILE_PX));
            let side = |at: usize, end: usize| TILE_PX.min(end - at);
            let pixels = side(corner.0, field.width()) * side(corner.1, field.height());
            let edges = Edges::new(&tile).count();
            let seen = pixels - tile.pixels() + edges;
            let shaded = seen > 0 && real.tile(index).pixels() > 0;
            8 * seen + 13 * edges + usize::from(shaded) * 6 * TILE_PIXELS
        })
        .sum()
}

/// CPU time of a frame with nothing new but the view, and the last picture.
fn composite_s(
    field: Field<'_>,
    receivers: Receivers<'_>,
    kernel: Kernel,
    views: &[Vec<u32>],
) -> Result<(f64, Vec<u32>), Box<dyn std::error::Error>> {
    let weights = PatchWeights { radiance: vec![[1.0; 3]; field.patch_set().len()], sun: None };
    let mut light = ReceiverLight::new(&field, receivers);
    let mut relighter = Relighter::with_kernel(field, 1, kernel);
    relighter.expect_live_view();
    relighter.set_weights(&weights, 0.2)?;
    light.set_weights(&weights, 0.2)?;
    light.follow();
    let mut framebuffer = Framebuffer::new(field.width(), field.height());
    let mut view = View::new(field.width(), field.height(), Vec::new());
    let mut pixels = views.to_vec();
    let mut times = Vec::new();
    for frame in 0..FRAMES + VIEWS {
        let start = cpu_s();
        view.exchange(&mut pixels[frame % VIEWS]);
        let behind = Backdrop { view: &view, shading: Some(light.shading()) };
        relighter.draw_over(&behind, &mut framebuffer);
        times.push(cpu_s() - start);
    }
    Ok((median(&times[VIEWS..]), framebuffer.pixels))
}
