//! Who may use a link: `allowed_uses`, with the groups of `use_group.csv`.

use crate::csv_table::CsvTable;
use kit::error::Result;
use kit::files::Text;
use std::collections::{HashMap, HashSet};

/// Uses by which cars drive, in the words of the specification's examples, DTALite and OpenStreetMap.
const CARS: [&str; 14] = [
    "all",
    "auto",
    "autos",
    "car",
    "cars",
    "drive",
    "driving",
    "sov",
    "hov",
    "hov2",
    "hov3",
    "motor_vehicle",
    "passenger",
    "vehicle",
];

/// Types of links that are no roads for cars, in the words of OpenStreetMap, where nothing says who may use them.
const NO_ROADS: [&str; 14] = [
    "bikeway",
    "bridleway",
    "corridor",
    "cycleway",
    "footway",
    "funicular",
    "light_rail",
    "monorail",
    "path",
    "pedestrian",
    "rail",
    "steps",
    "subway",
    "tram",
];

/// Whether a type of link is none that cars drive on.
pub(super) fn is_no_road(kind: &str) -> bool {
    NO_ROADS.iter().any(|known| kind.eq_ignore_ascii_case(known))
}

/// Which words of `allowed_uses` stand for cars.
#[derive(Debug)]
pub(super) struct CarUses {
    words: HashSet<String>,
}

impl CarUses {
    /// The words that everybody uses, and the groups that hold one of them.
    pub(super) fn new(groups: Option<&Text>) -> Result<Self> {
        let mut words: HashSet<String> = CARS.map(str::to_owned).into();
        let Some(groups) = groups else {
            return Ok(Self { words });
        };
        let table = CsvTable::parse(groups)?;
        let (name, uses) = (table.column("use_group")?, table.column("uses")?);
        let groups: HashMap<String, Vec<String>> = table
            .rows()
            .map(|row| {
                let uses = split(row.text(Some(uses))).collect();
                (row.text(Some(name)).to_ascii_lowercase(), uses)
            })
            .collect();
        // A group may hold groups; each round finds one level more.
        for _ in 0..groups.len() {
            let known = words.len();
            for (name, uses) in &groups {
                if uses.iter().any(|word| words.contains(word)) {
                    words.insert(name.clone());
                }
            }
            if words.len() == known {
                break;
            }
        }
        Ok(Self { words })
    }

    /// Whether cars are among the uses; an empty list allows all.
    pub(super) fn allow(&self, uses: &str) -> bool {
        let mut words = split(uses).peekable();
        words.peek().is_none() || words.any(|word| self.words.contains(&word))
    }
}

/// The words of a list, in lower case, whatever stands between them.
fn split(uses: &str) -> impl Iterator<Item = String> {
    uses.split([',', ';', '|', '/', ' '])
        .filter(|word| !word.is_empty())
        .map(str::to_ascii_lowercase)
}
