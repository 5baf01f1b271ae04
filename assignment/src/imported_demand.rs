//! A demand as files gave it: the trips, and those of them that cannot be made.

use crate::demand::Trip;
use crate::demand_table::{UnknownZone, Zones, read_csv};
use crate::report::{ImportReport, NoteKind};
use crate::{Demand, Network, reach, text, tntp};
use kit::choice::Choice;
use kit::error::{Error, Result};
use std::collections::HashSet;
use std::fmt::Write as _;
use std::path::Path;

/// So many pairs an error names (chosen: one line of a screen or two).
const NAMED_PAIRS: usize = 12;

/// Why trips cannot be made.
const NO_ZONE: &str = "no zone";

/// See [`NO_ZONE`].
const NO_PATH: &str = "no path";

/// What happens to trips that no path serves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Unreachable {
    /// They are an error.
    #[default]
    Fail,
    /// They are left out, and counted.
    Drop,
}

impl Choice for Unreachable {
    const ALL: &'static [Self] = &[Self::Fail, Self::Drop];

    fn name(self) -> &'static str {
        match self {
            Self::Fail => "fail",
            Self::Drop => "drop",
        }
    }

    fn meaning(self) -> &'static str {
        match self {
            Self::Fail => "Trips without a path are an error that names them",
            Self::Drop => "Trips without a path are left out and counted",
        }
    }
}

/// Trips that cannot be made.
#[derive(Debug, Clone, PartialEq)]
pub struct LostTrips {
    /// Names of the zones, or where a zone stands that the network does not have.
    pub origin: String,
    /// See [`origin`](Self::origin).
    pub destination: String,
    /// Vehicles per unit of time.
    pub volume: f64,
    /// Why not.
    pub why: &'static str,
}

/// A demand, trips that cannot be made included.
#[derive(Debug, Clone)]
pub struct ImportedDemand {
    /// Who drives.
    pub demand: Demand,
    /// Trips without a path or without a zone.
    pub lost: Vec<LostTrips>,
    unreachable: Vec<Trip>,
}

impl ImportedDemand {
    /// Reads a demand in any format of tables: the content decides. `matrix` is the name of one in an OMX file; `banned_links`
    /// are those, as indices from 0, that its vehicles may not use.
    ///
    /// # Errors
    /// What is wrong with the file. Trips without a path are none yet.
    pub fn read(
        path: &Path,
        network: &Network,
        banned_links: &[u32],
        matrix: Option<&str>,
        report: &mut ImportReport,
    ) -> Result<Self> {
        let count = network.numbering().zones;
        let mut zones = Zones::of(network);
        let trips = match read_matrix(path, matrix, &mut zones, report)? {
            Some(trips) => trips,
            None => {
                let text = text::read(path)?;
                let numbers_are_names =
                    || (1..=count).all(|zone| network.zone_name(zone) == zone.to_string());
                if !tntp::is_tntp(&text.text) {
                    read_csv(&text, &mut zones, report)?
                } else if numbers_are_names() {
                    let demand = tntp::read_trips(&text, count)?;
                    return Ok(Self::new(network, demand, Vec::new(), banned_links));
                } else {
                    tntp::read_trips_by_name(&text, &mut zones)?
                }
            }
        };
        let demand = Demand::new(count, &trips)?;
        Ok(Self::new(network, demand, zones.unknown().to_vec(), banned_links))
    }

    /// Finds the trips that cannot be made.
    pub(crate) fn new(
        network: &Network,
        demand: Demand,
        unknown: Vec<UnknownZone>,
        banned_links: &[u32],
    ) -> Self {
        let unreachable = reach::unreachable(network, &demand, banned_links);
        let no_path = unreachable.iter().map(|trip| LostTrips {
            origin: network.zone_name(trip.origin).into_owned(),
            destination: network.zone_name(trip.destination).into_owned(),
            volume: trip.volume,
            why: NO_PATH,
        });
        let no_zone = unknown.into_iter().map(|unknown| LostTrips {
            origin: unknown.place,
            destination: unknown.zone,
            volume: unknown.volume,
            why: NO_ZONE,
        });
        Self {
            lost: no_path.chain(no_zone).collect(),
            demand,
            unreachable,
        }
    }

