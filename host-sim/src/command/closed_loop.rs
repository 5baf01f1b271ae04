//! `host-sim loop`: what travellers lose to coverage, detection, radio, protocol and obedience, on the same hours.

use crate::age::AgeSummary;
use crate::closed_loop::experiment::{DEFAULT_WORLDS, LoopExperiment, LoopSource, Traffic, WORLDS};
use crate::closed_loop::{CaseResult, LoopSummary, Mean, PolicyResult};
use crate::command::assign::print_warnings;
use crate::command::options::{
    ScenarioArguments, TextArguments, check_table_is_used, choice, progress_bar, typed, within,
};
use crate::journeys::town::Town;
use crate::policy::Kind;
use crate::report::chart::{Axis, Bar, BarChart, LineChart, Point, Reference, Series};
use crate::report::table::{Column, Table};
use crate::report::{answers, pages};
use crate::threads::thread_pool;
use assignment::CostWeights;
use assignment::imported_demand::Unreachable;
use kit::choice::Choice as _;
use kit::error::Result;
use kit::files::{NamedText, check_folder, write_set, written};
use kit::{remark, say};
use std::path::{Path, PathBuf};

/// Share of unfinished trips from which on times are no longer trip times (chosen).
const UNFINISHED: f64 = 0.005;

/// Decimals with which vehicles that wait, and shares of trips in trouble, are shown.
const WAITING_DECIMALS: usize = 1;
const SHARE_DECIMALS: usize = 3;

/// Options of `loop`.
#[derive(Clone, Debug, clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct LoopArguments {
    /// The scenario.
    #[command(flatten)]
    pub scenario: ScenarioArguments,
    /// Policy to run (repeatable) [default: central, actor, assigned, age-threshold]
    #[arg(long, value_parser = choice::<&'static Kind>(), value_name = "NAME")]
    pub policy: Vec<&'static Kind>,
    /// Weight table for the actor [default: the one built into the firmware]
    #[arg(long, value_name = "FILE")]
    pub table: Option<PathBuf>,
    /// Independent hours
    #[arg(long, default_value_t = DEFAULT_WORLDS, value_parser = within(WORLDS))]
    pub worlds: u32,
    /// Delay of knowledge to look at besides the policies', in seconds (repeatable) [default: 1, 10, 60, 300]
    #[arg(long, value_name = "SECONDS")]
    pub delay: Vec<f64>,
    /// Who moves the vehicles
    #[arg(long, value_parser = choice::<Traffic>(), default_value = Traffic::BuiltIn.name())]
    pub traffic: Traffic,
    /// Drive on this network instead of the grid: TNTP network file, folder with GMNS node.csv and link.csv, or SUMO net.xml
    #[arg(long, value_name = "FILE|DIR", requires = "trips")]
    pub net: Option<PathBuf>,
    /// Trips an hour in the network's format, as for `assign`
    #[arg(long, value_name = "FILE", requires = "net")]
    pub trips: Option<PathBuf>,
    /// TNTP file with the coordinates of the nodes [default: NAME_node.tntp beside NAME_net.tntp]
    #[arg(long, value_name = "FILE", requires = "net")]
    pub nodes: Option<PathBuf>,
    /// Metres for each unit of the network's coordinates [default: 1 with SUMO; otherwise so many that vehicles alone drive at
    /// 50 km/h on average]
    #[arg(long, value_name = "METRES", requires = "net")]
    pub metres_per_unit: Option<f64>,
    /// Seconds for each unit of the network's travel times [default: 1 with SUMO, otherwise 60]
    #[arg(long, value_name = "SECONDS", requires = "net")]
    pub seconds_per_unit: Option<f64>,
    /// Cost of a unit of toll, in units of free-flow time
    #[arg(long, default_value_t = 0.0, requires = "net")]
    pub toll_weight: f64,
    /// Cost of a unit of length, in units of free-flow time
    #[arg(long, default_value_t = 0.0, requires = "net")]
    pub distance_weight: f64,
    /// What happens to trips that no path serves
    #[arg(long, value_parser = choice::<Unreachable>(), default_value = "fail", requires = "net")]
    pub unreachable: Unreachable,
    /// Seed of the hours; any number is held out from training
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Worker threads; results do not depend on them [default: one a core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Folder for figures and data [default: out]
    #[arg(long, value_name = "DIR", conflicts_with = "json")]
    pub out: Option<PathBuf>,
    /// How the table is shown.
    #[command(flatten)]
    pub text: TextArguments,
    /// Print one JSON object and nothing else; write no files
    #[arg(long)]
    pub json: bool,
}

