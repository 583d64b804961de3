use super::*;

fn fails(args: &[&str], code: u8, parts: &[&str]) {
    let failure = run(args.iter().map(OsString::from)).expect_err("should fail");
    let text = failure.to_string();
    assert_eq!(failure.exit_code(), code, "{text}");
    assert!(!text.contains('\n') && parts.iter().all(|part| text.contains(part)), "{text} lacks one of {parts:?}");
}

#[test]
fn every_command_has_help_that_names_it() {
    for command in COMMANDS {
        assert!(command.help.starts_with(&format!("relume {}", command.name)), "{}", command.name);
        assert!(HELP.contains(&format!("relume {}", command.name)), "{}", command.name);
        run([command.name, "--help"].map(OsString::from)).unwrap();
    }
    run([OsString::from("--version")]).unwrap();
}

#[test]
fn bad_arguments_are_exit_code_2_in_one_line() {
    fails(&[], 2, &["relume --help"]);
    fails(&["relit"], 2, &["relit", "did you mean relight"]);
    fails(&["sky", "mix"], 2, &["mix", "merge, weights"]);
    fails(&["sky", "merge"], 2, &["FRAMES_DIR is missing", "relume sky --help"]);
    fails(&["sky", "merge", "none", "-o", "none/a.hdr"], 2, &["none/a.hdr", "does not exist"]);
    fails(&["sky", "merge", "none", "-o", "a.jpg"], 2, &["a.jpg", ".hdr or .exr"]);
    fails(&["--frobnicate"], 2, &["frobnicate"]);
    fails(&["devices", "--nope"], 2, &["--nope", "relume devices --help"]);
}

#[test]
#[cfg(not(feature = "board"))]
fn devices_need_the_board_build() {
    fails(&["devices"], 2, &["--features board"]);
}

#[test]
fn relight_refuses_what_it_cannot_use() {
    fails(&["relight", "a.field", "-o", "a.exr"], 2, &["--sky MAP", "missing", "relume relight --help"]);
    fails(&["relight", "a.field", "--light", "0,1,0", "-o", "a.jpg"], 2, &["a.jpg", ".exr", ".png"]);
    fails(&["relight", "a.field", "--light", "0,1", "-o", "a.exr"], 2, &["--light 0,1", "3 numbers"]);
    fails(&["relight", "a.field", "--light", "0,1,0", "--sky", "b.hdr"], 2, &["one of --sky"]);
    fails(&["relight", "a.field", "--light", "0,1,0", "--view", "b.png", "-o", "a.exr"], 2, &["--view", ".png"]);
    fails(&["relight", "a.field", "--light", "0,1,0", "--env-rot", "9", "-o", "a.exr"], 2, &["--env-rot"]);
    fails(&["relight", "a.field", "--light", "0,1,0", "--exposure", "nan", "-o", "a.png"], 2, &["--exposure nan"]);
    fails(&["relight", "none.field", "--light", "0,1,0", "-o", "no/a.exr"], 2, &["no/a.exr", "does not exist"]);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.exr").display().to_string();
    fails(&["relight", "none.field", "--light", "0,1,0", "-o", &out], 2, &["none.field"]);
    fails(&["relight", "a.field", "b.field", "--light", "0,1,0", "-o", &out], 2, &["b.field"]);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_post_that_cannot_open_is_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("POST.toml");
    let text = "field = 'none.field'\nsky = 'simulated'\n[site]\nlatitude = 41.9\nlongitude = 12.5\n\
                [display]\nkind = 'headless'\nfolder = 'out'\n";
    std::fs::write(&file, text).unwrap();
    let file = file.display().to_string();
    fails(&["run", &file], 2, &["none.field"]);
    fails(&["check", &file], 2, &["POST.toml", "1 to put right"]);
    fails(&["run", "--setup"], 2, &["POST.toml is missing"]);
    fails(&["run", "none/POST.toml"], 2, &["none/POST.toml", "cannot be read"]);
}
