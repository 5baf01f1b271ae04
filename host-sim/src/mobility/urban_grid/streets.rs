//! The streets of the grid: their lanes and crossings, and the way that a vehicle takes over them.

use super::{Heading, Turn, Vehicle};
use crate::scenario::{MobilityScenario, Turns};
use crate::stream::Stream;

/// Streets between rectangular blocks, and along the grid's edge.
#[derive(Clone)]
pub(super) struct Streets<'s> {
    pub scenario: &'s MobilityScenario,
    /// Coordinates across each heading's lanes, ascending.
    pub lanes: [Vec<f64>; 4],
}

/// A crossing as a vehicle comes to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Crossing {
    /// Which one of those along the vehicle's street, from the grid's south-west corner.
    pub index: u32,
    /// Where its area begins on the vehicle's lane.
    pub begin_m: f64,
}

/// What a vehicle comes to next.
enum Ahead {
    /// A lane that it may turn into.
    Lane(Turn),
    /// The area of a crossing, where it makes up its mind.
    Crossing(Crossing),
}

impl<'s> Streets<'s> {
    pub fn new(scenario: &'s MobilityScenario) -> Self {
        Self {
            scenario,
            lanes: Heading::ALL.map(|heading| lanes(scenario, heading)),
        }
    }

    /// Length of the lanes of one heading.
    pub fn extent_m(&self, heading: Heading) -> f64 {
        let (block_m, blocks) = self.blocks(heading);
        block_m * f64::from(blocks)
    }

    /// Length and number of the blocks along the lanes of one heading.
    pub fn blocks(&self, heading: Heading) -> (f64, u32) {
        let scenario = self.scenario;
        if heading.along_y() {
            (scenario.block_y_m, scenario.blocks_y)
        } else {
            (scenario.block_x_m, scenario.blocks_x)
        }
    }

    /// From the middle of a street to its border.
    fn half_width_m(&self) -> f64 {
        self.scenario.lane_width_m * f64::from(self.scenario.lanes_per_direction)
    }

    /// The first crossing whose area begins strictly ahead of a place on a lane.
    pub fn next_crossing(&self, heading: Heading, along_m: f64) -> Option<Crossing> {
        let (block_m, blocks) = self.blocks(heading);
        let sign = heading.sign();
        let crossing = |index: u32| Crossing {
            index,
            begin_m: f64::from(index) * block_m - sign * self.half_width_m(),
        };
        let is_ahead = |crossing: &Crossing| (crossing.begin_m - along_m) * sign > 0.0;
        if sign > 0.0 {
            (0..=blocks).map(crossing).find(is_ahead)
        } else {
            (0..=blocks).rev().map(crossing).find(is_ahead)
        }
    }

    /// Drives so far onwards, turning where the vehicle turns. `free_m` says how far it may go at most from where it then is.
    /// Returns how far it went.
    pub fn drive(
        &self,
        vehicle: &mut Vehicle,
        way_m: f64,
        stream: &mut Stream,
        free_m: impl Fn(&Self, &Vehicle) -> f64,
    ) -> f64 {
        let (mut remaining_m, mut kept_m) = (way_m, 0.0);
        while remaining_m > 0.0 {
            let free_m = free_m(self, vehicle);
            if free_m < remaining_m {
                kept_m += remaining_m - free_m;
                remaining_m = free_m;
            }
            let ahead = self.ahead(vehicle);
            if let Some((along_m, ahead)) = ahead.filter(|(at_m, _)| vehicle.distance_m(*at_m) <= remaining_m)
            {
                remaining_m -= (along_m - vehicle.along_m).abs();
                vehicle.along_m = along_m;
                match ahead {
                    Ahead::Crossing(crossing) => vehicle.turn = self.choose(vehicle, &crossing, stream),
                    Ahead::Lane(turn) if vehicle.turn.is_some() => vehicle.turn(turn.heading),
                    Ahead::Lane(turn) => {
                        if stream.chance(self.scenario.turn_probability) {
                            vehicle.turn(turn.heading);
                        }
                    }
                }
                continue;
            }
            let edge_m = if vehicle.heading.sign() > 0.0 {
                self.extent_m(vehicle.heading)
            } else {
                0.0
            };
            if vehicle.distance_m(edge_m) > remaining_m {
                vehicle.along_m += vehicle.heading.sign() * remaining_m;
                break;
            }
            // Past the last crossing there is only the edge: go on along the border.
            remaining_m -= vehicle.distance_m(edge_m).abs();
            let border = vehicle.heading.right();
            let border_lanes = &self.lanes[border as usize];
            let outermost = if vehicle.heading.sign() > 0.0 {
                border_lanes.last()
            } else {
                border_lanes.first()
            };
            vehicle.along_m = outermost.copied().unwrap_or(edge_m);
            vehicle.turn(border);
        }
        way_m - kept_m
    }

    /// What a vehicle comes to next, and where.
    fn ahead(&self, vehicle: &Vehicle) -> Option<(f64, Ahead)> {
        let turn = match (vehicle.turn, self.scenario.turns) {
            (Some(turn), _) => Some(turn),
            (None, Turns::PerLane) => self.next_lane(vehicle),
            (None, Turns::PerCrossing) => {
                let crossing = self.next_crossing(vehicle.heading, vehicle.along_m)?;
                return Some((crossing.begin_m, Ahead::Crossing(crossing)));
            }
        };
        turn.map(|turn| (turn.lane_m, Ahead::Lane(turn)))
    }