impl LoopArguments {
    /// The loop that the options describe.
    pub fn source(&self) -> LoopSource {
        LoopSource {
            scenario: self.scenario.source(),
            policies: self.policy.clone(),
            table: self.table.clone(),
            worlds: self.worlds,
            delays_s: (!self.delay.is_empty()).then(|| self.delay.clone()),
            traffic: self.traffic,
            net: self.net.clone(),
            trips: self.trips.clone(),
            nodes: self.nodes.clone(),
            metres_per_unit: self.metres_per_unit,
            seconds_per_unit: self.seconds_per_unit,
            weights: CostWeights {
                toll: self.toll_weight,
                distance: self.distance_weight,
            },
            unreachable: self.unreachable,
            seed: self.seed,
        }
    }
}

/// Runs and reports.
///
/// # Errors
/// The first input that does not fit; nothing is written then.
pub fn run(arguments: &LoopArguments) -> Result<()> {
    let out = arguments.out.as_deref().unwrap_or(Path::new("out"));
    if !arguments.json {
        check_folder(out)?;
    }
    let pool = thread_pool(arguments.threads)?;
    check_table_is_used(arguments.table.as_deref(), &arguments.policy)?;
    let experiment = arguments.source().read()?;
    if let Some(report) = experiment.report() {
        print_warnings(report);
    }
    let town = pool.install(|| experiment.town())?;
    if town.most_v_over_c() > 1.0 {
        remark!(
            "warning: trips: {:.0} an hour are {:.1} times what the fullest road carries; planning.demand_factor is a factor on them",
            town.trips_per_h(),
            town.most_v_over_c()
        );
    }
    let template = "closed loop {bar:40} {percent} %, {left} left";
    let bar = progress_bar(1, template, arguments.json);
    let summary = pool.install(|| {
        experiment.summary(&town, |progress| {
            bar.set_length(progress.total);
            bar.set_position(progress.done);
        })
    })?;
    bar.finish_and_clear();
    let object = experiment.to_json(&town, &summary);
    if arguments.json {
        say!("{object}");
        return Ok(());
    }
    let description = description(&experiment, &town, &summary);
    let cases = cases_table(&experiment, &town, &summary)?;
    // Before anything is written: the hours are lost with a full disk, their numbers are not.
    say!("{}", arguments.text.of(&cases));
    for answer in answers::of_loop(&experiment.scenario, &summary) {
        say!("{answer}\n");
    }
    let mut set = vec![("loop.csv".to_owned(), cases.to_csv())];
    set.extend(figures(&description, &summary)?);
    set.push(("loop.json".to_owned(), format!("{object:#}\n")));
    let command = typed("loop", &["--out"]);
    let page = pages::closed_loop(&experiment, &summary, &description, &cases, &set, &command)?;
    set.push(("loop.html".to_owned(), page.render()));
    write_set(out, &set)?;
    say!("{}", written(out, "loop.html", &set));
    Ok(())
}

/// A row of the table: a case, and what it costs beyond the one that it is compared with.
struct Row<'r> {
    name: String,
    ages: Option<&'r AgeSummary>,
    result: &'r CaseResult,
    /// Lost to what, and how much.
    loss: Option<(&'static str, Mean)>,
}

fn rows(summary: &LoopSummary) -> Vec<Row<'_>> {
    let row = |name: &str, result, loss| Row {
        name: name.to_owned(),
        ages: None,
        result,
        loss,
    };
    let LoopSummary {
        all_obey,
        full_knowledge,
        covered,
        detected,
        no_information,
        ..
    } = summary;
    let mut rows = vec![
        row("all known, all follow", all_obey, None),
        row(
            "all known",
            full_knowledge,
            Some(("obedience", full_knowledge.beyond(all_obey))),
        ),
        row(
            "reporters' roads known",
            covered,
            Some(("coverage", covered.beyond(full_knowledge))),
        ),
        row(
            "reports heard at once",
            detected,
            Some(("detection", detected.beyond(covered))),
        ),
    ];
    let freshest = summary.freshest().map(|freshest| freshest.policy);
    let mut policies: Vec<&PolicyResult> = summary.policies.iter().collect();
    policies.sort_by_key(|result| Some(result.policy) != freshest);
    for policy in policies {
        let loss = summary.loss(policy);
        rows.push(Row {
            name: policy.policy.name.to_owned(),
            ages: policy.ages.as_ref(),
            result: &policy.result,
            loss: Some(if Some(policy.policy) == freshest {
                ("radio", loss.radio)
            } else {
                ("protocol", loss.protocol)
            }),
        });
    }
    for (delay_s, result) in &summary.delayed {
        rows.push(row(
            &format!("reports {delay_s} s late"),
            result,
            Some(("delay", result.beyond(detected))),
        ));
    }
    rows.push(row(
        "nobody is advised",
        no_information,
        Some(("no information", no_information.beyond(detected))),
    ));
    rows
}

