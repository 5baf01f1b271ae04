//! Where tables come from.

use firmware::table::Provenance;
use std::path::{Path, PathBuf};

include!(concat!(env!("OUT_DIR"), "/sources.rs"));

/// The top folder of the sources.
pub fn workspace_folder() -> PathBuf {
    let trainer = Path::new(env!("CARGO_MANIFEST_DIR"));
    trainer.parent().unwrap_or(trainer).to_owned()
}

/// Where a run with this seed comes from: the sources that this program was built of.
pub fn provenance(seed: u64) -> Provenance {
    Provenance {
        seed,
        revision: SOURCES,
        modified: false,
    }
}
