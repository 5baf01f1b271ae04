//! Statistics of ages over slots, vehicles and worlds.

use crate::activity::Activity;
use crate::environment::Environment;
use crate::lanes::{LANES, Row, Rows, Vectors};

use firmware::units::Age;
use std::ops::AddAssign;

/// Slots at the start whose mean age is reported as `first100`.
const COLD_START_SLOTS: usize = 100;

/// Slots at the start whose mean ages are kept one by one.
const START_CURVE_SLOTS: usize = 300;

/// Where the paper's ages saturate, T.
const TIME_CONSTRAINT: u16 = Age::TIME_CONSTRAINT.slots();

const AGES: usize = TIME_CONSTRAINT as usize + 1;

/// Ages of one world.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldAges {
    /// Vehicle-slots after warm-up by age.
    histogram: [u64; AGES],
    /// By slot from the start.
    start: Vec<Mean>,
    /// By vehicle, after warm-up.
    by_vehicle: Vec<Mean>,
    /// The same of ages that do not saturate at T.
    uncapped: Vec<Mean>,
    successes: u64,
    slots: u64,
    /// Vehicle-slots after warm-up, each counted as the slot begins: what `transmissions` and `energy_mj` are over.
    vehicle_slots: u64,
    transmissions: u64,
    energy_mj: f64,
    /// Sum over successes of the ages that they ended.
    peak_ages: u64,
    /// How many slots those waited to be heard who joined the running world; `None` who never was.
    pub joiner_waits: Vec<Option<u32>>,
}

/// A sum and what it is over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mean {
    sum: u64,
    count: u64,
}

impl Mean {
    fn merge(&mut self, other: &Self) {
        self.sum += other.sum;
        self.count += other.count;
    }

    fn of_all<'m>(means: impl IntoIterator<Item = &'m Self>) -> Self {
        let mut total = Self::default();
        means.into_iter().for_each(|mean| total.merge(mean));
        total
    }

    /// How many values.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// The mean, if there is one.
    pub fn value(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum as f64 / self.count as f64)
    }
}

impl WorldAges {
    /// Mean over vehicles and slots after warm-up.
    pub fn mean(&self) -> Option<f64> {
        Mean::of_all(&self.by_vehicle).value()
    }

    /// Whether both ways to add up the ages give the same.
    fn agrees(&self) -> bool {
        let sum: u64 = (0..).zip(&self.histogram).map(|(age, count)| age * count).sum();
        sum == Mean::of_all(&self.by_vehicle).sum
    }

    /// The same of ages that do not saturate at T.
    pub fn uncapped_mean(&self) -> Option<f64> {
        Mean::of_all(&self.uncapped).value()
    }
}

/// Counts the ages of a batch of worlds.
#[derive(Clone, Debug)]
pub struct AgeCounter {
    warmup: u32,
    worlds: usize,
    /// Vehicle-slots after warm-up. `[age][world]`.
    histogram: Rows<u64>,
    /// Sum over vehicles. `[slot from the start][world]`.
    start: Rows<u32>,
    /// Vehicles in each slot from the start.
    start_counts: Vec<u64>,
    /// Sum over slots after warm-up. `[vehicle][world]`.
    by_vehicle: Rows<u64>,
    /// The same of ages that do not saturate at T.
    uncapped: Rows<u64>,
    /// Slots after warm-up in which a vehicle was present in some world.
    presence: Vec<u64>,
    /// Where worlds have different vehicles: how often a vehicle of the list was absent from a world, by slot from the start
    /// and, after warm-up, by vehicle. `[slot][world]` and `[vehicle][world]`.
    absences: Option<(Rows<u32>, Rows<u32>)>,
    /// Received transmissions after warm-up. One item, as all sums that follow.
    successes: Rows<u64>,
    vehicle_slots: Rows<u64>,
    transmissions: Rows<u64>,
    energy_mj: Rows<f64>,
    peak_ages: Rows<u64>,
    slots: u64,
}

