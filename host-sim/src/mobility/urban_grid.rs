//! The urban grid of 3GPP TR 36.885 A.1.2: streets between rectangular blocks, lanes in both directions, and vehicles
//! that turn at crossings. The outermost streets carry only the lanes on the grid's side, and a vehicle that reaches
//! the edge goes on along it, so the number of vehicles stays the same.

mod signals;
mod streets;

use super::{Mobility, MobilitySource, Place, Road};
use crate::scenario::{MobilityScenario, Scenario};
use crate::stream::{Role, Stream, WorldKey};
use kit::error::Result;
use signals::Signals;
use streets::Streets;

/// The scenario's urban grid, with other vehicles on it in each world.
#[derive(Clone, Copy, Debug, Default)]
pub struct Grid;

impl MobilitySource for Grid {
    fn open<'s>(&'s self, scenario: &'s Scenario, key: &WorldKey) -> Box<dyn Mobility + 's> {
        Box::new(UrbanGrid::new(&scenario.mobility, scenario.cell.vehicles, key))
    }

    fn describe(&self, scenario: &Scenario) -> String {
        let mobility = &scenario.mobility;
        format!(
            "urban grid of {} x {} blocks",
            mobility.blocks_x, mobility.blocks_y
        )
    }

    fn vehicles(&self, scenario: &Scenario) -> usize {
        scenario.cell.vehicles as usize
    }

    fn replaces_vehicles(&self) -> bool {
        true
    }

    fn is_grid(&self) -> bool {
        true
    }
}

/// The way a vehicle drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heading {
    /// Up the y axis.
    North,
    /// Down the y axis.
    South,
    /// Down the x axis.
    West,
    /// Up the x axis.
    East,
}

impl Heading {
    const ALL: [Self; 4] = [Self::North, Self::South, Self::West, Self::East];

    const fn along_y(self) -> bool {
        matches!(self, Self::North | Self::South)
    }

    const fn sign(self) -> f64 {
        if matches!(self, Self::North | Self::East) {
            1.0
        } else {
            -1.0
        }
    }

    /// After a turn to the left.
    const fn left(self) -> Self {
        match self {
            Self::North => Self::West,
            Self::West => Self::South,
            Self::South => Self::East,
            Self::East => Self::North,
        }
    }

    /// After a turn to the right.
    const fn right(self) -> Self {
        match self {
            Self::North => Self::East,
            Self::East => Self::South,
            Self::South => Self::West,
            Self::West => Self::North,
        }
    }
}

/// A vehicle on a lane: `across` is the lane's coordinate, `along` the vehicle's place on it.
#[derive(Clone, Copy, Debug)]
struct Vehicle {
    heading: Heading,
    across_m: f64,
    along_m: f64,
    /// Where nothing holds it up.
    free_speed_m_per_s: f64,
    speed_m_per_s: f64,
    moved_m: f64,
    /// The lane of the crossing it is at that it turns into.
    turn: Option<Turn>,
}

/// A lane that a vehicle may turn into, by heading and coordinate.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Turn {
    heading: Heading,
    lane_m: f64,
}

/// Vehicles on the grid.
#[derive(Clone)]
struct UrbanGrid<'s> {
    streets: Streets<'s>,
    /// At the crossings, if they have any.
    signals: Option<Signals>,
    vehicles: Vec<Vehicle>,
    /// How many vehicles the scenario has; others joined.
    count: u32,
    stream: Stream,
    slots: u32,
}

impl<'s> UrbanGrid<'s> {
    /// `count` vehicles, each on a uniformly drawn heading, lane and place, with a uniformly drawn speed; where there are signals,
    /// some time later.
    fn new(scenario: &'s MobilityScenario, count: u32, key: &WorldKey) -> Self {
        let mut grid = Self {
            signals: Signals::new(scenario),
            streets: Streets::new(scenario),
            count,
            vehicles: Vec::with_capacity(count as usize),
            stream: key.stream(Role::Mobility, 0),
            slots: 0,
        };
        grid.begin(key);
        grid
    }

    fn begin(&mut self, key: &WorldKey) {
        self.stream = key.stream(Role::Mobility, 0);
        self.slots = 0;
        self.vehicles.clear();
        let (streets, stream) = (&self.streets, &mut self.stream);
        let draw = |index| Vehicle::draw(streets, index, self.count, stream);
        self.vehicles.extend((0..self.count).map(draw));
        if let Some(signals) = &mut self.signals {
            signals.begin(&mut key.stream(Role::Mobility, 1));
            signals.lead_in(&self.streets, &mut self.vehicles, &mut self.stream);
        }
    }
}

