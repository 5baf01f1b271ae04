//! What comes between the truth and those who sense it, as the scenario says: gains that are old and inexact, acknowledgements and
//! broadcasts that are late or lost, modems that measure nothing.

mod acknowledgements;
mod broadcasts;
mod gains;
mod measurements;

use crate::decisions::{Decisions, SILENT};
use crate::lanes::{LANES, LaneStream, Row, unit_interval};
use crate::scenario::Scenario;
use crate::senses::{Perfect, Readings, Sensing};
use crate::stream::{Role, WorldKey};
use acknowledgements::Acknowledgements;
pub use broadcasts::Heard as HeardBroadcasts;
use broadcasts::Heard;
use firmware::units::{Age, SlotIndex};
use gains::KnownGains;
use measurements::Measured;

/// All imperfections of a batch of worlds; what is perfect is `None`.
#[derive(Clone)]
struct Imperfections {
    gains: Option<KnownGains>,
    acknowledgements: Option<Acknowledgements>,
    broadcasts: Option<Heard>,
    measurements: Option<Measured>,
}

/// How the units of these worlds sense.
pub fn sensing(scenario: &Scenario, vehicles: usize, keys: &[WorldKey]) -> Box<dyn Sensing> {
    let imperfections = Imperfections {
        gains: KnownGains::new(scenario, keys),
        acknowledgements: Acknowledgements::new(&scenario.feedback, vehicles, keys),
        broadcasts: Heard::new(&scenario.feedback, vehicles, keys),
        measurements: Measured::new(&scenario.feedback, vehicles, keys),
    };
    if let Imperfections {
        gains: None,
        acknowledgements: None,
        broadcasts: None,
        measurements: None,
    } = imperfections
    {
        Box::new(Perfect)
    } else {
        Box::new(imperfections)
    }
}

impl Sensing for Imperfections {
    fn reset(&mut self, keys: &[WorldKey]) -> bool {
        if let Some(gains) = &mut self.gains {
            gains.reset(keys);
        }
        if let Some(acknowledgements) = &mut self.acknowledgements {
            acknowledgements.reset(keys);
        }
        if let Some(broadcasts) = &mut self.broadcasts {
            broadcasts.reset(keys);
        }
        if let Some(measurements) = &mut self.measurements {
            measurements.reset(keys);
        }
        true
    }

    fn begin_unit(&mut self, world: usize, vehicle: usize, age: Age) {
        if let Some(gains) = &mut self.gains {
            gains.begin_unit(world, vehicle);
        }
        if let Some(acknowledgements) = &mut self.acknowledgements {
            acknowledgements.begin_unit(world, vehicle, age);
        }
        if let Some(broadcasts) = &mut self.broadcasts {
            broadcasts.begin_unit(world, vehicle);
        }
    }

    fn begin_slot(&mut self, _slot: SlotIndex, truth: &Readings<'_>) {
        if let Some(gains) = &mut self.gains {
            gains.begin_slot(truth.gains_db);
        }
        if let Some(acknowledgements) = &mut self.acknowledgements {
            acknowledgements.begin_slot(truth);
        }
        if let Some(broadcasts) = &mut self.broadcasts {
            broadcasts.begin_slot(truth.announcements);
        }
        if let Some(measurements) = &mut self.measurements {
            measurements.begin_slot();
        }
    }

    fn readings<'t>(&'t self, truth: Readings<'t>) -> Readings<'t> {
        let truth = match &self.acknowledgements {
            Some(acknowledgements) => acknowledgements.readings(truth),
            None => truth,
        };
        Readings {
            gains_db: self.gains.as_ref().map_or(truth.gains_db, KnownGains::gains_db),
            heard: self.broadcasts.as_ref(),
            measured: self.measurements.as_ref().map(Measured::rows),
            ..truth
        }
    }

    fn copy(&self) -> Box<dyn Sensing> {
        Box::new(self.clone())
    }
}

/// Draws of what is lost, world by world.
#[derive(Clone, Debug)]
pub(crate) struct Losses {
    probability: f32,
    /// By block of worlds.
    streams: Vec<LaneStream>,
}

impl Losses {
    /// Losses of one member of [`Role::Losses`] with this probability; `None` if nothing is lost.
    pub(crate) fn new(probability: f64, member: u32, keys: &[WorldKey]) -> Option<Self> {
        (probability > 0.0).then(|| Self {
            probability: probability as f32,
            streams: LaneStream::rows(keys, Role::Losses, member),
        })
    }

    /// [`Losses::new`] for as many other worlds, in the same memory.
    pub(crate) fn reset(&mut self, keys: &[WorldKey]) {
        LaneStream::reset_rows(&mut self.streams, keys);
    }

    /// Silences those whose grants are lost.
    pub(crate) fn silence(&mut self, present: &[usize], decisions: &mut Decisions) {
        for block in 0..self.streams.len() {
            for &vehicle in present {
                let lost = self.draw(block);
                let decisions = decisions.of(block, vehicle);
                for lane in 0..LANES {
                    if lost[lane] {
                        decisions.sub_channel[lane] = SILENT;
                    }
                }
            }
        }
    }

    /// Whether the next one is lost, in every world of a row.
    fn draw(&mut self, block: usize) -> Row<bool> {
        let words = self.streams[block].next_row();
        words.map(|word| unit_interval(word) < self.probability)
    }
}
