//! Link flows in the tables of other programs: the published flows of TNTP, AequilibraE's results, GMNS.
//!
//! | table | columns read |
//! |---|---|
//! | own, Parquet too | `init_node`, `term_node`, `volume`, one row for each link in the network's order |
//! | `*_flow.tntp` | From, To, Volume, in this order, whatever the first line says |
//! | nodes of links | a pair of `from_node_id`, `to_node_id` or alike, and `volume` or `flow` |
//! | links by name | `link_id`, and `volume`, or flows of both directions such as `PCE_AB`, `PCE_BA` or `matrix_ab`, `matrix_ba` |
//!
//! Rows come in any order. Of several links with the same nodes, the first row means the first in the network's order.
//! Where links have no names, `link_id` is their number in file order.

use crate::check;
use crate::csv_table::{CsvTable, Row};
use crate::link_names::{FROM, LINK, LinkNames, TO};
use crate::network::Network;
use kit::error::{Error, Result};
use kit::files::Text;

/// Names of columns with a link's flow, in the order of preference.
const VOLUME: [&str; 5] = ["volume", "flow", "vol", "link_flow", "pce_tot"];

/// The same with the flows of both directions.
const DIRECTIONS: [(&str, &str); 4] = [
    ("pce_ab", "pce_ba"),
    ("matrix_ab", "matrix_ba"),
    ("flow_ab", "flow_ba"),
    ("volume_ab", "volume_ba"),
];

/// Reads the flow of every link, or of every road where that is enough to judge them; `road_names` are what files call the
/// roads, empty where they have no names.
///
/// # Errors
/// [`Error::Input`] naming file and line for a table of another kind, a volume that is negative or no number, a link that the
/// network does not have, or a link without a row.
pub fn read(text: &Text, network: &Network, road_names: &[String]) -> Result<Vec<f64>> {
    let first = text
        .text
        .lines()
        .map(str::trim)
        .find(|line| !line.is_empty())
        .unwrap_or("");
    if first == check::HEADER {
        return check::read_flows(text, network);
    }
    let mut flows = Flows::new(network, road_names);
    if first.contains(',') {
        flows.read_csv(text)?;
    } else {
        flows.read_tntp(text)?;
    }
    flows.finish(&text.name)
}

/// Flows on the way.
struct Flows<'n> {
    network: &'n Network,
    links: LinkNames,
    volumes: Vec<Option<f64>>,
}

impl<'n> Flows<'n> {
    fn new(network: &'n Network, road_names: &[String]) -> Self {
        Self {
            volumes: vec![None; network.links().len()],
            network,
            links: LinkNames::new(network, road_names),
        }
    }

    fn read_tntp(&mut self, text: &Text) -> Result<()> {
        let expected = "From To Volume Cost, as in published flows, or a CSV";
        let mut rows = 0;
        for (number, line) in (1..).zip(text.text.lines()) {
            let mut fields = line
                .split([' ', '\t', ':', ';'])
                .filter(|field| !field.trim().is_empty());
            let [Some(from), Some(to), Some(volume)] = [fields.next(), fields.next(), fields.next()] else {
                continue;
            };
            let Ok(volume) = volume.trim().parse::<f64>() else {
                // Headings and metadata come before all rows.
                if rows == 0 {
                    continue;
                }
                let place = format!("{}:{number}: volume", text.name);
                return Err(Error::input(
                    place,
                    format!("`{volume}`"),
                    "a finite number, not negative",
                ));
            };
            let place = format!("{}:{number}", text.name);
            crate::link::check_not_negative(&format!("{place}: volume"), volume)?;
            self.put_nodes(&place, (from, to), volume)?;
            rows += 1;
        }
        if rows == 0 {
            return Err(Error::input(&text.name, "no such rows", expected));
        }
        Ok(())
    }

    fn read_csv(&mut self, text: &Text) -> Result<()> {
        let table = CsvTable::parse(text)?;
        let nodes = table.any_column(&FROM).zip(table.any_column(&TO));
        let directions = DIRECTIONS.iter().find_map(|(ab, ba)| {
            let ab = table.optional_column(ab)?;
            Some((ab, table.optional_column(ba)?))
        });
        let volume = table.any_column(&VOLUME);
        match (nodes, directions, volume) {
            (Some((from, to)), _, Some(volume)) => {
                for row in table.rows() {
                    let flow = row.optional_amount(Some(volume))?.unwrap_or(0.0);
                    self.put_nodes(&row.place(), (row.id(Some(from)), row.id(Some(to))), flow)?;
                }
            }
            (_, Some((ab, ba)), _) => {
                let link = table.column(LINK)?;
                for row in table.rows() {
                    self.put_name(row, link, &[ab, ba])?;
                }
            }
            (None, None, Some(volume)) => {
                let link = table.column(LINK)?;
                for row in table.rows() {
                    self.put_name(row, link, &[volume])?;
                }
            }
            _ => {
                table.column(VOLUME[0])?;
            }
        }
        Ok(())
    }

    fn put_nodes(&mut self, place: &str, nodes: (&str, &str), volume: f64) -> Result<()> {
        let link = self.links.take_between(place, nodes)?;
        self.volumes[link as usize] = Some(volume);
        Ok(())
    }

    /// The flows of a link's directions, or of the only one.
    fn put_name(&mut self, row: Row<'_>, link: usize, columns: &[usize]) -> Result<()> {
        let links = self.links.named(row.id(Some(link)));
        let links = links.ok_or_else(|| row.refuse(link, "a link of the network"))?;
        for &column in columns {
            let flow = row.optional_amount(Some(column))?.unwrap_or(0.0);
            match links.pop() {
                Some(link) => self.volumes[link as usize] = Some(flow),
                // The direction that a one-way road does not have.
                None if flow == 0.0 => {}
                None => {
                    return Err(row.refuse(
                        column,
                        "no flow where the network has no link, and each link once",
                    ));
                }
            }
        }
        Ok(())
    }

    fn finish(self, name: &str) -> Result<Vec<f64>> {
        let missing = self.volumes.iter().position(Option::is_none);
        let roads = self.network.roads().len();
        if missing == Some(roads)
            && self.volumes[roads..].iter().all(Option::is_none)
            && check::is_enough(self.network, roads)
        {
            return Ok(self.volumes.into_iter().flatten().collect());
        }
        let Some(missing) = missing else {
            return Ok(self.volumes.into_iter().flatten().collect());
        };
        let all = self.volumes.iter().filter(|volume| volume.is_none()).count();
        let link = &self.network.links()[missing];
        let [from, to] = [link.init_node, link.term_node].map(|node| self.network.node_name(node));
        let expected = if missing < roads {
            "a row for every link"
        } else {
            "a row for every link, connectors and turns included, where turns cost time"
        };
        let found = format!("no flow of {all} links, the first from {from} to {to}");
        Err(Error::input(name, found, expected))
    }
}
