//! What happened, episode by episode, for learning from it later (the paper's D).

use super::view::View;
use crate::laboratory::state::State;
use host_sim::stream::Stream;
use kit::error::Result;

/// Sizes of a replay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Episodes that it holds; the oldest makes room.
    pub episodes: usize,
    /// Slots of an episode.
    pub slots: usize,
    /// Worlds of an episode.
    pub worlds: usize,
    /// Vehicles that a world has room for.
    pub vehicles: usize,
    /// Values known of a vehicle in a slot.
    pub known: usize,
    /// How many of them, from the first on, the vehicle itself observes.
    pub observed: usize,
    /// Values stored of an action: 1 for a choice.
    pub action: usize,
}

impl Extent {
    /// Shapes of what is known, actions, rewards and present vehicles.
    fn shapes(&self) -> [Vec<usize>; 4] {
        let (episodes, slots) = (self.episodes, self.slots);
        let rows = [self.worlds, self.vehicles];
        [
            [&[episodes, slots + 1], &rows[..], &[self.known]].concat(),
            [&[episodes, slots], &rows[..], &[self.action]].concat(),
            [&[episodes, slots], &rows[..]].concat(),
            vec![episodes],
        ]
    }
}

/// A ring of episodes. A slot's observation is stored once: it is the next one of the slot before.
#[derive(Clone, Debug)]
pub struct Replay {
    extent: Extent,
    /// `[episode][slot + 1][world][vehicle][known]`.
    known: Vec<f32>,
    /// `[episode][slot][world][vehicle][action]`.
    actions: Vec<f32>,
    /// `[episode][slot][world][vehicle]`.
    rewards: Vec<f32>,
    /// `[episode]`: how many vehicles took part.
    present: Vec<u8>,
    /// Episodes begun so far.
    begun: u64,
    /// Slots done of the newest.
    filled: usize,
}

/// Samples for one update.
#[derive(Clone, Debug, Default)]
pub struct Batch {
    /// `[sample][vehicle][known]`.
    pub known: Vec<f32>,
    /// The same n slots later.
    pub later: Vec<f32>,
    /// `[sample][vehicle][action]`.
    pub actions: Vec<f32>,
    /// `[sample][vehicle]`: rewards of n slots, discounted.
    pub rewards: Vec<f32>,
    /// `[sample]`.
    pub present: Vec<u8>,
}

impl Replay {
    /// An empty one.
    pub fn new(extent: Extent) -> Self {
        let [known, actions, rewards, present] = extent.shapes().map(|shape| shape.iter().product::<usize>());
        Self {
            known: vec![0.0; known],
            actions: vec![0.0; actions],
            rewards: vec![0.0; rewards],
            present: vec![0; present],
            begun: 0,
            filled: 0,
            extent,
        }
    }

    /// Transitions from which n slots can be looked ahead.
    pub fn transitions(&self, n: usize) -> usize {
        self.starts(n).0
    }

    /// Begins an episode with so many vehicles, in the place of the oldest.
    pub fn begin(&mut self, present: usize) {
        self.begun += 1;
        self.filled = 0;
        let episode = self.newest();
        self.present[episode] = present as u8;
    }

    /// Room for what is known at the beginning of the slot after those done, `[world][vehicle][known]`.
    pub fn known(&mut self) -> &mut [f32] {
        let length = self.rows() * self.extent.known;
        let place = self.newest() * (self.extent.slots + 1) + self.filled;
        &mut self.known[place * length..][..length]
    }

    /// Room for the slot's actions, `[world][vehicle][action]`, and rewards, `[world][vehicle]`.
    pub fn outcome(&mut self) -> (&mut [f32], &mut [f32]) {
        let rows = self.rows();
        let place = self.newest() * self.extent.slots + self.filled;
        let length = rows * self.extent.action;
        (
            &mut self.actions[place * length..][..length],
            &mut self.rewards[place * rows..][..rows],
        )
    }

    /// The slot is done.
    pub fn advance(&mut self) {
        self.filled += 1;
    }

    /// Uniform samples of transitions, with what was known n slots later. A time limit ends no world: the last slots of an
    /// episode are only looked at from n slots before its end.
    pub fn sample(&self, count: usize, n: usize, discount: f32, stream: &mut Stream, batch: &mut Batch) {
        let extent = &self.extent;
        let (total, whole) = self.starts(n);
        let each = (extent.slots + 1 - n) * extent.worlds;
        batch.known.clear();
        batch.later.clear();
        batch.actions.clear();
        batch.rewards.clear();
        batch.present.clear();
        let rows = extent.vehicles;
        for _ in 0..count {
            let drawn = stream.below(total as u32) as usize;
            // Complete episodes first, then the newest.
            let (age, rest) = if drawn < whole * each {
                (whole - drawn / each, drawn % each)
            } else {
                (0, drawn - whole * each)
            };
            let episode = ((self.begun - 1) as usize - age) % extent.episodes;
            let (slot, world) = (rest / extent.worlds, rest % extent.worlds);
            let known = |slot: usize| {
                let place = (episode * (extent.slots + 1) + slot) * extent.worlds + world;
                &self.known[place * rows * extent.known..][..rows * extent.known]
            };
            batch.known.extend_from_slice(known(slot));
            batch.later.extend_from_slice(known(slot + n));
            let place = |slot: usize| (episode * extent.slots + slot) * extent.worlds + world;
            let actions = rows * extent.action;
            batch
                .actions
                .extend_from_slice(&self.actions[place(slot) * actions..][..actions]);
            let first = batch.rewards.len();
            batch.rewards.resize(first + rows, 0.0);
            let mut factor = 1.0;
            for step in 0..n {
                let rewards = &self.rewards[place(slot + step) * rows..][..rows];
                for (sum, reward) in batch.rewards[first..].iter_mut().zip(rewards) {
                    *sum += factor * reward;
                }
                factor *= discount;
            }
            batch.present.push(self.present[episode]);
        }
    }

