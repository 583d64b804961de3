//! Fields that are cut short, damaged, foreign or of another patch set: each is refused in one line, by library and
//! program alike, and none ends in a panic or a wrong picture.

#![allow(clippy::unwrap_used)]

use relume::relight::FieldFile;
use relume_tests::files::{fresh_folder, put};
use relume_tests::program::{bake_in, relume_in};
use relume_tests::scene::write_courtyard;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

struct Fixture {
    folder: PathBuf,
    bytes: Vec<u8>,
}

fn sound() -> &'static Fixture {
    static FIXTURE: OnceLock<Fixture> = OnceLock::new();
    FIXTURE.get_or_init(|| {
        let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "faults");
        write_courtyard(&folder);
        let size = ["--size", "20x18", "--directions", "16", "-o", "sound.field"];
        bake_in(&folder, &[&["scene", "scene.glb", "--camera", "camera.json"][..], &size].concat()).well();
        let bytes = std::fs::read(folder.join("sound.field")).unwrap();
        Fixture { folder, bytes }
    })
}

fn refused_by_library(path: &Path, what: &str) -> String {
    let error = FieldFile::open(path).err().unwrap_or_else(|| panic!("{what} was taken for a field")).to_string();
    assert!(!error.contains('\n') && error.contains(&*path.file_name().unwrap().to_string_lossy()), "{error}");
    error
}

fn refused_by_programs(name: &str, bytes: &[u8], parts: &[&str]) {
    let folder = &sound().folder;
    put(&folder.join(name), bytes);
    let parts = [&[name][..], parts].concat();
    bake_in(folder, &["info", name]).refused(2, &parts);
    relume_in(folder, &["relight", name, "--light", "0,1,0", "-o", "never.exr"]).refused(2, &parts);
    assert!(!folder.join("never.exr").exists());
}

#[test]
fn a_sound_field_is_told_about() {
    let told = bake_in(&sound().folder, &["info", "sound.field"]).well();
    assert!(told.stdout.contains("sound") && told.stdout.contains("20 x 18"), "{}", told.stdout);
    let json = bake_in(&sound().folder, &["info", "sound.field", "--json"]).well().stdout;
    let info: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((&info["width"], &info["height"], &info["patches_upper"]), (&20.into(), &18.into(), &16.into()));
    assert!(FieldFile::open(&sound().folder.join("sound.field")).is_ok());
}

#[test]
fn no_part_of_a_field_is_a_field() {
    let bytes = &sound().bytes;
    let path = sound().folder.join("cut.field");
    let steps = (0..400).map(|k| bytes.len() * k / 400).chain(bytes.len() - 70..bytes.len()).chain(0..170);
    for length in steps {
        put(&path, &bytes[..length]);
        refused_by_library(&path, &format!("{length} of {} bytes", bytes.len()));
    }
    refused_by_programs("half.field", &bytes[..bytes.len() / 2], &["truncated"]);
    refused_by_programs("head.field", &bytes[..100], &["truncated"]);
    refused_by_programs("empty.field", &[], &[]);
    put(&path, [bytes.as_slice(), b"and more"].concat());
    refused_by_library(&path, "a field with a tail");
}

#[test]
fn no_flipped_bit_goes_unnoticed() {
    let bytes = &sound().bytes;
    let path = sound().folder.join("bent.field");
    // Bytes between layers and reserved ones are of no layer: only there may a flip be harmless.
    let field = relume_firmware::field::Field::new(bytes).unwrap();
    let held = |at: usize| {
        let in_layer = |l: relume_firmware::field::Layer| (l.offset..l.offset + l.length).contains(&(at as u64));
        at < 160 + 32 * field.layers().count() || field.layers().any(in_layer)
    };
    let mut bent = bytes.clone();
    let every = (0..700).map(|k| (bytes.len() * k / 700, k % 8)).chain((0..700).map(|at| (at, at * 5 % 8)));
    let mut refused = 0;
    for (at, bit) in every {
        bent[at] ^= 1 << bit;
        put(&path, &bent);
        if held(at) {
            refused_by_library(&path, &format!("bit {bit} of byte {at} flipped"));
            refused += 1;
        } else {
            // Whatever it says, it must not panic.
            let _ = FieldFile::open(&path);
        }
        bent[at] ^= 1 << bit;
    }
    assert!(refused > 1000, "{refused}");
    let mut one = bytes.clone();
    one[bytes.len() * 2 / 3] ^= 4;
    refused_by_programs("bit.field", &one, &["damaged"]);
}

/// CRC-32 as in zip, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
    })
}

/// A field whose header was changed at `at` and sealed again.
fn resealed(at: usize, value: &[u8]) -> Vec<u8> {
    let mut bytes = sound().bytes.clone();
    bytes[at..at + value.len()].copy_from_slice(value);
    let crc = crc32(&bytes[..156]);
    bytes[156..160].copy_from_slice(&crc.to_le_bytes());
    bytes
}

