//! SUMO as the traffic: the same roads, incidents and routes in a program that others know, through [`traci`].
//!
//! One process a simulation, in steps of 1 s. A vehicle enters at the next whole second, and so late a trip seems on average,
//! since its end is a whole second, too. Crossings have no rules, as in the built-in queues: what they cost is in a planning
//! network's capacities. Where two streams meet, vehicles may overlap for a moment, then the later one falls back. Drivers follow as closely as the
//! capacity of the road under them says (Newell's reaction time). An incident is a lower speed on the roads of its block, at which the lanes carry the capacity that is left.
//!
//! # Sources
//! SUMO: P. Alvarez Lopez and others: *Microscopic Traffic Simulation using SUMO*, IEEE ITSC, 2018. Its options:
//! <https://sumo.dlr.de/docs/sumo.html>.

mod network;
mod program;
pub mod traci;

pub use program::{Process, Programs};

use super::incidents::Incidents;
use super::roads::RoadMap;
use super::{Arrival, OnRoad, STUCK_S, TrafficModel};
use kit::error::{Error, Result};
use std::collections::BTreeMap;
use std::ffi::OsString;
use traci::{Client, Version};

/// Vehicles in a SUMO of their own.
#[derive(Debug)]
pub struct SumoTraffic {
    client: Client,
    version: Version,
    map: RoadMap,
    incidents: Incidents,
    /// By block, whether its roads are slow now.
    slow: Vec<bool>,
    /// Seconds since the start.
    second: u32,
    /// By road, the type of vehicles on it.
    types: Vec<String>,
    /// Everybody who departed and has not arrived: the road whose type it has.
    kinds: BTreeMap<u32, u32>,
    /// Everybody who has entered and not arrived.
    present: BTreeMap<u32, Presence>,
    routes: u64,
    let_through: u64,
}

/// A vehicle on its way.
#[derive(Clone, Copy, Debug)]
struct Presence {
    place: OnRoad,
    /// The last second in which it was on a road; before now for one that is being let through.
    seen: u32,
}

impl SumoTraffic {
    /// Builds the network and starts SUMO at time 0. A seed gives the same traffic with the same version of SUMO.
    ///
    /// # Errors
    /// [`Error::Input`] if SUMO refuses the network or does not start.
    pub fn start(programs: &Programs, map: &RoadMap, incidents: Incidents, seed: u64) -> Result<Self> {
        let folder = tempfile::tempdir().map_err(|source| Error::file(&std::env::temp_dir(), source))?;
        let files = network::write(map, folder.path(), programs)?;
        let mut arguments: Vec<OsString> = Vec::new();
        for (option, value) in [
            ("--net-file", files.network.into()),
            ("--additional-files", files.types.into()),
            ("--seed", seed_text(seed).into()),
            ("--step-length", "1".into()),
            ("--no-internal-links", "true".into()),
            ("--time-to-teleport", STUCK_S.to_string().into()),
            ("--collision.action", "none".into()),
            ("--max-depart-delay", "-1".into()),
            // Who comes from behind falls back: else a busy street before a crossing keeps everybody from entering behind it.
            ("--insertion-checks", "collision leaderGap speedLimit".into()),
            ("--no-step-log", "true".into()),
            ("--no-warnings", "true".into()),
            ("--duration-log.disable", "true".into()),
            ("--xml-validation", "never".into()),
        ] {
            arguments.extend([OsString::from(option), value]);
        }
        let (mut client, version) = programs.start(&arguments, None)?;
        client.subscribe()?;
        // SUMO tells of a second at its end: with this one, what is told after n steps holds for time n.
        client.step()?;
        // SUMO has read its files. Whoever kills this program leaves none behind.
        drop(folder);
        Ok(Self {
            client,
            version,
            map: map.clone(),
            incidents,
            slow: vec![false; map.block_count() as usize],
            second: 0,
            types: map.roads().iter().map(network::vehicle_type).collect(),
            kinds: BTreeMap::new(),
            present: BTreeMap::new(),
            routes: 0,
            let_through: 0,
        })
    }

    /// The SUMO that moves the vehicles.
    pub fn version(&self) -> &Version {
        &self.version
    }

    /// The number of its process.
    pub fn process_id(&mut self) -> Option<u32> {
        self.client.process_mut().map(|process| process.id())
    }

    /// Slows the roads of blocks where an incident began, and frees those where one ended.
    fn apply_incidents(&mut self) {
        let time_s = f64::from(self.second);
        let changed: Vec<bool> = (0..self.map.block_count())
            .map(|block| self.incidents.active(Some(block), time_s) != self.slow[block as usize])
            .collect();
        let capacity_left = self.incidents.capacity_left();
        for (index, road) in self.map.roads().iter().enumerate() {
            if let Some(block) = road.block.filter(|&block| changed[block as usize]) {
                let speed_m_per_s = if self.slow[block as usize] {
                    road.free_speed_m_per_s
                } else {
                    road.crawl_speed_m_per_s(capacity_left)
                };
                self.client.set_edge_speed(&index.to_string(), speed_m_per_s);
            }
        }
        for (slow, changed) in self.slow.iter_mut().zip(changed) {
            *slow ^= changed;
        }
    }

