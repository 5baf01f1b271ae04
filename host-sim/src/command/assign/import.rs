//! What the files do not say: options of the readers, and the report of what they assumed.

use crate::assign::AssignInput;
use crate::command::options::choice;
use assignment::formats::ImportOptions;
use assignment::imported_demand::{Unreachable, format_lost};
use assignment::report::{ImportReport, NoteKind, phrase};
use assignment::units::{Length, Speed};
use kit::error::{Error, Result};
use kit::files::write_whole;
use kit::say;
use kit::text::wrapped;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Options of the readers.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Reading")]
pub struct ImportArguments {
    /// Treat what is likely to be wrong with the input as an error
    #[arg(long)]
    pub strict: bool,
    /// What happens to trips that no path serves
    #[arg(long, value_parser = choice::<Unreachable>(), default_value = "fail")]
    pub unreachable: Unreachable,
    /// Write the trips that no path serves to this CSV (origin,destination,volume,reason), also where they are an error
    #[arg(long, value_name = "FILE.csv")]
    pub unreachable_pairs: Option<PathBuf>,
    /// Matrix of an OMX file with the trips, if it has several
    #[arg(long, value_name = "NAME")]
    pub matrix: Option<String>,
    /// CSV from_node,via_node,to_node,penalty of turns at nodes of a TNTP or GMNS network: penalty in units of free-flow time,
    /// empty where the turn is banned; other turns are free
    #[arg(long, value_name = "FILE.csv")]
    pub turns: Option<PathBuf>,
    /// Node file of a TNTP network, for maps [default: its own _node.tntp beside it]
    #[arg(long, value_name = "FILE")]
    pub nodes: Option<PathBuf>,
    /// SUMO file with the `<taz>` elements that trips name, unless the network or the trips have them
    #[arg(long, value_name = "FILE.xml")]
    pub taz: Option<PathBuf>,
    /// Vehicles an hour and lane of roads whose type begins so, or of all (repeatable, the last that fits counts). SUMO's files
    /// have no capacities [default: 1800]; in GMNS it fills empty fields
    #[arg(long, value_name = "[TYPE=]NUMBER")]
    pub lane_capacity: Vec<String>,
    /// Unit of lengths in GMNS [default: as config.csv, else the coordinates say]
    #[arg(long, value_parser = choice::<Length>())]
    pub length_unit: Option<Length>,
    /// Unit of speeds in GMNS [default: as config.csv says, else what goes with the lengths]
    #[arg(long, value_parser = choice::<Speed>())]
    pub speed_unit: Option<Speed>,
    /// Number of the period in GMNS: which of the columns VDF_cap1, VDF_cap2 ... are read [default: 1]
    #[arg(long, value_name = "NUMBER")]
    pub period: Option<u32>,
}

impl ImportArguments {
    /// As the readers want them; the weights stand elsewhere.
    ///
    /// # Errors
    /// [`Error::Input`] for a lane capacity that is no positive number.
    pub(super) fn options(&self) -> Result<ImportOptions> {
        let capacities = self.lane_capacity.iter().map(|text| {
            let (kind, number) = text.rsplit_once('=').unwrap_or(("", text));
            let number = number.trim().parse::<f64>().ok();
            let number = number.filter(|number| number.is_finite() && *number > 0.0);
            number.map(|number| (kind.to_owned(), number)).ok_or_else(|| {
                let expected = "a positive number, or a type of road, = and one";
                Error::input("--lane-capacity", format!("`{text}`"), expected)
            })
        });
        Ok(ImportOptions {
            length_unit: self.length_unit,
            speed_unit: self.speed_unit,
            lane_capacities: capacities.collect::<Result<_>>()?,
            period: self.period,
            turns: self.turns.clone(),
            taz: self.taz.clone(),
            matrix: self.matrix.clone(),
            ..ImportOptions::default()
        })
    }

    /// Files that are read.
    pub(super) fn files(&self) -> impl Iterator<Item = PathBuf> {
        [&self.turns, &self.nodes, &self.taz]
            .into_iter()
            .flatten()
            .cloned()
    }

    /// Lists the trips without a path, where a file is asked for.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(super) fn write_lost(&self, input: &AssignInput) -> Result<()> {
        match &self.unreachable_pairs {
            Some(path) => write_whole(path, format_lost(input.lost()).as_bytes()),
            None => Ok(()),
        }
    }
}

/// The report for scripts.
pub(super) fn report_json(report: &ImportReport) -> Value {
    let notes = report.notes().map(|(note, times)| {
        json!({
            "kind": note.kind.name(),
            "place": note.place,
            "text": note.text,
            "count": times,
        })
    });
    notes.collect()
}

/// What is likely to be wrong with the input, on stderr.
pub(in crate::command) fn print_warnings(report: &ImportReport) {
    for (note, times) in report.warnings() {
        kit::remark!("warning: {}: {}", note.place, phrase(&note.text, times));
    }
}

/// The report for people: warnings on stderr, the rest as a table.
pub(super) fn print_report(report: &ImportReport, json: bool) {
    print_warnings(report);
    if json {
        return;
    }
    for (note, times) in report.notes() {
        if note.kind != NoteKind::Warning {
            let line = format!(
                "{:<21}{}: {}",
                note.kind.name(),
                note.place,
                phrase(&note.text, times)
            );
            say!("{}", wrapped(&line, &" ".repeat(21)));
        }
    }
}
