//! Points that are one `host-sim assign`.

use super::{Command, Measure, Task, column};
use crate::assign::AssignSource;
use crate::report::chart::Scale;
use crate::sweep::Settings;
use crate::sweep::axis::{GRID, Kind};
use assignment::formats::ImportOptions;
use kit::error::Result;

/// `host-sim assign`.
pub static COMMAND: Command = Command {
    name: "assign",
    meaning: "User equilibrium or system optimum of a road network",
    takes_scenario: false,
    keys: &[
        ("net", Kind::Network(GRID)),
        ("trips", Kind::File(None)),
        ("algorithm", Kind::Text),
        ("objective", Kind::Text),
        ("gap", Kind::Number),
        ("max_iterations", Kind::Integer),
        ("toll_weight", Kind::Number),
        ("distance_weight", Kind::Number),
        ("demand_factor", Kind::Number),
        ("link_table", Kind::File(None)),
        ("delay", Kind::Text),
        ("delay_period", Kind::Number),
        ("turns", Kind::File(None)),
        ("matrix", Kind::Text),
        ("unreachable", Kind::Text),
    ],
    policies: &[],
    counts: &[
        column("links", "/links"),
        column("zones", "/zones"),
        column("pairs", "/pairs"),
        column("iterations", "/iterations"),
    ],
    numbers: &[
        column("total_demand", "/total_demand"),
        column("intrazonal_demand", "/intrazonal_demand"),
        column("total_travel_time", "/total_travel_time"),
        // What was minimised; which of the two is the key `objective`.
        column("objective_value", "/objective"),
        column("relative_gap", "/relative_gap"),
        column("mean_v_over_c", "/mean_v_over_c"),
        column("max_v_over_c", "/max_v_over_c"),
    ],
    measures: &[
        Measure {
            title: "Total travel time",
            file: "total_travel_time",
            axis: "total travel time (units of the network)",
            mean: "total_travel_time",
            ..EXACT
        },
        Measure {
            title: "Flow over capacity",
            file: "v_over_c",
            axis: "flow over capacity, mean over roads",
            mean: "mean_v_over_c",
            ..EXACT
        },
    ],
    extent: "{links} roads",
    prepare,
};

/// What results without chance have in common.
const EXACT: Measure = Measure {
    title: "",
    file: "",
    axis: "",
    scale: Scale::Linear,
    least: 0.0,
    mean: "",
    ci95: None,
};

fn prepare(settings: &Settings<'_>) -> Result<Task> {
    let default = AssignSource::default();
    let most = settings.whole("max_iterations")?;
    let source = AssignSource {
        net: settings.file("net"),
        trips: settings.file("trips"),
        demand_factor: settings.number("demand_factor").unwrap_or(default.demand_factor),
        weights: settings.weights(),
        algorithm: settings.choice("algorithm")?.unwrap_or(default.algorithm),
        objective: settings.choice("objective")?.unwrap_or(default.objective),
        gap: settings.number("gap"),
        max_iterations: most.map_or(default.max_iterations, |most| most as usize),
        links: settings.file("link_table"),
        delay: settings
            .name("delay")
            .map_or(Ok(default.delay), |name| name.parse())?,
        period_hours: settings.number("delay_period"),
        unreachable: settings.choice("unreachable")?.unwrap_or(default.unreachable),
        import: ImportOptions {
            turns: settings.file("turns"),
            matrix: settings.name("matrix"),
            ..default.import
        },
        // Points run side by side.
        threads: 1,
        ..default
    };
    let assignment = source.read()?;
    Ok(Box::new(move || {
        let solution = assignment.solve(&[], &mut assignment::uninterrupted)?;
        Ok(assignment.to_json(&solution))
    }))
}
