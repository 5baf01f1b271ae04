//! The folder in which targets find the input and what it goes with.

use crate::targets::{Seeds, Target};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Fixtures of the crates that targets use too: their paths, and their names here.
const SHARED: [(&str, &str); 7] = [
    ("assignment/tests/fixtures/Braess_net.tntp", "braess_net.tntp"),
    ("assignment/tests/fixtures/Braess_trips.tntp", "braess_trips.tntp"),
    ("assignment/tests/fixtures/SiouxFalls_net.tntp", "sioux_net.tntp"),
    (
        "assignment/tests/fixtures/SiouxFalls_node.tntp",
        "sioux_node.tntp",
    ),
    ("assignment/tests/fixtures/sumo_turn/net.xml", "town.net.xml"),
    ("assignment/tests/fixtures/sumo_turn/trips.xml", "trips.xml"),
    ("host-sim/tests/fixtures/fcd-gap.xml", "fcd.xml"),
];

/// In memory where the system has such a folder.
const IN_MEMORY: &str = "/dev/shm";

/// A folder of its own with everything that targets read.
pub struct Scene {
    folder: TempDir,
}

impl Scene {
    pub fn new() -> Self {
        let memory = Path::new(IN_MEMORY);
        let folder = if memory.is_dir() {
            tempfile::tempdir_in(memory).unwrap()
        } else {
            tempfile::tempdir().unwrap()
        };
        let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/scene");
        copy(&own, folder.path());
        let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
        for (from, to) in SHARED {
            std::fs::copy(workspace.join(from), folder.path().join(to)).unwrap();
        }
        Self { folder }
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Puts the input where the target reads it.
    pub fn put(&self, target: &Target, input: &[u8]) {
        std::fs::write(self.path().join(target.file), input).unwrap();
    }

    /// What mutations begin with.
    pub fn corpus(&self, target: &Target) -> Vec<Vec<u8>> {
        let mut corpus = match target.seeds {
            Seeds::File => vec![std::fs::read(self.path().join(target.file)).unwrap()],
            Seeds::Also(others) => {
                let files = [target.file].into_iter().chain(others.iter().copied());
                files
                    .map(|file| std::fs::read(self.path().join(file)).unwrap())
                    .collect()
            }
            Seeds::Made(make) => make(self.path()),
        };
        let kept = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("fuzz/corpus")
            .join(target.name);
        let mut kept: Vec<PathBuf> = std::fs::read_dir(kept)
            .into_iter()
            .flatten()
            .map(|entry| entry.unwrap().path())
            .collect();
        kept.sort();
        corpus.extend(kept.iter().map(|path| std::fs::read(path).unwrap()));
        corpus
    }
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let to = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &to);
        } else {
            std::fs::copy(&path, to).unwrap();
        }
    }
}
