//! What the central critic sees besides a vehicle's own observation: where the other vehicles of its cell stand.
//!
//! Vehicles are interchangeable, so the critic gets counts, which have the same length for any number of them.

use firmware::observation::Observation;
use firmware::units::Age;

/// Ages that are told apart, in quarters of a frame.
const AGES: usize = 24;

/// Classes of ages in frames: below 1, 2, 3 and 5, older, and turn lost.
const AGE_CLASSES: usize = 6;

/// Values that the critic knows beside a vehicle's observation: shares of the others at each age, and in each class of ages.
pub const CELL_COUNTS: usize = AGES + AGE_CLASSES;

/// Where a vehicle stands in its cell.
#[derive(Clone, Copy, Debug)]
struct Standing {
    age: usize,
    age_class: usize,
}

/// An age in the frames of who observes this: rounds of its ring.
pub fn frames(age: Age, observation: &Observation) -> f32 {
    let known = observation.quantities();
    f32::from(age.slots()) * known.sub_channels as f32 / known.places as f32
}

impl Standing {
    fn new(observation: &Observation) -> Self {
        let frames = frames(observation.age(), observation);
        let age_class = match frames as usize {
            _ if observation.quantities().turn_lost() => 5,
            0 => 0,
            1 => 1,
            2 => 2,
            3 | 4 => 3,
            _ => 4,
        };
        Self {
            age: ((frames * 4.0) as usize).min(AGES - 1),
            age_class,
        }
    }
}

/// Counts of all vehicles in one slot of one world.
#[derive(Clone, Debug)]
pub struct CellCounts {
    vehicles: f32,
    ages: [f32; AGES],
    age_classes: [f32; AGE_CLASSES],
}

impl CellCounts {
    /// Counts the vehicles of a world.
    pub fn new<'a>(observations: impl Iterator<Item = &'a Observation>) -> Self {
        let mut counts = Self {
            vehicles: 0.0,
            ages: [0.0; AGES],
            age_classes: [0.0; AGE_CLASSES],
        };
        for observation in observations {
            let standing = Standing::new(observation);
            counts.vehicles += 1.0;
            counts.ages[standing.age] += 1.0;
            counts.age_classes[standing.age_class] += 1.0;
        }
        counts
    }

    /// Writes what the critic knows of the others around one of the counted vehicles.
    pub fn write(&self, observation: &Observation, values: &mut [f32]) {
        let standing = Standing::new(observation);
        let (ages, classes) = values.split_at_mut(AGES);
        ages.copy_from_slice(&self.ages);
        ages[standing.age] -= 1.0;
        classes.copy_from_slice(&self.age_classes);
        classes[standing.age_class] -= 1.0;
        values.iter_mut().for_each(|count| *count /= self.vehicles);
    }
}
