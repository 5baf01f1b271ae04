//! Where vehicles are: on the urban grid for ever, in a recorded trace for as long as it shows them, or wherever an outside
//! program says: SUMO (`live`), or your own.

pub mod floating_car_data;
#[cfg(feature = "program")]
pub mod live;
mod recorded;
mod urban_grid;

use crate::scenario::{MobilityScenario, Scenario};
use crate::stream::{Stream, WorldKey};
use kit::error::{Error, Result};
pub use urban_grid::{Grid, Heading};

/// A vehicle's place in metres, in the coordinates of the base station: from the grid's south-west corner, or as in the trace.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place {
    /// Eastwards.
    pub x_m: f64,
    /// Northwards.
    pub y_m: f64,
    /// Way driven since the last update, which decorrelates its shadowing.
    pub moved_m: f64,
    /// How fast it moves, which gives its fading's Doppler shift.
    pub speed_m_per_s: f64,
}

/// The road that a vehicle drives on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Road {
    /// A street of the urban grid, in this direction.
    Street(Heading),
    /// A link of the source's network, by its index.
    Link(u32),
}

/// What moves the vehicles of every world. Implement it to bring places of your own: [`MobilitySource::open`] begins a world.
pub trait MobilitySource: Send + Sync + std::fmt::Debug {
    /// One world's vehicles before their first update. A source that has to reach an outside program first may do so at that
    /// update, which can fail.
    fn open<'s>(&'s self, scenario: &'s Scenario, key: &WorldKey) -> Box<dyn Mobility + 's>;

    /// Where they drive, in a few words.
    fn describe(&self, scenario: &Scenario) -> String;

    /// Who drives there, in a few words.
    fn describe_vehicles(&self, scenario: &Scenario) -> String {
        format!("{} vehicles", self.vehicles(scenario))
    }

    /// How many vehicles ever appear in a world; their indices are below.
    fn vehicles(&self, scenario: &Scenario) -> usize;

    /// The most vehicles at once.
    fn most_vehicles(&self, scenario: &Scenario) -> usize {
        self.vehicles(scenario)
    }

    /// A vehicle's name.
    fn vehicle_name(&self, vehicle: usize) -> String {
        vehicle.to_string()
    }

    /// Whether worlds may have different vehicles in the same slot.
    fn worlds_differ(&self) -> bool {
        false
    }

    /// How many worlds are simulated where nobody asks for a number.
    fn default_worlds(&self) -> u32 {
        match self.duration_slots() {
            None => 256,
            Some(_) => 8,
        }
    }

    /// How many slots it moves vehicles for; `None` if for ever.
    fn duration_slots(&self) -> Option<u32> {
        None
    }

    /// Whether vehicles may be replaced at any slot ([`Mobility::replace`]).
    fn replaces_vehicles(&self) -> bool {
        false
    }

    /// Whether vehicles drive on the scenario's urban grid.
    fn is_grid(&self) -> bool {
        false
    }

    /// Checks that the source fits the scenario: it can replace vehicles if that asks for it, and its coordinates are those of the
    /// base station.
    ///
    /// # Errors
    /// [`Error::Input`] if not.
    fn check(&self, scenario: &Scenario) -> Result<()> {
        if self.replaces_vehicles() {
            return Ok(());
        }
        refuse_replacement(scenario)
    }
}

impl MobilityScenario {
    /// The speed of the vehicle of this index out of `count`, for good and for whoever takes its index: it stands, or its speed
    /// is uniform.
    fn speed_m_per_s(&self, index: u32, count: u32, stream: &mut Stream) -> f64 {
        let drawn = stream.uniform_between(self.min_speed_m_per_s, self.max_speed_m_per_s);
        let stands = f64::from(index) < (self.standing_share * f64::from(count)).round();
        if stands { 0.0 } else { drawn }
    }
}

/// Checks that the scenario asks for no replacement of vehicles.
fn refuse_replacement(scenario: &Scenario) -> Result<()> {
    let probability = scenario.cell.replacement_probability;
    if probability > 0.0 {
        let expected = "0 but on the urban grid";
        return Err(Error::input(
            "cell.replacement_probability",
            probability,
            expected,
        ));
    }
    Ok(())
}

/// The moving vehicles of one world. A vehicle keeps its index for good; not every vehicle is always present.
pub trait Mobility: Send + Sync {
    /// Moves on to `slots` after the start and hands over every present vehicle with its place, by ascending index.
    ///
    /// # Errors
    /// If an outside program does not answer as it should; vehicles then stay where they are.
    fn advance(&mut self, slots: u32, places: &mut Vec<(usize, Place)>) -> Result<()>;

    /// Goes on with another world's vehicles before their first update, as its source would open it, in the same memory. `false` where
    /// it has to be opened.
    fn reset(&mut self, _key: &WorldKey) -> bool {
        false
    }

    /// Another vehicle takes a vehicle's index: its place. `None` where vehicles are not replaced.
    fn replace(&mut self, _vehicle: usize) -> Option<Place> {
        None
    }

    /// One more vehicle near a place, if there are fewer than `room`: its index. `None` where nobody may join.
    fn join(&mut self, _x_m: f64, _y_m: f64, _room: usize) -> Option<usize> {
        None
    }

    /// The same vehicles in the same place, who go on by themselves. `None` where an outside program moves them.
    fn copy<'a>(&self) -> Option<Box<dyn Mobility + 'a>>
    where
        Self: 'a,
    {
        None
    }

    /// The road that a present vehicle drives on, where that is known.
    fn road(&self, _vehicle: usize) -> Option<Road> {
        None
    }

    /// Tells a vehicle to drive these links of the source's network, one after the other, from where it is.
    ///
    /// # Errors
    /// [`Error::Input`] for a route that it cannot take, and from a source whose vehicles choose their ways alone.
    fn take_route(&mut self, vehicle: usize, _links: &[u32]) -> Result<()> {
        let found = "vehicles that choose their ways alone";
        Err(Error::input(
            format!("route of vehicle {vehicle}"),
            found,
            "a source that can be told routes",
        ))
    }
}

/// The source of this name: `grid`, a file of SUMO floating-car data, or `sumo:` with a SUMO configuration.
///
/// # Errors
/// What is wrong with the file.
#[cfg(feature = "program")]
pub fn read_source(name: &str) -> Result<Box<dyn MobilitySource>> {
    if name == "grid" {
        Ok(Box::new(Grid))
    } else if let Some(name) = name.strip_prefix(live::PREFIX) {
        Ok(Box::new(live::LiveSumo::read(name)?))
    } else {
        Ok(Box::new(floating_car_data::Trace::read(std::path::Path::new(
            name,
        ))?))
    }
}

/// Checks that a source moves vehicles for so many slots.
///
/// # Errors
/// [`Error::Input`] if it does not.
pub fn check_slots(source: &dyn MobilitySource, slots: u32) -> Result<()> {
    match source.duration_slots() {
        Some(most) if slots > most => {
            let expected = format!("at most {most}, the length of the trace");
            Err(Error::input("warmup + slots", slots, expected))
        }
        _ => Ok(()),
    }
}