/// The table, also as data.
fn cases_table(experiment: &LoopExperiment, town: &Town, summary: &LoopSummary) -> Result<Table> {
    let rows = rows(summary);
    let each = || rows.iter();
    let ages = |value: fn(&AgeSummary) -> f64| each().map(move |row| row.ages.map(value));
    // Shown where there is any.
    let trouble = |shown: &str, name: &str, decimals: usize, value: fn(&CaseResult) -> f64| {
        let column = Column::number(name, each().map(|row| value(row.result)));
        match each().any(|row| is_seen(value(row.result), decimals)) {
            true => column.shown(shown, "", decimals).aside(),
            false => column.unseen(),
        }
    };
    let mut table = Table::new(vec![
        Column::text("case", each().map(|row| row.name.clone())).shown("what is known", "", 0),
        Column::number("uncapped_mean_age_ms", ages(|ages| ages.uncapped_mean_ms)).shown("mean age", "ms", 2),
        Column::number("road_age_s", each().map(|row| row.result.road_age_s))
            .shown("road age", "s", 0)
            .aside(),
        Column::number("trip_time_s", each().map(|row| row.result.trip_time_s.0)).shown("trip time", "s", 2),
        Column::number("trip_time_ci95_s", each().map(|row| row.result.trip_time_s.1))
            .shown("+-95 %", "s", 2)
            .aside(),
        Column::text(
            "lost_to",
            each().map(|row| row.loss.map(|(name, _)| name.to_owned())),
        )
        .shown("lost to", "", 0),
        Column::number("trip_loss_s", each().map(|row| row.loss.map(|(_, loss)| loss.0)))
            .shown("a trip", "s", 2),
        Column::number(
            "trip_loss_ci95_s",
            each().map(|row| row.loss.and_then(|(_, loss)| loss.1)),
        )
        .shown("+-95 %", "s", 2),
        Column::number("queued_vehicles", each().map(|row| row.result.queued.0))
            .shown("queued", "", 0)
            .aside(),
        Column::number("mean_v_over_c", each().map(|row| row.result.v_over_c))
            .shown("V/C", "", 2)
            .aside(),
        trouble("waiting", "waiting_vehicles", WAITING_DECIMALS, |result| {
            result.waiting
        }),
        trouble("unfinished", "unfinished_share", SHARE_DECIMALS, |result| {
            result.unfinished
        }),
        trouble("stuck", "let_through_per_trip", SHARE_DECIMALS, |result| {
            result.let_through
        }),
    ])?
    .titled("From slot to street");
    table.note(&format!("{}.", description(experiment, town, summary)));
    let planning = &experiment.scenario.planning;
    table.note(&format!(
        "Incidents of {} s on average, {} s apart on each block, take {:.0} % of its capacity; {:.0} % of vehicles report, {:.0} % \
         follow advice.",
        planning.incident_duration_s,
        planning.incident_interval_s,
        100.0 * planning.incident_capacity_loss,
        100.0 * planning.connected_share,
        100.0 * planning.obeying_share,
    ));
    if let Some((net, trips, seconds)) = experiment.files() {
        let trips = trips.map_or_else(String::new, |trips| format!(" with {}", trips.display()));
        table.note(&format!(
            "{}{trips}: {:.0} m for each unit of its coordinates, {seconds} s for each of its times; a base station every {} m.",
            net.display(),
            town.metres_per_coordinate(),
            planning.station_spacing_m
        ));
    }
    table.note(
        "Lost: beyond the row above that differs in this thing alone (obedience, coverage, detection, radio), beyond the \
         freshest policy (protocol), or beyond reports heard at once (delay, no information), paired by hour.",
    );
    table.note(
        "Mean age: of connected vehicles, not capped. Road age: time since a road's newest known report, mean over roads and the \
         hour; from the start where there is none. Trip time: of all, from the wish to set out to arrival. Queued: vehicles slower than \
         5 km/h. V/C: flow over capacity, mean over roads.",
    );
    let trouble = |result: &CaseResult| {
        is_seen(result.waiting, WAITING_DECIMALS)
            || is_seen(result.unfinished.max(result.let_through), SHARE_DECIMALS)
    };
    if rows.iter().any(|row| trouble(row.result)) {
        table.note(
            "Waiting: vehicles that found no room to set out. Unfinished: share of trips that did not arrive. Stuck: how often, for each \
             trip, somebody was let into a full road after 300 s.",
        );
    }
    let unfinished = rows.iter().map(|row| row.result.unfinished).fold(0.0, f64::max);
    if unfinished > UNFINISHED {
        table.note(&format!(
            "CAUTION: up to {:.0} % of trips had not arrived at twice planning.horizon_s and count as arriving then: they are longer than \
             that, the roads do not carry them (waiting), or streets are locked (stuck). Such times do not measure knowledge.",
            100.0 * unfinished
        ));
    }
    table.note(if experiment.worlds > 1 {
        "Where an interval holds zero, these hours cannot tell; more --worlds may. Cells do not disturb each other here."
    } else {
        "One world: no intervals. Cells do not disturb each other here."
    });
    Ok(table)
}

