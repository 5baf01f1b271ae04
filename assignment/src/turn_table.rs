//! Turns as a table of triples: from which node over which node to which node, and what it costs.

use crate::csv_table::CsvTable;
use crate::link::Link;
use crate::report::{ImportReport, NoteKind};
use crate::road_plan::TurnRules;
use kit::error::Result;
use kit::files::Text;
use std::collections::HashMap;

/// Reads a table `from_node,via_node,to_node,penalty` for roads between junctions; an empty penalty bans the turn, a number
/// is what it costs in units of travel time. Between nodes that several roads join, the row holds for all of them.
///
/// # Errors
/// [`Error::Input`](kit::error::Error::Input) naming file, line and column for a column that is missing, nodes that no road
/// joins, a turn given twice, or a penalty that is negative or no number.
pub(crate) fn read(
    text: &Text,
    roads: &[Link],
    junctions: &HashMap<String, u32>,
    report: &mut ImportReport,
) -> Result<TurnRules> {
    let table = CsvTable::parse(text)?;
    let [from, via, to] = [
        table.column("from_node")?,
        table.column("via_node")?,
        table.column("to_node")?,
    ];
    let penalty = table.optional_column("penalty");
    let mut between: HashMap<(u32, u32), Vec<u32>> = HashMap::new();
    for (index, road) in (0..).zip(roads) {
        between
            .entry((road.init_node, road.term_node))
            .or_default()
            .push(index);
    }
    let mut rules = TurnRules::default();
    let (mut bans, mut penalties) = (0, 0);
    for row in table.rows() {
        let junction = |column: usize| {
            let number = junctions.get(row.id(Some(column))).copied();
            number.ok_or_else(|| row.refuse(column, "a node of the network"))
        };
        let (from_node, via_node, to_node) = (junction(from)?, junction(via)?, junction(to)?);
        let roads = |column: usize, ends: (u32, u32)| {
            let roads = between.get(&ends);
            roads.ok_or_else(|| row.refuse(column, "a node that a road joins with via_node"))
        };
        let (entering, leaving) = (
            roads(from, (from_node, via_node))?,
            roads(to, (via_node, to_node))?,
        );
        let cost = row.optional_amount(penalty)?;
        for &entering in entering {
            for &leaving in leaving {
                if rules.penalties.insert((entering, leaving), cost).is_some() {
                    return Err(row.refuse(via, "each turn once"));
                }
            }
        }
        match cost {
            Some(_) => penalties += 1,
            None => bans += 1,
        }
    }
    table.report(report);
    let file = crate::csv_table::file_name(&text.name);
    report.count(NoteKind::Read, &file, "turns that are banned", bans);
    report.count(NoteKind::Read, &file, "turns that cost time", penalties);
    Ok(rules)
}
