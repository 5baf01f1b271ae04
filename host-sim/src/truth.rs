//! What is true in a batch of worlds at the beginning of a slot, and the part of it that a base station can know.

use crate::base_station::Announcements;
use crate::lanes::{Rows, Vectors};
use crate::presence::Presence;

/// What a base station knows: who is associated, whom it received when, what it announces itself, and how it would hear its
/// vehicles, as well as the scenario lets it.
#[derive(Clone, Copy, Debug)]
pub struct Knowledge<'t> {
    /// Slots since the start.
    pub elapsed: u32,
    /// How many worlds.
    pub worlds: usize,
    /// How many sub-channels the cell has.
    pub sub_channels: usize,
    /// The associated vehicles.
    pub presence: &'t Presence,
    /// The slot, counted from the start, at which a present vehicle associated: a later one at the same index is another vehicle.
    /// `[vehicle][world]`.
    pub associated_at: &'t Rows<u32>,
    /// Slots since a vehicle was last received, saturating: its age of information, `[vehicle][world]`.
    pub ages: &'t Rows<u16>,
    /// Whether each vehicle was received in the slot before: 1 or 0, `[vehicle][world]`.
    pub receptions: &'t Rows<u8>,
    /// Gain on every sub-channel in dB over noise at full power, as old and as inexact as the vehicles know it: from the reference
    /// signals by which a base station sounds the uplink (3GPP TS 36.213 8.2). `[vehicle][sub_channel][world]`.
    pub gains_db: &'t Rows<f32>,
    /// Gain in dB without fast fading, which a base station measures over time. `[vehicle][world]`.
    pub large_scale_db: &'t Rows<f32>,
    /// Largest Doppler shift of each vehicle in Hz, which it measures over time as well, `[vehicle][world]`; `None` where fading is
    /// new in every slot.
    pub doppler_hz: Option<&'t Rows<f32>>,
    /// Places and what is broadcast.
    pub announcements: &'t Announcements,
    /// The vector unit for loops over rows.
    pub vectors: Vectors,
}

/// Everything, which nobody in the cell knows.
#[derive(Clone, Copy, Debug)]
pub struct Truth<'t> {
    /// What the base station knows.
    pub known: Knowledge<'t>,
    /// Gains of the slot in dB over noise at full power, `[vehicle][sub_channel][world]`.
    pub gains_db: &'t Rows<f32>,
}
