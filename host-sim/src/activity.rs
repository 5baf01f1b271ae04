//! What the vehicles of every world did in a slot, summed over them.

use crate::decisions::{Decisions, SILENT};
use crate::lanes::{LANES, Row, Rows, Vectors, ratio};
use crate::presence::Presence;

/// Level in dBm whose energy in a slot of 1 ms is 1 mJ: 1 W.
const MILLIJOULE_DBM: f32 = 30.0;

/// Sums over the vehicles that were present in a slot, in every world of a batch: one item each.
#[derive(Clone, Debug)]
pub struct Activity {
    pub(crate) vehicles: Rows<u16>,
    pub(crate) transmissions: Rows<u16>,
    pub(crate) energy_mj: Rows<f32>,
    pub(crate) peak_ages: Rows<u32>,
}

impl Activity {
    /// Before the first slot.
    pub(crate) fn new(worlds: usize) -> Self {
        Self {
            vehicles: Rows::new(worlds, 1, 0),
            transmissions: Rows::new(worlds, 1, 0),
            energy_mj: Rows::new(worlds, 1, 0.0),
            peak_ages: Rows::new(worlds, 1, 0),
        }
    }

    /// Before the first slot of other worlds.
    pub(crate) fn reset(&mut self) {
        self.vehicles.fill_all(0);
        self.transmissions.fill_all(0);
        self.energy_mj.fill_all(0.0);
        self.peak_ages.fill_all(0);
    }

    /// How many vehicles were present.
    pub fn vehicles(&self) -> &Rows<u16> {
        &self.vehicles
    }

    /// How many of them sent.
    pub fn transmissions(&self) -> &Rows<u16> {
        &self.transmissions
    }

    /// The energy that they radiated, in mJ. A world's sum goes through its vehicles in ascending order, whatever batch it is in.
    pub fn energy_mj(&self) -> &Rows<f32> {
        &self.energy_mj
    }

    /// The sum of the ages that receptions ended: what each received vehicle's would have become without.
    pub fn peak_ages(&self) -> &Rows<u32> {
        &self.peak_ages
    }

    /// Takes in a slot: who was present, what they did, who was received (1 or 0, `[vehicle][world]`), and the ages before.
    /// Decisions of those who are absent are silent.
    pub(crate) fn record(
        &mut self,
        vectors: Vectors,
        presence: &Presence,
        decisions: &Decisions,
        received: &Rows<u8>,
        ages: &Rows<u16>,
    ) {
        for block in 0..self.vehicles.blocks() {
            vectors.run(
                #[inline(always)]
                || {
                    *self.vehicles.row_mut(block, 0) = vehicles(block, presence);
                    let (transmissions, energy_mj) = sent(block, presence.vehicles(), decisions);
                    *self.transmissions.row_mut(block, 0) = transmissions;
                    *self.energy_mj.row_mut(block, 0) = energy_mj;
                    let peak_ages = peak_ages(block, presence.vehicles(), received, ages);
                    *self.peak_ages.row_mut(block, 0) = peak_ages;
                },
            );
        }
    }
}

#[inline(always)]
fn vehicles(block: usize, presence: &Presence) -> Row<u16> {
    let present = presence.vehicles();
    let Some(here) = presence.rows() else {
        return [present.len() as u16; LANES];
    };
    let mut sums = [0; LANES];
    for &vehicle in present {
        let here = here.row(block, vehicle);
        for lane in 0..LANES {
            sums[lane] += u16::from(here[lane]);
        }
    }
    sums
}

/// Transmissions and their energy in mJ.
#[inline(always)]
fn sent(block: usize, present: &[usize], decisions: &Decisions) -> (Row<u16>, Row<f32>) {
    let (mut transmissions, mut energy_mj) = ([0; LANES], [0.0; LANES]);
    // Most policies send at one power, so that one row of energies serves many vehicles.
    let (mut known, mut known_mj) = (None, [0.0; LANES]);
    for &vehicle in present {
        let (chosen, power) = decisions.rows(block, vehicle);
        if known != Some(power) {
            known = Some(power);
            for lane in 0..LANES {
                known_mj[lane] = ratio(f32::from(power[lane]) / 256.0 - MILLIJOULE_DBM);
            }
        }
        for lane in 0..LANES {
            transmissions[lane] += u16::from(chosen[lane] != SILENT);
        }
        for lane in 0..LANES {
            // Chosen by masks, as in the radio.
            let sends = u32::from(chosen[lane] != SILENT).wrapping_neg();
            energy_mj[lane] += f32::from_bits(sends & known_mj[lane].to_bits());
        }
    }
    (transmissions, energy_mj)
}

#[inline(always)]
fn peak_ages(block: usize, present: &[usize], received: &Rows<u8>, ages: &Rows<u16>) -> Row<u32> {
    let mut sums = [0; LANES];
    for &vehicle in present {
        let (received, ages) = (received.row(block, vehicle), ages.row(block, vehicle));
        for lane in 0..LANES {
            let peak = u32::from(ages[lane].saturating_add(1));
            sums[lane] += peak & u32::from(received[lane]).wrapping_neg();
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mobility::Place;
    use firmware::units::Dbm;

    #[test]
    fn a_slot_by_hand() {
        let mut presence = Presence::new(2, 3, false);
        let places = [(0, Place::default()), (2, Place::default())];
        presence.update(0, &places, &mut Vec::new(), &mut Vec::new());
        let mut decisions = Decisions::new(2, 3);
        // World 0: two send, 1 W and 0.1 W, and one is heard at its age of 41. World 1: nobody sends. Vehicle 1 is not there.
        decisions.transmit(0, 0, 0, Dbm::from_bits(30 << 8));
        decisions.transmit(0, 2, 1, Dbm::from_bits(20 << 8));
        let (mut received, mut ages) = (Rows::new(2, 3, 0), Rows::new(2, 3, 7));
        received.set(0, 2, 1);
        for (vectors, age, peak) in [(Vectors::widest(), 41, 42), (Vectors::plain(), 700, 701)] {
            ages.set(0, 2, age);
            let mut activity = Activity::new(2);
            activity.record(vectors, &presence, &decisions, &received, &ages);
            assert_eq!([0, 1].map(|world| activity.vehicles().get(world, 0)), [2, 2]);
            assert_eq!([0, 1].map(|world| activity.transmissions().get(world, 0)), [2, 0]);
            assert!((activity.energy_mj().get(0, 0) - 1.1).abs() < 1e-6);
            assert_eq!(activity.energy_mj().get(1, 0), 0.0);
            assert_eq!([0, 1].map(|world| activity.peak_ages().get(world, 0)), [peak, 0]);
        }
    }
}
