//! The urban grid of 3GPP TR 36.885 A.1.2: streets between rectangular blocks, lanes in both directions, and vehicles
//! that turn at crossings. The outermost streets carry only the lanes on the grid's side, and a vehicle that reaches
//! the edge goes on along it, so the number of vehicles stays the same.

use super::{Mobility, MobilitySource, Place, Road};
use crate::scenario::{MobilityScenario, Scenario};
use crate::stream::{Role, Stream, WorldKey};
use kit::error::Result;

/// The scenario's urban grid, with other vehicles on it in each world.
#[derive(Clone, Copy, Debug, Default)]
pub struct Grid;

impl MobilitySource for Grid {
    fn open<'s>(&'s self, scenario: &'s Scenario, key: &WorldKey) -> Box<dyn Mobility + 's> {
        let stream = key.stream(Role::Mobility, 0);
        Box::new(UrbanGrid::new(&scenario.mobility, scenario.cell.vehicles, stream))
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
}

/// A vehicle on a lane: `across` is the lane's coordinate, `along` the vehicle's place on it.
#[derive(Clone, Copy, Debug)]
struct Vehicle {
    heading: Heading,
    across_m: f64,
    along_m: f64,
    speed_m_per_s: f64,
    moved_m: f64,
}

/// Vehicles on the grid.
struct UrbanGrid<'s> {
    scenario: &'s MobilityScenario,
    /// Coordinates across each heading's lanes, ascending.
    lanes: [Vec<f64>; 4],
    vehicles: Vec<Vehicle>,
    /// How many vehicles the scenario has; others joined.
    count: u32,
    stream: Stream,
    slots: u32,
}

impl<'s> UrbanGrid<'s> {
    /// `count` vehicles, each on a uniformly drawn heading, lane and place, with a uniformly drawn speed.
    fn new(scenario: &'s MobilityScenario, count: u32, mut stream: Stream) -> Self {
        let lanes = Heading::ALL.map(|heading| lanes(scenario, heading));
        let vehicles = (0..count)
            .map(|index| Vehicle::draw(scenario, &lanes, index, count, &mut stream))
            .collect();
        Self {
            scenario,
            count,
            lanes,
            vehicles,
            stream,
            slots: 0,
        }
    }
}

impl Mobility for UrbanGrid<'_> {
    fn advance(&mut self, slots: u32, places: &mut Vec<(usize, Place)>) -> Result<()> {
        let seconds = f64::from(slots - self.slots) / 1000.0;
        self.slots = slots;
        places.clear();
        for (index, vehicle) in self.vehicles.iter_mut().enumerate() {
            vehicle.moved_m = vehicle.speed_m_per_s * seconds;
            drive(vehicle, self.scenario, &self.lanes, &mut self.stream);
            places.push((index, vehicle.place()));
        }
        Ok(())
    }

    /// Anywhere on the grid.
    fn replace(&mut self, vehicle: usize) -> Option<Place> {
        let drawn = Vehicle::draw(
            self.scenario,
            &self.lanes,
            vehicle as u32,
            self.count,
            &mut self.stream,
        );
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
            let lanes = self.lanes[heading as usize].iter();
            lanes.map(move |&lane| (heading, lane, along, (lane - across).abs()))
        });
        let nearest = lanes.min_by(|(.., a), (.., b)| a.total_cmp(b));
        // A grid has a street along each side of its blocks.
        let (heading, across_m, along_m, _) = nearest.unwrap_or((Heading::North, x_m, y_m, 0.0));
        let scenario = self.scenario;
        let (slowest, fastest) = (scenario.min_speed_m_per_s, scenario.max_speed_m_per_s);
        self.vehicles.push(Vehicle {
            heading,
            across_m,
            along_m: along_m.clamp(0.0, extent(scenario, heading)),
            speed_m_per_s: self.stream.uniform_between(slowest, fastest),
            moved_m: 0.0,
        });
        Some(self.vehicles.len() - 1)
    }

    fn road(&self, vehicle: usize) -> Option<Road> {
        Some(Road::Street(self.vehicles[vehicle].heading))
    }
}