impl AgeCounter {
    /// Nothing yet; slots before `warmup` count for the cold start only.
    pub fn new(warmup: u32, worlds: usize, vehicles: usize) -> Self {
        Self {
            warmup,
            worlds,
            histogram: Rows::new(worlds, AGES, 0),
            start: Rows::new(worlds, START_CURVE_SLOTS, 0),
            start_counts: Vec::with_capacity(START_CURVE_SLOTS),
            by_vehicle: Rows::new(worlds, vehicles, 0),
            uncapped: Rows::new(worlds, vehicles, 0),
            presence: vec![0; vehicles],
            absences: None,
            successes: Rows::new(worlds, 1, 0),
            vehicle_slots: Rows::new(worlds, 1, 0),
            transmissions: Rows::new(worlds, 1, 0),
            energy_mj: Rows::new(worlds, 1, 0.0),
            peak_ages: Rows::new(worlds, 1, 0),
            slots: 0,
        }
    }

    /// Takes in what a slot with this index, counted from the start, has left: ages after its transmissions, how many of these
    /// succeeded, and what they cost.
    pub fn record(&mut self, slot: u32, environment: &Environment<'_>) {
        let ages = environment.ages();
        match environment.presence().rows() {
            Some(here) => self.record_present(slot, here, ages),
            None => self.record_all(environment.vectors(), slot, environment.present(), ages),
        }
        if slot >= self.warmup {
            self.record_activity(environment.successes(), environment.activity());
        }
    }

    /// What a slot after warm-up adds to the sums over all vehicles of a world.
    fn record_activity(&mut self, successes: &Rows<u16>, activity: &Activity) {
        for block in 0..successes.blocks() {
            add(self.successes.row_mut(block, 0), successes.row(block, 0));
            add(
                self.vehicle_slots.row_mut(block, 0),
                activity.vehicles().row(block, 0),
            );
            add(
                self.transmissions.row_mut(block, 0),
                activity.transmissions().row(block, 0),
            );
            add(
                self.energy_mj.row_mut(block, 0),
                activity.energy_mj().row(block, 0),
            );
            add(
                self.peak_ages.row_mut(block, 0),
                activity.peak_ages().row(block, 0),
            );
        }
    }

    /// [`AgeCounter::record`] where the same vehicles are present in every world.
    fn record_all(&mut self, vectors: Vectors, slot: u32, present: &[usize], ages: &Rows<u16>) {
        let warm = slot >= self.warmup;
        let start = self.start_counts.len();
        let starting = start < START_CURVE_SLOTS;
        for block in 0..ages.blocks() {
            vectors.run(
                #[inline(always)]
                || {
                    if starting {
                        let sums = self.start.row_mut(block, start);
                        for &vehicle in present {
                            add(sums, &capped(ages.row(block, vehicle)));
                        }
                    }
                    if warm {
                        for &vehicle in present {
                            let ages = ages.row(block, vehicle);
                            add(self.by_vehicle.row_mut(block, vehicle), &capped(ages));
                            add(self.uncapped.row_mut(block, vehicle), ages);
                        }
                    }
                },
            );
            if warm {
                for &vehicle in present {
                    for (lane, age) in capped(ages.row(block, vehicle)).into_iter().enumerate() {
                        self.histogram.row_mut(block, usize::from(age))[lane] += 1;
                    }
                }
            }
        }
        if starting {
            self.start_counts.push(present.len() as u64);
        }
        if warm {
            self.slots += 1;
            present.iter().for_each(|&vehicle| self.presence[vehicle] += 1);
        }
    }

