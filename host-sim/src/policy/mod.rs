//! Who decides: the firmware's actor, simple baselines, and the central scheduler as the bound in practice.
//!
//! A policy is one file here and one line in the list `kinds!`. Three sorts of deciders differ in what they may know, by type:
//! a decentralised [`Policy`] gets what each vehicle [senses](crate::senses), a [`Scheduler`] what a base station
//! [knows](Knowledge), an [`Oracle`] the [truth](Truth).

use crate::decisions::{Decisions, VehicleDecisions};
use crate::lanes::{LANES, LaneStream, Row};
use crate::scenario::Scenario;
use crate::senses::{Broadcasts, Senses};
use crate::stream::{Role, Stream, WorldKey};
use crate::truth::{Knowledge, Truth};
use firmware::decision::PowerPlan;
use firmware::table::Table;
use firmware::units::{Dbm, Level, SUB_CHANNELS};
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
/// use firmware::decision::{Action, PowerPlan};
/// use firmware::observation::Observation;
/// use host_sim::decisions::VehicleDecisions;
/// use host_sim::mobility::Grid;
/// use host_sim::policy::{Setup, power_plan};
/// use host_sim::senses::Senses;
/// use host_sim::{Decider, Extent, Policy, ScenarioSource, Simulation};
///
/// /// Sends at full power in every slot in which its age is a multiple of its group's size.
/// struct Punctual(PowerPlan);
///
/// impl Policy for Punctual {
///     fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
///         for world in 0..senses.worlds() {
///             let Some(measurement) = senses.measurement(world) else { continue };
///             if measurement.age().slots() % measurement.broadcast().period.slots() == 0 {
///                 let observation = Observation::new(&measurement);
///                 decisions.set(world, self.0.decision(Action::FullPower, &observation));
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
/// let build = |_: &Setup<'_>| Decider::Policy(Box::new(Punctual(power_plan(&scenario))));
/// let (ages, _) = simulation.run(build, |_, _| ())?;
/// // All begin with the largest age, so all have the same turn and collide for ever.
/// assert!(ages.mean_ms > 50.0);
/// # Ok(())
/// # }
/// ```
pub trait Policy {
    /// Hears what is broadcast to everybody in a row of worlds, before their vehicles decide.
    fn hear(&mut self, _broadcasts: &Broadcasts<'_>) {}

    /// Writes what one vehicle does in a row of worlds; it is silent beforehand.
    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>);
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
    /// The base station's groups, which reach 100 members each, and their broadcasts.
    Groups,
    /// Groups, and a weight table made for the scenario.
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

    /// The stream that a vehicle's unit draws its back-off from.
    pub fn back_off(&self, world: usize, vehicle: usize) -> Stream {
        self.keys[world].stream(Role::BackOff, vehicle as u32)
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
        let needs_groups = self.needs != Needs::Nothing;
        if self.uses_table() {
            let most = usize::from(table.max_vehicles());
            if vehicles > most {
                return Err(Error::input(
                    "vehicles",
                    vehicles,
                    format!("at most {most}, which the table serves"),
                ));
            }
            // Measured gains are relative to full power, and the joiner levels to the required SINR: a table lives in the
            // scenario that it was made for.
            let radio = &scenario.radio;
            if table.power_plan().max_power != dbm(radio.max_power_dbm) {
                let expected = format!("{} dBm as in the table", table.power_plan().max_power.value());
                return Err(Error::input("radio.max_power_dbm", radio.max_power_dbm, expected));
            }
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
        let sub_channels = scenario.radio.sub_channels as usize;
        if needs_groups && sub_channels != SUB_CHANNELS {
            let expected = format!(
                "{SUB_CHANNELS}, which units are built for, for policy {}",
                self.name
            );
            return Err(Error::input("radio.sub_channels", sub_channels, expected));
        }
        let most = SUB_CHANNELS * 100;
        if needs_groups && vehicles > most {
            let expected = format!("at most {most}: groups of 100 for policy {}", self.name);
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
    PowerPlan {
        max_power: dbm(scenario.radio.max_power_dbm),
        joiner_levels,
    }
}

/// dBm as units know it, rounded down so that no limit is exceeded.
fn dbm(value: f64) -> Dbm {
    Dbm::from_bits((value * 256.0).floor() as i16)
}

/// Words as numbers that are uniform on `0..count`.
#[inline(always)]
fn below(words: &Row<u32>, count: u32) -> Row<u8> {
    words.map(|word| ((u64::from(word) * u64::from(count)) >> 32) as u8)
}
