//! Who decides: the firmware's actor, simple baselines, and the central scheduler as the bound in practice.
//!
//! A policy is one file here and one line in the list `kinds!`. Three sorts of deciders differ in what they may know, by type:
//! a decentralised [`Policy`] gets what each vehicle [senses](crate::senses), a [`Scheduler`] what a base station
//! [knows](Knowledge), an [`Oracle`] the [truth](Truth).

mod actions;
mod observer;

pub use actions::carry_out;
pub use observer::Observer;

use crate::decisions::{Decisions, VehicleDecisions};
use crate::lanes::{LANES, LaneStream, Row, Vectors};
use crate::scenario::Scenario;
use crate::senses::{Broadcasts, Senses};
use crate::stream::{Role, Stream, WorldKey};
use crate::truth::{Knowledge, Truth};
use firmware::decision::PowerPlan;
use firmware::ring::MAX_PLACES;
use firmware::table::Table;
use firmware::units::{Level, MAX_SUB_CHANNELS, SubChannels};
use kit::choice::Choice;
use kit::error::{Error, Result};

/// Declares the files of policies and lists their kinds, in the order of help and reports.
macro_rules! kinds {
    ($($policy:ident)*) => {
        $(pub mod $policy;)*

        /// Every policy, in the order of help and reports.
        pub static KINDS: &[&Kind] = &[$(&$policy::KIND),*];
    };
}

// A policy: its file, and its line here.
kinds! {
    actor
    central
    clock
    assigned
    grants
    max_weight
    sps
    age_threshold
    aloha
    random
    always
}

// No two policies draw from the same streams.
const _: () = {
    let mut first = 0;
    while first < KINDS.len() {
        let mut second = first + 1;
        while second < KINDS.len() {
            assert!(
                KINDS[first].stream != KINDS[second].stream,
                "a number of random streams that another policy has"
            );
            second += 1;
        }
        first += 1;
    }
};

/// A decentralised policy: every vehicle decides from what it alone senses.
///
/// ```
/// use firmware::decision::Decision;
/// use firmware::units::SubChannel;
/// use host_sim::decisions::VehicleDecisions;
/// use host_sim::mobility::Grid;
/// use host_sim::policy::Setup;
/// use host_sim::senses::Senses;
/// use host_sim::{Decider, Extent, Policy, ScenarioSource, Simulation};
///
/// /// Sends on the first sub-channel, at full power, when its age is a multiple of ten slots.
/// struct Punctual;
///
/// impl Policy for Punctual {
///     fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
///         for world in 0..senses.worlds() {
///             let Some(measurement) = senses.measurement(world) else { continue };
///             if measurement.age().slots() % 10 == 0
///                 && let Some(sub_channel) = SubChannel::new(0)
///             {
///                 let power = measurement.broadcast().max_power;
///                 decisions.set(world, Decision::Transmit { sub_channel, power });
///             }
///         }
///     }
/// }
///
/// # fn main() -> host_sim::Result<()> {
/// let scenario = ScenarioSource::default().read()?;
/// let simulation = Simulation {
///     scenario: &scenario,
///     source: &Grid,
///     extent: Extent { seed: 1, worlds: 2, slots: 100, warmup: 0 },
/// };
/// let build = |_: &Setup<'_>| Decider::Policy(Box::new(Punctual));
/// let (ages, _) = simulation.run(build, |_, _| ())?;
/// // All begin with the same age, so all send together, and hardly anybody is heard.
/// assert!(ages.mean_ms > 50.0);
/// # Ok(())
/// # }
/// ```
pub trait Policy {
    /// Hears what is broadcast to everybody in a row of worlds, before their vehicles decide.
    fn hear(&mut self, _broadcasts: &Broadcasts<'_>) {}

    /// Writes what one vehicle does in a row of worlds; it is silent beforehand.
    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>);

    /// Writes what those do for whom `decide` wrote nothing, once all vehicles of all worlds have sensed. For policies that work on
    /// many vehicles at a time.
    fn conclude(&mut self, _vectors: Vectors, _decisions: &mut Decisions) {}
}

/// A base station that decides for everybody, from what it knows.
pub trait Scheduler {
    /// Writes everybody's decisions, which are all silent beforehand.
    fn decide(&mut self, known: &Knowledge<'_>, decisions: &mut Decisions);
}

/// Somebody who knows what nobody in the cell knows: a bound for those who must do without.
pub trait Oracle {
    /// Writes everybody's decisions, which are all silent beforehand.
    fn decide(&mut self, truth: &Truth<'_>, decisions: &mut Decisions);
}

/// Whoever decides for a batch of worlds.
pub enum Decider<'t> {
    /// Every vehicle for itself.
    Policy(Box<dyn Policy + 't>),
    /// A base station.
    Scheduler(Box<dyn Scheduler + 't>),
    /// The truth.
    Oracle(Box<dyn Oracle + 't>),
}

/// A kind of decider.
#[derive(Debug)]
pub struct Kind {
    /// The name on the command line and in results.
    pub name: &'static str,
    /// What it does, in one sentence.
    pub meaning: &'static str,
    /// Number of its random streams, one that no other policy has and that never changes, even if it draws nothing: no policy's
    /// bytes depend on which others there are. 0 to 10 are taken.
    pub stream: u32,
    /// What it does not work without.
    pub needs: Needs,
    /// Makes it for a batch of worlds. The table is the actor's.
    pub build: for<'t> fn(&Setup<'_>, &'t Table<'t>) -> Decider<'t>,
}

/// What a kind of decider does not work without.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// Nothing besides the cell.
    Nothing,
    /// The base station's ring and what it broadcasts of it.
    Ring,
    /// The ring, and a weight table made for the scenario.
    Table,
}

impl PartialEq for Kind {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self, other)
    }
}

