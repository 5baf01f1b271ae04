//! What limits trips on a network where all is known: how long the ways are, and who else is on them.

use super::{Answer, FELT, TRIPS, counted};
use crate::assign::Assignment;
use assignment::Solution;
use assignment::report::short;

/// The answer of `assign`; none where nobody drives, or driving takes no time.
pub fn of_assign(assignment: &Assignment, solution: &Solution) -> Option<Answer> {
    let Assignment { network, demand, .. } = assignment;
    let flows = &solution.link_flows;
    let time = assignment.total_time(solution);
    let links = network.links().iter().zip(flows);
    let times = links.zip(assignment.link_times(solution));
    // By link, what its vehicles lose to others there, with its index.
    let mut losses: Vec<(f64, usize)> = times
        .enumerate()
        .map(|(index, ((link, flow), time))| (flow * (time - link.free_flow_time).max(0.0), index))
        .collect();
    let lost: f64 = losses.iter().map(|(loss, _)| loss).sum();
    let empty = time - lost;
    if !(empty > 0.0 && demand.total() > 0.0) {
        return None;
    }
    losses.sort_by(|a, b| b.0.total_cmp(&a.0));
    let ratios = network.volume_over_capacity(flows);
    let full = ratios.iter().filter(|ratio| **ratio > 1.0).count();
    let roads = ratios.len();
    let mut reasons = format!(
        "A trip takes {} units of the network's time on average, {:.1} % more than on the same ways without traffic. Of {}, {full} {} above \
         capacity.",
        short(time / demand.total()),
        100.0 * lost / empty,
        counted(roads, "road"),
        if full == 1 { "is" } else { "are" }
    );
    let mut verdict = "The ways themselves; traffic adds next to nothing.".to_owned();
    if lost >= FELT * time {
        let half = holders_of_half(&losses, lost);
        let (worst_loss, worst) = losses[0];
        let link = &network.links()[worst];
        reasons.push_str(&format!(
            " The one from {} to {} alone makes {:.1} % of what traffic costs",
            network.node_name(link.init_node),
            network.node_name(link.term_node),
            100.0 * worst_loss / lost,
        ));
        reasons.push_str(&match ratios.get(worst) {
            Some(ratio) if *ratio > 0.0 => format!(", at {ratio:.2} times its capacity."),
            _ => ".".to_owned(),
        });
        verdict = if lost > empty {
            format!(
                "Traffic; half of what it costs is lost on {half} of {}.",
                counted(roads, "road")
            )
        } else {
            "The ways themselves, more than the traffic on them.".to_owned()
        };
    }
    if !solution.converged {
        reasons.push_str(" The flows had not settled when the solve ended; all of this may move.");
    }
    Some(Answer {
        question: TRIPS,
        verdict,
        reasons,
    })
}

/// How many of the largest losses hold half of all together.
fn holders_of_half(losses: &[(f64, usize)], lost: f64) -> usize {
    let mut held = 0.0;
    let before = losses.iter().take_while(|(loss, _)| {
        held += loss;
        held < 0.5 * lost
    });
    before.count() + 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assign::AssignSource;
    use assignment::uninterrupted;
    use std::path::Path;

    /// Sioux Falls, or two nodes of which 100 trips go from the first to the second on a road for 1,000, in a time of 1 (1 + 0.15 x^4).
    fn answer(name: &str, demand_factor: f64, max_iterations: usize) -> Answer {
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assignment/tests/fixtures");
        let source = AssignSource {
            net: Some(fixtures.join(format!("{name}_net.tntp"))),
            trips: Some(fixtures.join(format!("{name}_trips.tntp"))),
            demand_factor,
            max_iterations,
            gap: Some(1e-6),
            ..AssignSource::default()
        };
        let assignment = source.read().unwrap();
        let solved = assignment.solve(&[], &mut uninterrupted).unwrap();
        of_assign(&assignment, &solved.total).unwrap()
    }

    #[test]
    fn the_answer_is_that_of_a_road_by_hand() {
        let full = answer("two", 20.0, 9);
        assert_eq!(
            full.verdict,
            "Traffic; half of what it costs is lost on 1 of 2 roads."
        );
        assert_eq!(
            full.reasons,
            "A trip takes 3.40 units of the network's time on average, 240.0 % more than on the same ways without traffic. Of 2 roads, 1 is above \
             capacity. The one from 1 to 2 alone makes 100.0 % of what traffic costs, at 2.00 times its capacity."
        );
        let busy = answer("two", 10.0, 9);
        assert_eq!(
            busy.verdict,
            "The ways themselves, more than the traffic on them."
        );
        assert!(busy.reasons.contains("15.0 % more"), "{}", busy.reasons);
        let quiet = answer("two", 1.0, 9);
        assert_eq!(
            quiet.verdict,
            "The ways themselves; traffic adds next to nothing."
        );
    }

    #[test]
    fn flows_that_have_not_settled_say_so() {
        let unsettled = "The flows had not settled";
        assert!(answer("SiouxFalls", 1.0, 1).reasons.contains(unsettled));
        assert!(!answer("SiouxFalls", 1.0, 999).reasons.contains(unsettled));
    }
}
