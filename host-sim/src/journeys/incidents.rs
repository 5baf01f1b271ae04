//! Incidents: when a block has less than its capacity.

use crate::stream::Stream;

/// Alternating exponential times without and with an incident on every block, stationary from time 0.
#[derive(Clone, Debug)]
pub struct Incidents {
    /// By block: beginnings and ends in s, ascending.
    spans: Vec<Vec<(f64, f64)>>,
    /// Share of capacity that is left.
    capacity_left: f64,
}

impl Incidents {
    /// No incidents on so many blocks.
    pub fn none(blocks: u32) -> Self {
        Self {
            spans: vec![Vec::new(); blocks as usize],
            capacity_left: 1.0,
        }
    }

    /// These spans by block, each in s from beginning to end, ascending and apart; a share of the capacity above 0 is left.
    pub fn scripted(spans: Vec<Vec<(f64, f64)>>, capacity_left: f64) -> Self {
        Self { spans, capacity_left }
    }

    /// Draws them up to `horizon_s`: `duration_s` long on average and `interval_s` apart, block by block from its stream.
    pub fn draw(
        (duration_s, interval_s): (f64, f64),
        capacity_left: f64,
        horizon_s: f64,
        blocks: impl Iterator<Item = Stream>,
    ) -> Self {
        let draw = |mut stream: Stream| {
            let mut spans = Vec::new();
            // Exponential times forget: what is left of one that began before 0 is one more of its kind.
            let within = stream.chance(duration_s / (duration_s + interval_s));
            let mut time = 0.0;
            if !within {
                time = interval_s * f64::from(stream.exponential());
            }
            while time < horizon_s {
                let end = time + duration_s * f64::from(stream.exponential());
                spans.push((time, end));
                time = end + interval_s * f64::from(stream.exponential());
            }
            spans
        };
        Self {
            spans: blocks.map(draw).collect(),
            capacity_left,
        }
    }

    /// Share of the capacity that an incident leaves.
    pub fn capacity_left(&self) -> f64 {
        self.capacity_left
    }

    /// A block's incidents in s, from beginning to end; where there is no block, there are none.
    pub fn of(&self, block: Option<u32>) -> &[(f64, f64)] {
        block.map_or(&[], |block| &self.spans[block as usize])
    }

    /// Whether a block has one at a time.
    pub fn active(&self, block: Option<u32>, time_s: f64) -> bool {
        let spans = self.of(block);
        let begun = spans.partition_point(|&(start, _)| start <= time_s);
        begun > 0 && time_s < spans[begun - 1].1
    }

    /// When a block's state changes next after a time; infinity if never.
    pub fn next_change_s(&self, block: Option<u32>, time_s: f64) -> f64 {
        let spans = self.of(block);
        let ended = spans.partition_point(|&(_, end)| end <= time_s);
        spans.get(ended).map_or(
            f64::INFINITY,
            |&(start, end)| {
                if start > time_s { start } else { end }
            },
        )
    }
}
