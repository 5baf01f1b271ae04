//! Gradient projection on path flows (Jayakrishnan, Tsai, Prashker and Rajadhyaksha, "A Faster Path-Based Algorithm for
//! Traffic Assignment", Transportation Research Record 1443, 1994), with Gauss-Seidel sweeps.
//!
//! One iteration searches the cheapest path of every origin-destination pair at fixed costs, which also yields the gap,
//! and adds those that are cheaper than all known ones. Sweeps over the pairs then shift flow from dearer to the cheapest
//! path by Newton steps, costs following at once. Paths that carry nothing are dropped, and link flows are summed anew
//! from the paths, so that rounding does not pile up.

use crate::all_or_nothing::unreachable_pair;
use crate::demand::{Demand, OriginDemand};
use crate::line_search::exact_step;
use crate::newton;
use crate::origin_paths::{OriginPaths, Pair, Workshop};
use crate::path_flows::{FlowInTree, OriginFlows, PathFlows};
use crate::path_shift::{LinkState, Shift};
use crate::path_tree::PathTree;
use crate::problem::{OriginBlock, Problem, Progress, dot, relative_gap};
use crate::shortest_path::{SearchOrder, ShortestPathTree};
use kit::error::Result;
use std::ops::Range;

/// Most sweeps over all pairs between two searches for new paths (chosen with the three that follow: of the settings
/// tried they take the least time to gaps from 1e-4 to 1e-12).
const SWEEPS_PER_ITERATION: usize = 20;

/// Below [`SMALL_GAP`] there are so many sweeps at least: the first ones only even out what a few new paths would gain, and
/// that all others gain little then looks like an end (chosen: with 3, the gap of Winnipeg creeps from 1e-9 on).
const FEWEST_SWEEPS: usize = 5;

/// See [`FEWEST_SWEEPS`] (chosen: larger gaps are reached in the same number of iterations without).
const SMALL_GAP: f64 = 1e-6;

/// Sweeps end when the largest excess cost has fallen to this share of the first sweep's.
const SWEEP_REDUCTION: f64 = 0.01;

/// Sweeps that leave more than this share of the first one's largest excess creep: where they do so twice in a row, a step
/// on all pairs at once follows (chosen: of 0.03 to 0.5, those from 0.1 spare the large networks that do without, and all solve the random ones).
const CREEPING: f64 = 0.2;

/// Below this gap sweeps creep because costs differ by rounding alone, and a step on all pairs at once is work for nothing.
const ROUNDING_GAP: f64 = 1e-13;

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

/// Where a solve begins.
pub(crate) enum Start<'s> {
    /// At cheapest paths.
    Nothing,
    /// At known paths, of each class.
    Paths(&'s [&'s PathFlows]),
    /// Where the last solve ended, for the same demand on the same links.
    End(Vec<Block>),
}

/// Link flows by class at the last record of `progress`, and the paths that make them up.
pub(crate) fn solve(
    problem: &Problem<'_>,
    start: Start<'_>,
    progress: &mut Progress<'_>,
) -> Result<(Vec<Vec<f64>>, Vec<Block>)> {
    let mut state = LinkState::new(problem);
    let is_warm = !matches!(start, Start::Nothing);
    let mut blocks = match start {
        Start::Nothing => initial_loading(problem, &[], &mut state)?,
        Start::Paths(start) => initial_loading(problem, start, &mut state)?,
        Start::End(mut blocks) => {
            sum_paths(&mut blocks, &mut state);
            blocks
        }
    };
    if is_warm {
        // First the paths that are known find their balance: at costs without it, a search would bring many for nothing.
        state.update();
        equilibrate(&mut blocks, &mut state, 1, false);
    }
    let mut creeps = false;
    loop {
        let class_flows = sum_paths(&mut blocks, &mut state);
        let classes = 0..problem.classes.len();
        let class_costs: Vec<_> = classes
            .map(|class| problem.class_costs(class, &state.costs))
            .collect();
        problem.for_each(&mut blocks, |block| {
            block.find_cheaper_paths(problem, &class_costs[block.class]);
        });
        let shortest_path_cost = blocks.iter().map(|block| block.shortest_path_cost).sum();
        let surcharges = problem.surcharges(&class_flows);
        let times: f64 = class_flows.iter().map(|flows| dot(flows, &state.costs)).sum();
        let gap = relative_gap(times + surcharges, shortest_path_cost);
        if progress.record(gap, problem.objective(&state.flows) + surcharges) {
            return Ok((class_flows, blocks));
        }
        let fewest_sweeps = if gap < SMALL_GAP { FEWEST_SWEEPS } else { 1 };
        creeps = equilibrate(
            &mut blocks,
            &mut state,
            fewest_sweeps,
            creeps && gap > ROUNDING_GAP,
        );
    }
}

