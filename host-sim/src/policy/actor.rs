//! The firmware's units, one a vehicle, fed with measurements as on the road.

use super::Policy;
use crate::cell::Cell;
use crate::stream::{Role, Stream, WorldKey};
use firmware::decision::Decision;
use firmware::table::Table;
use firmware::unit::{Event, Unit};

/// One [`Unit`] a vehicle, switched on when the vehicle first appears; it stays on while the vehicle is away.
pub struct FirmwareActor<'t> {
    table: &'t Table<'t>,
    key: WorldKey,
    units: Vec<Option<Unit<'t, Stream>>>,
}

impl<'t> FirmwareActor<'t> {
    /// Units that run this table.
    pub fn new(table: &'t Table<'t>, key: WorldKey) -> Self {
        Self {
            table,
            key,
            units: Vec::new(),
        }
    }
}

impl Policy for FirmwareActor<'_> {
    fn decide(&mut self, cell: &Cell<'_>, decisions: &mut [Decision]) {
        self.units.resize_with(cell.vehicles(), || None);
        for &vehicle in cell.present() {
            let unit = self.units[vehicle].get_or_insert_with(|| {
                Unit::new(self.table.bytes(), self.key.stream(Role::BackOff, vehicle as u32))
            });
            let event = cell
                .measurement(vehicle)
                .map_or(Event::Missed(cell.slot()), Event::Measured);
            if let Some(report) = unit.slot(&event) {
                decisions[vehicle] = report.decision;
            }
        }
    }
}
