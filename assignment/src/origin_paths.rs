//! The paths of all pairs of one origin.
//!
//! Most pairs use one path, and are a single number. What shifts flow looks only at the pairs that have a choice, and of
//! their paths only at the part in which they differ.

use crate::network::Network;
use crate::path_tree::{PathTree, ROOT, Way};
use crate::shortest_path::ShortestPathTree;

/// A path with less than this share of its pair's demand is emptied: no gap in double precision sees it.
pub(crate) const NEGLIGIBLE_SHARE: f64 = 1e-16;

/// A new path must be cheaper than the known ones by more than this share: sums in another order differ by as much.
const PATH_COST_TOLERANCE: f64 = 1e-14;

/// Marks a pair that has a choice.
const CHOICE: u32 = 1 << 31;

/// "Not there".
const NOWHERE: u32 = u32::MAX;

/// One of several ways from an origin to a destination.
#[derive(Clone)]
pub(crate) struct Path {
    pub(crate) flow: f64,
    /// Flow before the sweep that is extrapolated.
    pub(crate) flow_before: f64,
    /// What its own links cost its class beyond what they cost everybody.
    pub(crate) surcharge: f64,
    /// Where it ends in the origin's tree.
    end: u32,
    /// Where its part that not all paths of the pair share ends.
    own_end: u32,
}

/// A pair that knows more than one path.
#[derive(Clone)]
struct Choice {
    demand: f64,
    /// Sweeps that pass it by, because its paths cost all but the same.
    rest: u32,
    /// How many paths it has: those that follow the ones of the choice before it.
    paths: u32,
    /// Up to where all its paths are one.
    fork: u32,
}

/// A pair with a choice, and the paths that its demand takes.
pub(crate) struct Pair<'s> {
    pub(crate) demand: f64,
    pub(crate) rest: &'s mut u32,
    pub(crate) paths: &'s mut [Path],
    pub(crate) links: OwnLinks<'s>,
}

impl Pair<'_> {
    /// Makes the path flows add up to the demand again, from which rounding takes them: the largest one gives way.
    pub(crate) fn settle(&mut self) {
        let total: f64 = self.paths.iter().map(|path| path.flow).sum();
        if let Some(largest) = self.paths.iter_mut().max_by(|a, b| a.flow.total_cmp(&b.flow)) {
            largest.flow += self.demand - total;
        }
    }
}

/// Gives the links that a path of a pair does not share with all others of it.
#[derive(Clone, Copy)]
pub(crate) struct OwnLinks<'s> {
    tree: &'s PathTree,
    fork: u32,
}

impl<'s> OwnLinks<'s> {
    /// Those of one path, the last one first.
    #[inline]
    pub(crate) fn of(self, path: &Path) -> Way<'s> {
        self.tree.way(path.own_end, self.fork)
    }
}

/// The paths of the pairs of an origin, by ascending destination.
#[derive(Clone, Default)]
pub(crate) struct OriginPaths {
    tree: PathTree,
    /// Per pair, where its path ends; with [`CHOICE`], the number of its choice.
    pairs: Vec<u32>,
    choices: Vec<Choice>,
    paths: Vec<Path>,
}

/// Room for making the paths of one origin after the other.
#[derive(Clone)]
pub(crate) struct Workshop {
    /// Ends and flows of all paths, pair by pair, and where those of each pair end.
    ends: Vec<u32>,
    flows: Vec<f64>,
    pair_ends: Vec<u32>,
    /// Of each pair whose paths are those of an old choice, that choice and the first of its paths.
    same: Vec<Option<(u32, u32)>>,
    /// Per node, where the cheapest path to it stands in the tree of known ones, if it does.
    known_ends: Vec<u32>,
    /// Per position of that tree.
    costs: Vec<f64>,
    carried: Vec<f64>,
    moved: Vec<u32>,
    links: Vec<u32>,
}

impl Workshop {
    pub(crate) fn new(network: &Network) -> Self {
        Self {
            ends: Vec::new(),
            flows: Vec::new(),
            pair_ends: Vec::new(),
            same: Vec::new(),
            known_ends: vec![NOWHERE; network.numbering().nodes as usize],
            costs: Vec::new(),
            carried: Vec::new(),
            moved: Vec::new(),
            links: Vec::new(),
        }
    }

    /// Begins with the pairs of an origin none of whose cheapest paths is known.
    pub(crate) fn begin(&mut self, origin: u32) {
        self.ends.clear();
        self.flows.clear();
        self.pair_ends.clear();
        self.same.clear();
        self.known_ends.fill(NOWHERE);
        self.known_ends[origin as usize] = ROOT;
    }

    /// Gives the open pair a path.
    pub(crate) fn push(&mut self, end: u32, flow: f64) {
        self.ends.push(end);
        self.flows.push(flow);
    }