impl Vehicle {
    /// The vehicle of this index out of `count`: uniform heading, lane, place and speed.
    fn draw(
        scenario: &MobilityScenario,
        lanes: &[Vec<f64>; 4],
        index: u32,
        count: u32,
        stream: &mut Stream,
    ) -> Self {
        let heading = Heading::ALL[stream.below(4) as usize];
        let lanes = &lanes[heading as usize];
        let across_m = lanes[stream.below(lanes.len() as u32) as usize];
        let along_m = stream.uniform_between(0.0, extent(scenario, heading));
        let speed_m_per_s = scenario.speed_m_per_s(index, count, stream);
        Self {
            heading,
            across_m,
            along_m,
            speed_m_per_s,
            moved_m: 0.0,
        }
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
}

/// Drives `moved_m` onwards, deciding at every crossing lane whether to turn into it.
fn drive(vehicle: &mut Vehicle, scenario: &MobilityScenario, lanes: &[Vec<f64>; 4], stream: &mut Stream) {
    let mut remaining = vehicle.moved_m;
    while remaining > 0.0 {
        let sign = vehicle.heading.sign();
        let edge = if sign > 0.0 {
            extent(scenario, vehicle.heading)
        } else {
            0.0
        };
        let crossing =
            next_crossing(vehicle, lanes).filter(|(_, lane)| (lane - vehicle.along_m) * sign <= remaining);
        if let Some((heading, lane)) = crossing {
            remaining -= (lane - vehicle.along_m).abs();
            vehicle.along_m = lane;
            if stream.chance(scenario.turn_probability) {
                turn(vehicle, heading);
            }
        } else if (edge - vehicle.along_m) * sign > remaining {
            vehicle.along_m += sign * remaining;
            return;
        } else {
            // Past the last crossing lane there is only the edge: go on along the border.
            remaining -= (edge - vehicle.along_m).abs();
            let border = match vehicle.heading {
                Heading::North => Heading::East,
                Heading::East => Heading::South,
                Heading::South => Heading::West,
                Heading::West => Heading::North,
            };
            let border_lanes = &lanes[border as usize];
            let outermost = if sign > 0.0 {
                border_lanes.last()
            } else {
                border_lanes.first()
            };
            vehicle.along_m = outermost.copied().unwrap_or(edge);
            turn(vehicle, border);
        }
    }
}

/// The next lane across the vehicle's way, strictly ahead.
fn next_crossing(vehicle: &Vehicle, lanes: &[Vec<f64>; 4]) -> Option<(Heading, f64)> {
    let sign = vehicle.heading.sign();
    let across = Heading::ALL
        .into_iter()
        .filter(|heading| heading.along_y() != vehicle.heading.along_y());
    across
        .flat_map(|heading| lanes[heading as usize].iter().map(move |&lane| (heading, lane)))
        .filter(|(_, lane)| (lane - vehicle.along_m) * sign > 0.0)
        .min_by(|(_, a), (_, b)| (a * sign).total_cmp(&(b * sign)))
}

/// Leaves the lane at the present place for the lane that crosses there.
fn turn(vehicle: &mut Vehicle, heading: Heading) {
    std::mem::swap(&mut vehicle.across_m, &mut vehicle.along_m);
    vehicle.heading = heading;
}

/// Length of the lanes of one heading.
fn extent(scenario: &MobilityScenario, heading: Heading) -> f64 {
    if heading.along_y() {
        scenario.block_y_m * f64::from(scenario.blocks_y)
    } else {
        scenario.block_x_m * f64::from(scenario.blocks_x)
    }
}

/// Lane centres of one heading, ascending: vehicles keep to the right of each street's middle.
fn lanes(scenario: &MobilityScenario, heading: Heading) -> Vec<f64> {
    let (block, blocks) = if heading.along_y() {
        (scenario.block_x_m, scenario.blocks_x)
    } else {
        (scenario.block_y_m, scenario.blocks_y)
    };
    // North- and west-bound lanes lie on the side of the growing coordinate.
    let growing_side = matches!(heading, Heading::North | Heading::West);
    let mut lanes = Vec::new();
    for street in 0..blocks {
        for lane in 0..scenario.lanes_per_direction {
            let offset = (f64::from(lane) + 0.5) * scenario.lane_width_m;
            let middle = if growing_side { street } else { street + 1 };
            lanes.push(f64::from(middle) * block + if growing_side { offset } else { -offset });
        }
    }
    lanes.sort_by(f64::total_cmp);
    lanes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::ScenarioSource;
    use crate::stream::Purpose;

    #[test]
    fn lanes_are_those_of_the_urban_case() {
        let scenario = ScenarioSource::default().read().unwrap().mobility;
        assert_eq!(
            lanes(&scenario, Heading::North),
            [1.75, 5.25, 251.75, 255.25, 501.75, 505.25]
        );
        assert_eq!(
            lanes(&scenario, Heading::South),
            [244.75, 248.25, 494.75, 498.25, 744.75, 748.25]
        );
        assert_eq!(
            lanes(&scenario, Heading::West),
            [1.75, 5.25, 434.75, 438.25, 867.75, 871.25]
        );
        assert_eq!(
            lanes(&scenario, Heading::East),
            [427.75, 431.25, 860.75, 864.25, 1293.75, 1297.25]
        );
    }

    #[test]
    fn vehicles_stay_on_lanes_keep_their_speed_and_turn() {
        let scenario = ScenarioSource::default().read().unwrap().mobility;
        let key = WorldKey {
            seed: 5,
            purpose: Purpose::Evaluation,
            world: 0,
        };
        let mut grid = UrbanGrid::new(&scenario, 200, key.stream(Role::Mobility, 0));
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
                    grid.lanes[heading as usize].contains(&across),
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
