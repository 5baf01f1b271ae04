//! The programs of `chips/`, built as their users build them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Where Cargo puts the programs: one place for all, as they share what they depend on.
///
/// # Panics
/// If the test program has no path.
pub fn directory() -> PathBuf {
    // A test program lies in TARGET/PROFILE/deps, wherever the caller has put TARGET.
    let program = std::env::current_exe().unwrap();
    program.ancestors().nth(3).unwrap().join("chips")
}

/// Builds a program for these targets.
///
/// # Panics
/// If the build fails, with Cargo's own words.
pub fn build(program: &str, targets: impl Iterator<Item = &'static str>) {
    let targets: Vec<_> = targets.flat_map(|target| ["--target", target]).collect();
    let _ = cargo(&["build", "--release", "--locked", "-p", program], &targets);
}

/// Names of the crates that a package links for a target, itself left out; with `depth` 1 the direct ones.
///
/// # Panics
/// If Cargo does not know the package.
pub fn dependencies(package: &str, target: &str, depth: Option<u8>) -> BTreeSet<String> {
    let depth = depth.map_or_else(|| "256".to_owned(), |depth| depth.to_string());
    let text = cargo(
        &[
            "tree",
            "--locked",
            "--prefix",
            "none",
            "--edges",
            "normal,no-proc-macro",
            "--depth",
            &depth,
        ],
        &["-p", package, "--target", target],
    );
    let names = text.lines().filter_map(|line| line.split(' ').next());
    names
        .filter(|name| !name.is_empty() && *name != package)
        .map(str::to_owned)
        .collect()
}

fn cargo(command: &[&str], arguments: &[&str]) -> String {
    let output = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()))
        .args(command)
        .args(arguments)
        // Its configuration names the Cortex-M33; flags of the outer build are not for these processors.
        .current_dir(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../chips")))
        .env_remove("RUSTFLAGS")
        .env_remove("CARGO_ENCODED_RUSTFLAGS")
        .env("CARGO_TARGET_DIR", directory())
        .output()
        .unwrap_or_else(|error| panic!("cargo does not start: {error}"));
    assert!(
        output.status.success(),
        "cargo {} {} (`rustup target add` what is missing, or ./test chip):\n{}",
        command.join(" "),
        arguments.join(" "),
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8_lossy(&output.stdout).into_owned()
}
