//! The Frank-Wolfe family: link flows only, moving along a line towards better ones.
//!
//! Plain Frank-Wolfe (Frank and Wolfe 1956; LeBlanc, Morlok and Pierskalla 1975) moves towards the all-or-nothing flows
//! and zigzags. The conjugate and bi-conjugate variants (Mitradjieva and Lindberg, "The Stiff Is Moving - Conjugate
//! Direction Frank-Wolfe Methods with Applications to Traffic Assignment", Transportation Science 47, 2013) mix in their
//! one or two previous targets so that the new direction is conjugate to the old ones with respect to the Hessian.

use crate::Algorithm;
use crate::all_or_nothing::Loader;
use crate::line_search::exact_step;
use crate::problem::{Problem, Progress, dot, relative_gap};
use kit::error::Result;

/// Largest share of the previous target in a conjugate one, so that some new flow always enters (the paper's 1 - delta).
const LARGEST_CONJUGATE_SHARE: f64 = 0.99;

/// A step this long forgets the flows it started from, and conjugacy with them.
const FULL_STEP: f64 = 0.99999;

/// Flows of the last record of `progress`.
pub(crate) fn solve(
    problem: &Problem<'_>,
    algorithm: Algorithm,
    progress: &mut Progress<'_>,
) -> Result<Vec<f64>> {
    let links = problem.links();
    let mut loader = Loader::new(problem);
    let mut link_flows = vec![0.0; links];
    let mut link_costs = vec![0.0; links];
    let mut all_or_nothing = vec![0.0; links];
    let mut direction = vec![0.0; links];
    let mut history = History::new(algorithm);

    problem.network.fill_with_preloads(&mut link_flows);
    problem.update_costs(&link_flows, &mut link_costs);
    loader.load(problem, &link_costs, &mut link_flows)?;
    loop {
        problem.update_costs(&link_flows, &mut link_costs);
        let shortest_path_cost = loader.load(problem, &link_costs, &mut all_or_nothing)?;
        let demanded = problem.network.without_preloads(&link_flows);
        let gap = relative_gap(dot(&demanded, &link_costs), shortest_path_cost);
        if progress.record(gap, problem.objective(&link_flows)) {
            return Ok(demanded.into_owned());
        }
        let mut target = history.target(problem, &link_flows, &all_or_nothing);
        head_for(&mut direction, &link_flows, &target);
        if dot(&direction, &link_costs) >= 0.0 {
            history.forget();
            target.copy_from_slice(&all_or_nothing);
            head_for(&mut direction, &link_flows, &target);
        }
        let step = exact_step(&problem.delays, &link_flows, &direction, (0.0, 1.0));
        for (flow, change) in link_flows.iter_mut().zip(&direction) {
            *flow += step * change;
        }
        history.remember(target, step);
    }
}

/// The way from `link_flows` to `target`.
fn head_for(direction: &mut [f64], link_flows: &[f64], target: &[f64]) {
    for ((change, flow), towards) in direction.iter_mut().zip(link_flows).zip(target) {
        *change = towards - flow;
    }
}

/// The previous targets, as many as the algorithm wants to be conjugate to.
struct History {
    wanted: usize,
    /// Latest first.
    targets: Vec<Vec<f64>>,
    last_step: f64,
}

impl History {
    fn new(algorithm: Algorithm) -> Self {
        let wanted = match algorithm {
            Algorithm::BiconjugateFrankWolfe => 2,
            Algorithm::ConjugateFrankWolfe => 1,
            Algorithm::FrankWolfe | Algorithm::PathBased => 0,
        };
        Self {
            wanted,
            targets: Vec::new(),
            last_step: 0.0,
        }
    }

    fn forget(&mut self) {
        self.targets.clear();
    }

    fn remember(&mut self, target: Vec<f64>, step: f64) {
        if step > FULL_STEP {
            self.forget();
        } else {
            self.targets.insert(0, target);
            self.targets.truncate(self.wanted);
        }
        self.last_step = step;
    }

    /// Where to move: a convex combination of all-or-nothing flows and the previous targets.
    fn target(&self, problem: &Problem<'_>, link_flows: &[f64], all_or_nothing: &[f64]) -> Vec<f64> {
        match self.targets.as_slice() {
            [last, before] => self.biconjugate_target(problem, link_flows, all_or_nothing, last, before),
            [last] => conjugate_target(problem, link_flows, all_or_nothing, last),
            _ => all_or_nothing.to_vec(),
        }
    }

    /// Mitradjieva and Lindberg, section 3.2: with H the Hessian's diagonal, `y` the all-or-nothing flows, `s1`, `s2` the
    /// previous targets and `tau` the previous step, the direction is conjugate to `s1 - x` and to
    /// `tau s1 + (1 - tau) s2 - x`, the direction before.
    fn biconjugate_target(
        &self,
        problem: &Problem<'_>,
        link_flows: &[f64],
        all_or_nothing: &[f64],
        last: &[f64],
        before: &[f64],
    ) -> Vec<f64> {
        let tau = self.last_step;
        let (mut before_y, mut before_s, mut last_y, mut last_s) = (0.0, 0.0, 0.0, 0.0);
        for (link, delay) in problem.delays.iter().enumerate() {
            let flow = link_flows[link];
            let hessian = delay.derivative(flow);
            let to_y = all_or_nothing[link] - flow;
            let to_last = last[link] - flow;
            let direction_before = tau * last[link] + (1.0 - tau) * before[link] - flow;
            before_y += direction_before * hessian * to_y;
            before_s += direction_before * hessian * (before[link] - last[link]);
            last_y += to_last * hessian * to_y;
            last_s += to_last * hessian * to_last;
        }
        let mu = share(-before_y / before_s);
        let nu = share(-last_y / last_s + mu * tau / (1.0 - tau));
        let total = 1.0 + mu + nu;
        let flows = all_or_nothing.iter().zip(last).zip(before);
        flows
            .map(|((y, s1), s2)| (y + nu * s1 + mu * s2) / total)
            .collect()
    }
}

/// A usable weight: quotients of vanishing sums and negative weights count as 0.
fn share(weight: f64) -> f64 {
    if weight.is_finite() && weight > 0.0 {
        weight
    } else {
        0.0
    }
}

/// Mitradjieva and Lindberg, section 3.1.
fn conjugate_target(
    problem: &Problem<'_>,
    link_flows: &[f64],
    all_or_nothing: &[f64],
    last: &[f64],
) -> Vec<f64> {
    let (mut numerator, mut denominator) = (0.0, 0.0);
    for (link, delay) in problem.delays.iter().enumerate() {
        let flow = link_flows[link];
        let weighted = delay.derivative(flow) * (last[link] - flow);
        numerator += weighted * (all_or_nothing[link] - flow);
        denominator += weighted * (all_or_nothing[link] - last[link]);
    }
    let alpha = share(numerator / denominator).min(LARGEST_CONJUGATE_SHARE);
    let flows = all_or_nothing.iter().zip(last);
    flows.map(|(y, s)| alpha * s + (1.0 - alpha) * y).collect()
}
