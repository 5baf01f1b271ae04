//! What every algorithm is given: the problem as numbers, the worker threads, and the log of its progress.

use crate::demand::OriginDemand;
use crate::{
    Algorithm, Demand, IterationRecord, Network, Observe, Options, PathFlows, Solution, Stop, VolumeDelay,
};
use kit::error::{Error, Result};
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::{ControlFlow, Range};
use std::time::Instant;

/// Fewest origins per block (chosen: less work than this is not worth a thread).
const FEWEST_ORIGINS_PER_BLOCK: usize = 16;

/// Most blocks, because each has buffers of the size of the network (chosen).
const MOST_BLOCKS: usize = 32;

/// Double precision gives no more when neither gap nor objective have improved for this many iterations.
const STALLED_ITERATIONS: usize = 30;

/// Where the Frank-Wolfe family gains less than [`CRAWLING_GAIN`] of its best gap in so many iterations, it gets nowhere
/// (chosen: the bi-conjugate variant then still comes to 3e-7 on Sioux Falls, where it pauses more than once).
const CRAWLING_ITERATIONS: usize = 300;

/// See [`CRAWLING_ITERATIONS`] (chosen).
const CRAWLING_GAIN: f64 = 0.01;

/// Objectives that differ by less than this share are equal but for rounding.
const OBJECTIVE_RESOLUTION: f64 = 1e-14;

/// Drivers who share a demand and meet the same costs.
pub(crate) struct Class<'a> {
    /// Empty where there is one class alone.
    pub(crate) name: &'a str,
    /// In passenger cars.
    pub(crate) demand: &'a Demand,
    /// Per link, what it costs them beyond what it costs everybody; empty where that is nothing.
    pub(crate) surcharges: Vec<f64>,
    /// Links that they may not use.
    pub(crate) banned_links: &'a [u32],
}

/// Some origins of a class.
pub(crate) struct OriginBlock<'a> {
    pub(crate) class: usize,
    /// Indices into the class's origins.
    pub(crate) range: Range<usize>,
    pub(crate) origins: &'a [OriginDemand],
}

/// A network, demands and the costs that the objective makes drivers balance.
pub(crate) struct Problem<'a> {
    pub(crate) network: &'a Network,
    pub(crate) classes: Vec<Class<'a>>,
    /// Travel costs for the user equilibrium, marginal costs for the system optimum.
    pub(crate) delays: Vec<VolumeDelay>,
    threads: Option<rayon::ThreadPool>,
}

impl<'a> Problem<'a> {
    /// All drivers in one class, at the network's own costs.
    pub(crate) fn new(network: &'a Network, demand: &'a Demand, options: &Options) -> Result<Self> {
        let class = Class {
            name: "",
            demand,
            surcharges: Vec::new(),
            banned_links: &[],
        };
        Self::with_classes(network, network.volume_delays(), vec![class], options)
    }

    /// Checks that network and demands belong together. `delays` are what everybody meets.
    pub(crate) fn with_classes(
        network: &'a Network,
        delays: &[VolumeDelay],
        classes: Vec<Class<'a>>,
        options: &Options,
    ) -> Result<Self> {
        for class in &classes {
            if class.demand.zones() != network.numbering().zones {
                let expected = format!("the network's {} zones", network.numbering().zones);
                let found = format!("{} zones", class.demand.zones());
                return Err(Error::input("demand", found, expected));
            }
        }
        let delays: Vec<VolumeDelay> = delays.iter().map(|delay| delay.view(options.objective)).collect();
        let demand: f64 = classes.iter().map(|class| class.demand.total()).sum();
        // With everybody on every road: more than any objective, any total time and any path costs all its drivers.
        let mut total = 0.0;
        for (index, (delay, link)) in delays.iter().zip(network.links()).enumerate() {
            let most = demand + network.preload(index);
            // With nobody on the road, a root is infinitely steep.
            let steep = most > 0.0 && !delay.derivative(most).is_finite();
            total += delay.cost(most) * most;
            if steep || !f64::is_finite(total) || !delay.integral(most).is_finite() {
                return Err(Error::input(
                    format!(
                        "link {} ({} to {})",
                        index + 1,
                        network.node_name(link.init_node),
                        network.node_name(link.term_node)
                    ),
                    format!("a cost that overflows at {most} vehicles"),
                    "a capacity of the size of the demand",
                ));
            }
        }
        Ok(Self {
            threads: thread_pool(options.threads, origins(&classes))?,
            network,
            classes,
            delays,
        })
    }

