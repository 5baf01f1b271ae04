//! Why bytes are no network.

/// Why bytes cannot be read as a network, or as a table around one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ReadError {
    /// Fewer bytes than needed.
    Truncated {
        /// Bytes there are.
        found: u32,
        /// Bytes there should be, at least.
        expected: u32,
    },
    /// A field has a value this firmware cannot serve.
    Field {
        /// Its name.
        name: &'static str,
        /// What was found.
        found: i32,
        /// The value, or the largest magnitude, that is accepted.
        expected: i32,
    },
}

impl ReadError {
    /// A field that does not fit.
    pub(crate) const fn field(name: &'static str, found: i32, expected: i32) -> Self {
        Self::Field {
            name,
            found,
            expected,
        }
    }
}

impl core::fmt::Display for ReadError {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Truncated { found, expected } => {
                write!(
                    formatter,
                    "truncated: found {found} bytes, expected at least {expected}"
                )
            }
            Self::Field {
                name,
                found,
                expected,
            } => write!(formatter, "{name}: found {found}, expected {expected}"),
        }
    }
}

impl core::error::Error for ReadError {}
