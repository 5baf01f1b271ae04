//! Where tables come from.

use firmware::table::Provenance;
use host_sim::revision::source_revision;
use std::path::{Path, PathBuf};

/// The top folder of the sources.
pub fn workspace_folder() -> PathBuf {
    let trainer = Path::new(env!("CARGO_MANIFEST_DIR"));
    trainer.parent().unwrap_or(trainer).to_owned()
}

/// Where a run with this seed on the present sources comes from.
pub fn provenance(seed: u64) -> Provenance {
    let (revision, modified) = source_revision(&workspace_folder());
    Provenance {
        seed,
        revision,
        modified,
    }
}
