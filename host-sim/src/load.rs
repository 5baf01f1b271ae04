//! How many vehicles a sub-channel carries: mean ages on a ladder of loads, and where they pass the ages that services ask for.
//!
//! Ages are uncapped, since most of the ladder lies beyond T. A policy climbs until its age is too high for every service.

use crate::age::uncapped_ideal_age_ms;
use crate::experiment::{Experiment, ExperimentSource};
use crate::mobility::Grid;
use crate::policy::Kind;
use kit::error::Result;

/// Mean ages that services ask for, in ms (chosen, decades).
pub const AGES_MS: [f64; 3] = [10.0, 100.0, 1000.0];

/// From one rung of the ladder to the next (chosen: ages between them are close to a power of the load).
const STEP: f64 = 1.4;

/// How many times the mean age that is expected a rung runs before it counts, in which ages forget their start, and then counts (chosen).
const WARMUP_AGES: f64 = 4.0;
const COUNTED_AGES: f64 = 2.0;

/// What a policy does with a number of vehicles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rung {
    /// In the cell.
    pub vehicles: u32,
    /// Uncapped mean age, in ms.
    pub mean_ms: f64,
    /// Half the width of its 95 % interval over worlds; `None` for a single world, and for the bound.
    pub ci95_ms: Option<f64>,
}

impl Rung {
    /// Lower end, mean and upper end. No age is below 1 ms, wherever the interval of a few worlds ends.
    fn ages_ms(&self) -> [f64; 3] {
        let half = self.ci95_ms.unwrap_or(0.0);
        [-half, 0.0, half].map(|off| (self.mean_ms + off).max(1.0))
    }
}

/// A policy's ages on the ladder, up to the first load that no service bears.
#[derive(Clone, Debug, PartialEq)]
pub struct Climb {
    /// Who decides.
    pub policy: &'static str,
    /// By ascending load.
    pub rungs: Vec<Rung>,
}

/// Vehicles that a sub-channel carries at a mean age. `None` is more than the ladder has, 0 less than one a sub-channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carried {
    /// At the mean.
    pub vehicles: Option<f64>,
    /// At both ends of the mean's 95 % interval, where it has one: the fewer first.
    pub interval: Option<[Option<f64>; 2]>,
}

/// Loads from one vehicle a sub-channel up to `most` vehicles in the cell, each `STEP` times the one before.
pub fn ladder(sub_channels: u32, most: u32) -> Vec<u32> {
    let mut loads = vec![sub_channels.min(most)];
    let mut load = f64::from(sub_channels);
    while loads.last().is_some_and(|&last| last < most) {
        load *= STEP;
        let rounded = libm::round(load).min(f64::from(most)) as u32;
        if !loads.contains(&rounded) {
            loads.push(rounded);
        }
    }
    loads
}

/// Lets a policy climb on the urban grid. The source says what else is simulated; its slots and warm-up are the least.
/// `before_rung` hears of every load.
///
/// # Errors
/// As [`ExperimentSource::read_with`] and [`crate::Simulation::run`].
pub fn climb(
    source: &ExperimentSource,
    policy: &'static Kind,
    ladder: &[u32],
    before_rung: impl Fn(u32),
) -> Result<Climb> {
    let mut rungs: Vec<Rung> = Vec::new();
    for &vehicles in ladder {
        before_rung(vehicles);
        let expected_ms = rungs.last().map_or(0.0, |rung| STEP * rung.mean_ms);
        let slots = |ages: f64| libm::ceil(ages * expected_ms) as u32;
        let experiment = ExperimentSource {
            vehicles: Some(vehicles),
            policies: vec![policy],
            slots: Some(source.slots.unwrap_or(0).max(slots(COUNTED_AGES))),
            warmup: source.warmup.max(slots(WARMUP_AGES)),
            ..source.clone()
        }
        .read_with(Box::new(Grid))?;
        let rung = measure(&experiment, policy, vehicles)?;
        rungs.push(rung);
        if rung.ages_ms()[0] > AGES_MS[AGES_MS.len() - 1] {
            break;
        }
    }
    Ok(Climb {
        policy: policy.name,
        rungs,
    })
}