    /// Gives the open pair the cheapest path to its destination, where `cheapest` is the result of a search.
    pub(crate) fn push_cheapest(
        &mut self,
        tree: &mut PathTree,
        network: &Network,
        cheapest: &ShortestPathTree,
        destination: u32,
        flow: f64,
    ) {
        self.links.clear();
        let mut node = destination;
        while self.known_ends[node as usize] == NOWHERE
            && let Some(link) = cheapest.entering_link(node)
        {
            self.links.push(link);
            node = network.init_node(link);
        }
        let mut end = self.known_ends[node as usize];
        for &link in self.links.iter().rev() {
            end = tree.grow(end, [link]);
            self.known_ends[network.term_node(link) as usize] = end;
        }
        self.push(end, flow);
    }

    /// Closes the open pair.
    pub(crate) fn end_pair(&mut self) {
        self.end_same_pair(None);
    }

    /// Closes the open pair, whose paths may be those of an old choice.
    fn end_same_pair(&mut self, same: Option<(u32, u32)>) {
        self.pair_ends.push(self.ends.len() as u32);
        self.same.push(same);
    }
}

impl OriginPaths {
    /// The paths in the `workshop`, which lie in `tree`, for pairs with these `demands` of a class with these `surcharges`; the tree
    /// may have other ways, too.
    pub(crate) fn new(
        tree: PathTree,
        workshop: &mut Workshop,
        demands: impl Iterator<Item = f64>,
        surcharges: &[f64],
        has_others: bool,
    ) -> Self {
        let mut made = Self {
            tree,
            ..Self::default()
        };
        made.take_from(workshop, demands, surcharges, has_others);
        made
    }

    /// Takes over all pairs; the tree needs pruning where some of its ways were `dropped`.
    fn take_from(
        &mut self,
        workshop: &mut Workshop,
        demands: impl Iterator<Item = f64>,
        surcharges: &[f64],
        dropped: bool,
    ) {
        if dropped {
            self.tree.prune(&mut workshop.ends, &mut workshop.moved);
        } else {
            self.tree.shrink();
        }
        let counts = || {
            let ends = workshop.pair_ends.iter();
            ends.scan(0, |begin, &end| Some(end - std::mem::replace(begin, end)))
        };
        let with_choice = || counts().filter(|&paths| paths > 1);
        // To the number: one that grows takes up to twice the room.
        let choices = Vec::with_capacity(with_choice().count());
        let paths = Vec::with_capacity(with_choice().sum::<u32>() as usize);
        let old_choices = std::mem::replace(&mut self.choices, choices);
        let old_paths = std::mem::replace(&mut self.paths, paths);
        self.pairs.clear();
        self.pairs.reserve_exact(workshop.pair_ends.len());
        let mut begin = 0;
        let pairs = workshop.pair_ends.iter().zip(&workshop.same);
        for ((&end, &same), demand) in pairs.zip(demands) {
            let range = std::mem::replace(&mut begin, end as usize)..end as usize;
            if let [only] = workshop.ends[range.clone()] {
                self.pairs.push(only);
                continue;
            }
            self.pairs.push(CHOICE | self.choices.len() as u32);
            if let Some((choice, first)) = same {
                let moved = |position: u32| {
                    if dropped {
                        workshop.moved[position as usize]
                    } else {
                        position
                    }
                };
                let (choice, first) = (&old_choices[choice as usize], first as usize);
                self.choices.push(Choice {
                    fork: moved(choice.fork),
                    ..choice.clone()
                });
                let paths = &old_paths[first..first + choice.paths as usize];
                self.paths.extend(paths.iter().map(|path| Path {
                    flow_before: path.flow,
                    end: moved(path.end),
                    own_end: moved(path.own_end),
                    ..path.clone()
                }));
                continue;
            }
            let ends = &workshop.ends[range.clone()];
            let fork = ends
                .iter()
                .copied()
                .reduce(|a, b| self.tree.fork(a, b))
                .unwrap_or(ROOT);
            self.choices.push(Choice {
                demand,
                rest: 0,
                paths: ends.len() as u32,
                fork,
            });
            let shared = self.shared_end(ends, fork);
            for (&end, &flow) in ends.iter().zip(&workshop.flows[range]) {
                let mut way = self.tree.way(end, fork);
                way.by_ref().take(shared).for_each(drop);
                let surcharge = if surcharges.is_empty() {
                    0.0
                } else {
                    way.clone().map(|link| surcharges[link as usize]).sum()
                };
                self.paths.push(Path {
                    flow,
                    flow_before: flow,
                    surcharge,
                    end,
                    own_end: way.position(),
                });
            }
        }
    }

    /// How many links all ways have in common at their end.
    fn shared_end(&self, ends: &[u32], fork: u32) -> usize {
        let Some((&first, others)) = ends.split_first() else {
            return 0;
        };
        let shared_with = |&other: &u32| {
            let both = self.tree.way(first, fork).zip(self.tree.way(other, fork));
            both.take_while(|(a, b)| a == b).count()
        };
        others.iter().map(shared_with).min().unwrap_or(0)
    }

