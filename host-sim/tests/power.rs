//! The power goes as soon as a command has ended: every file that it wrote is whole.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use std::fs::{copy, create_dir, read};
use std::path::{Path, PathBuf};
use std::process::Command;

/// A file system of its own in a file, as long as it is held.
struct Mounted(PathBuf);

impl Mounted {
    /// `None` where this user may not mount.
    fn new(image: &Path, place: PathBuf) -> Option<Self> {
        create_dir(&place).unwrap();
        done(Command::new("mount").args(["-o", "loop"]).arg(image).arg(&place)).then_some(Self(place))
    }
}

impl Drop for Mounted {
    fn drop(&mut self) {
        let _gone = done(Command::new("umount").arg(&self.0));
    }
}

fn done(command: &mut Command) -> bool {
    command.output().is_ok_and(|output| output.status.success())
}

/// All files below a folder but those that begin with a dot.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true if path.ends_with("lost+found") => {}
            true => found.extend(files(&path)),
            false => found.push(path),
        }
    }
    found
}

/// Where the rights to mount are missing, the order of steps that `kit` tests has to do.
#[test]
fn what_a_command_wrote_outlives_the_power() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let image = path("image");
    std::fs::File::create(&image).unwrap().set_len(64 << 20).unwrap();
    let made = done(Command::new("mkfs.ext4").arg("-q").arg(&image));
    let Some(disk) = made.then(|| Mounted::new(&image, path("disk"))).flatten() else {
        println!("no rights to mount a file system: not tested");
        return;
    };
    std::fs::write(
        path("grid.toml"),
        "worlds = 1\nslots = 30\nseed = [1, 2, 3]\npolicy = \"clock\"\n",
    )
    .unwrap();
    let fixture = |name: &str| {
        let fixtures = concat!(env!("CARGO_MANIFEST_DIR"), "/../assignment/tests/fixtures/");
        format!("{fixtures}{name}")
    };
    let (net, trips) = (fixture("SiouxFalls_net.tntp"), fixture("SiouxFalls_trips.tntp"));
    for arguments in [
        &[
            "sweep",
            "--grid",
            path("grid.toml").to_str().unwrap(),
            "--out",
            "sweep",
        ][..],
        &[
            "run", "--worlds", "1", "--slots", "50", "--policy", "clock", "--out", "run/deep",
        ],
        &["assign", "--net", &net, "--trips", &trips, "--flows", "flows.csv"],
    ] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_host-sim"));
        assert!(
            done(command.args(arguments).current_dir(&disk.0)),
            "{arguments:?}"
        );
    }
    // What is on the disk at this instant, whatever else the system meant to write.
    let _bytes = copy(&image, path("after")).unwrap();
    let after = Mounted::new(&path("after"), path("later")).unwrap();
    let written = files(&disk.0);
    assert!(written.len() > 10, "{written:?}");
    for file in written {
        let same = after.0.join(file.strip_prefix(&disk.0).unwrap());
        let found = read(&same).unwrap_or_else(|error| panic!("{}: {error}", same.display()));
        assert!(found == read(&file).unwrap(), "{} is not whole", same.display());
    }
}
