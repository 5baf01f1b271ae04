//! An incident in a town, and what comes of hearing about it: the same trips twice, once without advice and once with what connected
//! vehicles report by radio. This is the command line's closed loop on one scripted incident; it is run ahead, and kept to be drawn.

use firmware::table::Table;
use host_sim::closed_loop::{LoopOptions, Roads, built_in, usual_speeds};
use host_sim::journeys::OnRoad;
use host_sim::journeys::delays::{Delays, Fixed};
use host_sim::journeys::hour::{self, Case, Outcome, Sight};
use host_sim::journeys::incidents::Incidents;
use host_sim::journeys::radio_seconds::{self, Sampled, Sampler};
use host_sim::journeys::town::Town;
use host_sim::journeys::trips::{self, Trip};
use host_sim::policy::Kind;
use host_sim::scenario::{Scenario, ScenarioSource};
use host_sim::stream::{Purpose, WorldKey};
use kit::choice::Choice as _;
use kit::error::{Error, Result};
use serde::Deserialize;
use serde_json::{Value, json};

/// Numbers for one vehicle of a picture: x and y in metres, and 1 or 0 for: it stands in a queue.
const VEHICLE_NUMBERS: usize = 3;

/// How far from the middle of the street a vehicle is drawn, in m (chosen: both directions can be told apart).
const BESIDE_M: f64 = 9.0;

/// Speed below which a vehicle stands in a queue, in m/s: 5 km/h, as the loop counts.
const QUEUE_M_PER_S: f64 = 5.0 / 3.6;

/// When the roads are full enough to be shown, when something happens, when it is over, and when the last vehicle sets out, in s
/// (chosen: ten minutes of an incident, and as long to see the queue go).
const SHOWN_FROM_S: f64 = 300.0;
const INCIDENT_S: (f64, f64) = (420.0, 1_020.0);
const HORIZON_S: f64 = 1_800.0;

/// What a visitor asks for.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TownRequest {
    /// Seed as the command line takes it, in decimal.
    pub seed: String,
    /// Name of the policy that brings the reports.
    pub policy: String,
}

/// Pictures of one side, one a look.
#[derive(Debug, Default)]
pub struct Pictures {
    /// How many vehicles the pictures before each one have, and all of them at the end.
    starts: Vec<u32>,
    /// `[vehicle][VEHICLE_NUMBERS]`, picture by picture.
    numbers: Vec<f32>,
}

impl Pictures {
    /// See [`Pictures`].
    pub fn starts(&self) -> &[u32] {
        &self.starts
    }

    /// See [`Pictures`].
    pub fn numbers(&self) -> &[f32] {
        &self.numbers
    }

    fn take(&mut self, town: &Town, before: &[OnRoad], now: &[OnRoad], look_s: f64) {
        self.starts.push((self.numbers.len() / VEHICLE_NUMBERS) as u32);
        let mut before = before.iter().peekable();
        for on_road in now {
            while before.next_if(|last| last.vehicle < on_road.vehicle).is_some() {}
            let stands = before.peek().is_some_and(|last| {
                let is_same = (last.vehicle, last.road) == (on_road.vehicle, on_road.road);
                is_same && on_road.along_m - last.along_m < QUEUE_M_PER_S * look_s
            });
            let (x, y) = town.map().place_m(on_road);
            // On the right of the street's middle, where it drives.
            let (along_x, along_y) = town.map().direction(on_road.road);
            let (x, y) = (x + BESIDE_M * along_y, y - BESIDE_M * along_x);
            self.numbers
                .extend([x as f32, y as f32, f32::from(u8::from(stands))]);
        }
    }

    fn end(&mut self) {
        self.starts.push((self.numbers.len() / VEHICLE_NUMBERS) as u32);
    }
}

/// Both sides, run to their ends.
#[derive(Debug)]
pub struct TownSession {
    /// Without advice, and with reports.
    sides: [Pictures; 2],
    description: Value,
}

/// One hour that everything in it happens in, whoever knows of it.
struct Hours<'h> {
    scenario: &'h Scenario,
    town: &'h Town,
    trips: &'h [Trip],
    incidents: &'h Incidents,
    usual_speeds: &'h [f64],
    key: WorldKey,
}

impl Hours<'_> {
    fn run(
        &self,
        sight: Sight,
        delays: &mut dyn Delays,
        watch: impl FnMut(f64, &[OnRoad]),
    ) -> Result<Outcome> {
        let planning = &self.scenario.planning;
        let mut traffic = built_in(&Roads {
            map: self.town.map(),
            incidents: self.incidents,
            seed: self.key.seed,
        })?;
        let case = Case {
            sight,
            connected_share: planning.connected_share,
            obeying_share: planning.obeying_share,
            fade_s: planning.belief_fade_s,
        };
        let world = self
            .town
            .world(self.key, self.trips, self.incidents, self.usual_speeds, planning);
        hour::run(world, case, traffic.as_mut(), delays, watch)
    }

    fn pictures(&self, sight: Sight, delays: &mut dyn Delays) -> Result<(Outcome, Pictures)> {
        let look_s = self.scenario.planning.look_s;
        let (mut pictures, mut before) = (Pictures::default(), Vec::new());
        let outcome = self.run(sight, delays, |time_s, now| {
            if (SHOWN_FROM_S..=HORIZON_S).contains(&time_s) {
                pictures.take(self.town, &before, now, look_s);
            }
            before.clear();
            before.extend_from_slice(now);
        })?;
        pictures.end();
        Ok((outcome, pictures))
    }
}

