//! The firmware's own units, one a vehicle: slow, and able to decide without a measurement.

use super::table_index;
use crate::decisions::VehicleDecisions;
use crate::lanes::LANES;
use crate::policy::{Policy, Setup};
use crate::senses::Senses;
use firmware::lots::Identity;
use firmware::table::Table;
use firmware::unit::{Event, Unit};

/// One [`Unit`] a vehicle, with one table for all or one for each, switched on when the vehicle first appears; it stays on while the vehicle is away.
pub struct Units<'t> {
    tables: &'t [Table<'t>],
    vehicles: usize,
    /// `[world][vehicle]`.
    units: Vec<Option<Unit<'t>>>,
}

impl<'t> Units<'t> {
    /// Units that run these tables.
    pub fn new(tables: &'t [Table<'t>], setup: &Setup<'_>) -> Self {
        let mut units = Vec::new();
        units.resize_with(setup.worlds() * setup.vehicles, || None);
        Self {
            tables,
            vehicles: setup.vehicles,
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
            let identity = Identity(senses.identities()[lane]);
            let unit = self.units[index].get_or_insert_with(|| Unit::new(table.bytes(), identity));
            let event = senses
                .measurement(lane)
                .map_or(Event::Missed(senses.slot()), Event::Measured);
            if let Some(report) = unit.slot(&event) {
                decisions.set(lane, report.decision);
            }
        }
    }
}
