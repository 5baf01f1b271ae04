//! Newton shifts of flow between the paths of an origin-destination pair.

use crate::origin_paths::{NEGLIGIBLE_SHARE, Pair};
use crate::path_tree::Way;
use crate::problem::Problem;

/// A shift that turns the difference of two path costs around by more than this share of it was too long.
const OVERSHOOT: f64 = 0.5;

/// Most corrections of one shift.
const SHIFT_LIMIT: usize = 30;

/// Flows with the costs and derivatives that belong to them.
pub(crate) struct LinkState<'a> {
    pub(crate) problem: &'a Problem<'a>,
    /// Of everybody, in passenger cars.
    pub(crate) flows: Vec<f64>,
    pub(crate) costs: Vec<f64>,
    pub(crate) derivatives: Vec<f64>,
}

impl<'a> LinkState<'a> {
    pub(crate) fn new(problem: &'a Problem<'a>) -> Self {
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
    pub(crate) fn update(&mut self) {
        for (link, delay) in self.problem.delays.iter().enumerate() {
            (self.costs[link], self.derivatives[link]) = delay.cost_and_derivative(self.flows[link]);
        }
    }

    /// Cost of some links.
    #[inline]
    fn cost(&self, links: Way<'_>) -> f64 {
        links.map(|link| self.costs[link as usize]).sum()
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
pub(crate) struct Shift {
    /// Per link, whether the cheapest path uses it: it does where the stamp is the present one.
    stamps: Vec<u64>,
    stamp: u64,
    /// Links of the dearer path only.
    leaving: Vec<u32>,
    /// Links of the cheapest path only.
    joining: Vec<u32>,
}

impl Shift {
    pub(crate) fn new(links: usize) -> Self {
        Self {
            stamps: vec![0; links],
            stamp: 0,
            leaving: Vec::new(),
            joining: Vec::new(),
        }
    }

    /// Shifts flow from every path of a pair towards the one that is cheapest at the start. Returns by how much the
    /// dearest path in use exceeded it then.
    pub(crate) fn towards_cheapest(&mut self, pair: &mut Pair<'_>, state: &mut LinkState<'_>) -> f64 {
        let Pair {
            demand, paths, links, ..
        } = pair;
        let (mut cheapest, mut least, mut most) = (0, f64::INFINITY, 0.0);
        for (index, path) in paths.iter().enumerate() {
            let cost = path.surcharge + state.cost(links.of(path));
            if cost < least {
                (cheapest, least) = (index, cost);
            }
            if path.flow > 0.0 {
                most = cost.max(most);
            }
        }
        if most <= least {
            return 0.0;
        }
        self.stamp += 2;
        let cheapest_links = links.of(&paths[cheapest]);
        for link in cheapest_links.clone() {
            self.stamps[link as usize] = self.stamp;
        }
        for index in 0..paths.len() {
            if index == cheapest || paths[index].flow == 0.0 {
                continue;
            }
            let dearer = (links.of(&paths[index]), paths[index].flow);
            let surcharge = paths[index].surcharge - paths[cheapest].surcharge;
            let moved = self.between(
                dearer,
                (cheapest_links.clone(), paths[cheapest].flow),
                surcharge,
                state,
            );
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
    /// it overshoots, as it can where a volume-delay function bends sharply. The dearer one costs `surcharge` more beside its
    /// links. Returns the flow moved from the dearer path;
    /// negative if earlier shifts of the pair made it the cheaper one.
    fn between(
        &mut self,
        (dearer, dearer_flow): (Way<'_>, f64),
        (cheapest, cheapest_flow): (Way<'_>, f64),
        surcharge: f64,
        state: &mut LinkState<'_>,
    ) -> f64 {
        let (difference, slope) = self.compare(dearer, cheapest, state);
        let difference = difference + surcharge;
        if difference == 0.0 {
            return 0.0;
        }
        let newton = difference / slope;
        let full = if difference > 0.0 {
            dearer_flow
        } else {
            -cheapest_flow
        };
        // No congestion, or an infinite derivative at flow 0: try the whole flow.
        let usable = newton.is_finite() && newton != 0.0 && newton.abs() < full.abs();
        let mut moved = if usable { newton } else { full };
        let mut after = surcharge + state.add(&self.leaving, -moved) - state.add(&self.joining, moved);
        for _ in 0..SHIFT_LIMIT {
            if -after / difference <= OVERSHOOT {
                break;
            }
            // The secant's root lies at less than two thirds of the way.
            let shorter = moved * (difference / (difference - after)).max(0.1);
            let back = moved - shorter;
            after = surcharge + state.add(&self.leaving, back) - state.add(&self.joining, -back);
            moved = shorter;
        }
        moved
    }

    /// Splits off the links that the two paths do not share. Returns the difference of the path costs, and by how much
    /// each vehicle that is moved diminishes it.
    fn compare(&mut self, dearer: Way<'_>, cheapest: Way<'_>, state: &LinkState<'_>) -> (f64, f64) {
        let (in_cheapest, in_both) = (self.stamp, self.stamp + 1);
        let (mut difference, mut slope) = (0.0, 0.0);
        self.leaving.clear();
        self.joining.clear();
        for link in dearer {
            let index = link as usize;
            if self.stamps[index] == in_cheapest {
                self.stamps[index] = in_both;
            } else {
                self.leaving.push(link);
                difference += state.costs[index];
                slope += state.derivatives[index];
            }
        }
        for link in cheapest {
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
