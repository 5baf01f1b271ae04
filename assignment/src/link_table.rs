//! What else is true of roads, as a table beside any network: vehicles that are there anyway, delay functions, and tolls and
//! bans by class.
//!
//! | column | meaning |
//! |---|---|
//! | `from_node_id`, `to_node_id` or alike, or `link_id` | the road, as in [flows of other programs](crate::flow_table) |
//! | `preload` | passenger cars that use it whatever happens |
//! | `delay` | its delay function: `bpr`, `conical`, `conical=ALPHA`, `akcelik=J` |
//! | `toll_CLASS` | what a vehicle of the class pays, instead of the road's own toll |
//! | `banned_CLASS` | 1 where the class may not drive |
//!
//! Empty fields, and roads without a row, leave all as it is.

use crate::csv_table::{CsvTable, Row};
use crate::link::{DelayFunction, Link};
use crate::link_names::{FROM, LINK, LinkNames, TO};
use crate::network::Network;
use crate::report::ImportReport;
use kit::error::{Error, Result};
use kit::files::Text;
use std::str::FromStr;

/// What a delay function must be, for errors.
const DELAYS: &str = "bpr, conical, conical=ALPHA or akcelik=J, such as conical=4 or akcelik=0.4";

/// A delay function as people name it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Delay {
    /// BPR, as the network's files have it.
    #[default]
    Bpr,
    /// Conical, of this alpha; without one, of the link's power, which says the same of BPR: how sudden congestion sets in.
    Conical(Option<f64>),
    /// Akcelik's, of this J.
    Akcelik(f64),
}

impl FromStr for Delay {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let refuse = || Error::input("delay", format!("`{text}`"), DELAYS);
        let (name, number) = match text.split_once('=') {
            None => (text, None),
            Some((name, number)) => (name, Some(number.parse::<f64>().map_err(|_| refuse())?)),
        };
        match (name, number) {
            ("bpr", None) => Ok(Self::Bpr),
            ("conical", alpha) => Ok(Self::Conical(alpha)),
            ("akcelik", Some(delay_parameter)) => Ok(Self::Akcelik(delay_parameter)),
            _ => Err(refuse()),
        }
    }
}

impl Delay {
    /// What it is on a link; `period` is the length of the time in which demand and capacity count vehicles, in units of the
    /// free-flow time.
    fn on(self, link: &Link, period: f64) -> DelayFunction {
        match self {
            Self::Bpr => DelayFunction::Bpr,
            Self::Conical(alpha) => DelayFunction::Conical {
                alpha: alpha.unwrap_or(link.power),
            },
            Self::Akcelik(delay_parameter) => DelayFunction::Akcelik {
                delay_parameter,
                period,
            },
        }
    }
}

/// What a table says, by link in the network's order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LinkTable {
    /// Passenger cars that are there anyway; empty where the table has none.
    preloads: Vec<f64>,
    /// Delay functions of the roads that have one of their own.
    delays: Vec<Option<Delay>>,
    /// For each class that it names, in the order of the classes, what it says.
    rules: Vec<ClassRules>,
}

/// What a table says of a class.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ClassRules {
    /// What a vehicle pays on each link; none where the network's own tolls are right.
    pub tolls: Option<Vec<f64>>,
    /// Links, as indices from 0, that it may not use.
    pub banned_links: Vec<u32>,
}

/// A column, and what it says.
#[derive(Clone, Copy)]
enum Column {
    Preload,
    Delay,
    /// Of the class with this index.
    Toll(usize),
    /// See [`Column::Toll`].
    Ban(usize),
}