    /// The next lane across the vehicle's way, strictly ahead.
    fn next_lane(&self, vehicle: &Vehicle) -> Option<Turn> {
        let sign = vehicle.heading.sign();
        let across = Heading::ALL
            .into_iter()
            .filter(|heading| heading.along_y() != vehicle.heading.along_y());
        let lanes = across.flat_map(|heading| {
            let lanes = self.lanes[heading as usize].iter();
            lanes.map(move |&lane_m| Turn { heading, lane_m })
        });
        lanes
            .filter(|turn| vehicle.distance_m(turn.lane_m) > 0.0)
            .min_by(|a, b| (a.lane_m * sign).total_cmp(&(b.lane_m * sign)))
    }

    /// Where a vehicle turns at a crossing, if it does: by the shares of left, right and straight on among the ways that lead on
    /// from there, into any lane of the way.
    fn choose(&self, vehicle: &Vehicle, crossing: &Crossing, stream: &mut Stream) -> Option<Turn> {
        let scenario = self.scenario;
        let middle_m = f64::from(crossing.index) * self.blocks(vehicle.heading).0;
        let into = |heading: Heading| -> &[f64] {
            let lanes = &self.lanes[heading as usize];
            let before = |end_m: f64| lanes.partition_point(|&lane_m| lane_m < end_m);
            if self.next_crossing(heading, vehicle.across_m).is_some() {
                &lanes[before(middle_m - self.half_width_m())..before(middle_m + self.half_width_m())]
            } else {
                &[]
            }
        };
        let (left, right) = (scenario.left_turn_share, scenario.right_turn_share);
        let turns =
            [(vehicle.heading.left(), left), (vehicle.heading.right(), right)].map(|(heading, share)| {
                let lanes = into(heading);
                let share = if lanes.is_empty() { 0.0 } else { share };
                (heading, lanes, share)
            });
        let goes_on = self.next_crossing(vehicle.heading, crossing.begin_m).is_some();
        let straight = if goes_on {
            (1.0 - left - right).max(0.0)
        } else {
            0.0
        };
        let total = turns.iter().map(|(.., share)| share).sum::<f64>() + straight;
        let mut drawn = stream.uniform_between(0.0, total);
        for (heading, lanes, share) in turns {
            if drawn < share {
                let lane_m = lanes[stream.below(lanes.len() as u32) as usize];
                return Some(Turn { heading, lane_m });
            }
            drawn -= share;
        }
        None
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
    use crate::stream::{Purpose, Role, WorldKey};

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

    fn scenario(settings: &[&str]) -> MobilityScenario {
        let settings = settings.iter().map(|&setting| setting.to_owned()).collect();
        ScenarioSource {
            settings,
            ..ScenarioSource::default()
        }
        .read()
        .unwrap()
        .mobility
    }

    /// How often vehicles that come to a crossing from the south go on in each heading.
    fn ways(scenario: &MobilityScenario, (across_m, along_m): (f64, f64)) -> [f64; 4] {
        let streets = Streets::new(scenario);
        let key = WorldKey {
            seed: 5,
            purpose: Purpose::Evaluation,
            world: 0,
        };
        let (mut stream, mut counts) = (key.stream(Role::Mobility, 0), [0.0; 4]);
        for _ in 0..20_000 {
            let mut vehicle = Vehicle::new((Heading::North, across_m, along_m), 10.0);
            assert_eq!(
                streets.drive(&mut vehicle, 60.0, &mut stream, |_, _| f64::INFINITY),
                60.0
            );
            let lanes = &streets.lanes[vehicle.heading as usize];
            assert!(lanes.contains(&vehicle.across_m), "{vehicle:?}");
            counts[vehicle.heading as usize] += 1.0 / 20_000.0;
        }
        counts
    }

    /// By north, south, west, east; five standard errors are at most 0.018.
    fn assert_ways(found: [f64; 4], expected: [f64; 4]) {
        for (found_share, share) in found.into_iter().zip(expected) {
            assert!(
                (found_share - share).abs() < 0.018,
                "{found:?}, expected {expected:?}"
            );
        }
    }

    #[test]
    fn turns_are_read_per_lane_or_per_crossing() {
        let found = [251.75, 255.25].map(|lane_m| ways(&scenario(&[]), (lane_m, 400.0)));
        let mean: [f64; 4] = std::array::from_fn(|way| f64::midpoint(found[0][way], found[1][way]));
        // Whoever has turned comes to further lanes of the same crossing.
        assert_ways(mean, [0.24, 0.06, 0.115, 0.585]);
        let crossings = scenario(&["mobility.turns=\"per-crossing\""]);
        assert_ways(ways(&crossings, (251.75, 400.0)), [0.5, 0.0, 0.25, 0.25]);
        // On the western border there is no way to the left, at the northern one only that to the right.
        assert_ways(ways(&crossings, (5.25, 400.0)), [2.0 / 3.0, 0.0, 0.0, 1.0 / 3.0]);
        assert_ways(ways(&crossings, (251.75, 1260.0)), [0.0, 0.0, 0.0, 1.0]);
        let straight = [
            "mobility.turns=\"per-crossing\"",
            "mobility.left_turn_share=0",
            "mobility.right_turn_share=0",
        ];
        assert_ways(ways(&scenario(&straight), (251.75, 400.0)), [1.0, 0.0, 0.0, 0.0]);
        // The edge turns whoever does not.
        assert_ways(ways(&scenario(&straight), (251.75, 1260.0)), [0.0, 0.0, 0.0, 1.0]);
    }
}
