//! A unit's private randomness: a pure function of who it is and of the slot, so that a recorded slot replays exactly.

use crate::units::SlotIndex;
use core::convert::Infallible;
use rand_core::TryRng;

/// Who a unit is, as far as its lots are concerned. No two units of a cell should share it; 32 well mixed bits make that rare.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Identity(pub u32);

impl Identity {
    /// Of the device with this 96-bit identity. Chips of one wafer share the upper words (lot and wafer) and differ in the
    /// first (position).
    pub const fn of_device(device: [u32; 3]) -> Self {
        let [first, second, third] = device;
        Self(mix(first.wrapping_add(mix(second.wrapping_add(mix(third))))))
    }

    /// The first lot of a slot, uniform on 32 bits; the simulator calls it lane by lane.
    #[inline(always)]
    pub const fn lot(self, slot: SlotIndex) -> u32 {
        mix(self.0.wrapping_add(slot.0.wrapping_mul(GOLDEN)))
    }

    /// All lots of a slot, the same each time.
    pub const fn lots(self, slot: SlotIndex) -> Lots {
        Lots {
            state: self.0.wrapping_add(slot.0.wrapping_mul(GOLDEN)),
        }
    }
}

/// The lots of one slot.
#[derive(Clone, Debug)]
pub struct Lots {
    state: u32,
}

impl TryRng for Lots {
    type Error = Infallible;

    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        let lot = mix(self.state);
        // Another odd step than from slot to slot, so that no slot's lots are the next one's.
        self.state = self.state.wrapping_add(0x6c8e_9cf5);
        Ok(lot)
    }

    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        let [low, high] = [self.try_next_u32()?, self.try_next_u32()?];
        Ok(u64::from(high) << 32 | u64::from(low))
    }

    fn try_fill_bytes(&mut self, destination: &mut [u8]) -> Result<(), Infallible> {
        for bytes in destination.chunks_mut(4) {
            let lot = self.try_next_u32()?.to_le_bytes();
            bytes.iter_mut().zip(lot).for_each(|(byte, lot)| *byte = lot);
        }
        Ok(())
    }
}

/// 2^32 over the golden ratio: how far the state moves from slot to slot (Steele, Lea, Flood: Fast splittable pseudorandom number
/// generators, OOPSLA 2014).
const GOLDEN: u32 = 0x9e37_79b9;

/// The finaliser of MurmurHash3 (A. Appleby): every input bit changes every output bit with a probability near a half.
const fn mix(mut bits: u32) -> u32 {
    bits ^= bits >> 16;
    bits = bits.wrapping_mul(0x85eb_ca6b);
    bits ^= bits >> 13;
    bits = bits.wrapping_mul(0xc2b2_ae35);
    bits ^ bits >> 16
}