impl LinkTable {
    /// Reads a table for a network and the classes of these names.
    ///
    /// # Errors
    /// [`Error::Input`] naming file, line and column for a road that the network does not have, a number that is none, and a
    /// column with another name.
    pub fn read(
        text: &Text,
        network: &Network,
        road_names: &[String],
        classes: &[&str],
        report: &mut ImportReport,
    ) -> Result<Self> {
        let table = CsvTable::parse(text)?;
        let nodes = table.any_column(&FROM).zip(table.any_column(&TO));
        let own_name = match nodes {
            Some(_) => None,
            None => Some(table.column(LINK)?),
        };
        let columns = columns(&table, classes)?;
        let mut read = Self {
            rules: vec![ClassRules::default(); classes.len()],
            ..Self::default()
        };
        let mut links = LinkNames::new(network, road_names);
        for row in table.rows() {
            let link = match (nodes, own_name) {
                (Some((from, to)), _) => {
                    links.take_only(&row.place(), (row.id(Some(from)), row.id(Some(to))))?
                }
                (None, name) => {
                    let left = links.named(row.id(name)).and_then(Vec::pop);
                    left.ok_or_else(|| row.refuse(name.unwrap_or(0), "a link of the network, once"))?
                }
            };
            if link as usize >= network.roads().len() {
                let found = format!("link {}, a turn or a connector", link + 1);
                return Err(Error::input(row.place(), found, "a road"));
            }
            for &(index, column) in &columns {
                read.put(row, (index, column), link, network)?;
            }
        }
        table.report(report);
        Ok(read)
    }

    fn put(
        &mut self,
        row: Row<'_>,
        (index, column): (usize, Column),
        link: u32,
        network: &Network,
    ) -> Result<()> {
        if row.text(Some(index)).is_empty() {
            return Ok(());
        }
        let count = network.links().len();
        match column {
            Column::Preload => {
                self.preloads.resize(count, 0.0);
                self.preloads[link as usize] = row.amount(index)?;
            }
            Column::Delay => {
                self.delays.resize(count, None);
                self.delays[link as usize] = Some(row.value(index, DELAYS)?);
            }
            Column::Toll(class) => {
                let own = || network.links().iter().map(|link| link.toll).collect();
                let tolls = self.rules[class].tolls.get_or_insert_with(own);
                tolls[link as usize] = row.amount(index)?;
            }
            Column::Ban(class) => match row.text(Some(index)) {
                "0" => {}
                "1" => self.rules[class].banned_links.push(link),
                _ => return Err(row.refuse(index, "0 or 1")),
            },
        }
        Ok(())
    }

    /// The rules of each class, in the order in which they were named.
    pub fn rules(&self) -> &[ClassRules] {
        &self.rules
    }

    /// The network with what the table says of all vehicles, and where it says nothing with `delay` on every road whose files
    /// let it congest. See [`Delay`] for `period`.
    ///
    /// # Errors
    /// [`Error::Input`] naming the link for a function that its attributes do not give.
    pub fn apply(&self, network: Network, delay: Delay, period: f64) -> Result<Network> {
        let network = if self.preloads.is_empty() {
            network
        } else {
            network.with_preloads(self.preloads.clone())?
        };
        if delay == Delay::Bpr && self.delays.is_empty() {
            return Ok(network);
        }
        let links = network.links().iter().enumerate();
        let functions = links.map(|(index, link)| {
            let usual = if link.congests() { delay } else { Delay::Bpr };
            let own = self.delays.get(index).copied().flatten();
            own.unwrap_or(usual).on(link, period)
        });
        let functions = functions.collect();
        network.with_delay_functions(functions)
    }
}

/// The columns that say something, by index.
fn columns(table: &CsvTable, classes: &[&str]) -> Result<Vec<(usize, Column)>> {
    let mut found = Vec::new();
    for name in ["preload", "delay"] {
        if let Some(index) = table.optional_column(name) {
            let column = if name == "delay" {
                Column::Delay
            } else {
                Column::Preload
            };
            found.push((index, column));
        }
    }
    for (class, name) in classes.iter().enumerate() {
        if let Some(index) = table.optional_column(&format!("toll_{name}")) {
            found.push((index, Column::Toll(class)));
        }
        if let Some(index) = table.optional_column(&format!("banned_{name}")) {
            found.push((index, Column::Ban(class)));
        }
    }
    if let Some(column) = table.unread().next() {
        let known: Vec<String> = classes
            .iter()
            .map(|name| format!(", toll_{name}, banned_{name}"))
            .collect();
        let expected = format!("preload, delay{}", known.concat());
        let found = format!("column `{column}`");
        return Err(Error::input(format!("{}:1", table.name()), found, expected));
    }
    Ok(found)
}
