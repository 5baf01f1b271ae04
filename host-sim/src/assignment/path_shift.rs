//! Newton shifts of flow between the paths of an origin-destination pair.

use super::problem::Problem;

/// A shift that turns the difference of two path costs around by more than this share of it was too long.
const OVERSHOOT: f64 = 0.5;

/// Most corrections of one shift.
const SHIFT_LIMIT: usize = 30;

/// A path with less than this share of its pair's demand is emptied: no gap in double precision sees it.
const NEGLIGIBLE_SHARE: f64 = 1e-16;

/// One way from an origin to a destination.
pub(super) struct Path {
    /// The last link first.
    pub(super) links: Box<[u32]>,
    pub(super) flow: f64,
    /// Flow before the sweep that is extrapolated.
    pub(super) flow_before: f64,
}

impl Path {
    pub(super) fn new(links: Box<[u32]>, flow: f64) -> Self {
        Self {
            links,
            flow,
            flow_before: flow,
        }
    }
}

/// An origin-destination pair with the paths that its demand takes.
pub(super) struct Pair {
    pub(super) demand: f64,
    /// Sweeps that pass it by, because its paths cost all but the same.
    pub(super) rest: u32,
    pub(super) paths: Vec<Path>,
}

impl Pair {
    pub(super) fn new(demand: f64, paths: Vec<Path>) -> Self {
        Self {
            demand,
            rest: 0,
            paths,
        }
    }

    /// Makes the path flows add up to the demand again, from which rounding takes them: the largest one gives way.
    pub(super) fn settle(&mut self) {
        let total: f64 = self.paths.iter().map(|path| path.flow).sum();
        if let Some(largest) = self.paths.iter_mut().max_by(|a, b| a.flow.total_cmp(&b.flow)) {
            largest.flow += self.demand - total;
        }
    }
}

/// Cost of a path.
pub(super) fn path_cost(links: &[u32], link_costs: &[f64]) -> f64 {
    links.iter().map(|&link| link_costs[link as usize]).sum()
}

/// Flows with the costs and derivatives that belong to them.
pub(super) struct LinkState<'a> {
    pub(super) problem: &'a Problem<'a>,
    pub(super) flows: Vec<f64>,
    pub(super) costs: Vec<f64>,
    pub(super) derivatives: Vec<f64>,
}

impl<'a> LinkState<'a> {
    pub(super) fn new(problem: &'a Problem<'a>) -> Self {
        let links = problem.links();
        let mut state = Self {
            problem,
            flows: vec![0.0; links],
            costs: vec![0.0; links],
            derivatives: vec![0.0; links],
        };
        state.update();
        state
    }

    /// Costs and derivatives of the present flows.
    pub(super) fn update(&mut self) {
        for (link, delay) in self.problem.delays.iter().enumerate() {
            (self.costs[link], self.derivatives[link]) = delay.cost_and_derivative(self.flows[link]);
        }
    }

    /// Link flows as the sum of the pairs' path flows.
    pub(super) fn sum_paths<'p>(&mut self, pairs: impl Iterator<Item = &'p Pair>) {
        self.flows.fill(0.0);
        for path in pairs.flat_map(|pair| &pair.paths) {
            for &link in &path.links {
                self.flows[link as usize] += path.flow;
            }
        }
        self.update();
    }

    /// Adds `change` to the flow of some links; returns the sum of their costs then.
    fn add(&mut self, links: &[u32], change: f64) -> f64 {
        let mut cost = 0.0;
        for &link in links {
            let link = link as usize;
            let flow = (self.flows[link] + change).max(0.0);
            self.flows[link] = flow;
            let delay = &self.problem.delays[link];
            if delay.is_congestible() {
                (self.costs[link], self.derivatives[link]) = delay.cost_and_derivative(flow);
            }
            cost += self.costs[link];
        }
        cost
    }
}

/// Moves flow between two paths of a pair, on the links that they do not share.
pub(super) struct Shift {
    /// Per link, whether the cheapest path uses it: it does where the stamp is the present one.
    stamps: Vec<u64>,
    stamp: u64,
    /// Links of the dearer path only.
    leaving: Vec<u32>,
    /// Links of the cheapest path only.
    joining: Vec<u32>,
}