/// The paths of a class that carry anything, as a result: `blocks` are its own, and each of its vehicles counts as so many
/// passenger cars.
pub(crate) fn path_flows(
    demand: &Demand,
    blocks: impl IntoIterator<Item = Block>,
    equivalent: f64,
) -> PathFlows {
    let origins = blocks.into_iter().flat_map(|block| block.paths);
    let flows = origins.zip(demand.origins()).map(|(paths, from)| {
        let volumes = from.destinations.iter().map(|&(_, volume)| volume);
        let used = paths.used(volumes);
        let flows = used
            .map(|(pair, end, flow)| FlowInTree::new(from.destinations[pair].0 + 1, end, flow / equivalent));
        let flows = flows.collect();
        OriginFlows::new(from.origin + 1, paths.into_tree(), flows)
    });
    PathFlows::new(flows.collect())
}

/// Link flows as the sum of path flows, and their costs. Returns the flows of each class.
fn sum_paths(blocks: &mut [Block], state: &mut LinkState<'_>) -> Vec<Vec<f64>> {
    let classes = &state.problem.classes;
    let mut class_flows = vec![vec![0.0; state.flows.len()]; classes.len()];
    for block in blocks {
        let origins = &classes[block.class].demand.origins()[block.origins.clone()];
        for (paths, from) in block.paths.iter().zip(origins) {
            paths.load(
                &mut block.workshop,
                &from.destinations,
                &mut class_flows[block.class],
            );
        }
    }
    state.problem.network.fill_with_preloads(&mut state.flows);
    for flows in &class_flows {
        for (total, flow) in state.flows.iter_mut().zip(flows) {
            *total += flow;
        }
    }
    state.update();
    class_flows
}

/// Whether link flows are the sum of path flows, but for rounding.
fn add_up(blocks: &mut [Block], state: &LinkState<'_>) -> bool {
    const ROUNDING: f64 = 1e-9;
    let mut summed = LinkState::new(state.problem);
    sum_paths(blocks, &mut summed);
    let largest = summed.flows.iter().copied().fold(0.0, f64::max);
    let mut each = summed.flows.iter().zip(&state.flows);
    each.all(|(summed, flow)| (summed - flow).abs() <= ROUNDING * largest)
}

/// Some origins with the paths of all their pairs, and room to work on them.
#[derive(Clone)]
pub(crate) struct Block {
    pub(crate) class: usize,
    /// Indices into the class's origins.
    origins: Range<usize>,
    /// Per origin, its paths and how the last search went.
    paths: Vec<OriginPaths>,
    orders: Vec<SearchOrder>,
    cheapest: ShortestPathTree,
    workshop: Workshop,
    shortest_path_cost: f64,
}

/// Loads one origin after the other on its cheapest paths, each at the costs that the previous ones leave; pairs that a
/// warm start knows take its paths in its shares.
fn initial_loading(
    problem: &Problem<'_>,
    start: &[&PathFlows],
    state: &mut LinkState<'_>,
) -> Result<Vec<Block>> {
    let mut blocks = Vec::new();
    problem.network.fill_with_preloads(&mut state.flows);
    for OriginBlock {
        class,
        range,
        origins,
    } in problem.origin_blocks()
    {
        let mut block = Block {
            class,
            origins: range,
            paths: Vec::with_capacity(origins.len()),
            orders: vec![SearchOrder::default(); origins.len()],
            cheapest: ShortestPathTree::new(problem.network),
            workshop: Workshop::new(problem.network),
            shortest_path_cost: 0.0,
        };
        for (index, from) in origins.iter().enumerate() {
            block.load(problem, from, index, start.get(class).copied(), state)?;
        }
        blocks.push(block);
    }
    Ok(blocks)
}

impl Block {
    /// Loads the next origin: pairs that `start` knows on its paths, the others on their cheapest ones.
    fn load(
        &mut self,
        problem: &Problem<'_>,
        from: &OriginDemand,
        index: usize,
        start: Option<&PathFlows>,
        state: &mut LinkState<'_>,
    ) -> Result<()> {
        let known = start.and_then(|start| start.of_origin(from.origin + 1));
        let mut tree = known.map_or_else(PathTree::default, |known| known.tree().clone());
        let mut searched = false;
        self.workshop.begin(from.origin);
        for &(destination, volume) in &from.destinations {
            let known = known.map_or(&[][..], |known| known.to(destination + 1));
            let total: f64 = known.iter().map(|path| path.volume).sum();
            for path in known {
                self.workshop.push(path.end, path.volume / total * volume);
            }
            if known.is_empty() {
                if !std::mem::replace(&mut searched, true) {
                    state.update();
                    let order = &mut self.orders[index];
                    let costs = problem.class_costs(self.class, &state.costs);
                    self.cheapest.search(problem.network, &costs, from.origin, order);
                }
                if self.cheapest.cost_to(destination) == f64::INFINITY {
                    let failure = unreachable_pair(problem.network, from.origin, destination);
                    return Err(match problem.classes[self.class].name {
                        "" => failure,
                        name => failure.within(format!("class {name}")),
                    });
                }
                self.workshop
                    .push_cheapest(&mut tree, problem.network, &self.cheapest, destination, volume);
            }
            self.workshop.end_pair();
        }
        let demands = from.destinations.iter().map(|&(_, volume)| volume);
        let surcharges = &problem.classes[self.class].surcharges;
        let paths = OriginPaths::new(tree, &mut self.workshop, demands, surcharges, known.is_some());
        paths.load(&mut self.workshop, &from.destinations, &mut state.flows);
        self.paths.push(paths);
        Ok(())
    }