    /// Number of links.
    pub(crate) fn links(&self) -> usize {
        self.delays.len()
    }

    /// The blocks of origins that are worked on at once, class by class.
    pub(crate) fn origin_blocks(&self) -> impl Iterator<Item = OriginBlock<'a>> {
        let size = origins_per_block(origins(&self.classes));
        let classes = self.classes.iter().enumerate();
        classes.flat_map(move |(class, Class { demand, .. })| {
            let chunks = demand.origins().chunks(size).enumerate();
            chunks.map(move |(chunk, origins)| OriginBlock {
                class,
                range: chunk * size..chunk * size + origins.len(),
                origins,
            })
        })
    }

    /// What the links cost a class where they cost everybody `link_costs`; infinite where it is banned.
    pub(crate) fn class_costs<'c>(&self, class: usize, link_costs: &'c [f64]) -> Cow<'c, [f64]> {
        let Class {
            surcharges,
            banned_links,
            ..
        } = &self.classes[class];
        if surcharges.is_empty() && banned_links.is_empty() {
            return Cow::Borrowed(link_costs);
        }
        let mut costs = link_costs.to_vec();
        for (cost, surcharge) in costs.iter_mut().zip(surcharges) {
            *cost += surcharge;
        }
        for &link in *banned_links {
            costs[link as usize] = f64::INFINITY;
        }
        Cow::Owned(costs)
    }

    /// What the surcharges of all classes come to, where these use the links so much.
    pub(crate) fn surcharges(&self, class_flows: &[Vec<f64>]) -> f64 {
        let classes = self.classes.iter().zip(class_flows);
        classes.map(|(class, flows)| dot(&class.surcharges, flows)).sum()
    }

    /// Cost that drivers balance, of every link.
    pub(crate) fn update_costs(&self, link_flows: &[f64], link_costs: &mut [f64]) {
        for ((cost, delay), &flow) in link_costs.iter_mut().zip(&self.delays).zip(link_flows) {
            *cost = delay.cost(flow);
        }
    }

    /// The objective: sum of the integrals of the costs that drivers balance, from what the roads carry without them to
    /// `link_flows`. Surcharges come on top.
    pub(crate) fn objective(&self, link_flows: &[f64]) -> f64 {
        let links = self.delays.iter().zip(link_flows).enumerate();
        links
            .map(|(link, (delay, &flow))| match self.network.preload(link) {
                0.0 => delay.integral(flow),
                preload => delay.integral(flow) - delay.integral(preload),
            })
            .sum()
    }

    /// Runs `work` on every item, on all threads. Items must not depend on each other.
    pub(crate) fn for_each<T: Send>(&self, items: &mut [T], work: impl Fn(&mut T) + Send + Sync) {
        match &self.threads {
            Some(threads) => threads.install(|| items.par_iter_mut().for_each(work)),
            None => items.iter_mut().for_each(work),
        }
    }
}

fn origins(classes: &[Class<'_>]) -> usize {
    classes.iter().map(|class| class.demand.origins().len()).sum()
}

/// Depends on the problem alone: the order of additions must not change with the number of threads.
fn origins_per_block(origins: usize) -> usize {
    origins.div_ceil(MOST_BLOCKS).max(FEWEST_ORIGINS_PER_BLOCK)
}

/// Threads for as many blocks as there are; none where one thread does it all.
fn thread_pool(threads: usize, origins: usize) -> Result<Option<rayon::ThreadPool>> {
    let blocks = origins.div_ceil(origins_per_block(origins));
    let wanted = match threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        some => some,
    };
    let useful = wanted.min(blocks);
    if useful <= 1 {
        return Ok(None);
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(useful)
        .build()
        .map(Some)
        .map_err(|failure| Error::input("threads", failure, "as many as the system can start"))
}

/// (TSTT - SPTT) / TSTT, 0 where nobody travels. Rounding can take the difference below 0; it is clamped.
pub(crate) fn relative_gap(total_cost: f64, shortest_path_cost: f64) -> f64 {
    if total_cost == 0.0 {
        return 0.0;
    }
    let gap = (total_cost - shortest_path_cost) / total_cost;
    if gap < 0.0 { 0.0 } else { gap }
}

/// Sum of products, in order.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Least gap and objective so far.
#[derive(Debug, Clone, Copy)]
struct Best {
    gap: f64,
    objective: f64,
}

/// The log of a solve, which also says when to stop.
pub(crate) struct Progress<'a> {
    gap: f64,
    max_iterations: usize,
    /// Whether the method is one whose objective creeps on when its gap no longer falls.
    may_crawl: bool,
    /// A browser's program has no clock.
    start: Option<Instant>,
    records: Vec<IterationRecord>,
    /// Up to and including each record.
    best: Vec<Best>,
    stopped: Stop,
    observe: &'a mut Observe<'a>,
}

