//! The firmware's own units, one a vehicle: slow, and able to decide without a measurement.

use super::table_index;
use crate::decisions::VehicleDecisions;
use crate::lanes::LANES;
use crate::policy::{Policy, Setup};
use crate::senses::Senses;
use crate::stream::Stream;
use firmware::table::Table;
use firmware::unit::{Event, Unit};

/// One [`Unit`] a vehicle, with one table for all or one for each, switched on when the vehicle first appears; it stays on while the vehicle is away.
pub struct Units<'t> {
    tables: &'t [Table<'t>],
    vehicles: usize,
    /// What each unit draws its back-off from, until it is switched on. `[world][vehicle]`.
    back_off: Vec<Option<Stream>>,
    /// `[world][vehicle]`.
    units: Vec<Option<Unit<'t, Stream>>>,
}

impl<'t> Units<'t> {
    /// Units that run these tables.
    pub fn new(tables: &'t [Table<'t>], setup: &Setup<'_>) -> Self {
        let vehicles = 0..setup.vehicles;
        let worlds = 0..setup.worlds();
        let places = worlds.flat_map(|world| vehicles.clone().map(move |vehicle| (world, vehicle)));
        let back_off = places.map(|(world, vehicle)| Some(setup.back_off(world, vehicle)));
        let mut units = Vec::new();
        units.resize_with(setup.worlds() * setup.vehicles, || None);
        Self {
            tables,
            vehicles: setup.vehicles,
            back_off: back_off.collect(),
            units,
        }
    }
}

impl Policy for Units<'_> {
    fn decide(&mut self, senses: &Senses<'_>, decisions: &mut VehicleDecisions<'_>) {
        let vehicle = senses.vehicle();
        let table = &self.tables[table_index(self.tables, vehicle)];
        for lane in (0..senses.worlds()).filter(|&lane| senses.is_present(lane)) {
            let index = (senses.block() * LANES + lane) * self.vehicles + vehicle;
            if let Some(back_off) = self.back_off[index].take() {
                self.units[index] = Some(Unit::new(table.bytes(), back_off));
            }
            let Some(unit) = &mut self.units[index] else { continue };
            let event = senses
                .measurement(lane)
                .map_or(Event::Missed(senses.slot()), Event::Measured);
            if let Some(report) = unit.slot(&event) {
                decisions.set(lane, report.decision);
            }
        }
    }
}