impl Mobility for UrbanGrid<'_> {
    fn reset(&mut self, key: &WorldKey) -> bool {
        self.begin(key);
        true
    }

    fn advance(&mut self, slots: u32, places: &mut Vec<(usize, Place)>) -> Result<()> {
        let (streets, stream) = (&self.streets, &mut self.stream);
        if let Some(signals) = &mut self.signals {
            signals.drive(self.slots..slots, streets, &mut self.vehicles, stream);
        } else {
            let seconds = f64::from(slots - self.slots) / 1000.0;
            for vehicle in &mut self.vehicles {
                let way_m = vehicle.free_speed_m_per_s * seconds;
                vehicle.moved_m = streets.drive(vehicle, way_m, stream, |_, _| f64::INFINITY);
            }
        }
        self.slots = slots;
        places.clear();
        places.extend(self.vehicles.iter().map(Vehicle::place).enumerate());
        Ok(())
    }

    /// Anywhere on the grid.
    fn replace(&mut self, vehicle: usize) -> Option<Place> {
        let drawn = Vehicle::draw(&self.streets, vehicle as u32, self.count, &mut self.stream);
        self.vehicles[vehicle] = drawn;
        Some(self.vehicles[vehicle].place())
    }

    /// On the lane nearest to the place, with a uniformly drawn speed.
    fn join(&mut self, x_m: f64, y_m: f64, room: usize) -> Option<usize> {
        if self.vehicles.len() >= room {
            return None;
        }
        let lanes = Heading::ALL.into_iter().flat_map(|heading| {
            let (across, along) = if heading.along_y() { (x_m, y_m) } else { (y_m, x_m) };
            let lanes = self.streets.lanes[heading as usize].iter();
            lanes.map(move |&lane| (heading, lane, along, (lane - across).abs()))
        });
        let nearest = lanes.min_by(|(.., a), (.., b)| a.total_cmp(b));
        // A grid has a street along each side of its blocks.
        let (heading, across_m, along_m, _) = nearest.unwrap_or((Heading::North, x_m, y_m, 0.0));
        let scenario = self.streets.scenario;
        let (slowest, fastest) = (scenario.min_speed_m_per_s, scenario.max_speed_m_per_s);
        let along_m = along_m.clamp(0.0, self.streets.extent_m(heading));
        let speed_m_per_s = self.stream.uniform_between(slowest, fastest);
        self.vehicles
            .push(Vehicle::new((heading, across_m, along_m), speed_m_per_s));
        Some(self.vehicles.len() - 1)
    }

    fn copy<'a>(&self) -> Option<Box<dyn Mobility + 'a>>
    where
        Self: 'a,
    {
        Some(Box::new(self.clone()))
    }

    fn road(&self, vehicle: usize) -> Option<Road> {
        Some(Road::Street(self.vehicles[vehicle].heading))
    }
}

impl Vehicle {
    fn new((heading, across_m, along_m): (Heading, f64, f64), speed_m_per_s: f64) -> Self {
        Self {
            heading,
            across_m,
            along_m,
            free_speed_m_per_s: speed_m_per_s,
            speed_m_per_s,
            moved_m: 0.0,
            turn: None,
        }
    }

    /// The vehicle of this index out of `count`: uniform heading, lane, place and speed.
    fn draw(streets: &Streets<'_>, index: u32, count: u32, stream: &mut Stream) -> Self {
        let heading = Heading::ALL[stream.below(4) as usize];
        let lanes = &streets.lanes[heading as usize];
        let across_m = lanes[stream.below(lanes.len() as u32) as usize];
        let along_m = stream.uniform_between(0.0, streets.extent_m(heading));
        let speed_m_per_s = streets.scenario.speed_m_per_s(index, count, stream);
        Self::new((heading, across_m, along_m), speed_m_per_s)
    }

    fn place(&self) -> Place {
        let (x_m, y_m) = if self.heading.along_y() {
            (self.across_m, self.along_m)
        } else {
            (self.along_m, self.across_m)
        };
        Place {
            x_m,
            y_m,
            moved_m: self.moved_m,
            speed_m_per_s: self.speed_m_per_s,
        }
    }

    /// How far ahead a place on its lane is.
    fn distance_m(&self, along_m: f64) -> f64 {
        (along_m - self.along_m) * self.heading.sign()
    }

    /// Leaves its lane at the present place for one that crosses there.
    fn turn(&mut self, heading: Heading) {
        std::mem::swap(&mut self.across_m, &mut self.along_m);
        self.heading = heading;
        self.turn = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::ScenarioSource;
    use crate::stream::Purpose;

    #[test]
    fn vehicles_stay_on_lanes_keep_their_speed_and_turn() {
        let scenario = ScenarioSource::default().read().unwrap().mobility;
        let key = WorldKey {
            seed: 5,
            purpose: Purpose::Evaluation,
            world: 0,
        };
        let mut grid = UrbanGrid::new(&scenario, 200, &key);
        let mut places = Vec::new();
        grid.advance(0, &mut places).unwrap();
        let mut previous = places.clone();
        let mut turns = 0;
        for update in 1..=2000 {
            let headings: Vec<_> = (0..200).map(|v| grid.vehicles[v].heading).collect();
            grid.advance(update * 100, &mut places).unwrap();
            for (v, place) in &places {
                let heading = grid.vehicles[*v].heading;
                turns += u32::from(heading != headings[*v]);
                let across = if heading.along_y() { place.x_m } else { place.y_m };
                assert!(
                    grid.streets.lanes[heading as usize].contains(&across),
                    "vehicle {v} left its lane: {place:?}"
                );
                assert!(
                    (0.0..=750.0).contains(&place.x_m) && (0.0..=1299.0).contains(&place.y_m),
                    "{place:?}"
                );
                assert!((1.0..=1.4).contains(&place.moved_m));
                let (_, from) = previous[*v];
                let way = (place.x_m - from.x_m).abs() + (place.y_m - from.y_m).abs();
                // An edge costs up to the distance from the outermost lane.
                assert!(way <= place.moved_m + 5.3, "vehicle {v} jumped {way} m");
            }
            previous.clone_from(&places);
        }
        assert!(turns > 1000, "only {turns} turns");
    }
}