impl<'a> Progress<'a> {
    pub(crate) fn new(options: &Options, observe: &'a mut Observe<'a>) -> Self {
        Self {
            gap: options.gap,
            max_iterations: options.max_iterations,
            may_crawl: options.algorithm != Algorithm::PathBased,
            start: (!cfg!(target_family = "wasm")).then(Instant::now),
            records: Vec::new(),
            best: Vec::new(),
            stopped: Stop::Iterations,
            observe,
        }
    }

    /// Logs the flows of one more iteration. True if it was the last: the gap is reached, iterations are used up, or
    /// nothing improves any more, or whoever observes it says so.
    pub(crate) fn record(&mut self, relative_gap: f64, objective: f64) -> bool {
        let record = IterationRecord {
            iteration: self.records.len(),
            relative_gap,
            objective,
            seconds: self.start.map_or(0.0, |start| start.elapsed().as_secs_f64()),
        };
        let observed = (self.observe)(&record);
        self.records.push(record);
        let best = self.best.last().copied().unwrap_or(Best {
            gap: f64::INFINITY,
            objective: f64::INFINITY,
        });
        self.best.push(Best {
            gap: best.gap.min(relative_gap),
            objective: best.objective.min(objective),
        });
        let stop = if relative_gap <= self.gap {
            Some(Stop::Gap)
        } else if record.iteration >= self.max_iterations {
            Some(Stop::Iterations)
        } else if self.stalls_for(STALLED_ITERATIONS) || (self.may_crawl && self.crawls()) {
            Some(Stop::Stagnation)
        } else if let ControlFlow::Break(reason) = observed {
            Some(reason)
        } else {
            None
        };
        if let Some(reason) = stop {
            self.stopped = reason;
        }
        stop.is_some()
    }

    /// Whether neither the gap nor the objective have fallen below their best for `iterations` iterations. The gap alone
    /// says little: it goes up and down while the objective creeps towards its minimum.
    fn stalls_for(&self, iterations: usize) -> bool {
        self.best_before(iterations).is_some_and(|(before, now)| {
            now.gap >= before.gap && now.objective >= before.objective * (1.0 - OBJECTIVE_RESOLUTION)
        })
    }

    /// Whether the gap has all but stopped falling, even though the objective creeps on.
    fn crawls(&self) -> bool {
        self.best_before(CRAWLING_ITERATIONS)
            .is_some_and(|(before, now)| now.gap > (1.0 - CRAWLING_GAIN) * before.gap)
    }

    /// The best so many iterations ago, and the best now.
    fn best_before(&self, iterations: usize) -> Option<(Best, Best)> {
        let before = self.best.len().checked_sub(iterations + 1)?;
        Some((self.best[before], *self.best.last()?))
    }

    /// The finished solution: `link_flows` are those of the last record, and the links then cost `link_costs`.
    pub(crate) fn into_solution(
        self,
        link_costs: Vec<f64>,
        link_flows: Vec<f64>,
        path_flows: PathFlows,
    ) -> Solution {
        let last = self.records.last();
        let relative_gap = last.map_or(0.0, |record| record.relative_gap);
        Solution {
            total_travel_time: dot(&link_flows, &link_costs),
            relative_gap,
            objective: last.map_or(0.0, |record| record.objective),
            iterations: last.map_or(0, |record| record.iteration),
            converged: relative_gap <= self.gap,
            stopped: self.stopped,
            path_flows,
            convergence: self.records,
            link_flows,
            link_costs,
        }
    }
}
