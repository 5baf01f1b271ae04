//! Classes of vehicles as a TOML file describes them.
//!
//! ```toml
//! [[class]]
//! name = "lorry"                    # of letters, digits, - and _; columns of results have it
//! trips = "lorries.csv"             # its trips, beside this file; as for --trips
//! matrix = "hgv"                    # matrix of an OMX file, if it has several
//! demand_factor = 1.0               # on all its trips
//! passenger_car_equivalent = 2.5    # as how many cars one of them counts
//! value_of_time = 40.0              # tolls that it pays for an hour less; or toll_weight, in units of time a unit of toll
//! distance_weight = 0.1             # units of time that it gives for a unit of length less
//! ```
//!
//! All but `name` and `trips` may be left out: the factors are 1 then, and tolls and lengths cost nothing.

use super::HOUR;
use assignment::formats::RoadData;
use assignment::imported_demand::ImportedDemand;
use assignment::link_table::ClassRules;
use assignment::report::ImportReport;
use assignment::{CostWeights, Network, VehicleClass};
use kit::error::{Error, Result};
use kit::files::Text;
use kit::layers::parse_as;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Largest number of a class (chosen: what is beyond is a typing error).
const MOST: f64 = 1e6;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ClassFile {
    class: Vec<ClassDescription>,
}

/// A class as its file has it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClassDescription {
    /// What results call it.
    pub name: String,
    trips: PathBuf,
    matrix: Option<String>,
    #[serde(default = "one")]
    demand_factor: f64,
    #[serde(default = "one")]
    passenger_car_equivalent: f64,
    value_of_time: Option<f64>,
    toll_weight: Option<f64>,
    #[serde(default)]
    distance_weight: f64,
}

fn one() -> f64 {
    1.0
}

/// Reads a file of classes; their trips lie beside it.
///
/// # Errors
/// [`Error::File`] if it cannot be read, [`Error::Input`] naming its line or the class.
pub fn read(path: &Path) -> Result<Vec<ClassDescription>> {
    let Text { name: file, text } = Text::read(path)?;
    let expected = "[[class]] with name, trips, and what else a class can have";
    let ClassFile { class: mut classes } = parse_as(&file, &text, expected)?;
    if classes.is_empty() {
        return Err(Error::input(file, "no class", "at least one [[class]]"));
    }
    for index in 0..classes.len() {
        let (before, class) = (&classes[..index], &classes[index]);
        let place = format!("{file}: class {}", class.name);
        let plain = |letter: u8| letter.is_ascii_alphanumeric() || letter == b'-' || letter == b'_';
        if class.name.is_empty() || !class.name.bytes().all(plain) {
            let expected = "letters, digits, - and _";
            return Err(Error::input(place, "its name", expected));
        }
        if before
            .iter()
            .any(|other| other.name.eq_ignore_ascii_case(&class.name))
        {
            return Err(Error::input(
                place,
                "a second one",
                "a name of its own for each class",
            ));
        }
        if class.value_of_time.is_some() && class.toll_weight.is_some() {
            let expected = "one of the two: they say the same";
            return Err(Error::input(place, "value_of_time and toll_weight", expected));
        }
        for (key, value) in [
            ("value_of_time", class.value_of_time),
            ("passenger_car_equivalent", Some(class.passenger_car_equivalent)),
        ] {
            if let Some(value) = value
                && !(value > 0.0 && value <= MOST)
            {
                let expected = format!("more than 0, at most {MOST}");
                return Err(Error::input(format!("{place}: {key}"), value, expected));
            }
        }
        for (key, value) in [
            ("demand_factor", class.demand_factor),
            ("toll_weight", class.toll_weight.unwrap_or(0.0)),
            ("distance_weight", class.distance_weight),
        ] {
            if !(0.0..=MOST).contains(&value) {
                let expected = format!("0 to {MOST}");
                return Err(Error::input(format!("{place}: {key}"), value, expected));
            }
        }
    }
    let folder = path.parent().unwrap_or_else(|| Path::new(""));
    for class in &mut classes {
        class.trips = folder.join(&class.trips);
    }
    Ok(classes)
}

impl ClassDescription {
    /// The file of its trips.
    pub fn trips(&self) -> &Path {
        &self.trips
    }

    /// Units of time that a unit of toll costs it.
    pub fn toll_weight(&self, roads: &RoadData) -> f64 {
        match (self.toll_weight, self.value_of_time) {
            (Some(weight), _) => weight,
            (None, Some(value)) => HOUR / (roads.seconds * value),
            (None, None) => 0.0,
        }
    }

    /// Its trips, those that cannot be made on the links that are open to it included.
    ///
    /// # Errors
    /// What is wrong with their file.
    pub fn demand(
        &self,
        network: &Network,
        rules: &ClassRules,
        report: &mut ImportReport,
    ) -> Result<ImportedDemand> {
        let matrix = self.matrix.as_deref();
        let read = ImportedDemand::read(&self.trips, network, &rules.banned_links, matrix, report);
        let mut read = read.map_err(|error| error.within(format!("class {}", self.name)))?;
        read.scale(self.demand_factor)?;
        Ok(read)
    }

    /// The class for the solver.
    pub fn class(&self, read: &ImportedDemand, rules: &ClassRules, roads: &RoadData) -> VehicleClass {
        VehicleClass {
            name: self.name.clone(),
            demand: read.demand.clone(),
            passenger_car_equivalent: self.passenger_car_equivalent,
            weights: CostWeights {
                toll: self.toll_weight(roads),
                distance: self.distance_weight,
            },
            tolls: rules.tolls.clone(),
            banned_links: rules.banned_links.clone(),
        }
    }
}
