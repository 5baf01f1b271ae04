//! `trainer explain`: what the keys of a configuration mean.

use crate::configuration::{Layout, Preset};
use host_sim::command::explain;
pub use host_sim::command::explain::ExplainArguments;
use kit::choice::Choice as _;
use kit::error::Result;

/// Explains a key, a section or every key.
///
/// # Errors
/// An unknown key.
pub fn run(arguments: &ExplainArguments) -> Result<()> {
    let values = |preset: &Preset| Ok((preset.name(), preset.values()?));
    let presets = Preset::ALL.iter().map(values).collect::<Result<Vec<_>>>()?;
    explain::explain(Layout::KEYS, &presets, arguments)
}
