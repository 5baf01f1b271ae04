//! The central scheduler: it sees every gain of the slot and every age, which no real base station can.

use super::{Decider, Kind, Needs, Oracle};
use crate::decisions::Decisions;
use crate::lanes::{LANES, Row};
use crate::scenario::Scenario;
use crate::truth::{Knowledge, Truth};
use firmware::units::Dbm;

/// Greedy by age: the oldest vehicle first, on its best free sub-channel that carries C_min, at full power.
pub static KIND: Kind = Kind {
    name: "central",
    meaning: "A scheduler that knows everything: the oldest vehicles first, each on its best free sub-channel.",
    stream: 1,
    needs: Needs::Nothing,
    build: |setup, _| Decider::Oracle(Box::new(Central::new(setup.scenario))),
};

struct Central {
    max_power: Dbm,
    required_db: f32,
    /// Rank of every present vehicle: the older, then the lower index; 0 once it was served, and where it is absent. `[present vehicle]`, of one
    /// block of worlds.
    ranks: Vec<Row<u32>>,
    /// Whether a sub-channel is free. `[sub_channel]`, of one block of worlds.
    free: Vec<Row<bool>>,
}

impl Central {
    fn new(scenario: &Scenario) -> Self {
        let required_db = 10.0 * libm::log10(scenario.radio.required_sinr());
        // Room for the rounding of gains between dB and ratios.
        Self {
            max_power: scenario.radio.max_power(),
            required_db: required_db as f32 + 1e-3,
            ranks: Vec::new(),
            free: vec![[true; LANES]; scenario.radio.sub_channels as usize],
        }
    }

    /// Every world's first in rank, whose rank becomes 0; 0 where nobody is left.
    #[inline(always)]
    fn take_first(&mut self) -> Row<u32> {
        let mut first = [0; LANES];
        for ranks in &self.ranks {
            for lane in 0..LANES {
                first[lane] = ranks[lane].max(first[lane]);
            }
        }
        for (lane, &rank) in first.iter().enumerate() {
            if rank > 0 {
                self.ranks[index(rank)][lane] = 0;
            }
        }
        first
    }
}

/// Ages above, then the index from the end.
const INDEX_BITS: u32 = 16;

fn rank(age: u16, index: usize) -> u32 {
    u32::from(age) << INDEX_BITS | (u32::from(u16::MAX) - index as u32)
}

fn index(rank: u32) -> usize {
    (u32::from(u16::MAX) - (rank & u32::from(u16::MAX))) as usize
}

impl Oracle for Central {
    fn decide(&mut self, truth: &Truth<'_>, decisions: &mut Decisions) {
        let Knowledge {
            presence,
            sub_channels,
            ages,
            worlds,
            vectors,
            ..
        } = truth.known;
        let (present, gains_db) = (presence.vehicles(), truth.gains_db);
        for block in 0..ages.blocks() {
            self.ranks.clear();
            self.ranks
                .extend(present.iter().enumerate().map(|(index, &vehicle)| {
                    let ages = ages.row(block, vehicle);
                    let here = presence.rows().map(|here| here.row(block, vehicle));
                    let here = |lane: usize| here.is_none_or(|here| here[lane] > 0);
                    std::array::from_fn(|lane| if here(lane) { rank(ages[lane], index) } else { 0 })
                }));
            self.free.fill([true; LANES]);
            let lanes = (worlds - block * LANES).min(LANES);
            let mut unserved = [sub_channels; LANES];
            for _ in 0..present.len() {
                let first = vectors.run(
                    #[inline(always)]
                    || self.take_first(),
                );
                for lane in 0..lanes {
                    if unserved[lane] == 0 || first[lane] == 0 {
                        continue;
                    }
                    let vehicle = present[index(first[lane])];
                    let gain_db = |n: usize| gains_db.row(block, vehicle * sub_channels + n)[lane];
                    let best = (0..sub_channels)
                        .filter(|&n| self.free[n][lane] && gain_db(n) >= self.required_db)
                        .max_by(|&a, &b| gain_db(a).total_cmp(&gain_db(b)));
                    if let Some(best) = best {
                        self.free[best][lane] = false;
                        unserved[lane] -= 1;
                        decisions.transmit(block * LANES + lane, vehicle, best, self.max_power);
                    }
                }
                if unserved[..lanes].iter().all(|&unserved| unserved == 0) {
                    break;
                }
            }
        }
    }
}
