//! `trainer study`: cases and seeds of a plan, trained, evaluated and written as one table.

use crate::interquartile::Interquartile;
use crate::learning_curves::learning_curves;
use crate::study::{Plan, StudyConduct, StudyRun, in_cell};
use host_sim::Shard;
use host_sim::report::table::{Column, Table};
use kit::error::Result;
use kit::files::{check_output, write_set, write_whole};
use kit::{say, tell};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::PathBuf;

/// Options of `study`.
#[derive(Clone, Debug, clap::Args)]
pub struct StudyArguments {
    /// Plan file: preset, settings, seeds, evaluation and cases (see trainer/studies)
    #[arg(long, value_name = "FILE")]
    pub plan: PathBuf,
    /// Folder for the runs and the tables, which are named like the plan; finished runs in it are not done again
    #[arg(long, value_name = "DIR", default_value = "out/study")]
    pub out: PathBuf,
    /// Only every N-th run from the i-th on, i from 0 to N - 1, by cases, then seeds. No tables: once all shards are done and
    /// their folders are in one, study without --shard writes them
    #[arg(long, value_name = "i/N")]
    pub shard: Option<Shard>,
    /// Also write the learning curves, for host-sim figures, to this file
    #[arg(long, value_name = "FILE", conflicts_with = "shard")]
    pub curves: Option<PathBuf>,
    /// Runs at once; results do not depend on it
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub parallel: u16,
    /// Worker threads of each run; results do not depend on them
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: u16,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub json: bool,
}

/// Runs and reports.
///
/// # Errors
/// What is wrong with the plan or a run.
pub fn run(arguments: &StudyArguments) -> Result<()> {
    let plan = Plan::read(&arguments.plan)?;
    if let Some(curves) = &arguments.curves {
        check_output("--curves", curves, std::slice::from_ref(&arguments.plan))?;
    }
    // Named like the plan: two plans may share a folder, and with it the runs that both have.
    let name = arguments.plan.file_stem().unwrap_or_default().to_string_lossy();
    let conduct = StudyConduct {
        shard: arguments.shard.unwrap_or(Shard::WHOLE),
        parallel: arguments.parallel.into(),
        threads: arguments.threads,
        quiet: arguments.json,
    };
    let runs = plan.carry_out(&arguments.out, &conduct)?;
    if let Some(shard) = arguments.shard {
        return report_shard(arguments, &plan, shard, &runs);
    }
    let markdown = markdown(&plan, &runs);
    let files = [
        (format!("{name}.csv"), csv(&plan, &runs)?),
        (format!("{name}.md"), markdown.clone()),
    ];
    write_set(&arguments.out, &files)?;
    if let Some(path) = &arguments.curves {
        write_whole(path, learning_curves(&plan, &runs)?.as_bytes())?;
    }
    if arguments.json {
        let mut object = to_json(&plan, &runs);
        object["cases"] = together(&plan, &runs).into();
        say!("{object}");
    } else {
        say!(
            "{markdown}\nWritten to {}: {name}.csv, {name}.md.",
            arguments.out.display()
        );
    }
    Ok(())
}

fn to_json(plan: &Plan, runs: &[StudyRun]) -> Value {
    let run = |run: &StudyRun| {
        json!({
            "case": plan.case[run.case].name,
            "seed": run.seed,
            "folder": run.folder,
            "forms": run.forms,
        })
    };
    let runs: Vec<Value> = runs.iter().map(run).collect();
    json!({ "evaluation": plan.evaluation, "runs": runs })
}

/// Says what a shard did, what this folder still misses, and how the tables come about.
fn report_shard(arguments: &StudyArguments, plan: &Plan, shard: Shard, runs: &[StudyRun]) -> Result<()> {
    let out = arguments.out.display();
    let missing = plan.missing(&arguments.out)?;
    if arguments.json {
        let named = |&(case, seed): &(usize, u64)| json!({ "case": plan.case[case].name, "seed": seed });
        let mut object = to_json(plan, runs);
        object["shard"] = json!(shard.index);
        object["shards"] = json!(shard.count);
        object["missing"] = missing.iter().map(named).collect();
        say!("{object}");
        return Ok(());
    }
    tell!(
        "Shard {} of {}: {} runs are finished in {out}.",
        shard.index,
        shard.count,
        runs.len()
    );
    let plan_file = arguments.plan.display();
    if missing.is_empty() {
        tell!("None is missing: `trainer study --plan {plan_file} --out {out}` writes the tables.");
    } else {
        let named = missing
            .iter()
            .map(|&(case, seed)| format!("{}, seed {seed}", plan.case[case].name));
        tell!("Missing in {out}: {}.", named.collect::<Vec<_>>().join("; "));
        tell!(
            "Run the other shards, copy runs/ of their folders into {out}/runs, then `trainer study --plan {plan_file} --out {out}` \
             writes the tables."
        );
    }
    Ok(())
}

