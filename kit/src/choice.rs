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

/// Declares a choice that stands in configurations: an enumeration whose variants carry their meaning as a doc comment, and
/// their name.
///
/// ```
/// use kit::choice::Choice as _;
///
/// kit::choices! {
///     /// When networks learn.
///     pub enum Updates {
///         /// Once after every episode.
///         Episode = "episode",
///         /// Once after every slot.
///         Slot = "slot",
///     }
/// }
/// assert_eq!(Updates::Slot.meaning(), "Once after every slot.");
/// ```
#[macro_export]
macro_rules! choices {
    ($(
        $(#[$attribute:meta])*
        $visibility:vis enum $choice:ident {
            $($(#[doc = $meaning:literal])+ $variant:ident = $name:literal,)+
        }
    )+) => {$(
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        $visibility enum $choice {
            $($(#[doc = $meaning])+ #[serde(rename = $name)] $variant,)+
        }

        impl $crate::choice::Choice for $choice {
            const ALL: &'static [Self] = &[$(Self::$variant,)+];

            fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }

            fn meaning(self) -> &'static str {
                match self {
                    $(Self::$variant => concat!($($meaning),+).trim_ascii(),)+
                }
            }
        }
    )+};
}