    /// [`AgeCounter::record`] where worlds have different vehicles: `here` is 1 where a vehicle is present, `[vehicle][world]`.
    fn record_present(&mut self, slot: u32, here: &Rows<u8>, ages: &Rows<u16>) {
        let (worlds, vehicles) = (self.worlds, self.presence.len());
        let (slots_absent, vehicle_absent) = self.absences.get_or_insert_with(|| {
            (
                Rows::new(worlds, START_CURVE_SLOTS, 0),
                Rows::new(worlds, vehicles, 0),
            )
        });
        let warm = slot >= self.warmup;
        let start = self.start_counts.len();
        let starting = start < START_CURVE_SLOTS;
        for world in 0..worlds {
            for vehicle in 0..vehicles {
                let uncapped = ages.get(world, vehicle);
                let age = uncapped.min(TIME_CONSTRAINT);
                let here = here.get(world, vehicle) > 0;
                let count = |rows: &mut Rows<u32>, item: usize, more: u32| {
                    rows.set(world, item, rows.get(world, item) + more);
                };
                if starting && here {
                    count(&mut self.start, start, age.into());
                } else if starting {
                    count(slots_absent, start, 1);
                }
                if warm && here {
                    for (rows, item, more) in [
                        (&mut self.by_vehicle, vehicle, u64::from(age)),
                        (&mut self.uncapped, vehicle, u64::from(uncapped)),
                        (&mut self.histogram, usize::from(age), 1),
                    ] {
                        rows.set(world, item, rows.get(world, item) + more);
                    }
                } else if warm {
                    count(vehicle_absent, vehicle, 1);
                }
            }
        }
        if starting {
            self.start_counts.push(vehicles as u64);
        }
        if warm {
            self.slots += 1;
            self.presence.iter_mut().for_each(|slots| *slots += 1);
        }
    }

    /// What was counted in each world.
    pub fn worlds(&self) -> Vec<WorldAges> {
        let mean = |sum: u64, count: u64| Mean { sum, count };
        let absent = |rows: Option<&Rows<u32>>, world, item| {
            rows.map_or(0, |rows: &Rows<u32>| u64::from(rows.get(world, item)))
        };
        let slots_absent = self.absences.as_ref().map(|(slots, _)| slots);
        let vehicle_absent = self.absences.as_ref().map(|(_, vehicles)| vehicles);
        let by_vehicle = |world, sum: &dyn Fn(usize) -> u64| {
            let present = self.presence.iter().enumerate();
            let mean = |(vehicle, &count)| mean(sum(vehicle), count - absent(vehicle_absent, world, vehicle));
            present.map(mean).collect()
        };
        let world = |world| WorldAges {
            histogram: std::array::from_fn(|age| self.histogram.get(world, age)),
            start: (0..)
                .zip(&self.start_counts)
                .map(|(slot, &count)| {
                    let count = count - absent(slots_absent, world, slot);
                    mean(self.start.get(world, slot).into(), count)
                })
                .collect(),
            by_vehicle: by_vehicle(world, &|vehicle| self.by_vehicle.get(world, vehicle)),
            uncapped: by_vehicle(world, &|vehicle| self.uncapped.get(world, vehicle)),
            successes: self.successes.get(world, 0),
            slots: self.slots,
            vehicle_slots: self.vehicle_slots.get(world, 0),
            transmissions: self.transmissions.get(world, 0),
            energy_mj: self.energy_mj.get(world, 0),
            peak_ages: self.peak_ages.get(world, 0),
            joiner_waits: Vec::new(),
        };
        let worlds: Vec<WorldAges> = (0..self.worlds).map(world).collect();
        debug_assert!(worlds.iter().all(WorldAges::agrees), "a sum of ages ran over");
        worlds
    }
}

/// Ages as the paper has them.
#[inline(always)]
fn capped(ages: &Row<u16>) -> Row<u16> {
    let mut capped = [0; LANES];
    for lane in 0..LANES {
        capped[lane] = ages[lane].min(TIME_CONSTRAINT);
    }
    capped
}

#[inline(always)]
fn add<S: AddAssign, T: Copy + Into<S>>(sums: &mut Row<S>, values: &Row<T>) {
    for lane in 0..LANES {
        sums[lane] += values[lane].into();
    }
}

/// Vehicles that joined running worlds: slots from association to the first success.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Joiners {
    /// How many.
    pub count: usize,
    /// Half of them were heard after at most this many slots; `None` if more than half never were.
    pub median_slots: Option<u32>,
    /// Nine in ten of them.
    pub p90_slots: Option<u32>,
}

