//! Gradient projection on path flows (Jayakrishnan, Tsai, Prashker and Rajadhyaksha, "A Faster Path-Based Algorithm for
//! Traffic Assignment", Transportation Research Record 1443, 1994), with Gauss-Seidel sweeps.
//!
//! One iteration searches the cheapest path of every origin-destination pair at fixed costs, which also yields the gap,
//! and adds those that are cheaper than all known ones. Sweeps over the pairs then shift flow from dearer to the cheapest
//! path by Newton steps, costs following at once. Paths that carry nothing are dropped, and link flows are summed anew
//! from the paths, so that rounding does not pile up.

use super::all_or_nothing::unreachable_pair;
use super::demand::OriginDemand;
use super::problem::{Problem, Progress, dot, relative_gap};
use super::shortest_path::ShortestPathTree;
use crate::error::Result;

/// A new path must be cheaper than the known ones by more than this share: sums in another order differ by as much.
const PATH_COST_TOLERANCE: f64 = 1e-14;

/// Most sweeps over all pairs between two searches for new paths (chosen: a sweep costs about a third of a search).
const SWEEPS_PER_ITERATION: usize = 12;

/// Sweeps end when the largest excess cost has fallen to this share of the first sweep's (chosen).
const SWEEP_REDUCTION: f64 = 0.005;

/// A shift that turns the difference of two path costs around by more than this share of it was too long.
const OVERSHOOT: f64 = 0.5;

/// Most corrections of one shift.
const SHIFT_LIMIT: usize = 30;

/// A path with less than this share of its pair's demand is emptied: no gap in double precision sees it.
const NEGLIGIBLE_SHARE: f64 = 1e-16;

/// The gap is at the limit of double precision when it has not improved for this many iterations.
const STALLED_ITERATIONS: usize = 30;

/// One way from an origin to a destination.
struct Path {
    /// The last link first.
    links: Box<[u32]>,
    flow: f64,
}

/// The paths of one origin-destination pair that carry flow.
type PairPaths = Vec<Path>;

/// Flows of the last record of `progress`.
pub(crate) fn solve(problem: &Problem<'_>, progress: &mut Progress<'_>) -> Result<Vec<f64>> {
    let mut state = LinkState::new(problem);
    let mut blocks = initial_loading(problem, &mut state)?;
    loop {
        state.sum_paths(&blocks);
        problem.for_each(&mut blocks, |block| {
            block.add_cheaper_paths(problem, &state.costs)
        });
        let shortest_path_cost = blocks.iter().map(|block| block.shortest_path_cost).sum();
        let gap = relative_gap(dot(&state.flows, &state.costs), shortest_path_cost);
        let finished = progress.record(gap, problem.objective(&state.flows));
        if finished || progress.stalls_for(STALLED_ITERATIONS) {
            return Ok(state.flows);
        }
        equilibrate(&mut blocks, &mut state);
    }
}

/// Some origins with the paths of all their pairs.
struct Block<'a> {
    origins: &'a [OriginDemand],
    /// Per origin, per destination.
    paths: Vec<Vec<PairPaths>>,
    tree: ShortestPathTree,
    shortest_path_cost: f64,
}

/// Loads one origin after the other on its cheapest paths, each at the costs that the previous ones leave.
fn initial_loading<'a>(problem: &Problem<'a>, state: &mut LinkState<'_>) -> Result<Vec<Block<'a>>> {
    let mut links = Vec::new();
    let mut blocks = Vec::new();
    for origins in problem.origin_blocks() {
        let mut block = Block {
            origins,
            paths: Vec::with_capacity(origins.len()),
            tree: ShortestPathTree::new(problem.network),
            shortest_path_cost: 0.0,
        };
        for from in origins {
            block.tree.search(problem.network, &state.costs, from.origin);
            let mut pairs = Vec::with_capacity(from.destinations.len());
            for &(destination, volume) in &from.destinations {
                if block.tree.cost_to(destination) == f64::INFINITY {
                    return Err(unreachable_pair(from.origin, destination));
                }
                block.tree.trace(problem.network, destination, &mut links);
                for &link in &links {
                    state.flows[link as usize] += volume;
                }
                pairs.push(vec![Path {
                    links: links.as_slice().into(),
                    flow: volume,
                }]);
            }
            block.paths.push(pairs);
            state.update();
        }
        blocks.push(block);
    }
    Ok(blocks)
}