    /// So many times these trips.
    ///
    /// # Errors
    /// As [`Demand::scaled`].
    pub fn scale(&mut self, factor: f64) -> Result<()> {
        if factor == 1.0 {
            return Ok(());
        }
        self.demand = self.demand.scaled(factor)?;
        for lost in &mut self.lost {
            lost.volume *= factor;
        }
        Ok(())
    }

    /// A demand all of whose trips have a path.
    pub fn built(demand: Demand) -> Self {
        Self {
            demand,
            lost: Vec::new(),
            unreachable: Vec::new(),
        }
    }

    /// Refuses trips that cannot be made, or leaves them out.
    ///
    /// # Errors
    /// [`Error::Input`] that names them.
    pub fn settle(&mut self, place: &str, unreachable: Unreachable, report: &mut ImportReport) -> Result<()> {
        if self.lost.is_empty() {
            return Ok(());
        }
        let volume: f64 = self.lost.iter().map(|lost| lost.volume).sum();
        if unreachable == Unreachable::Fail {
            return Err(self.refusal(place, volume));
        }
        let pairs: HashSet<(u32, u32)> = self
            .unreachable
            .drain(..)
            .map(|trip| (trip.origin, trip.destination))
            .collect();
        self.demand = self.demand.without(&pairs)?;
        let text = format!("pairs with {volume} vehicles are left out: they have no path or no zone");
        report.count(NoteKind::Warning, place, text, self.lost.len());
        Ok(())
    }

    fn refusal(&self, place: &str, volume: f64) -> Error {
        if let Some(lost) = self.lost.iter().find(|lost| lost.why == NO_ZONE) {
            let expected = "a zone of the network; --unreachable drop leaves such rows out";
            return Error::input(&lost.origin, format!("`{}`", lost.destination), expected);
        }
        let named = self.lost.iter().take(NAMED_PAIRS);
        let named: Vec<String> = named
            .map(|lost| format!("{} to {}", lost.origin, lost.destination))
            .collect();
        let others = match self.lost.len().saturating_sub(NAMED_PAIRS) {
            0 => String::new(),
            others => format!(" and {others} more"),
        };
        let found = format!(
            "{volume} vehicles without a path, by pairs {}: {}{others}",
            self.lost.len(),
            named.join(", ")
        );
        let expected =
            "a path for every trip; --unreachable drop leaves them out, --unreachable-pairs lists all";
        Error::input(place, found, expected)
    }
}

/// First line of a file of trips that cannot be made.
pub const LOST_HEADER: &str = "origin,destination,volume,reason";

/// Trips that cannot be made, with the names of their classes, as CSV. It has a column for these where one is not empty.
pub fn format_lost<'l>(lost: impl Iterator<Item = (&'l str, &'l LostTrips)>) -> String {
    let mut lost = lost.peekable();
    let with_classes = lost.peek().is_some_and(|(class, _)| !class.is_empty());
    let mut text = format!("{}{LOST_HEADER}\n", if with_classes { "class," } else { "" });
    for (class, trips) in lost {
        let LostTrips {
            origin,
            destination,
            volume,
            why,
        } = trips;
        if with_classes {
            text.push_str(class);
            text.push(',');
        }
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{origin},{destination},{volume},{why}");
    }
    text
}

/// The trips of an OMX file; none if it is another one.
///
/// # Errors
/// What is wrong with it, and a name of a matrix beside a file that has none.
pub(crate) fn read_matrix(
    path: &Path,
    matrix: Option<&str>,
    zones: &mut Zones<'_>,
    report: &mut ImportReport,
) -> Result<Option<Vec<Trip>>> {
    #[cfg(feature = "omx")]
    if crate::omx::is_omx(path)? {
        let trips = crate::omx::read(path, matrix, zones, report)?;
        return Ok(Some(trips));
    }
    let _unused = (path, zones, report);
    match matrix {
        Some(name) => Err(Error::input(
            "matrix",
            format!("`{name}`"),
            "none beside trips that are no OMX file",
        )),
        None => Ok(None),
    }
}
