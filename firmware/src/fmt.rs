//! Logging: `defmt` where the feature is on, nothing where it is off.

/// Logs something that needs a person's attention.
macro_rules! log_warning {
    ($format:literal $(, $argument:expr)* $(,)?) => {{
        #[cfg(feature = "defmt")]
        ::defmt::warn!($format $(, $argument)*);
        #[cfg(not(feature = "defmt"))]
        { $( let _ = &$argument; )* }
    }};
}

/// Logs progress.
macro_rules! log_info {
    ($format:literal $(, $argument:expr)* $(,)?) => {{
        #[cfg(feature = "defmt")]
        ::defmt::info!($format $(, $argument)*);
        #[cfg(not(feature = "defmt"))]
        { $( let _ = &$argument; )* }
    }};
}

pub(crate) use {log_info, log_warning};