impl Joiners {
    fn new(worlds: &[WorldAges]) -> Option<Self> {
        let mut waits: Vec<u32> = worlds
            .iter()
            .flat_map(|world| &world.joiner_waits)
            .map(|wait| wait.unwrap_or(u32::MAX))
            .collect();
        waits.sort_unstable();
        // The smallest wait that at least this share does not exceed.
        let quantile = |tenths: usize| {
            let wait = waits[(waits.len() * tenths).div_ceil(10) - 1];
            (wait < u32::MAX).then_some(wait)
        };
        (!waits.is_empty()).then(|| Self {
            count: waits.len(),
            median_slots: quantile(5),
            p90_slots: quantile(9),
        })
    }
}

/// Ages over the worlds of a run. One slot is 1 ms.
#[derive(Clone, Debug, PartialEq)]
pub struct AgeSummary {
    /// Mean over worlds of the mean over vehicles and slots after warm-up.
    pub mean_ms: f64,
    /// Half the width of the mean's 95 % interval over worlds (Student's t); `None` for a single world.
    pub ci95_ms: Option<f64>,
    /// The mean of ages that do not saturate at T = 100 ms, over vehicles and slots after warm-up of all worlds.
    pub uncapped_mean_ms: f64,
    /// Half the width of its 95 % interval over worlds; `None` for a single world.
    pub uncapped_ci95_ms: Option<f64>,
    /// Median over worlds of their means.
    pub median_world_ms: f64,
    /// Mean of each world in which a vehicle was present after warm-up, in the order of worlds.
    pub by_world_ms: Vec<f64>,
    /// Those who joined running worlds, if any did.
    pub joiners: Option<Joiners>,
    /// 99th percentile over all vehicle-slots after warm-up.
    pub p99_ms: f64,
    /// Mean over vehicles and the first 100 slots.
    pub first100_ms: f64,
    /// Successful transmissions a slot after warm-up.
    pub success_per_slot: f64,
    /// Peak age: mean over receptions after warm-up of the age that each ended, not saturated; `None` without one
    /// (Costa, Codreanu and Ephremides, "On the age of information in status update systems with packet management", 2016).
    pub peak_ms: Option<f64>,
    /// The worst 5 % of vehicles, those at the cell's edge: 95th percentile over vehicles of all worlds of their mean ages after
    /// warm-up.
    pub worst_vehicles_ms: f64,
    /// The same of ages that do not saturate at T = 100 ms.
    pub uncapped_worst_vehicles_ms: f64,
    /// Transmissions after warm-up, received or not, a vehicle and slot.
    pub transmissions_per_vehicle_slot: f64,
    /// Mean radiated energy after warm-up, a vehicle and slot: 1 W in a slot of 1 ms is 1 mJ.
    pub energy_mj_per_vehicle_slot: f64,
    /// By vehicle, over worlds: slots after warm-up in which it was present, and its mean age.
    pub by_vehicle: Vec<Mean>,
    /// Fraction of vehicle-slots after warm-up at each age; index 0 is unused.
    pub distribution: Vec<f64>,
    /// Mean over worlds and vehicles after each of the first slots.
    pub start_ms: Vec<f64>,
}

