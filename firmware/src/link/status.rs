//! How a unit is, for whoever runs a fleet of them.

use serde::{Deserialize, Serialize};

/// Everything that a unit knows of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StatusFrame {
    /// What it runs.
    pub table: TableStatus,
    /// What it did since it started.
    pub counters: Counters,
    /// Why it started.
    pub reset: ResetCause,
    /// What its core runs from.
    pub clock: ClockSource,
    /// The most bytes of stack that it took so far.
    pub stack_bytes: u16,
    /// What program it is.
    pub image: ImageStatus,
}

/// The running image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ImageStatus {
    /// Its version; 0 if its build named none.
    pub version: u32,
    /// Whether the next start takes it back unless it proves itself: see [`crate::image_store`].
    pub on_trial: bool,
}

/// What a unit runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TableStatus {
    /// The running table's version; 0 for the one that is built in.
    pub version: u32,
    /// Its checksum.
    pub checksum: u32,
    /// Where the newest table stands.
    pub trial: Trial,
    /// Only versions above this one are taken.
    pub floor: u32,
    /// How often table slots were erased, ever.
    pub erases: u32,
}

/// Where the newest table stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Trial {
    /// No table waits for a verdict.
    None,
    /// This version waits until the unit knows how it does with the running one.
    Waiting(u32),
    /// The running table is on trial.
    Running,
}

/// Counters since the start: see [`crate::telemetry::Telemetry`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "as in telemetry")]
pub struct Counters {
    pub slots: u32,
    pub transmissions: u32,
    pub degraded: u32,
    pub overdue: u32,
    pub dropped_frames: u32,
    pub doubted_frames: u32,
}

/// Why a unit started; a chip that names several causes names the first of this list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ResetCause {
    /// A watchdog.
    Watchdog,
    /// The program itself.
    Software,
    /// The supply came up.
    PowerOn,
    /// The supply fell below what the chip needs, and came back.
    BrownOut,
    /// The reset pin.
    Pin,
    /// None that the chip names, as in an emulator.
    Unknown,
}

/// What a core runs from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ClockSource {
    /// The crystal, at full speed.
    Crystal,
    /// The internal oscillator, at full speed: the crystal is dead, and the line's rate as inexact as the oscillator.
    Internal,
    /// The internal oscillator alone, too slow for a slot of 1 ms.
    InternalSlow,
    /// An emulator's.
    Emulated,
}
