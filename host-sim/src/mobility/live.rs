//! Vehicles of the user's own SUMO configuration, live: every world runs a SUMO of its own.
//!
//! The rules of time and presence are those of recorded [floating-car data](super::floating_car_data): a vehicle's place is
//! interpolated between two of SUMO's steps that both hold it. How many vehicles there will be is not known beforehand, so
//! `cell.vehicles` says for how many there is room at once; a vehicle takes the lowest free index when it comes, and leaves it
//! when it goes.

use super::floating_car_data::Position;
use super::{Mobility, MobilitySource, Place};
use crate::journeys::sumo::traci::Client;
use crate::journeys::sumo::{Programs, seed_text};
use crate::scenario::Scenario;
use crate::stream::{Role, WorldKey};
use kit::error::{Error, Result};
use std::collections::HashMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// How a source of this kind begins by name.
pub const PREFIX: &str = "sumo:";

/// Where no vehicle has a chance of being heard (chosen), as for recorded traces.
const REACH_M: f64 = super::recorded::REACH_M;

/// The file in a source's name, whether that begins with [`PREFIX`] or not.
pub fn file_of(name: &str) -> &str {
    name.strip_prefix(PREFIX)
        .map_or(name, |name| name.rsplit_once('@').map_or(name, |(file, _)| file))
}

/// A source's name with another path to its file.
pub fn name_of(name: &str, file: &Path) -> String {
    let seconds = name.rsplit_once('@').filter(|_| name.starts_with(PREFIX));
    let (before, after) = match seconds {
        Some((_, seconds)) => (PREFIX, format!("@{seconds}")),
        None if name.starts_with(PREFIX) => (PREFIX, String::new()),
        None => ("", String::new()),
    };
    format!("{before}{}{after}", file.display())
}

/// A SUMO configuration that each world runs, by a seed of its own.
#[derive(Clone, Debug)]
pub struct LiveSumo {
    programs: Programs,
    configuration: PathBuf,
    /// What SUMO has simulated, in s, before the first slot.
    head_start_s: u32,
}

impl LiveSumo {
    /// A source from its name without the prefix: `FILE`, or `FILE@SECONDS` to begin so many seconds after SUMO does, when the
    /// roads have filled.
    ///
    /// # Errors
    /// If the file cannot be read, the seconds are no number, or SUMO is not there.
    pub fn read(name: &str) -> Result<Self> {
        let (file, seconds) = name.rsplit_once('@').unwrap_or((name, "0"));
        let head_start_s = seconds
            .parse()
            .map_err(|_| Error::input(format!("{PREFIX}{name}"), seconds, "whole seconds after the @"))?;
        let configuration = PathBuf::from(file);
        let _readable =
            std::fs::File::open(&configuration).map_err(|source| Error::file(&configuration, source))?;
        Ok(Self {
            programs: Programs::find()?,
            configuration,
            head_start_s,
        })
    }

    fn start(&self, seed: u64) -> Result<Client> {
        let mut arguments: Vec<OsString> = Vec::new();
        for (option, value) in [
            ("--configuration-file", self.configuration.clone().into()),
            ("--seed", seed_text(seed).into()),
            ("--no-step-log", "true".into()),
            ("--no-warnings", "true".into()),
        ] {
            arguments.extend([OsString::from(option), value]);
        }
        let (client, _) = self.programs.start(&arguments, None)?;
        Ok(client)
    }
}

impl MobilitySource for LiveSumo {
    /// SUMO's `--seed` is the first draw of the world's stream of mobility, so that all policies meet the same traffic.
    fn open<'s>(&'s self, scenario: &'s Scenario, key: &WorldKey) -> Box<dyn Mobility + 's> {
        Box::new(Live {
            source: self,
            seed: key.stream(Role::Mobility, 0).below(1 << 31).into(),
            room: scenario.cell.vehicles as usize,
            run: None,
            last: HashMap::new(),
        })
    }

    fn describe(&self, _scenario: &Scenario) -> String {
        format!("SUMO with {}", self.configuration.display())
    }

    fn describe_vehicles(&self, scenario: &Scenario) -> String {
        format!(
            "at most {} vehicles at once, as SUMO moves them,",
            scenario.cell.vehicles
        )
    }

    fn vehicles(&self, scenario: &Scenario) -> usize {
        scenario.cell.vehicles as usize
    }

    fn worlds_differ(&self) -> bool {
        true
    }

    /// Few: each is a process of its own.
    fn default_worlds(&self) -> u32 {
        8
    }

    /// Checks that vehicles are not replaced, that SUMO takes the configuration, and that the base station stands within 10 km of
    /// its network: else the network is in other coordinates.
    fn check(&self, scenario: &Scenario) -> Result<()> {
        super::refuse_replacement(scenario)?;
        let (x_m, y_m) = (scenario.cell.base_station_x_m, scenario.cell.base_station_y_m);
        let (low, high) = self.start(1)?.boundary_m()?;
        let away = |value: f64, low: f64, high: f64| (low - value).max(value - high).max(0.0);
        let away_m = libm::hypot(away(x_m, low.0, high.0), away(y_m, low.1, high.1));
        if away_m <= REACH_M {
            return Ok(());
        }
        let expected =
            format!("at most {REACH_M} m: set cell.base_station_x_m and _y_m in the network's coordinates");
        Err(Error::input(
            "distance of the network from the base station",
            format!("{away_m:.0} m"),
            expected,
        ))
    }
}

