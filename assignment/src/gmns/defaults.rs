//! What a link is taken to be like where its row does not say.

use crate::units::Speed;

/// A kind of road: speed in km/h, and capacity in vehicles an hour and lane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Kind {
    pub(super) speed_km_per_h: f64,
    pub(super) lane_capacity: f64,
}

/// Kinds by what their names hold, the first that fits; chosen after the defaults of osm2gmns and, for the words that
/// OpenStreetMap does not have, the table of types of the specification's example of Lima.
const KINDS: [(&str, Kind); 16] = [
    ("connector", kind(50.0, 10_000.0)),
    ("motorway", kind(120.0, 2_300.0)),
    ("freeway", kind(105.0, 2_000.0)),
    ("trunk", kind(100.0, 2_200.0)),
    ("ramp", kind(50.0, 1_000.0)),
    ("highway", kind(80.0, 1_500.0)),
    ("expressway", kind(80.0, 1_800.0)),
    ("primary", kind(80.0, 1_800.0)),
    ("arterial", kind(60.0, 900.0)),
    ("secondary", kind(60.0, 1_600.0)),
    ("tertiary", kind(40.0, 1_200.0)),
    ("collector", kind(50.0, 900.0)),
    ("residential", kind(30.0, 1_000.0)),
    ("service", kind(30.0, 800.0)),
    ("unclassified", kind(30.0, 800.0)),
    ("local", kind(30.0, 800.0)),
];

/// What is taken for any other name and for none.
const OTHER: Kind = kind(50.0, 900.0);

const fn kind(speed_km_per_h: f64, lane_capacity: f64) -> Kind {
    Kind {
        speed_km_per_h,
        lane_capacity,
    }
}

impl Kind {
    /// The kind of a road by the name of its type.
    pub(super) fn of(name: &str) -> Self {
        let name = name.to_ascii_lowercase();
        let known = KINDS.iter().find(|(word, _)| name.contains(word));
        known.map_or(OTHER, |(_, kind)| *kind)
    }

    /// Its speed in another unit.
    pub(super) fn speed(self, unit: Speed) -> f64 {
        self.speed_km_per_h * Speed::KilometrePerHour.metres_per_second() / unit.metres_per_second()
    }
}
