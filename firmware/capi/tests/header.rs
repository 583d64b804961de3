//! `include/relume.h` is what cbindgen makes of the sources.
//!
//! After a change of the interface: `RELUME_WRITE_HEADER=1 cargo test -p relume-capi --test header`.

#![allow(clippy::unwrap_used)]

use std::path::Path;

#[test]
fn the_header_is_that_of_the_sources() {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let bindings = cbindgen::Builder::new()
        .with_config(cbindgen::Config::from_file(package.join("cbindgen.toml")).unwrap())
        .with_src(package.join("src/types.rs"))
        .with_src(package.join("src/memory.rs"))
        .with_src(package.join("src/interface.rs"))
        .with_src(package.join("src/budget.rs"))
        .with_src(package.join("src/processor.rs"))
        .generate()
        .unwrap();
    let mut made = Vec::new();
    bindings.write(&mut made);
    let header = package.join("include/relume.h");
    if std::env::var_os("RELUME_WRITE_HEADER").is_some() {
        std::fs::write(&header, &made).unwrap();
    }
    let kept = std::fs::read(&header).unwrap_or_default();
    assert!(kept == made, "{} is not what its sources say; see the top of tests/header.rs", header.display());
}