/// One world's vehicles.
#[derive(Debug)]
struct Live<'s> {
    source: &'s LiveSumo,
    seed: u64,
    /// For how many vehicles there are indices.
    room: usize,
    /// SUMO, from the first update on.
    run: Option<Run>,
    /// By index: where it was shown at the last update.
    last: HashMap<usize, (f64, f64)>,
}

/// A step of SUMO: who is where, by ascending index.
#[derive(Debug, Default)]
struct Step {
    slot: u64,
    positions: Vec<(usize, Position)>,
}

/// A SUMO that runs, one step ahead of the slots.
#[derive(Debug)]
struct Run {
    client: Client,
    step_ms: f64,
    steps: u64,
    current: Step,
    next: Step,
    /// By SUMO's name: the index of everybody in the next step.
    indices: HashMap<String, usize>,
}

impl Run {
    fn start(source: &LiveSumo, seed: u64, room: usize) -> Result<Self> {
        let mut client = source.start(seed)?;
        let step_ms = 1000.0 * client.step_length_s()?;
        client.subscribe()?;
        let mut run = Self {
            client,
            step_ms,
            steps: 0,
            current: Step::default(),
            next: Step::default(),
            indices: HashMap::new(),
        };
        for _ in 0..(1000.0 * f64::from(source.head_start_s) / step_ms) as u64 {
            let _unseen = run.client.step()?;
        }
        run.next = run.step(room, &HashMap::new())?;
        Ok(run)
    }

    /// Takes one more step. Who comes anew takes an index that is neither in the step before nor `shown`, so that nobody is
    /// taken for the one who had it.
    fn step(&mut self, room: usize, shown: &HashMap<usize, (f64, f64)>) -> Result<Step> {
        let vehicles = self.client.step()?.vehicles;
        let slot = (self.steps as f64 * self.step_ms).round() as u64;
        self.steps += 1;
        let mut taken = vec![false; room];
        for index in self.indices.values().chain(shown.keys()) {
            taken[*index] = true;
        }
        let mut lowest = 0;
        let (mut indices, mut positions) = (HashMap::new(), Vec::with_capacity(vehicles.len()));
        let mut vehicles = vehicles;
        vehicles.sort_unstable_by(|one, other| one.name.cmp(&other.name));
        for vehicle in vehicles {
            let index = match self.indices.get(&vehicle.name) {
                Some(&index) => index,
                None => {
                    lowest += taken[lowest..].iter().take_while(|taken| **taken).count();
                    lowest += 1;
                    lowest - 1
                }
            };
            if index >= room {
                let found = "more vehicles";
                let expected =
                    format!("at most {room} in two steps of SUMO together: set cell.vehicles (--vehicles)");
                return Err(Error::input("vehicles at once", found, expected));
            }
            let position = Position {
                x_m: vehicle.x_m,
                y_m: vehicle.y_m,
                speed_m_per_s: vehicle.speed_m_per_s.max(0.0),
            };
            positions.push((index, position));
            let _new = indices.insert(vehicle.name, index);
        }
        positions.sort_unstable_by_key(|&(index, _)| index);
        self.indices = indices;
        Ok(Step { slot, positions })
    }
}

impl Live<'_> {
    /// Lets SUMO run until its present step is the last that is not after a slot.
    fn reach(&mut self, slot: u64) -> Result<()> {
        let run = match &mut self.run {
            Some(run) => run,
            none => none.insert(Run::start(self.source, self.seed, self.room)?),
        };
        while run.next.slot <= slot {
            let later = run.step(self.room, &self.last)?;
            run.current = std::mem::replace(&mut run.next, later);
        }
        Ok(())
    }
}

impl Mobility for Live<'_> {
    fn advance(&mut self, slots: u32, places: &mut Vec<(usize, Place)>) -> Result<()> {
        let slot = u64::from(slots);
        let source = self.source;
        self.reach(slot)
            .map_err(|error| error.within(source.configuration.display()))?;
        places.clear();
        let Some(run) = &self.run else { return Ok(()) };
        let span = (run.next.slot - run.current.slot) as f64;
        let fraction = (slot - run.current.slot) as f64 / span;
        for &(index, position) in &run.current.positions {
            let next = run
                .next
                .positions
                .binary_search_by_key(&index, |&(known, _)| known);
            let shown = match next {
                Ok(next) => position.towards(run.next.positions[next].1, fraction),
                // At the step itself it is still there.
                Err(_) if slot == run.current.slot => position,
                Err(_) => continue,
            };
            let (x_m, y_m) = (shown.x_m, shown.y_m);
            let moved_m = self
                .last
                .get(&index)
                .map_or(0.0, |&(x, y)| libm::hypot(x_m - x, y_m - y));
            places.push((
                index,
                Place {
                    x_m,
                    y_m,
                    moved_m,
                    speed_m_per_s: shown.speed_m_per_s,
                },
            ));
        }
        self.last = places
            .iter()
            .map(|&(index, place)| (index, (place.x_m, place.y_m)))
            .collect();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{file_of, name_of};
    use std::path::Path;

    #[test]
    fn a_name_is_a_file_and_perhaps_seconds() {
        let moved = |name: &str| name_of(name, &Path::new("folder").join(file_of(name)));
        assert_eq!(file_of("sumo:a@b.sumocfg@600"), "a@b.sumocfg");
        assert_eq!(moved("sumo:x.sumocfg"), "sumo:folder/x.sumocfg");
        assert_eq!(moved("sumo:x.sumocfg@600"), "sumo:folder/x.sumocfg@600");
        assert_eq!(moved("trace@1.xml"), "folder/trace@1.xml");
    }
}
