//! What training seeds tell together: the interquartile mean and its interval by a bootstrap over the seeds.
//!
//! # Source
//! R. Agarwal, M. Schwarzer, P. S. Castro, A. Courville, M. Bellemare: *Deep reinforcement learning at the edge of the statistical
//! precipice*, NeurIPS 2021. Their bootstrap is stratified: runs are drawn again within each task. Here every case in every cell is a
//! task and a row of its own, so that a row's interval is that of its stratum.

use host_sim::stream::{Purpose, Role, Stream, WorldKey};

/// Drawings of as many runs as there are.
const RESAMPLES: u32 = 10_000;

/// Share of the resamples on each side beyond a 95 % interval.
const TAIL: f64 = 0.025;

/// An interquartile mean with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interquartile {
    /// Of the runs.
    pub mean: f64,
    /// 2.5 % of the resamples are below.
    pub low: f64,
    /// 2.5 % are above.
    pub high: f64,
}

impl Interquartile {
    /// Of the runs of one task; `None` without any. Equal runs give equal intervals: the drawing has a stream of its own, always the
    /// same one.
    pub fn of(runs: &[f64]) -> Option<Self> {
        if runs.is_empty() {
            return None;
        }
        let mut stream = resampling();
        let mut drawn = vec![0.0; runs.len()];
        let mut means: Vec<f64> = (0..RESAMPLES)
            .map(|_| {
                for run in &mut drawn {
                    *run = runs[stream.below(runs.len() as u32) as usize];
                }
                mean_of_the_middle(&mut drawn)
            })
            .collect();
        means.sort_by(f64::total_cmp);
        let tail = (TAIL * f64::from(RESAMPLES)) as usize;
        Some(Self {
            mean: mean_of_the_middle(&mut runs.to_vec()),
            low: means[tail],
            high: means[means.len() - 1 - tail],
        })
    }
}

/// The mean without the lowest and the highest quarter, both rounded down: of three values or fewer, of all. Sorts them.
pub fn mean_of_the_middle(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let cut = values.len() / 4;
    let middle = &values[cut..values.len() - cut];
    middle.iter().sum::<f64>() / middle.len() as f64
}

fn resampling() -> Stream {
    let key = WorldKey {
        seed: 0,
        purpose: Purpose::Evaluation,
        world: u64::MAX,
    };
    key.stream(Role::Policy, 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_wild_run_in_five_moves_the_interval_and_not_the_mean() {
        assert_eq!(Interquartile::of(&[]), None);
        let tame = Interquartile::of(&[8.0, 5.0, 7.0, 6.0, 4.0]).unwrap();
        let wild = Interquartile::of(&[800.0, 5.0, 7.0, 6.0, 4.0]).unwrap();
        assert_eq!((tame.mean, wild.mean), (6.0, 6.0));
        assert!(wild.high > 100.0 && tame.high < 8.0 && wild.low == tame.low);
        let alone = Interquartile::of(&[3.5]).unwrap();
        assert_eq!((alone.mean, alone.low, alone.high), (3.5, 3.5, 3.5));
    }

    /// Of four values resampled, the chance that the middle two are both the largest is that of three or four of them drawn:
    /// 4 (1/4)^3 3/4 + (1/4)^4 = 13/256 = 5.1 %, more than the tail, so the interval reaches both ends.
    #[test]
    fn intervals_by_hand() {
        let four = Interquartile::of(&[1.0, 2.0, 3.0, 4.0]).unwrap();
        assert_eq!((four.low, four.mean, four.high), (1.0, 2.5, 4.0));
        // Of eight, the middle four are hardly ever all the largest: the interval stays within.
        let eight: Vec<f64> = (1..=8).map(f64::from).collect();
        let eight = Interquartile::of(&eight).unwrap();
        assert_eq!(eight.mean, 4.5);
        assert!(
            (2.0..3.0).contains(&eight.low) && (6.0..7.0).contains(&eight.high),
            "{eight:?}"
        );
    }
}
