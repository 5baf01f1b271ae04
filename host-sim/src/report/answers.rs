//! What a report answers before anything else: what limits what is known, and what limits trips. In words, from numbers of the run
//! alone; where intervals hold zero, the answer says that nothing can be told.

mod full_roads;

pub use full_roads::of_assign;

use crate::age::ideal_age_ms;
use crate::closed_loop::{LoopSummary, Mean, PolicyResult as LoopResult};
use crate::experiment::{Experiment, PolicyResult};
use crate::policy::{actor, central};
use crate::scenario::Scenario;
use kit::text::wrapped;
use std::fmt;

const KNOWING: &str = "What limits what is known?";
const TRIPS: &str = "What limits trips?";

/// Share of a trip below which a loss is not worth a cause (chosen: half a second of a trip of 100 s).
const FELT: f64 = 0.005;

/// A question with its answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// What is asked.
    pub question: &'static str,
    /// The answer, in a few words.
    pub verdict: String,
    /// The numbers behind it.
    pub reasons: String,
}

/// For a terminal.
impl fmt::Display for Answer {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = format!("{} {} {}", self.question, self.verdict, self.reasons);
        formatter.write_str(&wrapped(&text, "  "))
    }
}

/// The answers of `run`: of the actor, or of the first policy beside central if it did not run.
pub fn of_run(experiment: &Experiment, results: &[PolicyResult]) -> Vec<Answer> {
    let named = |name: &str| results.iter().find(|result| result.name == name);
    let others = || results.iter().find(|result| result.name != central::KIND.name);
    let Some(subject) = named(actor::KIND.name).or_else(others).or(results.first()) else {
        return Vec::new();
    };
    let reference = named(central::KIND.name).filter(|central| central.name != subject.name);
    let knowing = knowing(experiment, subject, reference);
    knowing.into_iter().chain(trips(subject, reference)).collect()
}

/// A mean age is that of an ideal schedule, and what the channel and the policy add.
fn knowing(
    experiment: &Experiment,
    subject: &PolicyResult,
    reference: Option<&PolicyResult>,
) -> Option<Answer> {
    let bound_ms = experiment.simulation().bound_age_ms()?;
    let Scenario { cell, radio, .. } = &experiment.scenario;
    let (name, mean_ms) = (subject.name, subject.ages.mean_ms);
    let mut reasons = format!(
        "Under {name} the base station's last report of a vehicle is {mean_ms:.2} ms old on average. {bound_ms:.2} ms of it is waiting for a \
         turn: {} on {} cannot do better, however good the policy, and one sub-channel more would make it {:.2} ms.",
        counted(cell.vehicles as usize, "vehicle"),
        counted(radio.sub_channels as usize, "sub-channel"),
        ideal_age_ms(cell.vehicles, radio.sub_channels + 1)
    );
    let turns = (bound_ms, "How many share how few sub-channels.".to_owned());
    let policy = |added: f64| {
        (
            added,
            format!("The policy: {name} does not use what the channel carries."),
        )
    };
    let parts = match reference {
        Some(central) => {
            let channel = central.ages.mean_ms - bound_ms;
            let own = mean_ms - central.ages.mean_ms;
            reasons.push_str(&format!(
                " Fading and distance add {}, which even a scheduler that sees everything pays; {name} adds {}.",
                added(channel),
                added(own)
            ));
            vec![
                turns,
                (channel, "The channel: fading, distance and power.".to_owned()),
                policy(own),
            ]
        }
        None => {
            reasons.push_str(&format!(
                " The rest, {}, is the channel's and the policy's; --policy central beside it tells them apart.",
                added(mean_ms - bound_ms)
            ));
            vec![turns, policy(mean_ms - bound_ms)]
        }
    };
    reasons.push_str(&format!(
        " One vehicle in 20 is above {:.1} ms.",
        subject.ages.worst_vehicles_ms
    ));
    let verdict = parts.into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?.1;
    Some(Answer {
        question: KNOWING,
        verdict,
        reasons,
    })
}

