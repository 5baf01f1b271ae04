//! An independent judge of link flows: gap, objective and conservation from the flows alone.
//!
//! It gets there by other means than the solvers. Costs come from the printed formulas of the delay functions, cheapest paths
//! from a label-correcting search (Pape 1974 with a plain queue), sums run in link order.

use crate::csv_rows::csv_rows;
use crate::demand::Demand;
use crate::link::{DelayFunction, Link};
use crate::network::Network;
use crate::{Objective, problem};
use kit::error::{Error, Result};
use kit::files::Text;
use std::collections::VecDeque;
use std::fmt::Write as _;

/// First line of a flow file.
pub const HEADER: &str = "init_node,term_node,volume,cost";

/// A node may lose or gain this share of the total demand before the flows count as not conserved (chosen: files from
/// other tools print few digits).
const CONSERVATION_TOLERANCE: f64 = 1e-6;

/// Whatever carries the demand costs as much as its cheapest paths; flows may fall short of that by this share (chosen: likewise).
const SHORT_OF_CHEAPEST: f64 = 1e-3;

/// What link flows are worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// (TSTT - SPTT) / TSTT, clamped at 0, as in [`Solution::relative_gap`](crate::Solution::relative_gap).
    pub relative_gap: f64,
    /// Beckmann function or total travel cost.
    pub objective: f64,
    /// Sum of flow times generalised travel cost.
    pub total_travel_time: f64,
    /// Largest difference, over all nodes, between what arrives and starts there and what leaves and ends there. A zone
    /// that may not be passed is held to more: what arrives must end there, what leaves must start there.
    pub largest_imbalance: f64,
    /// Number of the node with the largest imbalance.
    pub worst_node: u32,
    /// Whether the flows cost less than the demand would on its cheapest paths at their costs: no flows that carry it do, also where
    /// those that are missing balance at every node.
    pub is_short: bool,
    /// Whether the flows carry the demand, as far as they can show: the largest imbalance is below 1e-6 of its total, and they are
    /// not short of it.
    pub conserves_demand: bool,
}

/// Judges `link_flows`, one per link in file order, or one per road where all that a reader added costs nothing. Flows of
/// roads alone are held to what they can show: the nodes of a junction and its zones are one then.
///
/// # Errors
/// [`Error::Input`] for another number of flows, a flow that is negative or not finite, costs that overflow at them, a demand for
/// other zones, or a pair of zones with demand but no path.
pub fn evaluate(
    network: &Network,
    demand: &Demand,
    objective: Objective,
    link_flows: &[f64],
) -> Result<Evaluation> {
    let links = network.links();
    let only_roads = link_flows.len() < links.len() && is_enough(network, link_flows.len());
    if link_flows.len() != links.len() && !only_roads {
        let expected = format!("{}, one per link", links.len());
        return Err(Error::input("flows", link_flows.len(), expected));
    }
    let added = vec![0.0; links.len() - link_flows.len()];
    let link_flows = &[link_flows, &added].concat();
    if demand.zones() != network.numbering().zones {
        let expected = format!("the network's {}", network.numbering().zones);
        return Err(Error::input("zones of the demand", demand.zones(), expected));
    }
    let (mut beckmann, mut everybody, mut total_travel_time) = (0.0, 0.0, 0.0);
    let (mut drivers_total, mut drivers_costs) = (0.0, Vec::with_capacity(links.len()));
    for (index, &flow) in link_flows.iter().enumerate() {
        crate::link::check_not_negative(&format!("link {}: volume", index + 1), flow)?;
        // With what the road carries anyway, and that alone.
        let preload = network.preload(index);
        let (now, before) = (
            Judged::new(network, index, preload + flow),
            Judged::new(network, index, preload),
        );
        total_travel_time += flow * now.cost;
        everybody += (preload + flow) * now.cost - preload * before.cost;
        beckmann += now.area - before.area;
        let cost = match objective {
            Objective::UserEquilibrium => now.cost,
            Objective::SystemOptimum => now.marginal,
        };
        drivers_total += flow * cost;
        drivers_costs.push(cost);
    }
    if ![drivers_total, everybody, beckmann, total_travel_time]
        .iter()
        .all(|sum| sum.is_finite())
    {
        let expected = "flows of the size of the demand";
        return Err(Error::input("flows", "costs that overflow", expected));
    }
    let cheapest_total = cheapest_total(network, demand, &drivers_costs)?;
    let (largest_imbalance, worst_node) = if only_roads {
        largest_imbalance_of_junctions(network, demand, link_flows)
    } else {
        largest_imbalance(network, demand, link_flows)
    };
    let is_short = drivers_total < (1.0 - SHORT_OF_CHEAPEST) * cheapest_total;
    Ok(Evaluation {
        relative_gap: problem::relative_gap(drivers_total, cheapest_total),
        objective: match objective {
            Objective::UserEquilibrium => beckmann,
            Objective::SystemOptimum => everybody,
        },
        total_travel_time,
        largest_imbalance,
        worst_node,
        is_short,
        conserves_demand: largest_imbalance <= CONSERVATION_TOLERANCE * demand.total() && !is_short,
    })
}