    /// Writes everything into a state.
    pub fn save(&self, state: &mut State) -> (u64, usize) {
        let [known, actions, rewards, present] = self.extent.shapes();
        state.put("replay.known", &known, self.known.clone());
        state.put("replay.actions", &actions, self.actions.clone());
        state.put("replay.rewards", &rewards, self.rewards.clone());
        state.put("replay.present", &present, self.present.clone());
        (self.begun, self.filled)
    }

    /// Reads everything from a state.
    ///
    /// # Errors
    /// The tensor that is missing or has another shape.
    pub fn load(&mut self, state: &mut State, (begun, filled): (u64, usize)) -> Result<()> {
        let [known, actions, rewards, present] = self.extent.shapes();
        self.known = state.take_f32("replay.known", &known)?;
        self.actions = state.take_f32("replay.actions", &actions)?;
        self.rewards = state.take_f32("replay.rewards", &rewards)?;
        self.present = state.take_u8("replay.present", &present)?;
        (self.begun, self.filled) = (begun, filled.min(self.extent.slots));
        Ok(())
    }

    /// Transitions that can be drawn, and the complete episodes before the newest.
    fn starts(&self, n: usize) -> (usize, usize) {
        let extent = &self.extent;
        let whole = (self.begun.saturating_sub(1) as usize).min(extent.episodes - 1);
        let newest = (self.filled + 1).saturating_sub(n);
        let each = extent.slots + 1 - n;
        ((whole * each + newest) * extent.worlds, whole)
    }

    fn newest(&self) -> usize {
        (self.begun.saturating_sub(1) % self.extent.episodes as u64) as usize
    }

    fn rows(&self) -> usize {
        self.extent.worlds * self.extent.vehicles
    }
}

impl Batch {
    /// The samples as critics see them: now, or n slots later.
    pub fn view<'a>(&'a self, extent: &Extent, known: &'a [f32]) -> View<'a> {
        View {
            vehicles: extent.vehicles,
            observations: known,
            width: extent.known,
            observed: extent.observed,
            present: &self.present,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::laboratory::random::initial;

    const EXTENT: Extent = Extent {
        episodes: 3,
        slots: 6,
        worlds: 2,
        vehicles: 2,
        known: 1,
        observed: 1,
        action: 1,
    };

    /// What is known says where it is from: 100 episode + 10 slot + world + vehicle / 10. So does the reward of that slot.
    fn mark(episode: usize, slot: usize, row: usize) -> f32 {
        (100 * episode + 10 * slot + row / 2) as f32 + (row % 2) as f32 / 10.0
    }

    fn play(replay: &mut Replay, episode: usize, slots: usize) {
        replay.begin(2);
        for slot in 0..=slots {
            let known = replay.known();
            known
                .iter_mut()
                .enumerate()
                .for_each(|(row, value)| *value = mark(episode, slot, row));
            if slot < slots {
                let (actions, rewards) = replay.outcome();
                actions.fill(slot as f32);
                rewards
                    .iter_mut()
                    .enumerate()
                    .for_each(|(row, value)| *value = mark(episode, slot, row));
                replay.advance();
            }
        }
    }

    #[test]
    fn samples_look_ahead_within_their_episode_and_the_oldest_makes_room() {
        let mut replay = Replay::new(EXTENT);
        (0..4).for_each(|episode| play(&mut replay, episode, 6));
        play(&mut replay, 4, 3);
        // Episodes 2 and 3 are whole, with 4 starts each; episode 4 has 1: times two worlds.
        assert_eq!(replay.transitions(3), 2 * (4 + 4 + 1));
        let (mut batch, mut stream) = (Batch::default(), initial(1, 0));
        replay.sample(2000, 3, 0.5, &mut stream, &mut batch);
        let mut seen = std::collections::BTreeSet::new();
        for sample in 0..2000 {
            let (known, later) = (batch.known[2 * sample], batch.later[2 * sample]);
            let _new = seen.insert(known as u32);
            assert_eq!(later, known + 30.0, "three slots later in the same world");
            assert_eq!(batch.known[2 * sample + 1], known + 0.1);
            assert_eq!(
                batch.rewards[2 * sample],
                known + 0.5 * (known + 10.0) + 0.25 * (known + 20.0)
            );
            assert_eq!(batch.actions[2 * sample], (known as u32 / 10 % 10) as f32);
        }
        let starts = |episode: u32, slots: u32| {
            (0..slots).flat_map(move |slot| [0, 1].map(|w| 100 * episode + 10 * slot + w))
        };
        let expected: std::collections::BTreeSet<u32> =
            starts(2, 4).chain(starts(3, 4)).chain(starts(4, 1)).collect();
        assert_eq!(seen, expected, "every start is drawn, and no other");
    }
}
