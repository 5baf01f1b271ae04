//! What all vehicles of a batch of worlds do in one slot.

use crate::lanes::{LANES, Row, Rows};
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
        self.of(world / LANES, vehicle).set(world % LANES, decision);
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

    /// What a vehicle does in one block of worlds, to be decided.
    #[inline(always)]
    pub fn of(&mut self, block: usize, vehicle: usize) -> VehicleDecisions<'_> {
        VehicleDecisions {
            sub_channel: self.sub_channel.row_mut(block, vehicle),
            power: self.power.row_mut(block, vehicle),
        }
    }

    /// Takes over other decisions, and silences whoever is not present: `here` is 1 where a vehicle is, `[vehicle][world]`.
    pub(crate) fn copy_present(&mut self, decisions: &Self, here: &Rows<u8>) {
        self.power
            .as_flat_mut()
            .copy_from_slice(decisions.power.as_flat());
        let chosen = decisions.sub_channel.as_flat().iter().zip(here.as_flat());
        for (own, (&chosen, &here)) in self.sub_channel.as_flat_mut().iter_mut().zip(chosen) {
            *own = if here > 0 { chosen } else { SILENT };
        }
    }
}

/// What one vehicle does in a row of worlds.
#[derive(Debug)]
pub struct VehicleDecisions<'d> {
    /// [`SILENT`], or the sub-channel, by world.
    pub sub_channel: &'d mut Row<u8>,
    /// In 1/256 dBm, by world; means nothing for the silent.
    pub power: &'d mut Row<i16>,
}

impl VehicleDecisions<'_> {
    /// Does what a unit says in a world of the row.
    pub fn set(&mut self, lane: usize, decision: Decision) {
        match decision {
            Decision::Silent => self.sub_channel[lane] = SILENT,
            Decision::Transmit { sub_channel, power } => {
                self.sub_channel[lane] = sub_channel.index() as u8;
                self.power[lane] = power.to_bits();
            }
        }
    }
}