    /// Gives each pair its cheapest path where it is cheaper than all known ones; sums up what all trips would cost on the
    /// cheapest paths.
    fn find_cheaper_paths(&mut self, problem: &Problem<'_>, link_costs: &[f64]) {
        self.shortest_path_cost = 0.0;
        let class = &problem.classes[self.class];
        let origins = &class.demand.origins()[self.origins.clone()];
        for ((from, order), paths) in origins.iter().zip(&mut self.orders).zip(&mut self.paths) {
            self.cheapest
                .search(problem.network, link_costs, from.origin, order);
            self.shortest_path_cost += paths.improve(
                &mut self.workshop,
                problem.network,
                &self.cheapest,
                link_costs,
                &class.surcharges,
                (from.origin, &from.destinations),
            );
        }
    }
}

/// Sweeps over all pairs until their excess costs have fallen well below those at the start, and makes path flows add up.
/// Where `exact`, a step on all pairs at once helps sweeps that creep. Returns whether they do.
fn equilibrate(blocks: &mut [Block], state: &mut LinkState<'_>, fewest_sweeps: usize, exact: bool) -> bool {
    let mut shift = Shift::new(state.flows.len());
    let mut first_excess = 0.0;
    let mut previous_excess = 0.0;
    let mut creeps = false;
    for sweep in 1..=SWEEPS_PER_ITERATION {
        let extrapolated = sweep % EXTRAPOLATION_INTERVAL == 0 && sweep < SWEEPS_PER_ITERATION;
        let mut largest_excess = 0.0_f64;
        for mut pair in choices(blocks) {
            if extrapolated {
                pair.paths
                    .iter_mut()
                    .for_each(|path| path.flow_before = path.flow);
            } else if *pair.rest > 0 {
                *pair.rest -= 1;
                continue;
            }
            let excess = shift.towards_cheapest(&mut pair, state);
            largest_excess = largest_excess.max(excess);
            *pair.rest = if excess < RESTING_SHARE * previous_excess {
                RESTING_SWEEPS
            } else {
                0
            };
        }
        previous_excess = largest_excess;
        if sweep == 1 {
            first_excess = largest_excess;
        }
        if sweep >= fewest_sweeps && largest_excess <= SWEEP_REDUCTION * first_excess {
            break;
        }
        creeps = sweep == SWEEPS_PER_ITERATION && largest_excess > CREEPING * first_excess;
        if creeps && exact {
            let mut pairs: Vec<Pair<'_>> = choices(blocks).collect();
            newton::balance(&mut pairs, state);
            debug_assert!(add_up(blocks, state), "link flows are not the sum of path flows");
        }
        // Never at the end: the next sweep evens out what a long step magnifies.
        if extrapolated {
            extrapolate(blocks, state);
        }
    }
    for mut pair in choices(blocks) {
        *pair.rest = 0;
        pair.settle();
    }
    creeps
}

/// The pairs that know more than one path.
fn choices<'b>(blocks: &'b mut [Block]) -> impl Iterator<Item = Pair<'b>> {
    let origins = blocks.iter_mut().flat_map(|block| &mut block.paths);
    origins.flat_map(OriginPaths::choices)
}

/// Goes on in the direction of the last sweep as long as the objective falls and no path runs empty.
///
/// Sweeps creep where pairs block each other, as when one may leave a steep link only as fast as another joins it; their
/// changes then all but repeat, and many are worth one long step.
fn extrapolate(blocks: &mut [Block], state: &mut LinkState<'_>) {
    let mut direction = vec![0.0; state.flows.len()];
    let mut largest_step = LARGEST_EXTRAPOLATION;
    let mut largest_change = 0.0_f64;
    let mut surcharges = 0.0;
    for pair in choices(blocks) {
        for path in pair.paths.iter() {
            let change = path.flow - path.flow_before;
            if change == 0.0 {
                continue;
            }
            if change < 0.0 {
                largest_step = largest_step.min(path.flow / -change);
            }
            largest_change = largest_change.max(change.abs() / pair.demand);
            surcharges += change * path.surcharge;
            for link in pair.links.of(path) {
                direction[link as usize] += change;
            }
        }
    }
    if largest_change < SMALLEST_EXTRAPOLATED_CHANGE {
        return;
    }
    let step = exact_step(
        &state.problem.delays,
        &state.flows,
        &direction,
        (surcharges, largest_step),
    );
    if step <= 0.0 {
        return;
    }
    for mut pair in choices(blocks) {
        for path in pair.paths.iter_mut() {
            path.flow = (path.flow + step * (path.flow - path.flow_before)).max(0.0);
        }
        pair.settle();
    }
    for (flow, change) in state.flows.iter_mut().zip(&direction) {
        *flow = (*flow + step * change).max(0.0);
    }
    state.update();
}