fn measure(experiment: &Experiment, policy: &'static Kind, vehicles: u32) -> Result<Rung> {
    let table = experiment.table.parse()?;
    let (ages, _) = experiment.simulation().run_policy(policy, &table, |_, _| ())?;
    Ok(Rung {
        vehicles,
        mean_ms: ages.uncapped_mean_ms,
        ci95_ms: ages.uncapped_ci95_ms,
    })
}

/// What the bound is called among the policies.
pub const BOUND: &str = "(bound)";

/// The bound on the same ladder: an ideal schedule without fading.
pub fn bound(sub_channels: u32, ladder: &[u32]) -> Climb {
    let rung = |&vehicles: &u32| Rung {
        vehicles,
        mean_ms: uncapped_ideal_age_ms(vehicles, sub_channels),
        ci95_ms: None,
    };
    Climb {
        policy: BOUND,
        rungs: ladder.iter().map(rung).collect(),
    }
}

impl Climb {
    /// How many vehicles a sub-channel carries at a mean age of at most `age_ms`: up to where the age first passes it, on a straight
    /// line between two rungs where both axes are logarithmic.
    pub fn carried(&self, age_ms: f64, sub_channels: u32) -> Carried {
        let at = |end: usize| {
            let point = |rung: &Rung| {
                let load = f64::from(rung.vehicles) / f64::from(sub_channels);
                (load, rung.ages_ms()[end])
            };
            let above = self.rungs.iter().position(|rung| point(rung).1 > age_ms)?;
            let Some(below) = above.checked_sub(1) else {
                return Some(0.0);
            };
            let ((from, from_ms), (to, to_ms)) = (point(&self.rungs[below]), point(&self.rungs[above]));
            let share = libm::log(age_ms / from_ms) / libm::log(to_ms / from_ms);
            Some(from * libm::pow(to / from, share))
        };
        let has_interval = self.rungs.iter().all(|rung| rung.ci95_ms.is_some());
        Carried {
            vehicles: at(1),
            interval: has_interval.then(|| [at(2), at(0)]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ladders_end_at_the_most() {
        assert_eq!(ladder(3, 10), [3, 4, 6, 8, 10]);
        assert_eq!(ladder(1, 1), [1]);
        assert_eq!(ladder(8, 5), [5]);
        assert_eq!(ladder(1, 2000).last(), Some(&2000));
    }

    #[test]
    fn the_bound_carries_twice_the_age() {
        // (V / N + 1) / 2 is the age in ms.
        let climb = bound(3, &ladder(3, 2000));
        for (age_ms, vehicles) in [(10.0, 19.0), (100.0, 199.0)] {
            let carried = climb.carried(age_ms, 3).vehicles.unwrap();
            assert!((carried / vehicles - 1.0).abs() < 0.002, "{carried}");
        }
        assert_eq!(climb.carried(1000.0, 3).vehicles, None, "more than 667");
        assert_eq!(climb.carried(1000.0, 3).interval, None);
    }

    #[test]
    fn carried_loads_lie_between_two_rungs() {
        let rung = |vehicles, mean_ms, half| Rung {
            vehicles,
            mean_ms,
            ci95_ms: Some(half),
        };
        let climb = Climb {
            policy: "some",
            rungs: vec![rung(1, 5.0, 1.0), rung(4, 20.0, 4.0), rung(8, 400.0, 200.0)],
        };
        let carried = climb.carried(10.0, 1);
        assert!((carried.vehicles.unwrap() - 2.0).abs() < 1e-12);
        let [fewer, more] = carried.interval.unwrap().map(Option::unwrap);
        assert!(fewer > 1.0 && fewer < 2.0 && more > 2.0 && more < 4.0);
        assert_eq!(climb.carried(3.0, 1).vehicles, Some(0.0));
        let open = climb.carried(500.0, 1);
        assert_eq!(open.vehicles, None);
        assert!(open.interval.unwrap()[0].is_some_and(|fewer| fewer < 8.0));
    }
}
