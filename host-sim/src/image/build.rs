//! The package `firmware`, built where its sources are and as its users build it.

use kit::error::{Error, Result};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const TARGET: &str = "thumbv7em-none-eabihf";

/// Builds the image that is flashed, says which package is done, and gives the image's path.
///
/// # Errors
/// [`Error::Input`] with Cargo's first error.
pub fn deployed(done: impl FnMut(&str)) -> Result<PathBuf> {
    build("firmware", &[], done)
}

/// Builds the image that counts instructions in the emulator, beside the one that is flashed and with the same
/// dependencies: what is built for the one is there for the other.
///
/// # Errors
/// As [`deployed`].
pub fn measuring(done: impl FnMut(&str)) -> Result<PathBuf> {
    build("measure", &["--features", "measure"], done)
}

fn build(program: &str, arguments: &[&str], mut done: impl FnMut(&str)) -> Result<PathBuf> {
    let clone = needed_clone()?;
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()))
        .args(["build", "-p", "firmware", "--bin", program])
        .args(["--profile", "firmware", "--target", TARGET])
        .args(["--message-format", "json-render-diagnostics"])
        .args(arguments)
        .current_dir(clone)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|error| wrong_build(&error.to_string()))?;
    let mut errors = cargo.stderr.take().ok_or_else(|| wrong_build("no output"))?;
    // Read beside the messages, so that neither pipe fills while the other one is read.
    let words = std::thread::spawn(move || {
        let mut words = Vec::new();
        let _ = errors.read_to_end(&mut words);
        words
    });
    let mut executable = None;
    let messages = cargo.stdout.take().ok_or_else(|| wrong_build("no output"))?;
    for line in BufReader::new(messages)
        .lines()
        .map_while(std::result::Result::ok)
    {
        let Ok(message) = serde_json::from_str::<Value>(&line) else {
            continue;
        };
        if let Some(name) = message.pointer("/target/name").and_then(Value::as_str) {
            done(name);
        }
        if let Some(path) = message.get("executable").and_then(Value::as_str) {
            executable = Some(PathBuf::from(path));
        }
    }
    let status = cargo.wait().map_err(|error| wrong_build(&error.to_string()))?;
    if !status.success() {
        let words = words.join().unwrap_or_default();
        let words = String::from_utf8_lossy(&words);
        let error = words.lines().find(|line| line.starts_with("error"));
        return Err(wrong_build(error.unwrap_or("a failure without an error")));
    }
    executable.ok_or_else(|| wrong_build("no executable"))
}

/// The clone of the repository that this runs in, or else the one that this was built in. An installed program may have outlived that,
/// or have come from another machine.
pub fn clone() -> Option<PathBuf> {
    let working = std::env::current_dir().unwrap_or_default();
    let found = clone_around(&working).or_else(|| clone_around(Path::new(env!("CARGO_MANIFEST_DIR"))));
    found.map(Path::to_owned)
}

/// The same where there is nothing to do without one.
///
/// # Errors
/// [`Error::Input`] names the working directory.
pub fn needed_clone() -> Result<PathBuf> {
    clone().ok_or_else(|| {
        let working = std::env::current_dir().unwrap_or_default();
        let expected = "a run within a clone of the repository, whose firmware is built";
        Error::input("working directory", working.display(), expected)
    })
}

/// The clone of the repository that a folder is in.
fn clone_around(folder: &Path) -> Option<&Path> {
    let holds_firmware = |folder: &&Path| folder.join("firmware/src/bin/measure.rs").exists();
    folder.ancestors().find(holds_firmware)
}

fn wrong_build(found: &str) -> Error {
    let expected = format!("a build for {TARGET} (`rustup target add {TARGET}` if the target is missing)");
    Error::input("cargo build -p firmware", found, expected)
}

#[cfg(test)]
mod tests {
    use super::clone_around;
    use std::path::Path;

    #[test]
    fn the_clone_is_the_one_around() {
        let package = Path::new(env!("CARGO_MANIFEST_DIR"));
        assert_eq!(clone_around(&package.join("src/image")), package.parent());
        assert_eq!(clone_around(Path::new("/")), None);
    }
}