/// Whether so many flows, the first ones, can be judged: those of all links, or of all roads where the links behind them cost
/// nothing.
pub(crate) fn is_enough(network: &Network, flows: usize) -> bool {
    let roads = network.roads().len();
    let free = |index| Judged::new(network, index, 1.0).cost == 0.0;
    flows == network.links().len() || (flows == roads && (roads..network.links().len()).all(free))
}

/// What a link is worth at a flow, by the printed formulas.
struct Judged {
    /// What every vehicle meets.
    cost: f64,
    /// What one vehicle more costs all of them.
    marginal: f64,
    /// Integral of the cost from nobody to the flow.
    area: f64,
}

impl Judged {
    fn new(network: &Network, index: usize, flow: f64) -> Self {
        let link = &network.links()[index];
        let weights = network.weights();
        let fixed = weights.toll * link.toll + weights.distance * link.length;
        let time = match network.delay_function(index) {
            DelayFunction::Bpr => Self::bpr(link, flow),
            DelayFunction::Conical { alpha } => Self::conical(link, alpha, flow),
            DelayFunction::Akcelik {
                delay_parameter,
                period,
            } => Self::akcelik(link, delay_parameter, period, flow),
        };
        Self {
            cost: fixed + time.cost,
            marginal: fixed + time.marginal,
            area: flow * fixed + time.area,
        }
    }

    fn constant(cost: f64, flow: f64) -> Self {
        Self {
            cost,
            marginal: cost,
            area: flow * cost,
        }
    }

    fn bpr(link: &Link, flow: f64) -> Self {
        let free = link.free_flow_time;
        if free == 0.0 || link.b == 0.0 {
            return Self::constant(free, flow);
        }
        if link.power == 0.0 {
            return Self::constant(free + free * link.b, flow);
        }
        let delay = free * link.b * libm::pow(flow / link.capacity, link.power);
        Self {
            cost: free + delay,
            marginal: free + (link.power + 1.0) * delay,
            area: flow * free + flow * delay / (link.power + 1.0),
        }
    }

    /// With `u = 1 - x / capacity`: `t0 (2 - beta - alpha u + sqrt(alpha^2 u^2 + beta^2))`.
    fn conical(link: &Link, alpha: f64, flow: f64) -> Self {
        let (free, capacity) = (link.free_flow_time, link.capacity);
        if free == 0.0 {
            return Self::constant(0.0, flow);
        }
        let beta = (2.0 * alpha - 1.0) / (2.0 * alpha - 2.0);
        let u = 1.0 - flow / capacity;
        let root = libm::hypot(alpha * u, beta);
        let cost = free * (2.0 - beta - alpha * u + root);
        let slope = free * alpha / capacity * (1.0 - alpha * u / root);
        // The integral over u of the root, from u to 1.
        let under = |u: f64| {
            0.5 * u * libm::hypot(alpha * u, beta) + 0.5 * beta * beta / alpha * libm::asinh(alpha * u / beta)
        };
        let area = flow * (2.0 - beta) + capacity * (under(1.0) - under(u) - 0.5 * alpha * (1.0 - u * u));
        Self {
            cost,
            marginal: cost + flow * slope,
            area: free * area,
        }
    }

    /// With `z = x / capacity - 1` and `m = 8 J / capacity`: `t0 + T/4 (z + sqrt(z^2 + m x / capacity))`.
    fn akcelik(link: &Link, delay_parameter: f64, period: f64, flow: f64) -> Self {
        let (free, capacity) = (link.free_flow_time, link.capacity);
        if delay_parameter == 0.0 {
            return Self::constant(free, flow);
        }
        let noise = 8.0 * delay_parameter / capacity;
        let z = flow / capacity - 1.0;
        let root = libm::sqrt(z * z + noise * (z + 1.0));
        let cost = free + 0.25 * period * (z + root);
        let slope = 0.25 * period / capacity * (1.0 + (z + 0.5 * noise) / root);
        // The radicand is (z + noise / 2)^2 + rest, and the integral of its root, as of that of every such square, twice this.
        let rest = noise - 0.25 * noise * noise;
        let under = |z: f64| {
            let shifted = z + 0.5 * noise;
            let root = libm::sqrt(z * z + noise * (z + 1.0));
            let logarithm = if rest > 0.0 {
                libm::asinh(shifted / libm::sqrt(rest))
            } else if rest < 0.0 {
                libm::acosh(shifted / libm::sqrt(-rest))
            } else {
                0.0
            };
            shifted * root + rest * logarithm
        };
        let area = 0.5 * (z * z - 1.0) + 0.5 * (under(z) - under(-1.0));
        Self {
            cost,
            marginal: cost + flow * slope,
            area: flow * free + 0.25 * period * capacity * area,
        }
    }
}

