//! The HTML reports of `run` and `loop`.

use super::answers::{self, Answer};
use super::html::{Block, Page, Section};
use super::table::Table;
use crate::closed_loop::LoopSummary;
use crate::closed_loop::experiment::LoopExperiment;
use crate::experiment::{Experiment, PolicyResult};
use crate::policy::Kind;
use crate::revision::revision_text;
use crate::scenario::{Preset, Scenario};
use crate::weight_table::WeightTable;
use kit::error::Result;
use kit::files::NamedText;
use kit::keys::{listed, value};

/// What is simulated, for who reads a report before anything else.
const SCENE: &str = "Vehicles share a few radio sub-channels to one base station. In every slot of 1 ms each decides whether, where \
                     and how loudly to send, so that what the base station knows stays fresh.";

/// Relative difference of mean ages below which two policies' lines are hard to tell apart (chosen).
const ALIKE: f64 = 0.005;

/// The report of `run`, with the tables of ages and of what else is measured. `set` holds its figures by file name; `command` repeats it.
///
/// # Errors
/// As [`WeightTable::parse`](crate::weight_table::WeightTable::parse).
pub fn run(
    experiment: &Experiment,
    results: &[PolicyResult],
    [ages, measures]: [&Table; 2],
    traffic: Option<&Table>,
    set: &[NamedText],
    command: &str,
) -> Result<Page> {
    let figures = |captions: &[(&str, &str)]| figures(set, captions);
    let coincide = coincidence(results);
    let mut sections = vec![
        Section {
            heading: "Age of information",
            text: "How old the base station's latest report of a vehicle is, averaged over vehicles and slots. A policy says who \
                   sends when. None can be below the bound."
                .to_owned(),
            blocks: [meanings(&experiment.policies), Block::table(ages)].into_iter().chain(figures(&[(
                "mean_age.svg",
                "Mean age by policy on a logarithmic scale. A bar's length is the ratio to the bound; whiskers are 95 % \
                 intervals over worlds.",
            )])).chain([Block::table(measures)]).collect(),
        },
        Section {
            heading: "Over time",
            text: format!("All vehicles start unknown, at 100 ms, as after a power cut of the base station.{coincide}"),
            blocks: figures(&[(
                "cold_start.svg",
                "The mean age in every slot from the first on, warm-up included. A good policy sorts the vehicles out \
                 within some tens of slots.",
            )]),
        },
        Section {
            heading: "Distribution",
            text: format!("A mean hides rare long silences; planners feel them.{coincide}"),
            blocks: figures(&[(
                "age_distribution.svg",
                "How large a part of all vehicle-slots has an older report than the age below. Lower and further left is \
                 better; the tail comes from vehicles in deep shadow.",
            )]),
        },
        Section {
            heading: "In the cell",
            text: "What one world looks like from the base station.".to_owned(),
            blocks: figures(&[
                (
                    "occupancy.svg",
                    "Each policy's use of the sub-channels in the same slots of one world. The higher a mark, the better: full \
                     where the only sender was heard, half where several sent and nothing arrived. Nobody sent where there is \
                     none.",
                ),
                (
                    "age_map.svg",
                    "Mean age by the vehicles' place under the first policy of the table, in the same colours from 1 to 100 ms in every \
                     report and on the page. Far from the antenna and in shadow reports fail more often.",
                ),
                (
                    "decisions.svg",
                    "How often the network sends, by the gain that it would send with and its age, and what the clock does in the same \
                     place: the lighter, the more often; blank where it hardly ever came. What a table does in states that it never met in training shows \
                     where the two rows differ.",
                ),
            ]),
        },
    ];
    if let Some(table) = traffic {
        sections.push(Section {
            heading: "On the road",
            text: "The base station plans routes on road capacities that it knows as well as its reports are fresh. V/C is a \
                   road's traffic volume over its capacity; \"if informed\" is the trip time on the same roads with routes \
                   planned on the truth."
                .to_owned(),
            blocks: [Block::table(table)].into_iter().chain(figures(&[
                (
                    "volume_over_capacity.svg",
                    "The paper's figure: every road has the same age, and delta m of its capacity is lost at 100 ms. Above the \
                     dotted line roads carry more than they can.",
                ),
                (
                    "travel_time.svg",
                    "The same for travel times. The ages of this report's policies lie where the table above says.",
                ),
            ])).collect(),
        });
    }
    // A figure that this run has no data for has no section either.
    sections.retain(|section| !section.blocks.is_empty());
    let actor = results.iter().find(|result| result.name == "actor");
    let bound = experiment.simulation().bound_age_ms();
    let summary = match (actor, bound) {
        (Some(actor), Some(bound)) => format!(
            "{SCENE} The network in the vehicles, called actor, keeps a vehicle's report {:.2} ms old on average, {:.1} % above \
             what the best schedule could reach without fading.",
            actor.ages.mean_ms,
            100.0 * (actor.ages.mean_ms / bound - 1.0)
        ),
        _ => format!("{SCENE} These are the ages of the chosen policies on the same worlds."),
    };
    let facts = vec![
        ("worlds", experiment.description()),
        ("mobility", experiment.mobility_name()),
    ];
    let title = "Freshlane: ages of information";
    page(
        (title, summary),
        answers::of_run(experiment, results),
        facts,
        (&experiment.scenario, &experiment.table, command),
        sections,
    )
}