impl TownSession {
    /// Runs both sides: the paper's grid, its usual traffic, and an incident on the street that carries most.
    ///
    /// # Errors
    /// [`Error::Input`] names what does not fit.
    pub fn open(request: &TownRequest) -> Result<Self> {
        let seed = request.seed.trim().parse::<u64>().map_err(|_| {
            let expected = format!("a whole number from 0 to {}", u64::MAX);
            Error::input("seed", format!("\"{}\"", request.seed), expected)
        })?;
        let policy = <&Kind>::of_name("policy", &request.policy)?;
        let source = ScenarioSource {
            settings: [("warmup_s", SHOWN_FROM_S), ("horizon_s", HORIZON_S)]
                .map(|(key, value)| format!("planning.{key}={value}"))
                .into(),
            ..ScenarioSource::default()
        };
        let scenario = source.read()?;
        let planning = &scenario.planning;
        let table = Table::parse(firmware::tables::DISTILLED)
            .map_err(|error| Error::input("built-in table", error, "a table"))?;
        let town = Town::of_grid(&scenario)?;
        let key = WorldKey {
            seed,
            purpose: Purpose::Evaluation,
            world: 0,
        };
        let trips = trips::draw(town.paths(), planning.horizon_s, &key);
        let options = LoopOptions {
            scenario: &scenario,
            seed,
            worlds: 1,
            policies: &[],
            table: &table,
            delays_s: &[],
        };
        let usual_speeds = usual_speeds(&town, &options, &built_in)?;
        let road = fullest_road(&town);
        let mut spans = vec![Vec::new(); town.map().block_count() as usize];
        if let Some(block) = town.map().roads()[road].block {
            spans[block as usize].push(INCIDENT_S);
        }
        let incidents = Incidents::scripted(spans, 1.0 - planning.incident_capacity_loss);
        let hours = Hours {
            scenario: &scenario,
            town: &town,
            trips: &trips,
            incidents: &incidents,
            usual_speeds: &usual_speeds,
            key,
        };

        let (blind, without) = hours.pictures(Sight::Blind, &mut Fixed(0.0))?;
        let own_speeds = Sight::OwnSpeeds(planning.detector_memory_s);
        let mut sampler = Sampler::new(&town, &trips, planning);
        let _ = hours.run(own_speeds, &mut Fixed(0.0), |time_s, now| {
            sampler.look(time_s, now)
        })?;
        let moments = sampler.moments();
        let (seconds, ages) = radio_seconds::play(&scenario, seed, policy, &table, &moments)?;
        let mut delays = Sampled::new(&town, &seconds, planning.radio_sample_s);
        let (heard, with) = hours.pictures(own_speeds, &mut delays)?;

        let places = town.map().places_m();
        let at = |node: u32| json!([places[node as usize].0, places[node as usize].1]);
        let roads = town.map().roads();
        let lines: Vec<Value> = roads
            .iter()
            .map(|road| json!([at(road.from), at(road.to)]))
            .collect();
        let description = json!({
            "roads": lines,
            "incident": { "road": road, "from_s": INCIDENT_S.0, "to_s": INCIDENT_S.1, "capacity_loss": planning.incident_capacity_loss },
            "station": [scenario.cell.base_station_x_m, scenario.cell.base_station_y_m],
            "from_s": SHOWN_FROM_S,
            "look_s": planning.look_s,
            "pictures": with.starts.len() - 1,
            "vehicle_numbers": VEHICLE_NUMBERS,
            "connected_share": planning.connected_share,
            "obeying_share": planning.obeying_share,
            "mean_age_ms": ages.map(|ages| ages.uncapped_mean_ms),
            "trip_times_s": [blind.trip_time_s, heard.trip_time_s],
        });
        Ok(Self {
            sides: [without, with],
            description,
        })
    }

    /// What the page needs to know once: the roads, the incident, how pictures are laid out, and what came out.
    pub fn description(&self) -> &Value {
        &self.description
    }

    /// Pictures of a side: 0 without advice, 1 with reports. `None` for another.
    pub fn side(&self, side: usize) -> Option<&Pictures> {
        self.sides.get(side)
    }
}

/// The road that most take on their usual ways, the first of those alike.
fn fullest_road(town: &Town) -> usize {
    let mut flows = vec![0.0; town.map().roads().len()];
    for path in town.paths() {
        for &road in path.links.iter() {
            flows[road as usize] += path.volume;
        }
    }
    let most = flows.iter().copied().fold(0.0, f64::max);
    flows.iter().position(|&flow| flow == most).unwrap_or(0)
}