/// What all trips cost on cheapest paths.
fn cheapest_total(network: &Network, demand: &Demand, link_costs: &[f64]) -> Result<f64> {
    let mut labels = Vec::new();
    let mut searched = None;
    let mut total = 0.0;
    for trip in demand.trips() {
        if searched != Some(trip.origin) {
            searched = Some(trip.origin);
            labels = correct_labels(network, link_costs, trip.origin);
        }
        let cost = labels[trip.destination as usize - 1];
        if cost == f64::INFINITY {
            return Err(Error::input(
                format!(
                    "trips from {} to {}",
                    network.zone_name(trip.origin),
                    network.zone_name(trip.destination)
                ),
                "no path in the network",
                "a path wherever there is demand",
            ));
        }
        total += trip.volume * cost;
    }
    Ok(total)
}

/// Cost of the cheapest path from a node, given by number, to every node.
fn correct_labels(network: &Network, link_costs: &[f64], origin: u32) -> Vec<f64> {
    let numbering = network.numbering();
    let mut labels = vec![f64::INFINITY; numbering.nodes as usize];
    let mut queued = vec![false; numbering.nodes as usize];
    labels[origin as usize - 1] = 0.0;
    let mut queue = VecDeque::from([origin]);
    while let Some(number) = queue.pop_front() {
        let node = number as usize - 1;
        queued[node] = false;
        if number < numbering.first_thru_node && number != origin {
            continue;
        }
        for outgoing in network.outgoing(node) {
            let next = outgoing.term_node as usize;
            let cost = labels[node] + link_costs[outgoing.link as usize];
            if cost < labels[next] {
                labels[next] = cost;
                if !std::mem::replace(&mut queued[next], true) {
                    queue.push_back(outgoing.term_node + 1);
                }
            }
        }
    }
    labels
}

/// The largest imbalance of any node, and the number of that node.
fn largest_imbalance(network: &Network, demand: &Demand, link_flows: &[f64]) -> (f64, u32) {
    let numbering = network.numbering();
    let nodes = numbering.nodes as usize;
    // What arrives less what ends there, and what leaves less what starts there.
    let (mut arriving, mut leaving) = (vec![0.0; nodes], vec![0.0; nodes]);
    for (link, &flow) in network.links().iter().zip(link_flows) {
        leaving[link.init_node as usize - 1] += flow;
        arriving[link.term_node as usize - 1] += flow;
    }
    for trip in demand.trips() {
        leaving[trip.origin as usize - 1] -= trip.volume;
        arriving[trip.destination as usize - 1] -= trip.volume;
    }
    let (mut largest, mut worst_node) = (0.0, 1);
    for (number, (arriving, leaving)) in (1..).zip(arriving.into_iter().zip(leaving)) {
        let mut imbalance = f64::abs(arriving - leaving);
        if number < numbering.first_thru_node {
            imbalance = imbalance.max(arriving.abs()).max(leaving.abs());
        }
        if imbalance > largest {
            (largest, worst_node) = (imbalance, number);
        }
    }
    (largest, worst_node)
}

/// The largest imbalance where nodes that turns join count as one, and those where trips of one zone begin, and those where
/// they end; with the number of one of the nodes.
fn largest_imbalance_of_junctions(network: &Network, demand: &Demand, link_flows: &[f64]) -> (f64, u32) {
    let roads = network.roads();
    let mut on_road = vec![false; network.numbering().nodes as usize];
    for road in roads {
        on_road[road.init_node as usize - 1] = true;
        on_road[road.term_node as usize - 1] = true;
    }
    let is_apart = |node: u32| node <= network.numbering().zones && !on_road[node as usize - 1];
    let mut junctions = Merged((0..on_road.len()).collect());
    // Where the trips of zones that lie on no road begin and end.
    let (mut first, mut last) = (vec![None; on_road.len()], vec![None; on_road.len()]);
    for link in &network.links()[roads.len()..] {
        let [from, to] = [link.init_node, link.term_node].map(|node| node as usize - 1);
        if is_apart(link.init_node) {
            junctions.merge(to, *first[from].get_or_insert(to));
        } else if is_apart(link.term_node) {
            junctions.merge(from, *last[to].get_or_insert(from));
        } else {
            junctions.merge(from, to);
        }
    }
    let mut surplus = vec![0.0; on_road.len()];
    for (road, flow) in roads.iter().zip(link_flows) {
        surplus[junctions.of(road.term_node as usize - 1)] += flow;
        surplus[junctions.of(road.init_node as usize - 1)] -= flow;
    }
    for trip in demand.trips() {
        let [origin, destination] = [trip.origin, trip.destination].map(|zone| zone as usize - 1);
        surplus[junctions.of(first[origin].unwrap_or(origin))] += trip.volume;
        surplus[junctions.of(last[destination].unwrap_or(destination))] -= trip.volume;
    }
    let numbered = (1..)
        .zip(surplus)
        .map(|(number, surplus)| (f64::abs(surplus), number));
    numbered.fold(
        (0.0, 1),
        |worst, next| if next.0 > worst.0 { next } else { worst },
    )
}

