//! Demand as tables: a row for each pair of zones, or a matrix with a row for each origin.

use crate::csv_table::{CsvTable, file_name, id};
use crate::demand::Trip;
use crate::network::Network;
use crate::report::{ImportReport, NoteKind};
use csv::Reader;
use kit::error::{Error, Result};
use kit::files::Text;

/// Names of a column with the zone that trips start from, in the order of preference; all in upper or lower case.
const ORIGINS: [&str; 11] = [
    "o_zone_id",
    "origin",
    "o",
    "from_zone_id",
    "from_zone",
    "orig",
    "origin_zone",
    "from",
    "i",
    "orig_taz",
    "production",
];

/// The same of the zone that they go to.
const DESTINATIONS: [&str; 11] = [
    "d_zone_id",
    "destination",
    "d",
    "to_zone_id",
    "to_zone",
    "dest",
    "destination_zone",
    "to",
    "j",
    "dest_taz",
    "attraction",
];

/// The same of how many there are.
const VOLUMES: [&str; 8] = [
    "volume", "trips", "demand", "flow", "vehicles", "value", "total", "count",
];

/// Finds the number of a zone by its name.
type Find<'a> = Box<dyn FnMut(&str) -> Option<u32> + 'a>;

/// Zones by name, and the rows that named another one.
pub struct Zones<'a> {
    find: Find<'a>,
    unknown: Vec<UnknownZone>,
}

/// A row that names a zone which the network does not have.
#[derive(Debug, Clone, PartialEq)]
pub struct UnknownZone {
    /// File, line and column.
    pub place: String,
    /// What stands there.
    pub zone: String,
    /// Vehicles per unit of time of the row.
    pub volume: f64,
}

impl<'a> Zones<'a> {
    /// Those of a network.
    pub fn of(network: &Network) -> Self {
        let numbers = network.zone_numbers();
        Self::by(move |name| numbers.get(name).copied())
    }

    /// Those that a function knows.
    pub(crate) fn by(find: impl FnMut(&str) -> Option<u32> + 'a) -> Self {
        Self {
            find: Box::new(find),
            unknown: Vec::new(),
        }
    }

    /// The number of a zone; none, and remembered, if it is not known. `place` is asked for then.
    pub(crate) fn number(&mut self, name: &str, volume: f64, place: impl FnOnce() -> String) -> Option<u32> {
        let number = (self.find)(name);
        if number.is_none() {
            self.unknown.push(UnknownZone {
                place: place(),
                zone: name.to_owned(),
                volume,
            });
        }
        number
    }

    /// Whether a zone is known.
    pub(crate) fn knows(&mut self, name: &str) -> bool {
        (self.find)(name).is_some()
    }

    /// The rows that named an unknown zone.
    pub fn unknown(&self) -> &[UnknownZone] {
        &self.unknown
    }

    /// Refuses unknown zones.
    ///
    /// # Errors
    /// [`Error::Input`] names the first.
    pub fn refuse_unknown(&self) -> Result<()> {
        self.unknown.first().map_or(Ok(()), |unknown| {
            let found = format!("`{}`", unknown.zone);
            Err(Error::input(&unknown.place, found, "a zone of the network"))
        })
    }
}

/// Reads a table of trips.
///
/// # Errors
/// [`Error::Input`] naming file, line and column for columns that are none of a demand, or a volume that is negative or no
/// number.
pub(crate) fn read_csv(text: &Text, zones: &mut Zones<'_>, report: &mut ImportReport) -> Result<Vec<Trip>> {
    let (table, reader) = CsvTable::head(text)?;
    let long = table.any_column(&ORIGINS).zip(table.any_column(&DESTINATIONS));
    let trips = match long {
        Some((origin, destination)) => read_long(&table, reader, [origin, destination], zones, report)?,
        None => {
            let columns = table.columns();
            let is_matrix = columns.len() > 1 && columns[1..].iter().all(|name| zones.knows(id(name)));
            if !is_matrix {
                // The error for a table of pairs: that is what people mean most often.
                table.column(ORIGINS[0])?;
                table.column(DESTINATIONS[0])?;
            }
            read_wide(&table, reader, zones, report)?
        }
    };
    Ok(trips)
}

fn read_long(
    table: &CsvTable,
    reader: Reader<&[u8]>,
    [origin, destination]: [usize; 2],
    zones: &mut Zones<'_>,
    report: &mut ImportReport,
) -> Result<Vec<Trip>> {
    let named = table.any_column(&VOLUMES);
    let only_other = || (0..table.columns().len()).find(|column| ![origin, destination].contains(column));
    let volume = match (named, table.columns().len()) {
        (Some(volume), _) => volume,
        // Whatever it is called.
        (None, 3) => table.column(only_other().map_or("", |column| table.columns()[column].as_str()))?,
        (None, _) => table.column(VOLUMES[0])?,
    };
    let mut trips = Vec::new();
    let mut empty = 0;
    let rows = table.each_row(reader, |row| {
        let value = row.optional_amount(Some(volume))?;
        empty += usize::from(value.is_none());
        let value = value.unwrap_or(0.0);
        let mut zone = |column: usize| {
            let place = || format!("{}: {}", row.place(), table.columns()[column]);
            zones.number(row.id(Some(column)), value, place)
        };
        if let (Some(origin), Some(destination)) = (zone(origin), zone(destination)) {
            trips.push(Trip {
                origin,
                destination,
                volume: value,
            });
        }
        Ok(())
    })?;
    table.report_rows(rows, report);
    if empty > 0 {
        let place = format!("{}: {}", file_name(table.name()), table.columns()[volume]);
        report.count(NoteKind::Default, place, "0 where the field is empty", empty);
    }
    Ok(trips)
}

fn read_wide(
    table: &CsvTable,
    reader: Reader<&[u8]>,
    zones: &mut Zones<'_>,
    report: &mut ImportReport,
) -> Result<Vec<Trip>> {
    let file = file_name(table.name()).into_owned();
    let columns: Vec<Option<u32>> = table.columns()[1..]
        .iter()
        .map(|name| zones.number(id(name), 0.0, || format!("{file}:1")))
        .collect();
    let mut trips = Vec::new();
    let rows = table.each_row(reader, |row| {
        let volumes = (1..=columns.len()).map(|column| row.optional_amount(Some(column)));
        let volumes: Vec<f64> = volumes
            .map(|volume| volume.map(Option::unwrap_or_default))
            .collect::<Result<_>>()?;
        let Some(origin) = zones.number(row.id(Some(0)), volumes.iter().sum(), || row.place()) else {
            return Ok(());
        };
        for (&volume, destination) in volumes.iter().zip(&columns) {
            if let (Some(destination), true) = (*destination, volume > 0.0) {
                trips.push(Trip {
                    origin,
                    destination,
                    volume,
                });
            }
        }
        Ok(())
    })?;
    let text = format!("a matrix of {} origins and {} destinations", rows, columns.len());
    report.say(NoteKind::Read, file, text);
    Ok(trips)
}
