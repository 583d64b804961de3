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
    fails(&["devises"], 2, &["devises", "did you mean devices"]);
    fails(&["sky", "mix"], 2, &["mix", "merge or weights"]);
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