    /// Gives each pair the cheapest path to its destination, which a search found, where it is cheaper than all known ones,
    /// and drops paths that carry nothing. Returns what all trips would cost on the cheapest paths.
    pub(crate) fn improve(
        &mut self,
        workshop: &mut Workshop,
        network: &Network,
        cheapest: &ShortestPathTree,
        link_costs: &[f64],
        surcharges: &[f64],
        (origin, destinations): (u32, &[(u32, f64)]),
    ) -> f64 {
        workshop.begin(origin);
        self.look_through(workshop, network, cheapest, link_costs);
        let mut first = 0;
        let mut shortest_path_cost = 0.0;
        let (mut grown, mut dropped) = (false, false);
        for (&pair, &(destination, volume)) in self.pairs.iter().zip(destinations) {
            let mut known = f64::INFINITY;
            let mut same = None;
            if pair & CHOICE == 0 {
                known = workshop.costs[pair as usize];
                workshop.push(pair, volume);
            } else {
                let choice = pair & !CHOICE;
                let count = self.choices[choice as usize].paths;
                same = Some((choice, first));
                for path in &self.paths[first as usize..(first + count) as usize] {
                    if path.flow > 0.0 {
                        known = known.min(workshop.costs[path.end as usize]);
                        workshop.push(path.end, path.flow);
                    } else {
                        dropped = true;
                        same = None;
                    }
                }
                first += count;
            }
            let cost = cheapest.cost_to(destination);
            shortest_path_cost += volume * cost;
            if cost < known * (1.0 - PATH_COST_TOLERANCE) {
                workshop.push_cheapest(&mut self.tree, network, cheapest, destination, 0.0);
                grown = true;
                same = None;
            }
            workshop.end_same_pair(same);
        }
        if grown || dropped {
            let demands = destinations.iter().map(|&(_, volume)| volume);
            self.take_from(workshop, demands, surcharges, dropped);
        }
        shortest_path_cost
    }

    /// Notes the cost of every way, and which ways are cheapest paths.
    fn look_through(
        &self,
        workshop: &mut Workshop,
        network: &Network,
        cheapest: &ShortestPathTree,
        link_costs: &[f64],
    ) {
        workshop.costs.clear();
        workshop.costs.resize(self.tree.len(), 0.0);
        let (costs, known_ends) = (&mut workshop.costs, &mut workshop.known_ends);
        self.tree.for_each(|link, position, before| {
            costs[position as usize] = costs[before as usize] + link_costs[link as usize];
            let node = network.term_node(link);
            if cheapest.entering_link(node) == Some(link)
                && known_ends[network.init_node(link) as usize] == before
            {
                known_ends[node as usize] = position;
            }
        });
    }

    /// Every path in use, pair by pair: the number of its pair, its end in the tree, and its flow.
    pub(crate) fn used<'s>(
        &'s self,
        demands: impl Iterator<Item = f64> + 's,
    ) -> impl Iterator<Item = (usize, u32, f64)> + 's {
        let mut first = 0;
        let pairs = self.pairs.iter().zip(demands).enumerate();
        pairs.flat_map(move |(number, (&pair, demand))| {
            let paths = if pair & CHOICE == 0 {
                &[]
            } else {
                let count = self.choices[(pair & !CHOICE) as usize].paths as usize;
                first += count;
                &self.paths[first - count..first]
            };
            let only = (pair & CHOICE == 0).then_some((number, pair, demand));
            let used = paths.iter().filter(|path| path.flow > 0.0);
            only.into_iter()
                .chain(used.map(move |path| (number, path.end, path.flow)))
        })
    }

    /// The tree that the paths lie in.
    pub(crate) fn into_tree(self) -> PathTree {
        self.tree
    }

    /// Adds the flow of every path to that of its links.
    pub(crate) fn load(&self, workshop: &mut Workshop, destinations: &[(u32, f64)], link_flows: &mut [f64]) {
        let carried = &mut workshop.carried;
        carried.clear();
        carried.resize(self.tree.len(), 0.0);
        for (&pair, &(_, volume)) in self.pairs.iter().zip(destinations) {
            if pair & CHOICE == 0 {
                carried[pair as usize] += volume;
            }
        }
        for path in &self.paths {
            carried[path.end as usize] += path.flow;
        }
        self.tree.load(carried, link_flows);
    }

    /// The pairs that know more than one path.
    #[inline]
    pub(crate) fn choices(&mut self) -> impl Iterator<Item = Pair<'_>> {
        let (tree, mut rest) = (&self.tree, self.paths.as_mut_slice());
        self.choices.iter_mut().map(move |choice| {
            let (paths, after) = std::mem::take(&mut rest).split_at_mut(choice.paths as usize);
            rest = after;
            Pair {
                demand: choice.demand,
                rest: &mut choice.rest,
                paths,
                links: OwnLinks {
                    tree,
                    fork: choice.fork,
                },
            }
        })
    }
}
