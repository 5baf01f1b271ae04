//! What all vehicles of a batch of worlds do in one slot.

use crate::lanes::{Row, Rows};
use firmware::decision::Decision;
use firmware::units::{Dbm, SubChannel};

/// The sub-channel of a vehicle that sends nothing.
pub const SILENT: u8 = u8::MAX;

/// One slot's decisions, `[vehicle][world]`, of all vehicles that ever appear. An absent one's counts for nothing.
#[derive(Clone, Debug, PartialEq)]
pub struct Decisions {
    /// [`SILENT`], or which.
    sub_channel: Rows<u8>,
    /// In 1/256 dBm; means nothing for the silent.
    power: Rows<i16>,
}

impl Decisions {
    /// Everybody silent.
    pub fn new(worlds: usize, vehicles: usize) -> Self {
        Self {
            sub_channel: Rows::new(worlds, vehicles, SILENT),
            power: Rows::new(worlds, vehicles, 0),
        }
    }

    /// Makes everybody silent.
    pub fn clear(&mut self) {
        self.sub_channel.as_flat_mut().fill(SILENT);
    }

    /// A vehicle sends on the sub-channel with this index.
    pub fn transmit(&mut self, world: usize, vehicle: usize, sub_channel: usize, power: Dbm) {
        self.sub_channel.set(world, vehicle, sub_channel as u8);
        self.power.set(world, vehicle, power.to_bits());
    }

    /// A vehicle does what its unit says.
    pub fn set(&mut self, world: usize, vehicle: usize, decision: Decision) {
        match decision {
            Decision::Silent => self.sub_channel.set(world, vehicle, SILENT),
            Decision::Transmit { sub_channel, power } => {
                self.transmit(world, vehicle, sub_channel.index(), power);
            }
        }
    }

    /// A vehicle's sub-channel and power, if it sends.
    pub fn transmission(&self, world: usize, vehicle: usize) -> Option<(usize, Dbm)> {
        let sub_channel = self.sub_channel.get(world, vehicle);
        let power = Dbm::from_bits(self.power.get(world, vehicle));
        (sub_channel != SILENT).then_some((usize::from(sub_channel), power))
    }

    /// The decision as a unit makes it; silent on a sub-channel that units do not know.
    pub fn get(&self, world: usize, vehicle: usize) -> Decision {
        let transmission = self.transmission(world, vehicle);
        let decision = transmission.and_then(|(sub_channel, power)| {
            let sub_channel = SubChannel::new(sub_channel as u8)?;
            Some(Decision::Transmit { sub_channel, power })
        });
        decision.unwrap_or(Decision::Silent)
    }

    /// A vehicle's sub-channels and powers in one block of worlds.
    #[inline(always)]
    pub(crate) fn rows(&self, block: usize, vehicle: usize) -> (&Row<u8>, &Row<i16>) {
        (
            self.sub_channel.row(block, vehicle),
            self.power.row(block, vehicle),
        )
    }

    /// The same, to be written.
    #[inline(always)]
    pub(crate) fn rows_mut(&mut self, block: usize, vehicle: usize) -> (&mut Row<u8>, &mut Row<i16>) {
        (
            self.sub_channel.row_mut(block, vehicle),
            self.power.row_mut(block, vehicle),
        )
    }
}