/// Sets of nodes, each with one that stands for it: a way to that one from every other.
struct Merged(Vec<usize>);

impl Merged {
    fn of(&mut self, mut node: usize) -> usize {
        while self.0[node] != node {
            self.0[node] = self.0[self.0[node]];
            node = self.0[node];
        }
        node
    }

    fn merge(&mut self, a: usize, b: usize) {
        let (a, b) = (self.of(a), self.of(b));
        self.0[a] = b;
    }
}

/// Link flows and costs as a flow file: one row per link in file order, numbers with all their digits.
pub fn format_flows(network: &Network, link_flows: &[f64], link_costs: &[f64]) -> String {
    let mut text = format!("{HEADER}\n");
    let rows = network.links().iter().zip(link_flows).zip(link_costs);
    for ((link, flow), cost) in rows {
        // Writing to a string cannot fail.
        let (from, to) = (
            network.node_name(link.init_node),
            network.node_name(link.term_node),
        );
        let _ = writeln!(text, "{from},{to},{flow},{cost}");
    }
    text
}

/// Reads the volumes of a flow file. Its costs are not believed, only checked to be numbers.
///
/// # Errors
/// [`Error::Input`] naming the line for another header, a missing column, a volume
/// that is no number, negative or infinite, a row that is not the network's next link, or too few or too many rows.
pub fn read_flows(text: &Text, network: &Network) -> Result<Vec<f64>> {
    let rows = csv_rows(text, HEADER)?.map(|row| row.and_then(flow_row));
    volumes(&text.name, rows, network)
}

/// One row of a flow file, its numbers checked.
#[derive(Debug, Clone, PartialEq)]
pub struct FlowRow {
    /// What errors call it: file and line.
    pub place: String,
    /// Names of the nodes that the link leaves and enters.
    pub nodes: [String; 2],
    /// The link's flow.
    pub volume: f64,
}

/// The volumes of a flow file's rows; `name` stands for the file in errors.
///
/// # Errors
/// The first row's own error, and [`Error::Input`] for a row that is not the network's next link, or too few or too many
/// rows.
pub fn volumes(
    name: &str,
    rows: impl IntoIterator<Item = Result<FlowRow>>,
    network: &Network,
) -> Result<Vec<f64>> {
    let all = network.links().len();
    let mut volumes = Vec::with_capacity(all);
    for row in rows {
        let FlowRow { place, nodes, volume } = row?;
        let Some(link) = network.links().get(volumes.len()) else {
            let expected = format!("{all} rows, one per link");
            return Err(Error::input(place, "one more row", expected));
        };
        let expected = [link.init_node, link.term_node].map(|node| network.node_name(node));
        if nodes != expected {
            let found = format!("link {} to {}", nodes[0], nodes[1]);
            let expected = format!("{} to {}, the network's next", expected[0], expected[1]);
            return Err(Error::input(place, found, expected));
        }
        volumes.push(volume);
    }
    if volumes.len() != all {
        let expected = format!("{all}, one per link");
        return Err(Error::input(name, format!("{} rows", volumes.len()), expected));
    }
    Ok(volumes)
}

/// One row of a CSV.
fn flow_row((place, [init_node, term_node, volume, cost]): (String, [&str; 4])) -> Result<FlowRow> {
    let number = |name: &str, text: &str| {
        let value = text.parse::<f64>().ok();
        value
            .filter(|value| value.is_finite() && *value >= 0.0)
            .ok_or_else(|| {
                Error::input(
                    format!("{place}: {name}"),
                    format!("`{text}`"),
                    "a finite number, not negative",
                )
            })
    };
    number("cost", cost)?;
    let volume = number("volume", volume)?;
    Ok(FlowRow {
        place,
        nodes: [init_node, term_node].map(str::to_owned),
        volume,
    })
}