/// A sentence for figures in which the actor's and the clock's lines cover each other.
fn coincidence(results: &[PolicyResult]) -> &'static str {
    let result = |name| results.iter().find(|result| result.name == name);
    let mean_ms = |name| result(name).map(|result| result.ages.mean_ms);
    match (mean_ms("actor"), mean_ms("clock")) {
        (Some(actor), Some(clock)) if (actor / clock - 1.0).abs() < ALIKE => {
            " The lines of actor and clock coincide: their ages are all but the same."
        }
        _ => "",
    }
}

/// The report of `loop`. `set` holds its figures by file name; `command` repeats it.
///
/// # Errors
/// As [`WeightTable::parse`].
pub fn closed_loop(
    experiment: &LoopExperiment,
    summary: &LoopSummary,
    description: &str,
    table: &Table,
    set: &[NamedText],
    command: &str,
) -> Result<Page> {
    let captions = [
        (
            "loop_losses.svg",
            "What each thing costs a trip beyond the ones before it, on the same hours. Below zero a trip gains: who knows more \
             does not always share the roads better.",
        ),
        (
            "loop_delay.svg",
            "What a trip loses when every report comes so late, and where the policies lie: at their mean age, with the delays \
             that the played seconds of radio gave. The dotted line is what the same hours cost without any advice.",
        ),
    ];
    let sections = vec![Section {
        heading: "From slot to street",
        text: "Vehicles queue, incidents slow roads down, connected vehicles report their speeds by radio, and who follows \
               advice takes another way if it saves time on what the base station believes. Every row puts one thing more in \
               the way of what it knows."
            .to_owned(),
        blocks: figures(set, &captions).into_iter().chain([Block::table(table), meanings(&experiment.policies)]).collect(),
    }];
    let introduction =
        format!("{SCENE} This is what freshness is worth to a trip, on the same trips and incidents.");
    let facts = vec![("hours", description.to_owned())];
    page(
        ("Freshlane: from slot to street", introduction),
        answers::of_loop(&experiment.scenario, summary),
        facts,
        (&experiment.scenario, &experiment.table, command),
        sections,
    )
}

/// What the policies do, in the words of the command line's help.
fn meanings(policies: &[&'static Kind]) -> Block {
    let meaning = |policy: &&'static Kind| (policy.name, policy.meaning.to_owned());
    Block::terms(&policies.iter().map(meaning).collect::<Vec<_>>())
}

/// The figures that a set holds, with their captions.
fn figures(set: &[NamedText], captions: &[(&str, &str)]) -> Vec<Block> {
    let text = |name: &str| set.iter().find(|(known, _)| known == name).map(|(_, text)| text);
    let found = captions
        .iter()
        .filter_map(|(name, caption)| Some((text(name)?, caption)));
    found.map(|(svg, caption)| Block::figure(svg, caption)).collect()
}

fn page(
    (title, summary): (&str, String),
    answers: Vec<Answer>,
    mut facts: Vec<(&'static str, String)>,
    (scenario, weights, command): (&Scenario, &WeightTable, &str),
    mut sections: Vec<Section>,
) -> Result<Page> {
    let table = weights.parse()?;
    let provenance = table.provenance();
    facts.extend([
        (
            "changed keys",
            changed_keys(scenario).unwrap_or_else(|| "none: the paper's Table I".to_owned()),
        ),
        ("program", env!("CARGO_PKG_VERSION").to_owned()),
        (
            "weight table",
            format!(
                "{}: {} bytes, seed {}, from sources {}{}",
                weights.name(),
                weights.bytes().len(),
                provenance.seed,
                revision_text(&provenance.revision),
                if provenance.modified {
                    " with uncommitted changes"
                } else {
                    ""
                }
            ),
        ),
    ]);
    let scenario = toml::to_string(scenario).unwrap_or_default();
    sections.push(Section {
        heading: "How to repeat it",
        text: "The same scenario, table and seed give the same numbers on any machine with any number of threads. Training \
               never sees the worlds of an evaluation, whatever its seed."
            .to_owned(),
        blocks: vec![Block::command(command), Block::folded("The whole scenario", &scenario)],
    });
    Ok(Page {
        title: title.to_owned(),
        summary,
        answers,
        facts,
        sections,
    })
}

/// The scenario's keys that differ from the paper's, with their values.
fn changed_keys(scenario: &Scenario) -> Option<String> {
    let paper = Preset::Paper.values();
    let values = toml::Table::try_from(scenario).ok()?;
    let keys = listed(Scenario::KEYS);
    let changed = keys
        .iter()
        .filter(|(name, _)| value(&values, name) != value(&paper, name));
    let named = changed.filter_map(|(name, _)| Some(format!("{name} = {}", value(&values, name)?)));
    Some(named.collect::<Vec<_>>().join(", ")).filter(|changes| !changes.is_empty())
}
