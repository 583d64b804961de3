//! The field and the lights of the C library's tests.

use relume::weights::{PatchWeights, SunWeight};
use relume_bake::bake::{BakeOptions, bake};
use relume_bake::camera::Camera;
use relume_bake::scene;
use relume_firmware::field::{Field, HEADER, LAYER_ENTRY};
use relume_tests::files::{fresh_folder, put};
use relume_tests::scene::{Picture, checks_png, courtyard, glb};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A folder with `a.field`: shadow, texture, edges, sky at 70 x 50, both ragged.
pub fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "capi");
        put(&folder.join("scene.glb"), glb(&courtyard(), Some(Picture::Inside(&checks_png()))));
        let scene = scene::load(&folder.join("scene.glb"), scene::Shading::Lambert).unwrap().scene;
        let (position, target) = ([2.5, 2.6, 6.5], [-0.4, 0.8, 0.0]);
        let camera = Camera { position, target, up: [0.0, 1.0, 0.0], fov_y_deg: 45.0, north_deg: 12.5, optics: None };
        let options = BakeOptions { size: (70, 50), directions: 32, progress: false, ..BakeOptions::default() };
        put(&folder.join("a.field"), bake(&scene, &camera, &options).unwrap().bytes);
        folder
    })
}

/// The field in `a.field`.
pub fn field() -> Field<'static> {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    Field::new(BYTES.get_or_init(|| std::fs::read(folder().join("a.field")).unwrap())).unwrap()
}

/// The same field without its layers that may be left out, bounds and rows: they get names that nobody knows.
pub fn bare_bytes() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| {
        let mut bytes = std::fs::read(folder().join("a.field")).unwrap();
        let layers = field().layers().count();
        for entry in bytes[HEADER..][..layers * LAYER_ENTRY].chunks_exact_mut(LAYER_ENTRY) {
            if [*b"BNDB", *b"BNDT", *b"WAYT", *b"WAYD"].iter().any(|kind| entry[..4] == kind[..]) {
                entry[0] = b'x';
            }
        }
        let table = crc32fast::hash(&bytes[HEADER..][..layers * LAYER_ENTRY]);
        bytes[152..156].copy_from_slice(&table.to_le_bytes());
        let header = crc32fast::hash(&bytes[..156]);
        bytes[156..160].copy_from_slice(&header.to_le_bytes());
        bytes
    })
}

/// The field of [`bare_bytes`].
pub fn bare_field() -> Field<'static> {
    Field::new(bare_bytes()).unwrap()
}

/// Light number `seed` of `check.c`.
pub fn light(seed: usize) -> PatchWeights {
    let value = |patch: usize, c: usize| {
        let value = ((patch * 7 + c * 13 + seed * 31) % 64) as f32 / 64.0;
        if seed % 5 == 4 && patch % 9 == 3 { 32.0 + 8.0 * value } else { value }
    };
    let radiance = (0..field().patch_set().len()).map(|patch| [0, 1, 2].map(|c| value(patch, c))).collect();
    let dir_world = [0.48, 0.64, if seed % 2 == 1 { 0.6 } else { -0.6 }];
    let sun = (!seed.is_multiple_of(3)).then_some(SunWeight { dir_world, irradiance: [2.0, 1.75, 1.5] });
    PatchWeights { radiance, sun }
}

/// Coverage of every pixel, 0..=255.
pub fn coverage() -> Vec<u8> {
    let (field, columns) = (field(), field().response().grid().0);
    let mut all = vec![0; field.width() * field.height()];
    for index in 0..field.response().tiles() {
        for (k, pixel) in field.response().tile(index).covered().enumerate() {
            let (x, y) = (index % columns * 16 + pixel % 16, index / columns * 16 + pixel / 16);
            all[y * field.width() + x] = field.coverage(index).map_or(255, |shares| shares[k]);
        }
    }
    all
}
