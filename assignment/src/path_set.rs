//! The paths of all origin-destination pairs of a block of origins, side by side in memory.
//!
//! Most pairs use one path. What looks at all paths (sums of flows, costs of the known paths) reads straight through; what
//! shifts flow looks only at the pairs that have a choice.

/// A path with less than this share of its pair's demand is emptied: no gap in double precision sees it.
pub(crate) const NEGLIGIBLE_SHARE: f64 = 1e-16;

/// One way from an origin to a destination.
#[derive(Clone)]
pub(crate) struct Path {
    pub(crate) flow: f64,
    /// Flow before the sweep that is extrapolated.
    pub(crate) flow_before: f64,
    /// Where its links begin and end in the set's list.
    begin: u32,
    end: u32,
}

impl Path {
    /// Its links, the last one first.
    #[inline]
    pub(crate) fn links<'l>(&self, links: &'l [u32]) -> &'l [u32] {
        &links[self.begin as usize..self.end as usize]
    }
}

/// A pair that knows more than one path.
#[derive(Clone)]
struct Choice {
    demand: f64,
    /// Sweeps that pass it by, because its paths cost all but the same.
    rest: u32,
    /// Where its paths begin and end.
    begin: u32,
    end: u32,
}

/// A pair with a choice, and the paths that its demand takes.
pub(crate) struct Pair<'s> {
    pub(crate) demand: f64,
    pub(crate) rest: &'s mut u32,
    pub(crate) paths: &'s mut [Path],
    /// What [`Path::links`] looks into.
    pub(crate) links: &'s [u32],
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

/// The paths of the pairs of a block, by ascending origin and destination.
#[derive(Clone, Default)]
pub(crate) struct PathSet {
    links: Vec<u32>,
    paths: Vec<Path>,
    /// Where each pair's paths begin, and at last where the final pair's end.
    first_paths: Vec<u32>,
    choices: Vec<Choice>,
    /// Empty paths that were found since, each with its pair, by ascending pair; their links end the list of all.
    found: Vec<(u32, Path)>,
}

impl PathSet {
    /// A set for this many pairs, which are then pushed one after the other.
    pub(crate) fn with_capacity(pairs: usize) -> Self {
        let mut first_paths = Vec::with_capacity(pairs + 1);
        first_paths.push(0);
        Self {
            first_paths,
            paths: Vec::with_capacity(pairs),
            ..Self::default()
        }
    }

    /// Adds a path to the pair that is open, its last link first.
    pub(crate) fn push_path(&mut self, links: impl IntoIterator<Item = u32>, flow: f64) {
        let path = add_path(&mut self.links, links, flow);
        self.paths.push(path);
    }

    /// Closes the open pair.
    pub(crate) fn end_pair(&mut self, demand: f64) {
        let begin = self.first_paths.last().copied().unwrap_or(0);
        let end = self.paths.len() as u32;
        self.first_paths.push(end);
        self.note_choice(demand, begin, end);
    }

    fn note_choice(&mut self, demand: f64, begin: u32, end: u32) {
        if end - begin > 1 {
            self.choices.push(Choice {
                demand,
                rest: 0,
                begin,
                end,
            });
        }
    }

    /// The paths of a pair that carry anything, each with its links.
    #[inline]
    pub(crate) fn used(&self, pair: usize) -> impl Iterator<Item = (&Path, &[u32])> {
        let (begin, end) = (self.first_paths[pair], self.first_paths[pair + 1]);
        let paths = self.paths[begin as usize..end as usize].iter();
        paths
            .filter(|path| path.flow > 0.0)
            .map(|path| (path, path.links(&self.links)))
    }

    /// Notes a path that [`take_in`](Self::take_in) shall add to a pair; pairs come in ascending order.
    pub(crate) fn note(&mut self, pair: usize, links: &[u32]) {
        let path = add_path(&mut self.links, links.iter().copied(), 0.0);
        self.found.push((pair as u32, path));
    }

    /// Adds what was [noted](Self::note) to the pairs, whose `demands` are given in their order, and drops paths that
    /// carry nothing.
    pub(crate) fn take_in(&mut self, demands: impl Iterator<Item = f64>) {
        let old = std::mem::take(self);
        self.links.reserve(old.links.len());
        self.paths.reserve(old.paths.len());
        self.first_paths.reserve(old.first_paths.len());
        self.first_paths.push(0);
        let mut found = old.found.iter().peekable();
        for (pair, demand) in demands.enumerate() {
            for (path, links) in old.used(pair) {
                self.push_path(links.iter().copied(), path.flow);
            }
            while let Some((_, path)) = found.next_if(|(of, _)| *of as usize == pair) {
                self.push_path(path.links(&old.links).iter().copied(), 0.0);
            }
            self.end_pair(demand);
        }
    }

    /// The pairs that know more than one path.
    #[inline]
    pub(crate) fn choices(&mut self) -> impl Iterator<Item = Pair<'_>> {
        let (links, mut rest, mut passed) = (self.links.as_slice(), self.paths.as_mut_slice(), 0);
        self.choices.iter_mut().map(move |choice| {
            let (_, from_pair) = std::mem::take(&mut rest).split_at_mut((choice.begin - passed) as usize);
            let (paths, after) = from_pair.split_at_mut((choice.end - choice.begin) as usize);
            (rest, passed) = (after, choice.end);
            Pair {
                demand: choice.demand,
                rest: &mut choice.rest,
                paths,
                links,
            }
        })
    }

    /// Adds the flow of every path to that of its links.
    pub(crate) fn load(&self, link_flows: &mut [f64]) {
        for path in &self.paths {
            for &link in path.links(&self.links) {
                link_flows[link as usize] += path.flow;
            }
        }
    }
}

fn add_path(list: &mut Vec<u32>, links: impl IntoIterator<Item = u32>, flow: f64) -> Path {
    let begin = list.len() as u32;
    list.extend(links);
    Path {
        flow,
        flow_before: flow,
        begin,
        end: list.len() as u32,
    }
}

/// Cost of a path.
#[inline]
pub(crate) fn path_cost(links: &[u32], link_costs: &[f64]) -> f64 {
    links.iter().map(|&link| link_costs[link as usize]).sum()
}