/// A trip that is planned on what is believed, beside the same on what is true.
fn trips(subject: &PolicyResult, reference: Option<&PolicyResult>) -> Option<Answer> {
    let of = |result: &PolicyResult| {
        let traffic = result.traffic.as_ref()?;
        let (stale, informed) = (traffic.stale.mean_trip_time, traffic.informed.mean_trip_time);
        Some((stale, stale - informed))
    };
    let (time_s, lost_s) = of(subject)?;
    let name = subject.name;
    let mut reasons = format!(
        "Planned on what is heard under {name}, a trip takes {time_s:.2} s, {lost_s:.2} s more than planned on the truth."
    );
    let mut verdict = "Roads that are not heard of in time.".to_owned();
    if let Some((_, central_s)) = reference.and_then(of) {
        let own_s = lost_s - central_s;
        reasons.push_str(&format!(
            " Under central, which hears all that can be heard, {central_s:.2} s of it are lost all the same: roads on which nobody drives, \
             of which nothing is known. {} is what {name} loses beyond it.",
            seconds(own_s)
        ));
        verdict = if own_s > 0.5 * lost_s {
            format!("The policy: {name} lets reports come late.")
        } else {
            "Roads from which nobody reports, not the radio.".to_owned()
        };
    }
    if lost_s < FELT * time_s {
        verdict = "Nothing that the base station could know better.".to_owned();
    }
    reasons.push_str(" Every road without a vehicle counts as 100 ms old here; `host-sim loop` drives the trips and tells the causes apart.");
    Some(Answer {
        question: TRIPS,
        verdict,
        reasons,
    })
}

/// The answers of `loop`: of the actor, or of the freshest policy if it did not run.
pub fn of_loop(scenario: &Scenario, summary: &LoopSummary) -> Vec<Answer> {
    let Some(freshest) = summary.freshest() else {
        return Vec::new();
    };
    let actor = summary
        .policies
        .iter()
        .find(|result| result.policy == &actor::KIND);
    let subject = actor.unwrap_or(freshest);
    vec![
        knowing_roads(scenario, summary, subject),
        lost_trips(scenario, summary, freshest, subject),
    ]
}

/// How seldom somebody reports from a road, and how long the reports take.
fn knowing_roads(scenario: &Scenario, summary: &LoopSummary, subject: &LoopResult) -> Answer {
    let passing_s = summary.detected.road_age_s;
    let name = subject.policy.name;
    let mut reasons = format!(
        "The last word on a road is {passing_s:.1} s old on average even where reports are heard at once: so long it takes until one of the \
         {:.0} % of vehicles that report drives there again.",
        100.0 * scenario.planning.connected_share,
    );
    let mut verdict = "How seldom a connected vehicle passes, not the radio.".to_owned();
    if let Some(ages) = &subject.ages {
        let radio_ms = ages.uncapped_mean_ms;
        reasons.push_str(&format!(
            " What the base station has of a vehicle is {radio_ms:.1} ms old on average by radio under {name}."
        ));
        if radio_ms > 1000.0 * passing_s {
            verdict = format!("The radio: {name} brings reports late.");
        }
    }
    Answer {
        question: KNOWING,
        verdict,
        reasons,
    }
}

