//! Who decides: the firmware's actor, simple baselines, and the central scheduler as the bound in practice.

pub mod actor;
mod aloha;
mod always;
mod central;
pub mod clock;

use crate::decisions::Decisions;
use crate::environment::Environment;
use crate::lanes::{LANES, LaneStream, Row};
use crate::scenario::Scenario;
use crate::stream::Role;
use firmware::decision::PowerPlan;
use firmware::table::Table;
use firmware::units::{Dbm, Level, SUB_CHANNELS};
use kit::error::{Error, Result};

/// Decides for all vehicles of a batch of worlds.
pub trait Policy {
    /// Writes the present vehicles' decisions, which are all silent beforehand.
    fn decide(&mut self, environment: &Environment<'_>, decisions: &mut Decisions);
}

/// The policies by their names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, clap::ValueEnum)]
pub enum PolicyName {
    /// The frozen int8 network, one in each vehicle, on the firmware's own code.
    Actor,
    /// A scheduler that knows everything: the oldest vehicles first, each on its best free sub-channel.
    Central,
    /// The AoI clock, the rules that the network imitates: a vehicle sends when its age is a multiple of its period.
    Clock,
    /// Slotted ALOHA of those whose age has reached a threshold.
    AgeThreshold,
    /// Slotted ALOHA: everybody sends by chance, as often as the sub-channels bear.
    Aloha,
    /// A random sub-channel and a random power in every slot.
    Random,
    /// Full power on the best sub-channel in every slot.
    Always,
}

impl PolicyName {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Actor,
        Self::Central,
        Self::Clock,
        Self::AgeThreshold,
        Self::Aloha,
        Self::Random,
        Self::Always,
    ];

    /// The name on the command line and in results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Actor => "actor",
            Self::Central => "central",
            Self::Clock => "clock",
            Self::AgeThreshold => "age-threshold",
            Self::Aloha => "aloha",
            Self::Random => "random",
            Self::Always => "always",
        }
    }

    /// Whether it decides by a weight table.
    pub const fn uses_table(self) -> bool {
        matches!(self, Self::Actor)
    }

    /// Whether vehicles need the base station's groups, which reach 100 members each.
    const fn needs_groups(self) -> bool {
        matches!(self, Self::Actor | Self::Clock)
    }

    /// Checks that the policy can serve a cell of at most `vehicles` at once.
    ///
    /// # Errors
    /// [`Error::Input`] names the limit that is exceeded, or the table's property that does not fit the scenario.
    pub fn check(self, scenario: &Scenario, vehicles: usize, table: &Table<'_>) -> Result<()> {
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
        if self.needs_groups() && sub_channels != SUB_CHANNELS {
            let expected = format!(
                "{SUB_CHANNELS}, which units are built for, for policy {}",
                self.name()
            );
            return Err(Error::input("radio.sub_channels", sub_channels, expected));
        }
        let most = SUB_CHANNELS * 100;
        if self.needs_groups() && vehicles > most {
            let expected = format!("at most {most}: groups of 100 for policy {}", self.name());
            return Err(Error::input("vehicles", vehicles, expected));
        }
        Ok(())
    }

    /// The policy for a batch of worlds.
    pub fn build<'t>(self, environment: &Environment<'_>, table: &'t Table<'t>) -> Box<dyn Policy + 't> {
        let scenario = environment.scenario();
        let streams = || {
            let rows = environment.keys().chunks(LANES);
            rows.map(|keys| LaneStream::new(keys.iter().copied(), Role::Policy, self as u32))
                .collect()
        };
        match self {
            Self::Actor => actor::build(environment, std::slice::from_ref(table)),
            Self::Central => Box::new(central::Central::new(scenario)),
            Self::Clock => Box::new(clock::Clock::new(scenario)),
            Self::AgeThreshold => Box::new(aloha::Aloha::from_age(scenario, streams())),
            Self::Aloha => Box::new(aloha::Aloha::slotted(scenario, streams())),
            Self::Random => Box::new(always::Random::new(scenario, streams())),
            Self::Always => Box::new(always::Always::new(scenario)),
        }
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