#[test]
fn a_well_sealed_lie_is_still_refused() {
    refused_by_programs("set.field", &resealed(36, &0xdead_beef_u32.to_le_bytes()), &["patch set", "deadbeef"]);
    refused_by_programs("count.field", &resealed(40, &32u16.to_le_bytes()), &["patch set"]);
    refused_by_programs("version.field", &resealed(8, &9u16.to_le_bytes()), &["version 9"]);
    refused_by_programs("size.field", &resealed(24, &0u32.to_le_bytes()), &["size"]);
    refused_by_programs("wide.field", &resealed(24, &4000u32.to_le_bytes()), &[]);
    refused_by_programs("covered.field", &resealed(44, &1u32.to_le_bytes()), &["covered"]);
    refused_by_programs("camera.field", &resealed(48, &f32::NAN.to_le_bytes()), &["camera"]);
    refused_by_programs("fov.field", &resealed(84, &(-1f32).to_le_bytes()), &["camera"]);
    refused_by_programs("layers.field", &resealed(12, &u32::MAX.to_le_bytes()), &[]);
    refused_by_programs("length.field", &resealed(16, &u64::MAX.to_le_bytes()), &["truncated"]);
    // The same change without a change is a field: the seal above is the right one.
    put(&sound().folder.join("same.field"), resealed(8, &1u16.to_le_bytes()));
    bake_in(&sound().folder, &["info", "same.field"]).well();
}

/// The field with byte `at` of layer number `index` changed, its checksums right again.
fn with_lie(index: usize, at: usize, value: u8) -> Vec<u8> {
    let mut lie = sound().bytes.clone();
    let field = relume_firmware::field::Field::new(&sound().bytes).unwrap();
    let layer = field.layers().nth(index).unwrap();
    lie[layer.offset as usize + at] = value;
    let entry = 160 + 32 * index;
    let crc = crc32(&lie[layer.offset as usize..(layer.offset + layer.length) as usize]);
    lie[entry + 24..entry + 28].copy_from_slice(&crc.to_le_bytes());
    let table = crc32(&lie[160..160 + 32 * field.layers().count()]);
    lie[152..156].copy_from_slice(&table.to_le_bytes());
    let head = crc32(&lie[..156]);
    lie[156..160].copy_from_slice(&head.to_le_bytes());
    lie
}

#[test]
fn codes_beyond_what_sums_are_bounded_by_are_refused() {
    let field = relume_firmware::field::Field::new(&sound().bytes).unwrap();
    for kind in [*b"RESU", *b"RESV"] {
        let index = field.layers().position(|layer| layer.kind == kind).unwrap();
        refused_by_programs("code.field", &with_lie(index, 0, 0x80), &["-128"]);
        put(&sound().folder.join("code.field"), with_lie(index, 0, 0x81));
        bake_in(&sound().folder, &["info", "code.field"]).well();
    }
}

#[test]
fn a_layer_that_lies_is_refused_whatever_it_says() {
    // Every record of the tile layer changed in turn, its checksums right again: refused or harmless, never a panic.
    let bytes = &sound().bytes;
    let field = relume_firmware::field::Field::new(bytes).unwrap();
    let path = sound().folder.join("lie.field");
    let mut random = 1u64;
    for (index, layer) in field.layers().enumerate() {
        for _ in 0..60 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let at = (random >> 33) % layer.length.max(1);
            if (layer.offset + at) as usize >= bytes.len() {
                continue;
            }
            put(&path, with_lie(index, at as usize, (random >> 20) as u8));
            let Ok(file) = FieldFile::open(&path) else { continue };
            let mut relighter = relume::relight::Relighter::new(file.field(), 1);
            let sun = relume::weights::SunWeight { dir_world: [0.6, 0.8, 0.0], irradiance: [2.0; 3] };
            let weights = relume::weights::PatchWeights { radiance: vec![[1.0; 3]; 17], sun: Some(sun) };
            relighter.set_weights(&weights, 1.0).unwrap();
            let _ = relighter.radiance();
        }
    }
}

#[test]
fn foreign_files_are_no_fields() {
    refused_by_programs("scene.png", &relume_tests::scene::checks_png(), &["not a Relume field"]);
    refused_by_programs("text.field", b"\x89RLM\n\x1a\n as a text-mode copy leaves it", &["not a Relume field"]);
    refused_by_programs("short.field", b"\x89RL", &["not a Relume field"]);
    bake_in(&sound().folder, &["info", "nowhere.field"]).refused(2, &["nowhere.field"]);
    bake_in(&sound().folder, &["info", "."]).refused(2, &[]);
    relume_in(&sound().folder, &["relight", ".", "--light", "0,1,0", "-o", "never.exr"]).refused(2, &[]);
}
