//! The firmware's own units, one a vehicle: slow, and able to decide without a measurement.

use super::table_index;
use crate::decisions::Decisions;
use crate::environment::Environment;
use crate::policy::Policy;
use crate::stream::{Role, Stream};
use firmware::table::Table;
use firmware::unit::{Event, Unit};

/// One [`Unit`] a vehicle, with one table for all or one for each, switched on when the vehicle first appears; it stays on while the vehicle is away.
pub struct Units<'t> {
    tables: &'t [Table<'t>],
    /// `[world][vehicle]`.
    units: Vec<Option<Unit<'t, Stream>>>,
}

impl<'t> Units<'t> {
    /// Units that run these tables.
    pub fn new(tables: &'t [Table<'t>], environment: &Environment<'_>) -> Self {
        let mut units = Vec::new();
        units.resize_with(environment.worlds() * environment.vehicles(), || None);
        Self { tables, units }
    }
}

impl Policy for Units<'_> {
    fn decide(&mut self, environment: &Environment<'_>, decisions: &mut Decisions) {
        for (world, key) in environment.keys().iter().enumerate() {
            for &vehicle in environment.present() {
                let table = &self.tables[table_index(self.tables, vehicle)];
                let unit = &mut self.units[world * environment.vehicles() + vehicle];
                let unit = unit.get_or_insert_with(|| {
                    Unit::new(table.bytes(), key.stream(Role::BackOff, vehicle as u32))
                });
                let event = environment
                    .measurement(world, vehicle)
                    .map_or(Event::Missed(environment.slot()), Event::Measured);
                if let Some(report) = unit.slot(&event) {
                    decisions.set(world, vehicle, report.decision);
                }
            }
        }
    }
}
