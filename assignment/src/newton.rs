//! A Newton step on all path flows at once, for where sweeps creep.
//!
//! Sweeps look at one pair after the other. Where pairs block each other across steep links, as two that may exchange
//! flow on a crowded road only in tiny portions, thousands of sweeps get nowhere. The step here solves the second-order
//! model of all pairs together, by conjugate gradients on the flows of all paths in use but the largest of each pair,
//! which takes the rest (Bertsekas, Gafni and Gallager, "Second Derivative Algorithms for Minimum Delay Distributed
//! Routing in Networks", IEEE Transactions on Communications 32, 1984).

use crate::line_search::exact_step;
use crate::origin_paths::Pair;
use crate::path_shift::LinkState;
use crate::problem::dot;

/// Most steps in a row: each but the last empties a path (chosen with the next: of 1 to 8 steps and 20 to 100 iterations, a
/// third of the work to 1e-6 on a regional network of power 1.5 whose sweeps always creep, and the same gaps on the others).
const STEP_LIMIT: usize = 2;

/// Most iterations of the conjugate gradients: as much work as a few sweeps.
const CONJUGATE_LIMIT: usize = 50;

/// The linear system is solved when its residual, in the preconditioner's norm, has fallen to this share, squared.
const RESIDUAL_REDUCTION: f64 = 1e-16;

/// Longest step, where 1 is what the second-order model wants.
const LARGEST_STEP: f64 = 2.0;

/// Marks a link that only the pair's largest path uses.
const LEAVING: u32 = 1 << 31;

/// The flow of a path that is not its pair's largest.
struct Variable {
    pair: u32,
    path: u32,
    /// By how much it costs more than its pair's largest path, beside the links.
    surcharge: f64,
    /// Where its links end in the list of all.
    end: u32,
}

/// The variables of all pairs, with the links on which each differs from its pair's largest path.
struct System {
    variables: Vec<Variable>,
    links: Vec<u32>,
    largest: Vec<u32>,
}