impl Eq for Kind {}

impl Choice for &'static Kind {
    const ALL: &'static [Self] = KINDS;

    fn name(self) -> &'static str {
        self.name
    }

    fn meaning(self) -> &'static str {
        self.meaning
    }
}

/// What a decider of a batch of worlds is made for.
#[derive(Clone, Copy, Debug)]
pub struct Setup<'e> {
    /// The cell.
    pub scenario: &'e Scenario,
    /// How many vehicles a world has room for: their indices are 0 to one less.
    pub vehicles: usize,
    /// The most vehicles that are ever present in a world at once.
    pub most_vehicles: usize,
    /// Known here alone: whoever has a world's key can draw its channel.
    keys: &'e [WorldKey],
}

impl<'e> Setup<'e> {
    pub(crate) fn new(
        scenario: &'e Scenario,
        keys: &'e [WorldKey],
        vehicles: usize,
        most_vehicles: usize,
    ) -> Self {
        Self {
            scenario,
            vehicles,
            most_vehicles,
            keys,
        }
    }

    /// How many worlds.
    pub fn worlds(&self) -> usize {
        self.keys.len()
    }

    /// Random streams of one number for rows of worlds, by row: a policy's own ([`Kind::stream`]).
    pub fn row_streams(&self, number: u32) -> Vec<LaneStream> {
        let rows = self.keys.chunks(LANES);
        rows.map(|keys| LaneStream::new(keys.iter().copied(), Role::Policy, number))
            .collect()
    }

    /// A random stream of one number for each world.
    pub fn streams(&self, number: u32) -> impl Iterator<Item = Stream> + '_ {
        self.keys.iter().map(move |key| key.stream(Role::Policy, number))
    }
}

impl Kind {
    /// Whether it decides by a weight table.
    pub fn uses_table(&self) -> bool {
        self.needs == Needs::Table
    }

    /// Checks that the policy can serve a cell of at most `vehicles` at once.
    ///
    /// # Errors
    /// [`Error::Input`] names the limit that is exceeded, or the table's property that does not fit the scenario.
    pub fn check(&self, scenario: &Scenario, vehicles: usize, table: &Table<'_>) -> Result<()> {
        let needs_ring = self.needs != Needs::Nothing;
        if self.uses_table() {
            let sub_channels = SubChannels::new(scenario.radio.sub_channels as usize);
            if !sub_channels.is_some_and(|sub_channels| table.serves(sub_channels)) {
                let serves =
                    |count: &usize| SubChannels::new(*count).is_some_and(|count| table.serves(count));
                let served: Vec<usize> = (1..=MAX_SUB_CHANNELS).filter(serves).collect();
                let expected = match served[..] {
                    [first, .., last] => format!("{first} to {last}, which the table serves"),
                    [only] => format!("{only}, which the table serves"),
                    [] => "another table, which serves any".to_owned(),
                };
                return Err(Error::input(
                    "radio.sub_channels",
                    scenario.radio.sub_channels,
                    expected,
                ));
            }
            let most = usize::from(table.max_vehicles());
            if vehicles > most {
                return Err(Error::input(
                    "vehicles",
                    vehicles,
                    format!("at most {most}, which the table serves"),
                ));
            }
            // The joiner levels are relative to the required SINR: a table lives in cells of the one that it was made for.
            let radio = &scenario.radio;
            if table.required_sinr() != radio.required_level() {
                let level = |level: Level| format!("a required SINR of {:.3} dB", level.to_num::<f64>());
                let found = format!(
                    "{} ({})",
                    radio.min_spectral_efficiency,
                    level(radio.required_level())
                );
                let expected = format!("{} as in the table", level(table.required_sinr()));
                return Err(Error::input("radio.min_spectral_efficiency", found, expected));
            }
        }
        if needs_ring && SubChannels::new(scenario.radio.sub_channels as usize).is_none() {
            let expected = format!(
                "at most {MAX_SUB_CHANNELS}, which units know, for policy {}",
                self.name
            );
            return Err(Error::input(
                "radio.sub_channels",
                scenario.radio.sub_channels,
                expected,
            ));
        }
        if needs_ring && vehicles > usize::from(MAX_PLACES) {
            let expected = format!(
                "at most {MAX_PLACES}, the places of a ring, for policy {}",
                self.name
            );
            return Err(Error::input("vehicles", vehicles, expected));
        }
        Ok(())
    }
}

/// How actions become power in a scenario.
///
/// Each joiner level captures the receiver from all lower ones together with room to spare. For SINR 7 the levels are 9.1, 77,
/// 670 and 5,800 times the noise.
pub fn power_plan(scenario: &Scenario) -> PowerPlan {
    let required = scenario.radio.required_sinr();
    let mut below = 0.0;
    let joiner_levels = [1.3, 1.09, 1.10, 1.09].map(|room| {
        let level = required * (1.0 + below) * room;
        below += level;
        Level::saturating_from_num(10.0 * libm::log10(level))
    });
    PowerPlan { joiner_levels }
}

/// Words as numbers that are uniform on `0..count`.
#[inline(always)]
fn below(words: &Row<u32>, count: u32) -> Row<u8> {
    let mut numbers = [0; LANES];
    for lane in 0..LANES {
        numbers[lane] = ((u64::from(words[lane]) * u64::from(count)) >> 32) as u8;
    }
    numbers
}
