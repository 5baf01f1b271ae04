//! Statistics of ages over slots, vehicles and worlds.

use firmware::units::Age;

/// Slots at the start whose mean age is reported as `first100`.
const COLD_START_SLOTS: usize = 100;

/// Slots at the start whose mean ages are kept one by one.
const START_CURVE_SLOTS: usize = 300;

const AGES: usize = Age::MAX.slots() as usize + 1;

/// Ages of one world.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldAges {
    warmup: u32,
    /// Vehicle-slots after warm-up by age.
    histogram: [u64; AGES],
    /// By slot from the start.
    start: Vec<Mean>,
    /// By vehicle, after warm-up.
    by_vehicle: Vec<Mean>,
    successes: u64,
    slots: u64,
}

/// A sum and what it is over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mean {
    sum: u64,
    count: u64,
}

impl Mean {
    fn add(&mut self, value: u8) {
        self.sum += u64::from(value);
        self.count += 1;
    }

    fn merge(&mut self, other: &Self) {
        self.sum += other.sum;
        self.count += other.count;
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
    /// Nothing yet; slots before `warmup` count for the cold start only.
    pub fn new(warmup: u32, vehicles: usize) -> Self {
        Self {
            warmup,
            histogram: [0; AGES],
            start: Vec::new(),
            by_vehicle: vec![Mean::default(); vehicles],
            successes: 0,
            slots: 0,
        }
    }

    /// Takes in one slot's ages after its transmissions.
    pub fn record(&mut self, slot: u32, ages: impl Iterator<Item = (usize, Age)>, successes: usize) {
        let warm = slot >= self.warmup;
        let mut start = (self.start.len() < START_CURVE_SLOTS).then(Mean::default);
        if start.is_none() && !warm {
            return;
        }
        for (vehicle, age) in ages {
            if let Some(mean) = &mut start {
                mean.add(age.slots());
            }
            if warm {
                self.histogram[usize::from(age.slots())] += 1;
                self.by_vehicle[vehicle].add(age.slots());
            }
        }
        self.start.extend(start);
        if warm {
            self.slots += 1;
            self.successes += successes as u64;
        }
    }

    /// Mean over vehicles and slots after warm-up.
    pub fn mean(&self) -> Option<f64> {
        let mut total = Mean::default();
        self.by_vehicle.iter().for_each(|mean| total.merge(mean));
        total.value()
    }
}

/// Ages over the worlds of a run. One slot is 1 ms.
#[derive(Clone, Debug, PartialEq)]
pub struct AgeSummary {
    /// Mean over worlds of the mean over vehicles and slots after warm-up.
    pub mean_ms: f64,
    /// Half the width of the mean's 95 % interval over worlds (Student's t); `None` for a single world.
    pub ci95_ms: Option<f64>,
    /// Median over worlds of their means.
    pub median_world_ms: f64,
    /// Mean of each world in which a vehicle was present after warm-up, in the order of worlds.
    pub by_world_ms: Vec<f64>,
    /// 99th percentile over all vehicle-slots after warm-up.
    pub p99_ms: f64,
    /// Mean over vehicles and the first 100 slots.
    pub first100_ms: f64,
    /// Successful transmissions a slot after warm-up.
    pub success_per_slot: f64,
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
        let mut cold_start = Mean::default();
        start
            .iter()
            .take(COLD_START_SLOTS)
            .for_each(|mean| cold_start.merge(mean));
        let slots: u64 = worlds.iter().map(|world| world.slots).sum();
        let successes: u64 = worlds.iter().map(|world| world.successes).sum();
        let vehicle_slots: u64 = histogram.iter().sum();
        Some(Self {
            mean_ms,
            ci95_ms,
            median_world_ms,
            by_world_ms,
            p99_ms: quantile(&histogram, 0.99),
            first100_ms: cold_start.value().unwrap_or(mean_ms),
            success_per_slot: successes as f64 / slots as f64,
            by_vehicle,
            distribution: histogram
                .iter()
                .map(|&count| count as f64 / vehicle_slots as f64)
                .collect(),
            start_ms: start.iter().filter_map(Mean::value).collect(),
        })
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
    let limit = u64::from(Age::MAX.slots());
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
    }

    #[test]
    fn summary_of_known_ages() {
        let worlds: Vec<_> = [1_u32, 3]
            .map(|first| {
                let mut world = WorldAges::new(2, 1);
                (0..4).for_each(|slot| world.record(slot, [(0, Age::after(first + slot))].into_iter(), 1));
                world
            })
            .into();
        let summary = AgeSummary::new(&worlds).unwrap();
        assert_eq!(summary.mean_ms, 4.5); // (3 + 4) / 2 and (5 + 6) / 2
        assert_eq!(summary.median_world_ms, 4.5);
        assert_eq!(summary.first100_ms, 3.5);
        assert_eq!(summary.p99_ms, 6.0);
        assert_eq!(summary.success_per_slot, 1.0);
        assert_eq!(summary.by_vehicle[0].count(), 4);
        assert!((summary.ci95_ms.unwrap() - 12.706).abs() < 1e-12); // standard error 1
        assert_eq!(AgeSummary::new(&[WorldAges::new(5, 1)]), None);
    }

    #[test]
    fn student_t_is_continuous_at_the_table_s_end() {
        assert!((student_t_975(31) - 2.0395).abs() < 0.0005);
        assert!((student_t_975(255) - 1.9693).abs() < 0.0005);
    }
}