impl AgeSummary {
    /// Folds worlds in their order. `None` if no vehicle was present after warm-up.
    pub fn new(worlds: &[WorldAges]) -> Option<Self> {
        let mut means: Vec<f64> = worlds.iter().filter_map(WorldAges::mean).collect();
        if means.is_empty() {
            return None;
        }
        let (mean_ms, ci95_ms) = Self::mean_and_interval(&means);
        let by_world_ms = means.clone();
        means.sort_by(f64::total_cmp);
        let median_world_ms = f64::midpoint(means[(means.len() - 1) / 2], means[means.len() / 2]);

        let mut histogram = [0; AGES];
        let mut start = vec![Mean::default(); worlds.iter().map(|world| world.start.len()).max()?];
        let mut by_vehicle = vec![Mean::default(); worlds.iter().map(|world| world.by_vehicle.len()).max()?];
        for world in worlds {
            histogram
                .iter_mut()
                .zip(&world.histogram)
                .for_each(|(total, count)| *total += count);
            by_vehicle
                .iter_mut()
                .zip(&world.by_vehicle)
                .for_each(|(total, mean)| total.merge(mean));
            start
                .iter_mut()
                .zip(&world.start)
                .for_each(|(total, mean)| total.merge(mean));
        }
        let cold_start = Mean::of_all(start.iter().take(COLD_START_SLOTS));
        let uncapped = Mean::of_all(worlds.iter().flat_map(|world| &world.uncapped));
        let uncapped_means: Vec<f64> = worlds.iter().filter_map(WorldAges::uncapped_mean).collect();
        let slots: u64 = worlds.iter().map(|world| world.slots).sum();
        let successes: u64 = worlds.iter().map(|world| world.successes).sum();
        let vehicle_slots: u64 = histogram.iter().sum();
        let peak_ages: u64 = worlds.iter().map(|world| world.peak_ages).sum();
        // Who was present as a slot began, and not when it ended as in the histogram.
        let began = worlds.iter().map(|world| world.vehicle_slots).sum::<u64>().max(1);
        let transmissions: u64 = worlds.iter().map(|world| world.transmissions).sum();
        let energy_mj: f64 = worlds.iter().map(|world| world.energy_mj).sum();
        Some(Self {
            mean_ms,
            ci95_ms,
            uncapped_mean_ms: uncapped.value().unwrap_or(mean_ms),
            uncapped_ci95_ms: Self::mean_and_interval(&uncapped_means).1,
            median_world_ms,
            by_world_ms,
            joiners: Joiners::new(worlds),
            p99_ms: quantile(&histogram, 0.99),
            first100_ms: cold_start.value().unwrap_or(mean_ms),
            success_per_slot: successes as f64 / slots as f64,
            peak_ms: (successes > 0).then(|| peak_ages as f64 / successes as f64),
            worst_vehicles_ms: worst_vehicles(worlds, |world| &world.by_vehicle)?,
            uncapped_worst_vehicles_ms: worst_vehicles(worlds, |world| &world.uncapped)?,
            transmissions_per_vehicle_slot: transmissions as f64 / began as f64,
            energy_mj_per_vehicle_slot: energy_mj / began as f64,
            by_vehicle,
            distribution: histogram
                .iter()
                .map(|&count| count as f64 / vehicle_slots as f64)
                .collect(),
            start_ms: start.iter().filter_map(Mean::value).collect(),
        })
    }

    /// Age violation: the fraction of vehicle-slots after warm-up at which information is older than this many ms.
    pub fn share_above(&self, age_ms: usize) -> f64 {
        self.distribution.iter().skip(age_ms + 1).sum()
    }

    /// The mean of independent values and half the width of its 95 % interval (Student's t), which a single value lacks.
    pub fn mean_and_interval(values: &[f64]) -> (f64, Option<f64>) {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let half_width = (values.len() > 1).then(|| {
            let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
            student_t_975(values.len() - 1) * libm::sqrt(squares / (count - 1.0) / count)
        });
        (mean, half_width)
    }
}

/// The mean age that 5 % of the vehicles of all worlds exceed: the smallest that at least 95 % do not.
fn worst_vehicles(worlds: &[WorldAges], of: impl Fn(&WorldAges) -> &[Mean]) -> Option<f64> {
    let vehicles = worlds.iter().flat_map(of);
    let mut means: Vec<f64> = vehicles.filter_map(Mean::value).collect();
    means.sort_by(f64::total_cmp);
    means
        .get((means.len() * 95).div_ceil(100).checked_sub(1)?)
        .copied()
}

/// The smallest age that at least this fraction of the vehicle-slots does not exceed.
fn quantile(histogram: &[u64; AGES], fraction: f64) -> f64 {
    let needed = fraction * histogram.iter().sum::<u64>() as f64;
    let mut below = 0;
    let age = histogram.iter().position(|&count| {
        below += count;
        below as f64 >= needed
    });
    age.unwrap_or(AGES - 1) as f64
}

