//! `host-sim hil` on bad input: one clear line and exit code 2. What it does on good input is in `tests/hil.rs` of the
//! workspace, which builds the image.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use std::process::Command;

fn hil(path: Option<&str>, arguments: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
    command.arg("hil").args(arguments);
    if let Some(path) = path {
        command.env("PATH", path);
    }
    let output = command.output().unwrap();
    assert!(output.stdout.is_empty());
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn bad_input_is_one_line_and_exit_code_2() {
    let cases: [(Option<&str>, &[&str], &str); 4] = [
        (
            Some("/nonexistent"),
            &["--elf", "x"],
            "apt-get install qemu-system-arm",
        ),
        (None, &["--units", "0"], "--units"),
        (None, &["--units", "21"], "at most 20, the vehicles of the cell"),
        (None, &["--port", "70000"], "--port"),
    ];
    for (path, arguments, expected) in cases {
        let (code, text) = hil(path, arguments);
        assert_eq!(code, Some(2), "{arguments:?}: {text}");
        assert!(text.contains(expected), "{arguments:?}: {text}");
        assert_eq!(text.lines().count(), 1, "{text}");
    }
}