/// Takes steps until none is blocked by a path that runs empty.
pub(crate) fn balance(pairs: &mut [Pair<'_>], state: &mut LinkState<'_>) {
    for _ in 0..STEP_LIMIT {
        let system = System::new(pairs, state);
        if !system.step(pairs, state) {
            break;
        }
    }
}

impl System {
    fn new(pairs: &[Pair<'_>], state: &LinkState<'_>) -> Self {
        let mut system = Self {
            variables: Vec::new(),
            links: Vec::new(),
            largest: Vec::with_capacity(pairs.len()),
        };
        // Stamps tell which links the largest path has, and which of these the other one has too.
        let mut stamps = vec![0_u32; state.flows.len()];
        let mut stamp = 0;
        for (pair_index, pair) in pairs.iter().enumerate() {
            let by_flow =
                (0..pair.paths.len()).max_by(|&a, &b| pair.paths[a].flow.total_cmp(&pair.paths[b].flow));
            let largest = by_flow.unwrap_or(0);
            system.largest.push(largest as u32);
            for (path_index, path) in pair.paths.iter().enumerate() {
                if path_index == largest || path.flow <= 0.0 {
                    continue;
                }
                stamp += 2;
                for link in pair.links.of(&pair.paths[largest]) {
                    stamps[link as usize] = stamp;
                }
                let begin = system.links.len();
                let mut curvature = 0.0;
                for link in pair.links.of(path) {
                    let known = &mut stamps[link as usize];
                    if *known == stamp {
                        *known = stamp + 1;
                    } else {
                        system.links.push(link);
                        curvature += state.derivatives[link as usize];
                    }
                }
                for link in pair.links.of(&pair.paths[largest]) {
                    if stamps[link as usize] == stamp {
                        system.links.push(link | LEAVING);
                        curvature += state.derivatives[link as usize];
                    }
                }
                // Without curvature, a sweep moves all or nothing.
                if curvature > 0.0 && curvature.is_finite() {
                    system.variables.push(Variable {
                        pair: pair_index as u32,
                        path: path_index as u32,
                        surcharge: path.surcharge - pair.paths[largest].surcharge,
                        end: system.links.len() as u32,
                    });
                } else {
                    system.links.truncate(begin);
                }
            }
        }
        system
    }

    /// Every variable's links.
    fn rows(&self) -> impl Iterator<Item = &[u32]> {
        let ends = self.variables.iter().map(|variable| variable.end as usize);
        ends.scan(0, |begin, end| {
            let row = &self.links[*begin..end];
            *begin = end;
            Some(row)
        })
    }

    /// What a unit of each variable gains of a value per link.
    fn gather(&self, per_link: &[f64], into: &mut [f64]) {
        for (value, row) in into.iter_mut().zip(self.rows()) {
            *value = row.iter().map(|&link| signed(per_link, link)).sum();
        }
    }

    /// What the variables' values come to on each link.
    fn scatter(&self, values: &[f64], per_link: &mut [f64]) {
        per_link.fill(0.0);
        for (value, row) in values.iter().zip(self.rows()) {
            for &link in row {
                per_link[(link & !LEAVING) as usize] += if link & LEAVING == 0 { *value } else { -value };
            }
        }
    }

    /// The flow changes that balance all costs in the second-order model.
    fn solve(&self, state: &LinkState<'_>) -> Vec<f64> {
        let size = self.variables.len();
        let mut residual = vec![0.0; size];
        self.gather(&state.costs, &mut residual);
        for (value, variable) in residual.iter_mut().zip(&self.variables) {
            *value = -(*value + variable.surcharge);
        }
        let scale: Vec<f64> = self
            .rows()
            .map(|row| {
                let derivatives = row
                    .iter()
                    .map(|&link| state.derivatives[(link & !LEAVING) as usize]);
                1.0 / derivatives.sum::<f64>()
            })
            .collect();
        let precondition = |residual: &[f64]| -> Vec<f64> {
            residual
                .iter()
                .zip(&scale)
                .map(|(value, scale)| value * scale)
                .collect()
        };
        let mut changes = vec![0.0; size];
        let mut direction = precondition(&residual);
        let mut product = dot(&residual, &direction);
        let target = RESIDUAL_REDUCTION * product;
        let mut per_link = vec![0.0; state.flows.len()];
        let mut image = vec![0.0; size];
        for _ in 0..CONJUGATE_LIMIT {
            self.scatter(&direction, &mut per_link);
            for (value, derivative) in per_link.iter_mut().zip(&state.derivatives) {
                *value = if *value == 0.0 { 0.0 } else { *value * derivative };
            }
            self.gather(&per_link, &mut image);
            let length = product / dot(&direction, &image);
            if !(length.is_finite() && length > 0.0) {
                break;
            }
            for index in 0..size {
                changes[index] += length * direction[index];
                residual[index] -= length * image[index];
            }
            let scaled = precondition(&residual);
            let next = dot(&residual, &scaled);
            if next <= target {
                break;
            }
            let share = next / product;
            product = next;
            for (value, scaled) in direction.iter_mut().zip(&scaled) {
                *value = scaled + share * *value;
            }
        }
        changes
    }

    /// One step. True if a path ran empty before the end, so that another step, without it, is worth while.
    fn step(&self, pairs: &mut [Pair<'_>], state: &mut LinkState<'_>) -> bool {
        let changes = self.solve(state);
        let mut rest = vec![0.0; pairs.len()];
        let mut longest = LARGEST_STEP;
        for (variable, &change) in self.variables.iter().zip(&changes) {
            rest[variable.pair as usize] -= change;
            longest = longest.min(time_to_empty(
                pairs[variable.pair as usize].paths[variable.path as usize].flow,
                change,
            ));
        }
        for ((pair, &largest), &change) in pairs.iter().zip(&self.largest).zip(&rest) {
            longest = longest.min(time_to_empty(pair.paths[largest as usize].flow, change));
        }
        let mut direction = vec![0.0; state.flows.len()];
        self.scatter(&changes, &mut direction);
        let surcharges = self.variables.iter().zip(&changes);
        let linear = surcharges
            .map(|(variable, change)| variable.surcharge * change)
            .sum();
        let step = exact_step(&state.problem.delays, &state.flows, &direction, (linear, longest));
        if step.is_nan() || step <= 0.0 {
            return false;
        }
        for (variable, &change) in self.variables.iter().zip(&changes) {
            let path = &mut pairs[variable.pair as usize].paths[variable.path as usize];
            path.flow = emptied(path.flow, step * change);
        }
        for ((pair, &largest), &change) in pairs.iter_mut().zip(&self.largest).zip(&rest) {
            let path = &mut pair.paths[largest as usize];
            path.flow = emptied(path.flow, step * change);
            pair.settle();
        }
        for (flow, change) in state.flows.iter_mut().zip(&direction) {
            *flow = (*flow + step * change).max(0.0);
        }
        state.update();
        step >= longest && longest < LARGEST_STEP
    }
}

/// The link's value, negative where it is left.
#[inline]
fn signed(per_link: &[f64], link: u32) -> f64 {
    let value = per_link[(link & !LEAVING) as usize];
    if link & LEAVING == 0 { value } else { -value }
}

/// Step at which a flow runs empty; infinite if it does not fall.
fn time_to_empty(flow: f64, change: f64) -> f64 {
    if change < 0.0 {
        flow / -change
    } else {
        f64::INFINITY
    }
}

/// A flow after a change; what is left of it by rounding alone counts as nothing.
fn emptied(flow: f64, change: f64) -> f64 {
    const ROUNDING: f64 = 1e-14;
    let after = flow + change;
    if after <= ROUNDING * flow { 0.0 } else { after }
}