/// 97.5 % quantile of Student's t distribution: tabulated to 30 degrees of freedom, then two terms of the expansion
/// around the normal quantile (Abramowitz and Stegun 26.7.5).
fn student_t_975(degrees_of_freedom: usize) -> f64 {
    const TABLE: [f64; 30] = [
        12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145,
        2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048,
        2.045, 2.042,
    ];
    const Z: f64 = 1.959_964;
    let n = degrees_of_freedom as f64;
    let first = (Z * Z * Z + Z) / 4.0;
    let second = (5.0 * Z * Z * Z * Z * Z + 16.0 * Z * Z * Z + 3.0 * Z) / 96.0;
    let expansion = Z + first / n + second / (n * n);
    TABLE
        .get(degrees_of_freedom.wrapping_sub(1))
        .copied()
        .unwrap_or(expansion)
}

/// Mean age of an ideal schedule on a channel that never fades: in every slot the oldest vehicles are received, one on
/// each sub-channel. No policy is below it in the long run.
///
/// With V vehicles on N sub-channels a vehicle's turn comes every V/N slots, so that ages of whole slots alternate between
/// its two neighbours: 3.85 for 20 on 3.
pub fn ideal_age_ms(vehicles: u32, sub_channels: u32) -> f64 {
    ideal_age_up_to(TIME_CONSTRAINT.into(), vehicles, sub_channels)
}

/// The same of ages that do not saturate at T = 100 ms.
pub fn uncapped_ideal_age_ms(vehicles: u32, sub_channels: u32) -> f64 {
    ideal_age_up_to(u64::MAX, vehicles, sub_channels)
}

