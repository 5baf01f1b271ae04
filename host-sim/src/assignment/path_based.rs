//! Gradient projection on path flows (Jayakrishnan, Tsai, Prashker and Rajadhyaksha, "A Faster Path-Based Algorithm for
//! Traffic Assignment", Transportation Research Record 1443, 1994), with Gauss-Seidel sweeps.
//!
//! One iteration searches the cheapest path of every origin-destination pair at fixed costs, which also yields the gap,
//! and adds those that are cheaper than all known ones. Sweeps over the pairs then shift flow from dearer to the cheapest
//! path by Newton steps, costs following at once. Paths that carry nothing are dropped, and link flows are summed anew
//! from the paths, so that rounding does not pile up.

use super::all_or_nothing::unreachable_pair;
use super::demand::OriginDemand;
use super::line_search::exact_step;
use super::path_shift::{LinkState, Pair, Path, Shift, path_cost};
use super::problem::{Problem, Progress, dot, relative_gap};
use super::shortest_path::{SearchOrder, ShortestPathTree};
use crate::error::Result;

/// A new path must be cheaper than the known ones by more than this share: sums in another order differ by as much.
const PATH_COST_TOLERANCE: f64 = 1e-14;

/// Most sweeps over all pairs between two searches for new paths (chosen with the three that follow: of the settings
/// tried they take the least time to gaps from 1e-4 to 1e-12).
const SWEEPS_PER_ITERATION: usize = 20;

/// Sweeps end when the largest excess cost has fallen to this share of the first sweep's.
const SWEEP_REDUCTION: f64 = 0.01;

/// A pair whose excess cost is below this share of the largest one of the sweep before has little to gain: it rests.
const RESTING_SHARE: f64 = 0.03;

/// Sweeps that a resting pair sits out.
const RESTING_SWEEPS: u32 = 3;

/// Every so many sweeps the last one is extrapolated (chosen).
const EXTRAPOLATION_INTERVAL: usize = 5;

/// Longest extrapolation, in sweeps (chosen).
const LARGEST_EXTRAPOLATION: f64 = 1e4;

/// Where no pair changes by more than this share of its demand, long steps would magnify rounding: sweeps finish the work
/// (chosen: of 1e-8 to 1e-12 it needs the fewest iterations on random networks).
const SMALLEST_EXTRAPOLATED_CHANGE: f64 = 1e-8;

/// Double precision gives no more when neither gap nor objective have improved for this many iterations.
const STALLED_ITERATIONS: usize = 30;

