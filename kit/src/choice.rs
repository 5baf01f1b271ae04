//! Choices that people make by name: policies, presets, algorithms.

use crate::error::{Error, Result};

/// One of a fixed list of choices. Command lines, help, reports and Python read the same list.
pub trait Choice: Copy + 'static {
    /// Every choice, in the order of help and reports.
    const ALL: &'static [Self];

    /// The name that people write.
    fn name(self) -> &'static str;

    /// What it means, in one sentence for help.
    fn meaning(self) -> &'static str;

    /// The choice of this name; `place` is what errors call the option or argument.
    ///
    /// # Errors
    /// [`Error::Input`] with all names if there is none.
    fn of_name(place: &str, name: &str) -> Result<Self> {
        let found = Self::ALL.iter().find(|choice| choice.name() == name);
        found.copied().ok_or_else(|| {
            let names: Vec<String> = Self::ALL
                .iter()
                .map(|choice| format!("\"{}\"", choice.name()))
                .collect();
            Error::input(place, format!("\"{name}\""), names.join(", "))
        })
    }
}
