//! Turns: `movement.csv`.
//!
//! The file is used in two ways, and each link that enters a junction shows which. If one of its rows has no penalty, its
//! rows are all turns that there are. If all have one, or say that nothing may turn, the file lists what is special, and
//! the link's other turns are free.

use super::links::Links;
use super::nodes::Nodes;
use super::uses::CarUses;
use crate::csv_table::{CsvTable, file_name};
use crate::report::{ImportReport, NoteKind};
use crate::road_plan::TurnRules;
use kit::error::Result;
use kit::files::Text;
use std::collections::{HashMap, HashSet};

/// Penalties are in seconds, times in minutes.
const SECONDS_PER_MINUTE: f64 = 60.0;

pub(super) fn read(
    text: &Text,
    nodes: &Nodes,
    links: &Links,
    uses: &CarUses,
    report: &mut ImportReport,
) -> Result<TurnRules> {
    let table = CsvTable::parse(text)?;
    let [node, from, to] = [
        table.column("node_id")?,
        table.column("ib_link_id")?,
        table.column("ob_link_id")?,
    ];
    let [penalty, capacity, allowed] =
        ["penalty", "capacity", "allowed_uses"].map(|column| table.optional_column(column));
    let (mut entering, mut leaving) = (HashMap::new(), HashMap::new());
    for (index, (id, road)) in (0_u32..).zip(links.ids.iter().zip(&links.roads)) {
        entering.insert((road.term_node, id.as_str()), index);
        leaving.insert((road.init_node, id.as_str()), index);
    }
    let mut rules = TurnRules::default();
    let mut not_for_cars = 0;
    let mut special: HashSet<u32> = HashSet::new();
    for row in table.rows() {
        let number = nodes.numbers.get(row.id(Some(node))).copied();
        let number = number.ok_or_else(|| row.refuse(node, "a node of node.csv"))?;
        let (Some(&from), Some(&to)) = (
            entering.get(&(number, row.id(Some(from)))),
            leaving.get(&(number, row.id(Some(to)))),
        ) else {
            // A link that cars may not use, or one that does not meet the node.
            not_for_cars += 1;
            continue;
        };
        let seconds = row.optional_amount(penalty)?;
        let banned = row.optional_amount(capacity)? == Some(0.0) || !uses.allow(row.text(allowed));
        match seconds {
            _ if banned => {
                // Several rows may describe one turn, by lanes: one that may be made decides.
                rules.penalties.entry((from, to)).or_insert(None);
            }
            Some(seconds) if seconds > 0.0 => {
                special.insert(from);
                rules
                    .penalties
                    .insert((from, to), Some(seconds / SECONDS_PER_MINUTE));
            }
            _ => {
                rules.listed_only.insert(from);
                rules.penalties.insert((from, to), Some(0.0));
            }
        }
    }
    table.report(report);
    let file = file_name(&text.name);
    if not_for_cars > 0 {
        let text = "rows of links that cars may not use, or that do not meet the node";
        report.count(NoteKind::Unused, &file, text, not_for_cars);
    }
    if !rules.listed_only.is_empty() {
        let text = "links into junctions whose rows are all turns that there are";
        report.count(NoteKind::Read, &file, text, rules.listed_only.len());
    }
    let penalties_alone = special.difference(&rules.listed_only).count();
    if penalties_alone > 0 {
        let text = "links into junctions whose rows are penalties alone: their other turns are free";
        report.count(NoteKind::Default, &file, text, penalties_alone);
    }
    Ok(rules)
}