/// Flows of the last record of `progress`.
pub(crate) fn solve(problem: &Problem<'_>, progress: &mut Progress<'_>) -> Result<Vec<f64>> {
    let mut state = LinkState::new(problem);
    let mut blocks = initial_loading(problem, &mut state)?;
    loop {
        state.sum_paths(blocks.iter().flat_map(|block| block.pairs.iter().flatten()));
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
    pairs: Vec<Vec<Pair>>,
    tree: ShortestPathTree,
    /// Per origin, how the last search went.
    orders: Vec<SearchOrder>,
    shortest_path_cost: f64,
}

/// Loads one origin after the other on its cheapest paths, each at the costs that the previous ones leave.
fn initial_loading<'a>(problem: &Problem<'a>, state: &mut LinkState<'_>) -> Result<Vec<Block<'a>>> {
    let mut links = Vec::new();
    let mut blocks = Vec::new();
    for origins in problem.origin_blocks() {
        let mut block = Block {
            origins,
            pairs: Vec::with_capacity(origins.len()),
            tree: ShortestPathTree::new(problem.network),
            orders: vec![SearchOrder::default(); origins.len()],
            shortest_path_cost: 0.0,
        };
        for (from, order) in origins.iter().zip(&mut block.orders) {
            block
                .tree
                .search(problem.network, &state.costs, from.origin, order);
            let mut pairs = Vec::with_capacity(from.destinations.len());
            for &(destination, volume) in &from.destinations {
                if block.tree.cost_to(destination) == f64::INFINITY {
                    return Err(unreachable_pair(from.origin, destination));
                }
                block.tree.trace(problem.network, destination, &mut links);
                for &link in &links {
                    state.flows[link as usize] += volume;
                }
                pairs.push(Pair {
                    demand: volume,
                    rest: 0,
                    paths: vec![Path {
                        links: links.as_slice().into(),
                        flow: volume,
                        flow_before: volume,
                    }],
                });
            }
            block.pairs.push(pairs);
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
        let origins = self.origins.iter().zip(&mut self.orders);
        for ((from, order), pairs) in origins.zip(&mut self.pairs) {
            self.tree.search(problem.network, link_costs, from.origin, order);
            for (&(destination, volume), pair) in from.destinations.iter().zip(pairs) {
                let cost = self.tree.cost_to(destination);
                self.shortest_path_cost += volume * cost;
                let known = pair
                    .paths
                    .iter()
                    .map(|path| path_cost(&path.links, link_costs))
                    .fold(f64::INFINITY, f64::min);
                if cost >= known * (1.0 - PATH_COST_TOLERANCE) {
                    continue;
                }
                self.tree.trace(problem.network, destination, &mut links);
                // Summed in the order of the known paths, a path that is known already is not cheaper.
                if path_cost(&links, link_costs) < known {
                    pair.paths.push(Path {
                        links: links.as_slice().into(),
                        flow: 0.0,
                        flow_before: 0.0,
                    });
                }
            }
        }
    }
}

/// Sweeps over all pairs until their excess costs have fallen well below those at the start, then drops empty paths.
fn equilibrate(blocks: &mut [Block<'_>], state: &mut LinkState<'_>) {
    let mut shift = Shift::new(state.flows.len());
    let mut first_excess = 0.0;
    let mut previous_excess = 0.0;
    for sweep in 1..=SWEEPS_PER_ITERATION {
        let extrapolated = sweep % EXTRAPOLATION_INTERVAL == 0 && sweep < SWEEPS_PER_ITERATION;
        let mut largest_excess = 0.0_f64;
        for pair in pairs_with_choice(blocks) {
            if extrapolated {
                pair.paths
                    .iter_mut()
                    .for_each(|path| path.flow_before = path.flow);
            } else if pair.rest > 0 {
                pair.rest -= 1;
                continue;
            }
            let excess = shift.towards_cheapest(pair, state);
            largest_excess = largest_excess.max(excess);
            pair.rest = if excess < RESTING_SHARE * previous_excess {
                RESTING_SWEEPS
            } else {
                0
            };
        }
        previous_excess = largest_excess;
        if sweep == 1 {
            first_excess = largest_excess;
        }
        if largest_excess <= SWEEP_REDUCTION * first_excess {
            break;
        }
        // Never at the end: the next sweep evens out what a long step magnifies.
        if extrapolated {
            extrapolate(blocks, state);
        }
    }
    for pair in pairs_with_choice(blocks) {
        pair.rest = 0;
        pair.settle();
        pair.paths.retain(|path| path.flow > 0.0);
    }
}

/// The pairs that know more than one path.
fn pairs_with_choice<'b>(blocks: &'b mut [Block<'_>]) -> impl Iterator<Item = &'b mut Pair> {
    let pairs = blocks
        .iter_mut()
        .flat_map(|block| block.pairs.iter_mut().flatten());
    pairs.filter(|pair| pair.paths.len() > 1)
}

/// Goes on in the direction of the last sweep as long as the objective falls and no path runs empty.
///
/// Sweeps creep where pairs block each other, as when one may leave a steep link only as fast as another joins it; their
/// changes then all but repeat, and many are worth one long step.
fn extrapolate(blocks: &mut [Block<'_>], state: &mut LinkState<'_>) {
    let mut direction = vec![0.0; state.flows.len()];
    let mut largest_step = LARGEST_EXTRAPOLATION;
    let mut largest_change = 0.0_f64;
    for pair in pairs_with_choice(blocks) {
        for path in &pair.paths {
            let change = path.flow - path.flow_before;
            if change == 0.0 {
                continue;
            }
            if change < 0.0 {
                largest_step = largest_step.min(path.flow / -change);
            }
            largest_change = largest_change.max(change.abs() / pair.demand);
            for &link in &path.links {
                direction[link as usize] += change;
            }
        }
    }
    if largest_change < SMALLEST_EXTRAPOLATED_CHANGE {
        return;
    }
    let step = exact_step(&state.problem.delays, &state.flows, &direction, largest_step);
    if step <= 0.0 {
        return;
    }
    for pair in pairs_with_choice(blocks) {
        for path in &mut pair.paths {
            path.flow = (path.flow + step * (path.flow - path.flow_before)).max(0.0);
        }
        pair.settle();
    }
    for (flow, change) in state.flows.iter_mut().zip(&direction) {
        *flow = (*flow + step * change).max(0.0);
    }
    state.update();
}
