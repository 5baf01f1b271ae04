//! Logging for people: what the counters say once a second.

use firmware::telemetry::Telemetry;

/// Slots between two records.
#[cfg(feature = "defmt")]
const RECORD_SLOTS: u32 = 1000;

/// Notes a decided slot.
#[cfg(not(feature = "defmt"))]
pub const fn decided(_: &Telemetry, _: u32) {}

/// Notes a decided slot.
#[cfg(feature = "defmt")]
pub fn decided(telemetry: &Telemetry, slot: u32) {
    SLOT.store(slot, core::sync::atomic::Ordering::Relaxed);
    if telemetry.slots.is_multiple_of(RECORD_SLOTS) {
        defmt::info!(
            "slots {=u32}, transmissions {=u32}, degraded {=u32}, overdue {=u32}, dropped frames {=u32}, mean power {=f32} mW",
            telemetry.slots,
            telemetry.transmissions,
            telemetry.degraded,
            telemetry.overdue,
            telemetry.dropped_frames,
            telemetry.mean_power_mw()
        );
    }
}

/// Log records carry the last decided slot: the modem's time, which its own log has too.
#[cfg(feature = "defmt")]
static SLOT: core::sync::atomic::AtomicU32 = core::sync::atomic::AtomicU32::new(0);

#[cfg(feature = "defmt")]
defmt::timestamp!("slot {=u32}", SLOT.load(core::sync::atomic::Ordering::Relaxed));

#[cfg(all(feature = "defmt", not(feature = "semihosting")))]
use defmt_rtt as _;
#[cfg(feature = "semihosting")]
use defmt_semihosting as _;