fn ideal_age_up_to(limit: u64, vehicles: u32, sub_channels: u32) -> f64 {
    if vehicles <= sub_channels {
        return 1.0;
    }
    // Served in turns, a vehicle is received N times in V slots, at intervals of floor or ceil of V/N that sum to V.
    let (short, longer) = (
        u64::from(vehicles / sub_channels),
        u64::from(vehicles % sub_channels),
    );
    let (vehicles, sub_channels) = (u64::from(vehicles), u64::from(sub_channels));
    // An interval of L slots adds 1 + 2 + ... + L, where every term saturates at the largest age.
    let interval = |length: u64| {
        let growing = length.min(limit);
        growing * (growing + 1) / 2 + (length - growing) * limit
    };
    let sum = longer * interval(short + 1) + (sub_channels - longer) * interval(short);
    sum as f64 / vehicles as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ideal_ages() {
        assert_eq!(ideal_age_ms(20, 3), 3.85);
        assert_eq!(ideal_age_ms(3, 3), 1.0);
        assert_eq!(ideal_age_ms(5, 3), 1.4);
        assert_eq!(ideal_age_ms(6, 1), 3.5);
        // Saturated: 100 - 4950 N / V.
        assert_eq!(ideal_age_ms(400, 3), 62.875);
        assert_eq!(uncapped_ideal_age_ms(2000, 1), 1000.5);
    }

    #[test]
    fn summary_of_known_ages() {
        let mut counter = AgeCounter::new(2, 2, 1);
        for slot in 0..4 {
            let mut ages = Rows::new(2, 1, 0);
            ages.set(0, 0, 1 + slot as u16);
            ages.set(1, 0, 3 + slot as u16);
            counter.record_all(Vectors::widest(), slot, &[0], &ages);
            if slot >= 2 {
                let activity = Activity {
                    vehicles: Rows::new(2, 1, 1),
                    transmissions: Rows::new(2, 1, u16::from(slot == 3)),
                    energy_mj: Rows::new(2, 1, if slot == 3 { 0.5 } else { 0.0 }),
                    peak_ages: Rows::new(2, 1, 10 * slot),
                };
                counter.record_activity(&Rows::new(2, 1, 1), &activity);
            }
        }
        let worlds = counter.worlds();
        let summary = AgeSummary::new(&worlds).unwrap();
        assert_eq!(summary.mean_ms, 4.5); // (3 + 4) / 2 and (5 + 6) / 2
        assert_eq!(summary.median_world_ms, 4.5);
        assert_eq!(summary.first100_ms, 3.5);
        assert_eq!(summary.p99_ms, 6.0);
        assert_eq!(summary.success_per_slot, 1.0);
        assert_eq!(summary.peak_ms, Some(25.0)); // 20 and 30
        assert_eq!(summary.transmissions_per_vehicle_slot, 0.5);
        assert_eq!(summary.energy_mj_per_vehicle_slot, 0.25);
        // Ages 3 and 4 in one world, 5 and 6 in the other.
        let shares = [2, 3, 5, 6, 100].map(|age| summary.share_above(age));
        assert_eq!(shares, [1.0, 0.75, 0.25, 0.0, 0.0]);
        assert_eq!(summary.worst_vehicles_ms, 5.5);
        assert_eq!(summary.by_vehicle[0].count(), 4);
        assert!((summary.ci95_ms.unwrap() - 12.706).abs() < 1e-12); // standard error 1
        assert_eq!(
            (summary.uncapped_mean_ms, summary.uncapped_ci95_ms),
            (4.5, summary.ci95_ms),
            "no age is beyond T"
        );
        assert_eq!(AgeSummary::new(&AgeCounter::new(5, 1, 1).worlds()), None);
    }

    #[test]
    fn a_hundred_million_slots_add_up() {
        let mut counter = AgeCounter::new(0, 1, 1);
        let before = 99_999_999;
        counter.by_vehicle.set(0, 0, 100 * before);
        counter.uncapped.set(0, 0, u64::from(u16::MAX) * before);
        counter.histogram.set(0, 100, before);
        counter.presence[0] = before;
        counter.record_all(Vectors::widest(), 0, &[0], &Rows::new(1, 1, u16::MAX));
        let worlds = counter.worlds();
        assert_eq!(worlds[0].mean(), Some(100.0));
        assert_eq!(worlds[0].uncapped_mean(), Some(f64::from(u16::MAX)));
    }

    #[test]
    fn nine_in_ten_joiners_count_those_who_were_never_heard() {
        let joiners = |waits: &[Option<u32>]| {
            let mut world = AgeCounter::new(0, 1, 1).worlds().remove(0);
            world.joiner_waits = waits.to_vec();
            let joiners = Joiners::new(&[world])?;
            Some((joiners.count, joiners.median_slots, joiners.p90_slots))
        };
        assert_eq!(joiners(&[]), None);
        let ten: Vec<Option<u32>> = (1..=10).rev().map(Some).collect();
        assert_eq!(joiners(&ten), Some((10, Some(5), Some(9))));
        let one_never: Vec<Option<u32>> = (1..=9).map(Some).chain([None]).collect();
        assert_eq!(joiners(&one_never), Some((10, Some(5), Some(9))));
        let two_never: Vec<Option<u32>> = (1..=8).map(Some).chain([None, None]).collect();
        assert_eq!(joiners(&two_never), Some((10, Some(5), None)));
        assert_eq!(joiners(&[None, None, Some(7)]), Some((3, None, None)));
    }

    #[test]
    fn one_vehicle_in_twenty_is_worse() {
        // Mean ages 1 to 40 in two worlds, of which two are above 38. Vehicle 20 is in world 0 alone, vehicle 21 nowhere.
        let mut counter = AgeCounter::new(0, 2, 22);
        let (mut here, mut ages) = (Rows::new(2, 22, 1), Rows::new(2, 22, 100));
        for (world, vehicle) in [(1, 20), (0, 21), (1, 21)] {
            here.set(world, vehicle, 0);
        }
        for age in 0..39 {
            ages.set(age % 2, age / 2, 1 + age as u16);
        }
        ages.set(1, 19, 39);
        ages.set(0, 20, 40);
        counter.record_present(0, &here, &ages);
        let summary = AgeSummary::new(&counter.worlds()).unwrap();
        assert_eq!(summary.worst_vehicles_ms, 39.0);
        assert_eq!(summary.share_above(39), 1.0 / 41.0);
        assert_eq!(summary.peak_ms, None, "nobody was received");
    }

    #[test]
    fn student_t_is_continuous_at_the_table_s_end() {
        assert!((student_t_975(31) - 2.0395).abs() < 0.0005);
        assert!((student_t_975(255) - 1.9693).abs() < 0.0005);
    }
}
