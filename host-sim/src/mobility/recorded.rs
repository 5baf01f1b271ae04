//! Vehicles of a recorded trace, the same in every world.

use super::floating_car_data::{Cursor, Trace};
use super::{Mobility, MobilitySource, Place};
use crate::scenario::Scenario;
use crate::stream::WorldKey;
use kit::error::{Error, Result};

/// Where no vehicle has a chance of being heard (chosen).
pub(super) const REACH_M: f64 = 10_000.0;

impl MobilitySource for Trace {
    fn open<'s>(&'s self, _scenario: &'s Scenario, _key: &WorldKey) -> Box<dyn Mobility + 's> {
        Box::new(Recorded {
            cursor: self.cursor(),
            last: vec![None; self.vehicle_ids().len()],
        })
    }

    fn describe(&self, _scenario: &Scenario) -> String {
        format!("SUMO floating-car data of {} vehicles", self.vehicle_ids().len())
    }

    fn describe_vehicles(&self, _scenario: &Scenario) -> String {
        let (most, _) = self.max_simultaneous();
        format!(
            "{} vehicles of a trace, at most {most} at once,",
            self.vehicle_ids().len()
        )
    }

    fn vehicles(&self, _scenario: &Scenario) -> usize {
        self.vehicle_ids().len()
    }

    fn most_vehicles(&self, _scenario: &Scenario) -> usize {
        self.max_simultaneous().0
    }

    fn vehicle_name(&self, vehicle: usize) -> String {
        self.vehicle_ids()[vehicle].clone()
    }

    fn duration_slots(&self) -> Option<u32> {
        Some(Trace::duration_slots(self))
    }

    /// Checks that vehicles are not replaced, and that one comes within 10 km of the base station: else the trace is in other
    /// coordinates.
    fn check(&self, scenario: &Scenario) -> Result<()> {
        super::refuse_replacement(scenario)?;
        let (x_m, y_m) = (scenario.cell.base_station_x_m, scenario.cell.base_station_y_m);
        let mut cursor = self.cursor();
        let mut nearest_m = f64::INFINITY;
        for slot in (0..=Trace::duration_slots(self)).step_by(scenario.radio.slow_update_slots as usize) {
            for (_, position) in cursor.advance_to(slot) {
                nearest_m = nearest_m.min(libm::hypot(position.x_m - x_m, position.y_m - y_m));
            }
        }
        if nearest_m <= REACH_M {
            return Ok(());
        }
        let expected =
            format!("at most {REACH_M} m: set cell.base_station_x_m and _y_m in the trace's coordinates");
        Err(Error::input(
            "distance of the trace from the base station",
            format!("{nearest_m:.0} m"),
            expected,
        ))
    }
}

/// A trace on its way.
#[derive(Clone)]
struct Recorded<'s> {
    /// The present step.
    cursor: Cursor<'s>,
    /// Every vehicle's last known coordinates.
    last: Vec<Option<(f64, f64)>>,
}

impl Mobility for Recorded<'_> {
    fn reset(&mut self, _key: &WorldKey) -> bool {
        self.last.fill(None);
        true
    }

    fn copy<'a>(&self) -> Option<Box<dyn Mobility + 'a>>
    where
        Self: 'a,
    {
        Some(Box::new(self.clone()))
    }

    fn advance(&mut self, slots: u32, places: &mut Vec<(usize, Place)>) -> Result<()> {
        places.clear();
        for (vehicle, position) in self.cursor.advance_to(slots) {
            let (x_m, y_m) = (position.x_m, position.y_m);
            let moved_m = self.last[vehicle].map_or(0.0, |(x, y)| libm::hypot(x_m - x, y_m - y));
            self.last[vehicle] = Some((x_m, y_m));
            let place = Place {
                x_m,
                y_m,
                moved_m,
                speed_m_per_s: position.speed_m_per_s,
            };
            places.push((vehicle, place));
        }
        Ok(())
    }
}
