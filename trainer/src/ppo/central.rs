//! What the central critic sees besides a vehicle's own observation: where the other members of its group stand.
//!
//! Members are interchangeable, so the critic gets counts, which have the same length for any number of vehicles.

use firmware::observation::Observation;
use firmware::units::SUB_CHANNELS;

/// Turns are told apart up to this many slots ahead; later ones count as the last. Groups of up to 72 vehicles fit.
const TURNS: usize = 24;

/// Classes of ages in periods: below 1, 2, 3 and 5, older, and turn lost.
const AGE_CLASSES: usize = 6;

/// Values that the critic knows beside a vehicle's observation: how many others have their turn in 0, 1, ... slots, then the
/// shares of others in each class of age.
pub const GROUP_COUNTS: usize = TURNS + AGE_CLASSES;

/// Where a vehicle stands in its group.
#[derive(Clone, Copy, Debug)]
struct Standing {
    turn: usize,
    age_class: usize,
}

impl Standing {
    fn new(observation: &Observation) -> Self {
        let (age, period) = (
            usize::from(observation.age().slots()),
            usize::from(observation.period().slots()),
        );
        let age_class = match age / period {
            _ if observation.quantities().turn_lost() => 5,
            0 => 0,
            1 => 1,
            2 => 2,
            3 | 4 => 3,
            _ => 4,
        };
        Self {
            turn: ((period - age % period) % period).min(TURNS - 1),
            age_class,
        }
    }
}

/// Counts of all groups in one slot of one world.
#[derive(Clone, Debug)]
pub struct GroupCounts {
    members: [f32; SUB_CHANNELS],
    turns: [[f32; TURNS]; SUB_CHANNELS],
    age_classes: [[f32; AGE_CLASSES]; SUB_CHANNELS],
}

impl GroupCounts {
    /// Counts the vehicles of a world.
    pub fn new<'a>(observations: impl Iterator<Item = &'a Observation>) -> Self {
        let mut counts = Self {
            members: [0.0; SUB_CHANNELS],
            turns: [[0.0; TURNS]; SUB_CHANNELS],
            age_classes: [[0.0; AGE_CLASSES]; SUB_CHANNELS],
        };
        for observation in observations {
            let (group, standing) = (observation.home().index(), Standing::new(observation));
            counts.members[group] += 1.0;
            counts.turns[group][standing.turn] += 1.0;
            counts.age_classes[group][standing.age_class] += 1.0;
        }
        counts
    }

    /// Writes what the critic knows of the others around one of the counted vehicles.
    pub fn write(&self, observation: &Observation, values: &mut [f32]) {
        let (group, standing) = (observation.home().index(), Standing::new(observation));
        let (turns, classes) = values.split_at_mut(TURNS);
        turns.copy_from_slice(&self.turns[group]);
        turns[standing.turn] -= 1.0;
        classes.copy_from_slice(&self.age_classes[group]);
        classes[standing.age_class] -= 1.0;
        classes.iter_mut().for_each(|count| *count /= self.members[group]);
    }
}