/// A row for each form of each run.
fn csv(plan: &Plan, runs: &[StudyRun]) -> Result<String> {
    let rows = || {
        runs.iter()
            .flat_map(|run| run.forms.iter().map(move |form| (run, form)))
    };
    let mut columns = vec![
        Column::text("case", rows().map(|(run, _)| plan.case[run.case].name.clone())),
        Column::unsigned("seed", rows().map(|(run, _)| run.seed)),
        Column::text("form", rows().map(|(_, form)| form.form.clone())),
        Column::number("mean_age_ms", rows().map(|(_, form)| form.mean_age_ms)),
        Column::number("mean_age_ci95_ms", rows().map(|(_, form)| form.mean_age_ci95_ms)),
        Column::number(
            "median_world_age_ms",
            rows().map(|(_, form)| form.median_world_age_ms),
        ),
    ];
    if rows().any(|(_, form)| form.cell.is_some()) {
        let cells = rows().map(|(_, form)| form.cell.clone().unwrap_or_default());
        columns.insert(2, Column::text("cell", cells));
    }
    Ok(Table::new(columns)?.to_csv())
}

/// What the seeds of each case say together, in each cell and form.
fn together(plan: &Plan, runs: &[StudyRun]) -> Vec<Value> {
    let mut all = Vec::new();
    for (index, case) in plan.case.iter().enumerate() {
        let own = || runs.iter().filter(|run| run.case == index);
        for form in own().next().map_or(&[][..], |run| &run.forms) {
            let cell = form.cell.as_deref();
            let ages: Vec<f64> = own()
                .filter_map(|run| Some(run.form(cell, &form.form)?.mean_age_ms))
                .collect();
            let Some(Interquartile { mean, low, high }) = Interquartile::of(&ages) else {
                continue;
            };
            all.push(json!({
                "case": case.name,
                "cell": cell,
                "form": form.form,
                "interquartile_mean_age_ms": mean,
                "interquartile_mean_age_interval95_ms": [low, high],
            }));
        }
    }
    all
}

/// The table for people, a row for each case.
fn markdown(plan: &Plan, runs: &[StudyRun]) -> String {
    let mut text =
        "| case | greedy: IQM of seeds, 95 % | each seed | exploring: IQM of seeds, 95 % | each seed |\n\
                    |---|---|---|---|---|\n"
            .to_owned();
    for (index, case) in plan.case.iter().enumerate() {
        let own = || runs.iter().filter(|run| run.case == index);
        for cell in own().next().map(StudyRun::cells).unwrap_or_default() {
            let ages =
                |form: &dyn Fn(&StudyRun) -> Option<f64>| -> Vec<f64> { own().filter_map(form).collect() };
            let greedy = ages(&|run| Some(run.greedy(cell)?.mean_age_ms));
            let exploring = ages(&|run| Some(run.form(cell, "exploring")?.mean_age_ms));
            let form = if own().all(|run| run.form(cell, "actor").is_some()) {
                ""
            } else {
                " (float)"
            };
            let _infallible = writeln!(
                text,
                "| {}{form} | {} | {} | {} | {} |",
                in_cell(&case.name, cell).replace('|', "\\|"),
                interquartile(&greedy),
                each(&greedy),
                interquartile(&exploring),
                each(&exploring)
            );
        }
    }
    let evaluation = plan.evaluation;
    let _infallible = writeln!(
        text,
        "\nMean age in ms on {} held-out worlds x {} slots after {}, seed {}. Greedy: int8 as deployed, or float where no \
         table holds the actor. IQM: mean over training seeds without the best and the worst quarter, and its 95 % interval by a \
         bootstrap over the seeds (Agarwal et al. 2021). Training seeds {}.",
        evaluation.worlds,
        evaluation.slots,
        evaluation.warmup,
        evaluation.seed,
        plan.seeds
            .iter()
            .map(u64::to_string)
            .collect::<Vec<_>>()
            .join(", ")
    );
    text
}

/// An interquartile mean and its interval.
fn interquartile(values: &[f64]) -> String {
    Interquartile::of(values).map_or_else(String::new, |Interquartile { mean, low, high }| {
        format!("{mean:.2} ({low:.2} to {high:.2})")
    })
}

fn each(values: &[f64]) -> String {
    let values: Vec<String> = values.iter().map(|value| format!("{value:.2}")).collect();
    values.join(", ")
}