    fn step(&mut self, arrived: &mut Vec<Arrival>) -> Result<()> {
        self.apply_incidents();
        let step = self.client.step()?;
        self.second += 1;
        self.let_through += u64::from(step.let_through);
        for vehicle in step.vehicles {
            let place = OnRoad {
                vehicle: number(&vehicle.name)?,
                road: number(&vehicle.road)?,
                along_m: vehicle.along_m,
            };
            self.suit_type(&vehicle.name, place);
            let seen = self.second;
            let _before = self.present.insert(place.vehicle, Presence { place, seen });
        }
        let first = arrived.len();
        for name in &step.arrived {
            let vehicle = number(name)?;
            let _left = (self.present.remove(&vehicle), self.kinds.remove(&vehicle));
            let time_s = f64::from(self.second);
            arrived.push(Arrival { vehicle, time_s });
        }
        arrived[first..].sort_unstable_by_key(|arrival| arrival.vehicle);
        Ok(())
    }

    /// Lets a vehicle follow as closely as its road's capacity says, from the next step on.
    fn suit_type(&mut self, name: &str, place: OnRoad) {
        let Some(before) = self.kinds.insert(place.vehicle, place.road) else {
            return;
        };
        let kind = self.types.get(place.road as usize);
        if let (true, Some(kind)) = (kind != self.types.get(before as usize), kind) {
            self.client.set_type(name, kind);
        }
    }

    /// Checks that a vehicle can drive these roads one after the other, and names them for SUMO.
    fn edges(&self, vehicle: u32, roads: impl Iterator<Item = u32>) -> Result<Vec<String>> {
        let place = || format!("route of vehicle {vehicle}");
        let mut end: Option<u32> = None;
        let mut edges = Vec::new();
        for road in roads {
            let Some(known) = self.map.roads().get(road as usize) else {
                let expected = format!("below {}, the number of roads", self.map.roads().len());
                return Err(Error::input(place(), format!("road {road}"), expected));
            };
            if end.is_some_and(|end| end != known.from) {
                let expected = "a road that begins where the one before ends";
                return Err(Error::input(place(), format!("road {road}"), expected));
            }
            end = Some(known.to);
            edges.push(road.to_string());
        }
        if edges.is_empty() {
            return Err(Error::input(place(), "no road", "at least one"));
        }
        Ok(edges)
    }
}

impl TrafficModel for SumoTraffic {
    fn depart(&mut self, vehicle: u32, route: &[u32]) -> Result<()> {
        let edges = self.edges(vehicle, route.iter().copied())?;
        let name = self.routes.to_string();
        self.routes += 1;
        let _before = self.kinds.insert(vehicle, route[0]);
        self.client.add_vehicle(
            &vehicle.to_string(),
            &self.types[route[0] as usize],
            &name,
            &edges,
        );
        Ok(())
    }

    /// Moves on to the last whole second that is not after `time_s`.
    fn advance(&mut self, time_s: f64, arrived: &mut Vec<Arrival>) -> Result<()> {
        while f64::from(self.second) + 1.0 <= time_s {
            self.step(arrived)?;
        }
        Ok(())
    }

    /// A vehicle that is being let through is where it stood.
    fn on_roads(&mut self, vehicles: &mut Vec<OnRoad>) -> Result<()> {
        vehicles.clear();
        vehicles.extend(self.present.values().map(|presence| presence.place));
        Ok(())
    }

    /// A vehicle that is being let through keeps its route.
    fn take_route(&mut self, vehicle: u32, onward: &[u32]) -> Result<()> {
        let Some(presence) = self.present.get(&vehicle) else {
            let place = format!("route of vehicle {vehicle}");
            return Err(Error::input(place, "no road under it", "a vehicle on a road"));
        };
        let roads = std::iter::once(presence.place.road).chain(onward.iter().copied());
        let edges = self.edges(vehicle, roads)?;
        if presence.seen == self.second {
            self.client.set_route(&vehicle.to_string(), &edges);
        }
        Ok(())
    }

    fn let_through(&self) -> u64 {
        self.let_through
    }
}

/// SUMO's seeds have 31 bits.
pub(crate) fn seed_text(seed: u64) -> String {
    (seed & 0x7fff_ffff).to_string()
}

/// The index that a vehicle or a road is called by.
fn number(name: &str) -> Result<u32> {
    name.parse().map_err(|_| {
        Error::input(
            "sumo: answer",
            format!("the name {name:?}"),
            "an index that SUMO was given",
        )
    })
}
