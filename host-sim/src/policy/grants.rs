//! Dynamic grants: the base station says slot by slot who sends, some slots ahead, and knows no gain.

use super::{Decider, Kind, Needs, Scheduler};
use crate::decisions::Decisions;
use crate::lanes::Rows;
use crate::truth::Knowledge;
use firmware::units::Dbm;
use std::cmp::Reverse;

/// The oldest vehicles first, as many as there are sub-channels.
pub static KIND: Kind = Kind {
    name: "grants",
    meaning: "Dynamic grants: the oldest vehicles first, decided some slots ahead, without any gain.",
    stream: 8,
    needs: Needs::Nothing,
    build: |setup, _| {
        let delay = setup.scenario.baselines.grant_delay_slots;
        let grants = setup.worlds() * setup.scenario.radio.sub_channels as usize;
        Decider::Scheduler(Box::new(Grants {
            max_power: setup.scenario.radio.max_power(),
            delay,
            under_way: (0..=delay).map(|_| Vec::with_capacity(grants)).collect(),
            busy_until: Rows::new(setup.worlds(), setup.vehicles, 0),
            waiting: Vec::with_capacity(setup.vehicles),
        }))
    },
};

struct Grants {
    max_power: Dbm,
    /// Slots from a decision to its transmission.
    delay: u32,
    /// Decisions of the last slots, `[slot modulo the ring's length]`.
    under_way: Vec<Vec<Grant>>,
    /// First slot in which a vehicle has no grant under way. `[vehicle][world]`.
    busy_until: Rows<u32>,
    /// Those without a grant, of the world in work.
    waiting: Vec<usize>,
}

/// Who may send in a slot.
struct Grant {
    world: usize,
    vehicle: usize,
    /// The slot of its association: whoever has the index later is not meant.
    associated_at: u32,
    sub_channel: usize,
}

impl Scheduler for Grants {
    fn decide(&mut self, known: &Knowledge<'_>, decisions: &mut Decisions) {
        let (slot, ring) = (known.elapsed as usize, self.under_way.len());
        let (now, due) = (slot % ring, (slot + 1) % ring);
        let mut decided = std::mem::take(&mut self.under_way[now]);
        let mut waiting = std::mem::take(&mut self.waiting);
        decided.clear();
        for world in 0..known.worlds {
            let present = known.presence.vehicles().iter().copied();
            let here = present.filter(|&vehicle| known.presence.contains(world, vehicle));
            waiting.clear();
            waiting.extend(here.filter(|&vehicle| self.is_free(known, world, vehicle)));
            waiting.sort_unstable_by_key(|&vehicle| (Reverse(known.ages.get(world, vehicle)), vehicle));
            for (turn, &vehicle) in waiting.iter().take(known.sub_channels).enumerate() {
                let free_from = known.elapsed + self.delay + 1;
                self.busy_until.set(world, vehicle, free_from);
                decided.push(Grant {
                    world,
                    vehicle,
                    associated_at: known.associated_at.get(world, vehicle),
                    // From slot to slot another one, so that no fade lasts.
                    sub_channel: (slot + turn) % known.sub_channels,
                });
            }
        }
        self.waiting = waiting;
        self.under_way[now] = decided;
        for grant in self.under_way[due].drain(..) {
            let same = known.associated_at.get(grant.world, grant.vehicle) == grant.associated_at;
            if same && known.presence.contains(grant.world, grant.vehicle) {
                decisions.transmit(grant.world, grant.vehicle, grant.sub_channel, self.max_power);
            }
        }
    }
}

impl Grants {
    /// Whether a vehicle has no grant under way; one for who had its index before does not count.
    fn is_free(&self, known: &Knowledge<'_>, world: usize, vehicle: usize) -> bool {
        let until = self.busy_until.get(world, vehicle);
        let decided_at = until.saturating_sub(self.delay + 1);
        until <= known.elapsed || known.associated_at.get(world, vehicle) > decided_at
    }
}