impl Shift {
    pub(super) fn new(links: usize) -> Self {
        Self {
            stamps: vec![0; links],
            stamp: 0,
            leaving: Vec::new(),
            joining: Vec::new(),
        }
    }

    /// Shifts flow from every path of a pair towards the one that is cheapest at the start. Returns by how much the
    /// dearest path in use exceeded it then.
    pub(super) fn towards_cheapest(&mut self, pair: &mut Pair, state: &mut LinkState<'_>) -> f64 {
        let Pair { demand, paths, .. } = pair;
        let (mut cheapest, mut least, mut most) = (0, f64::INFINITY, 0.0);
        for (index, path) in paths.iter().enumerate() {
            let cost = path_cost(&path.links, &state.costs);
            if cost < least {
                (cheapest, least) = (index, cost);
            }
            if path.flow > 0.0 && cost > most {
                most = cost;
            }
        }
        if most <= least {
            return 0.0;
        }
        self.stamp += 2;
        for &link in &paths[cheapest].links {
            self.stamps[link as usize] = self.stamp;
        }
        for index in 0..paths.len() {
            if index == cheapest || paths[index].flow == 0.0 {
                continue;
            }
            let moved = self.between(&paths[index], &paths[cheapest], state);
            paths[index].flow -= moved;
            paths[cheapest].flow += moved;
            if paths[index].flow < NEGLIGIBLE_SHARE * *demand {
                let rest = std::mem::take(&mut paths[index].flow);
                paths[cheapest].flow += rest;
            }
        }
        most - least
    }

    /// Moves flow between two paths so that their costs come together: a Newton step, taken back towards the start where
    /// it overshoots, as it can where a volume-delay function bends sharply. Returns the flow moved from `dearer`;
    /// negative if earlier shifts of the pair made it the cheaper one.
    fn between(&mut self, dearer: &Path, cheapest: &Path, state: &mut LinkState<'_>) -> f64 {
        let (difference, slope) = self.compare(dearer, cheapest, state);
        if difference == 0.0 {
            return 0.0;
        }
        let newton = difference / slope;
        let full = if difference > 0.0 {
            dearer.flow
        } else {
            -cheapest.flow
        };
        // No congestion, or an infinite derivative at flow 0: try the whole flow.
        let usable = newton.is_finite() && newton != 0.0 && newton.abs() < full.abs();
        let mut moved = if usable { newton } else { full };
        let mut after = state.add(&self.leaving, -moved) - state.add(&self.joining, moved);
        for _ in 0..SHIFT_LIMIT {
            if -after / difference <= OVERSHOOT {
                break;
            }
            // The secant's root lies at less than two thirds of the way.
            let shorter = moved * (difference / (difference - after)).max(0.1);
            let back = moved - shorter;
            after = state.add(&self.leaving, back) - state.add(&self.joining, -back);
            moved = shorter;
        }
        moved
    }

    /// Splits off the links that the two paths do not share. Returns the difference of the path costs, and by how much
    /// each vehicle that is moved diminishes it.
    fn compare(&mut self, dearer: &Path, cheapest: &Path, state: &LinkState<'_>) -> (f64, f64) {
        let (in_cheapest, in_both) = (self.stamp, self.stamp + 1);
        let (mut difference, mut slope) = (0.0, 0.0);
        self.leaving.clear();
        self.joining.clear();
        for &link in &dearer.links {
            let index = link as usize;
            if self.stamps[index] == in_cheapest {
                self.stamps[index] = in_both;
            } else {
                self.leaving.push(link);
                difference += state.costs[index];
                slope += state.derivatives[index];
            }
        }
        for &link in &cheapest.links {
            let index = link as usize;
            if self.stamps[index] == in_both {
                self.stamps[index] = in_cheapest;
            } else {
                self.joining.push(link);
                difference -= state.costs[index];
                slope += state.derivatives[index];
            }
        }
        (difference, slope)
    }
}