/// What a trip loses, the largest first, and what these hours cannot tell from zero.
fn lost_trips(
    scenario: &Scenario,
    summary: &LoopSummary,
    freshest: &LoopResult,
    subject: &LoopResult,
) -> Answer {
    let loss = summary.loss(subject);
    let mut parts = vec![
        (
            loss.obedience,
            format!(
                "{:.0} % of the vehicles do not follow advice",
                100.0 * (1.0 - scenario.planning.obeying_share)
            ),
        ),
        (loss.coverage, "roads have no connected vehicle".to_owned()),
        (loss.detection, "vehicles tell their own speed alone".to_owned()),
        (
            loss.radio,
            format!("the radio takes its time, even under {}", freshest.policy.name),
        ),
    ];
    if subject.policy != freshest.policy {
        parts.push((
            loss.protocol,
            format!(
                "{} is not as fresh as {}",
                subject.policy.name, freshest.policy.name
            ),
        ));
    }
    let is_told = |((value, half), _): &(Mean, String)| half.is_some_and(|half| value.abs() > half);
    parts.sort_by(|a, b| b.0.0.total_cmp(&a.0.0));
    let each = parts.iter().map(|part| {
        let ((value, half), why) = part;
        let half = half.map_or_else(String::new, |half| format!(" ± {half:.2}"));
        let doubt = if is_told(part) {
            ""
        } else {
            " (these hours cannot tell)"
        };
        format!("{value:.2}{half} s because {why}{doubt}")
    });
    let each: Vec<String> = each.collect();
    let (blind, _) = summary.no_information.beyond(&summary.detected);
    let reasons = format!(
        "A trip takes {:.1} s under {}, and {:.1} s where all is known and everybody follows advice. It loses {}. Without any advice it would \
         lose {blind:.1} s more than with reports that are heard at once.",
        subject.result.trip_time_s.0,
        subject.policy.name,
        summary.all_obey.trip_time_s.0,
        each.join("; ")
    );
    let verdict = match parts.iter().find(|part| is_told(part) && part.0.0 > 0.0) {
        Some((_, why)) => format!("That {why}."),
        None => "Nothing that these hours can tell from chance; more --worlds may.".to_owned(),
    };
    Answer {
        question: TRIPS,
        verdict,
        reasons,
    }
}

/// So many of something, in words.
pub(super) fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// Milliseconds that something adds.
fn added(ms: f64) -> String {
    if ms < 0.005 {
        "nothing that shows".to_owned()
    } else {
        format!("{ms:.2} ms")
    }
}

/// Seconds, with as many digits as there is to see.
fn seconds(value: f64) -> String {
    if value.abs() < 0.005 {
        "less than 0.01 s".to_owned()
    } else {
        format!("{value:.2} s")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::ExperimentSource;
    use crate::policy::{Kind, always};
    use crate::scenario::ScenarioSource;

    fn answers(policies: &[&'static Kind], settings: &[&str]) -> Vec<Answer> {
        let source = ExperimentSource {
            policies: policies.to_vec(),
            scenario: ScenarioSource {
                settings: settings.iter().map(|&setting| setting.to_owned()).collect(),
                ..ScenarioSource::default()
            },
            worlds: Some(4),
            slots: Some(400),
            warmup: 100,
            ..ExperimentSource::default()
        };
        let experiment = source.read().unwrap();
        let results = experiment.results(|_| ()).unwrap();
        of_run(&experiment, &results)
    }

    #[test]
    fn the_answer_follows_the_numbers() {
        let both = [&actor::KIND, &central::KIND];
        let paper = answers(&both, &[]);
        assert_eq!(paper[0].verdict, "How many share how few sub-channels.");
        assert!(
            paper[0].reasons.contains("3.85 ms of it is waiting"),
            "{}",
            paper[0].reasons
        );
        assert_eq!(
            paper[1].verdict,
            "Roads from which nobody reports, not the radio."
        );

        let weak = answers(&both, &["radio.max_power_dbm=-15"]);
        assert_eq!(weak[0].verdict, "The channel: fading, distance and power.");

        let loud = answers(&[&always::KIND, &central::KIND], &[]);
        assert!(
            loud[0].verdict.starts_with("The policy: always"),
            "{}",
            loud[0].verdict
        );
        assert!(
            loud.iter()
                .all(|answer| answer.to_string().lines().all(|line| line.chars().count() <= 80))
        );
    }
}