impl Block<'_> {
    /// Adds the cheapest path of each pair, empty, where it is cheaper than all known ones; sums up what all trips would
    /// cost on the cheapest paths.
    fn add_cheaper_paths(&mut self, problem: &Problem<'_>, link_costs: &[f64]) {
        let mut links = Vec::new();
        self.shortest_path_cost = 0.0;
        for (from, pairs) in self.origins.iter().zip(&mut self.paths) {
            self.tree.search(problem.network, link_costs, from.origin);
            for (&(destination, volume), paths) in from.destinations.iter().zip(pairs) {
                let cost = self.tree.cost_to(destination);
                self.shortest_path_cost += volume * cost;
                let known = paths
                    .iter()
                    .map(|path| path_cost(&path.links, link_costs))
                    .fold(f64::INFINITY, f64::min);
                if cost >= known * (1.0 - PATH_COST_TOLERANCE) {
                    continue;
                }
                self.tree.trace(problem.network, destination, &mut links);
                // Summed in the order of the known paths, a path that is known already is not cheaper.
                if path_cost(&links, link_costs) < known {
                    paths.push(Path {
                        links: links.as_slice().into(),
                        flow: 0.0,
                    });
                }
            }
        }
    }
}

/// Cost of a path.
fn path_cost(links: &[u32], link_costs: &[f64]) -> f64 {
    links.iter().map(|&link| link_costs[link as usize]).sum()
}

/// Sweeps over all pairs until their excess costs have fallen well below those at the start, then drops empty paths.
fn equilibrate(blocks: &mut [Block<'_>], state: &mut LinkState<'_>) {
    let mut shift = Shift::new(state.flows.len());
    let mut first_excess = 0.0;
    for sweep in 0..SWEEPS_PER_ITERATION {
        let mut largest_excess = 0.0_f64;
        for paths in blocks
            .iter_mut()
            .flat_map(|block| block.paths.iter_mut().flatten())
        {
            if paths.len() > 1 {
                largest_excess = largest_excess.max(shift.towards_cheapest(paths, state));
            }
        }
        if sweep == 0 {
            first_excess = largest_excess;
        }
        if largest_excess <= SWEEP_REDUCTION * first_excess {
            break;
        }
    }
    for paths in blocks
        .iter_mut()
        .flat_map(|block| block.paths.iter_mut().flatten())
    {
        if paths.len() > 1 {
            paths.retain(|path| path.flow > 0.0);
        }
    }
}

/// Flows with the costs and derivatives that belong to them.
struct LinkState<'a> {
    problem: &'a Problem<'a>,
    flows: Vec<f64>,
    costs: Vec<f64>,
    derivatives: Vec<f64>,
}

impl<'a> LinkState<'a> {
    fn new(problem: &'a Problem<'a>) -> Self {
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
    fn update(&mut self) {
        for (link, delay) in self.problem.delays.iter().enumerate() {
            (self.costs[link], self.derivatives[link]) = delay.cost_and_derivative(self.flows[link]);
        }
    }

    /// Link flows as the sum of all path flows.
    fn sum_paths(&mut self, blocks: &[Block<'_>]) {
        self.flows.fill(0.0);
        for path in blocks
            .iter()
            .flat_map(|block| block.paths.iter().flatten().flatten())
        {
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
struct Shift {
    /// Per link, whether the cheapest path uses it: it does where the stamp is the present one.
    stamps: Vec<u64>,
    stamp: u64,
    costs: Vec<f64>,
    /// Links of the dearer path only.
    leaving: Vec<u32>,
    /// Links of the cheapest path only.
    joining: Vec<u32>,
}

impl Shift {
    fn new(links: usize) -> Self {
        Self {
            stamps: vec![0; links],
            stamp: 0,
            costs: Vec::new(),
            leaving: Vec::new(),
            joining: Vec::new(),
        }
    }

    /// Shifts flow from every path of a pair towards the one that is cheapest at the start. Returns by how much the
    /// dearest path in use exceeded it then.
    fn towards_cheapest(&mut self, paths: &mut [Path], state: &mut LinkState<'_>) -> f64 {
        let (mut cheapest, mut least, mut most) = (0, f64::INFINITY, 0.0);
        self.costs.clear();
        for (index, path) in paths.iter().enumerate() {
            let cost = path_cost(&path.links, &state.costs);
            self.costs.push(cost);
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
        let demand: f64 = paths.iter().map(|path| path.flow).sum();
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
            if paths[index].flow < NEGLIGIBLE_SHARE * demand {
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
