//! The HTML report of an assignment.

use super::class_table;
use crate::assign::Assignment;
use crate::report::answers;
use crate::report::chart::RoadMapChart;
use crate::report::html::{Block, Page, Section};
use crate::report::table::{Column, Table};
use assignment::coordinates::NodePlaces;
use assignment::report::ImportReport;
use assignment::{ClassSolution, Solution};
use kit::error::Result;

/// Rows of the table of the fullest roads (chosen).
const FULLEST_ROADS: usize = 20;

/// The page: what came out, a map where places are known, the fullest roads, what the readers assumed, and the command that repeats it.
///
/// # Errors
/// A map that cannot be drawn.
pub(super) fn render(
    assignment: &Assignment,
    solved: &ClassSolution,
    report: &ImportReport,
    places: Option<&NodePlaces>,
    command: &str,
) -> Result<String> {
    let Assignment { network, demand, .. } = assignment;
    let solution = &solved.total;
    let mut sections = Vec::new();
    if let Some(places) = places {
        let caption = "Flow over capacity of every road, the fullest on top; above 1 a road carries more than its capacity.";
        sections.push(Section {
            heading: "Map",
            text: "Where it is full.".to_owned(),
            blocks: vec![Block::figure(&map(assignment, solution, places)?, caption)],
        });
    }
    if !assignment.classes.is_empty() {
        sections.push(Section {
            heading: "Classes",
            text: "Vehicles of each class, and what all of them together spend.".to_owned(),
            blocks: vec![Block::table(&class_table(assignment, solved)?)],
        });
    }
    sections.push(Section {
        heading: "The fullest roads",
        text: "By flow over capacity; of roads alike, the first of the file first.".to_owned(),
        blocks: vec![Block::table(&fullest(assignment, solution)?)],
    });
    sections.push(Section {
        heading: "What was read",
        text: "Every assumption of the readers, with how often it was made.".to_owned(),
        blocks: vec![Block::table(&notes(report)?)],
    });
    sections.push(Section {
        heading: "How to repeat it",
        text: "The same files give the same flows on any machine with any number of threads.".to_owned(),
        blocks: vec![Block::command(command)],
    });
    let summary = format!(
        "{} {} between {} pairs of zones on {} roads, to a relative gap of {:.1e}.",
        demand.total(),
        assignment.unit_of_demand(),
        demand.pairs(),
        network.roads().len(),
        solution.relative_gap
    );
    let facts = vec![
        (assignment.name_of_total(), solution.total_travel_time.to_string()),
        ("objective", solution.objective.to_string()),
        (
            "converged",
            if solution.converged { "yes" } else { "no" }.to_owned(),
        ),
        (
            "pairs without a path, left out",
            assignment.lost.len().to_string(),
        ),
        ("program", env!("CARGO_PKG_VERSION").to_owned()),
    ];
    let page = Page {
        title: "Freshlane: traffic assignment".to_owned(),
        summary,
        answers: answers::of_assign(assignment, solution).into_iter().collect(),
        facts,
        sections,
    };
    Ok(page.render())
}

fn map(assignment: &Assignment, solution: &Solution, places: &NodePlaces) -> Result<String> {
    let Assignment { network, roads, .. } = assignment;
    let on_earth = places
        .places
        .iter()
        .all(|(x, y)| (-180.0..=180.0).contains(x) && (-90.0..=90.0).contains(y));
    let latitude = places.places.first().map_or(0.0, |place| place.1);
    // A degree of longitude is shorter than one of latitude.
    let stretch = if on_earth {
        libm::cos(latitude.to_radians())
    } else {
        1.0
    };
    let lines = network
        .volume_over_capacity(&solution.link_flows)
        .into_iter()
        .enumerate()
        .map(|(road, ratio)| {
            let line = roads.line(network, places, road).into_iter();
            (line.map(|(x, y)| (stretch * x, y)).collect(), ratio)
        });
    let chart = RoadMapChart {
        title: "Flow over capacity".to_owned(),
        note: String::new(),
        quantity: "flow over capacity".to_owned(),
        roads: lines.collect(),
    };
    chart.to_svg()
}

fn fullest(assignment: &Assignment, solution: &Solution) -> Result<Table> {
    let Assignment { network, roads, .. } = assignment;
    let ratios = network.volume_over_capacity(&solution.link_flows);
    let mut order: Vec<usize> = (0..ratios.len()).collect();
    order.sort_by(|&a, &b| ratios[b].total_cmp(&ratios[a]));
    order.truncate(FULLEST_ROADS);
    let links = || order.iter().map(|&road| &network.links()[road]);
    let name = |road: &usize| match roads.names.get(*road) {
        Some(name) if !name.is_empty() => name.clone(),
        _ => (road + 1).to_string(),
    };
    Table::new(vec![
        Column::text("link", order.iter().map(name)).shown("link", "", 0),
        Column::text(
            "init_node",
            links().map(|link| network.node_name(link.init_node).into_owned()),
        )
        .shown("from", "", 0),
        Column::text(
            "term_node",
            links().map(|link| network.node_name(link.term_node).into_owned()),
        )
        .shown("to", "", 0),
        Column::number("volume", order.iter().map(|&road| solution.link_flows[road])).shown("flow", "", 1),
        Column::number("capacity", links().map(|link| link.capacity)).shown("capacity", "", 1),
        Column::number("v_over_c", order.iter().map(|&road| ratios[road])).shown("flow over capacity", "", 3),
        Column::number("cost", order.iter().map(|&road| solution.link_costs[road])).shown("cost", "", 3),
    ])
}

fn notes(report: &ImportReport) -> Result<Table> {
    let notes = || report.notes();
    Table::new(vec![
        Column::text("kind", notes().map(|(note, _)| note.kind.name().to_owned())).shown("kind", "", 0),
        Column::text("place", notes().map(|(note, _)| note.place.clone())).shown("place", "", 0),
        Column::text("text", notes().map(|(note, _)| note.text.clone())).shown("what", "", 0),
        Column::unsigned(
            "count",
            notes().map(|(_, times)| (times > 0).then_some(times as u64)),
        )
        .shown("times", "", 0),
    ])
}