/// Whether so many decimals show more than 0.
fn is_seen(value: f64, decimals: usize) -> bool {
    value > 0.5 * libm::pow(0.1, decimals as f64)
}

fn description(experiment: &LoopExperiment, town: &Town, summary: &LoopSummary) -> String {
    let roads = town.map().roads().len();
    let stations = match town.stations_m().len() {
        1 => "one base station".to_owned(),
        count => format!("{count} base stations"),
    };
    let minutes = experiment.scenario.planning.horizon_s / 60.0;
    format!(
        "{roads} roads under {stations}, {:.0} vehicles on them where reports are heard at once, {:.0} connected in a cell (at most {}), \
         {} x {minutes} min with {:.0} trips that count, {} traffic, seed {}",
        summary.detected.vehicles,
        summary.connected_in_cell.0,
        summary.connected_in_cell.1,
        match experiment.worlds {
            1 => "1 world".to_owned(),
            worlds => format!("{worlds} worlds"),
        },
        summary.detected.trips,
        experiment.traffic.name(),
        experiment.seed
    )
}

fn figures(description: &str, summary: &LoopSummary) -> Result<Vec<NamedText>> {
    let intervals = match summary.detected.trip_time_s.1 {
        Some(_) => "; whiskers are 95 % intervals",
        None => "",
    };
    let note = format!("{description}. Differences of the same hours{intervals}.");
    let point = |x: f64, (y, half): Mean| Point {
        x,
        y,
        band: half.map(|half| (y - half, y + half)),
    };
    let mut series: Vec<Series> = Vec::new();
    let delays: Vec<Point> = summary
        .delayed
        .iter()
        .filter(|(delay_s, _)| *delay_s > 0.0)
        .map(|(delay_s, result)| point(*delay_s, result.beyond(&summary.detected)))
        .collect();
    if !delays.is_empty() {
        series.push(Series {
            name: "every report this late".to_owned(),
            points: delays,
        });
    }
    let mut labels: Vec<String> = series.iter().map(|series| series.name.clone()).collect();
    for policy in &summary.policies {
        if let Some(ages) = &policy.ages {
            let (age_ms, lost) = (ages.uncapped_mean_ms, policy.result.beyond(&summary.detected));
            // Policies that are alike lie on one another: the legend says where.
            labels.push(format!(
                "{}: {:.2} s at {age_ms:.0} ms",
                policy.policy.name, lost.0
            ));
            series.push(Series {
                name: policy.policy.name.to_owned(),
                points: vec![point(age_ms / 1000.0, lost)],
            });
        }
    }
    let mut set = Vec::new();
    if !series.is_empty() {
        let mut chart = LineChart {
            title: "What a trip loses when knowledge comes late".to_owned(),
            note: note.clone(),
            horizontal: Axis::logarithmic("delay of reports, or a policy's mean age (s)"),
            vertical: Axis::linear("trip time beyond reports at once (s)"),
            series,
            references: vec![Reference {
                name: "nobody is advised".to_owned(),
                value: summary.no_information.beyond(&summary.detected).0,
            }],
        };
        let points = chart.to_csv([
            "case",
            "delay_or_mean_age_s",
            "trip_time_beyond_reports_at_once_s",
        ])?;
        for (series, label) in chart.series.iter_mut().zip(labels) {
            series.name = label;
        }
        set.push(("loop_delay.svg".to_owned(), chart.to_svg()?));
        set.push(("loop_delay.csv".to_owned(), points));
    }
    let bars = rows(summary).into_iter().filter_map(|row| {
        let (to, (value, half)) = row.loss?;
        let name = match to {
            // The other figure has these.
            "delay" => return None,
            "protocol" | "radio" => format!("{to}: {}", row.name),
            _ => to.to_owned(),
        };
        Some(Bar {
            name,
            value,
            interval: half.map(|half| (value - half, value + half)),
            emphasised: matches!(to, "radio" | "protocol"),
        })
    });
    let chart = BarChart {
        title: "What a trip loses to what".to_owned(),
        note,
        axis: Axis::linear("trip time lost (s)"),
        decimals: 2,
        bars: bars.collect(),
        reference: None,
    };
    set.push(("loop_losses.svg".to_owned(), chart.to_svg()?));
    Ok(set)
}
