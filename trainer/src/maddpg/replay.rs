//! What happened, episode by episode, for learning from it later (the paper's D).

use super::view::View;
use crate::laboratory::state::{Part, State};
use host_sim::stream::Stream;
use kit::error::Result;
use std::ops::Range;

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

/// Transitions in a full replay with room for so many world-slots: of whole episodes, without the slots from which n steps lead beyond
/// their end.
pub fn most_transitions(room: usize, worlds: usize, slots: usize, n: usize) -> usize {
    room / (worlds * slots) * worlds * (slots + 1 - n)
}

impl Extent {
    /// Shapes of what an episode holds: what is known, actions, rewards and ends.
    fn shapes(&self) -> [Vec<usize>; 4] {
        let (slots, rows) = (self.slots, [self.worlds, self.vehicles]);
        [
            [&[slots + 1], &rows[..], &[self.known]].concat(),
            [&[slots], &rows[..], &[self.action]].concat(),
            [&[slots], &rows[..]].concat(),
            [&[slots], &rows[..]].concat(),
        ]
    }

    /// How many values an episode has of each.
    fn lengths(&self) -> [usize; 4] {
        self.shapes().map(|shape| shape.iter().product())
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
    /// `[episode][slot][world][vehicle]`: 1 where a vehicle's agent ended with the slot and another's begins in its row, else 0.
    ended: Vec<u8>,
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
    /// `[sample][vehicle]`: rewards of n slots, discounted, whoever the vehicle is in each of them: parts of the cell's reward.
    pub rewards: Vec<f32>,
    /// `[sample][vehicle]`: the same of the agent that acted alone, up to its end.
    pub own_rewards: Vec<f32>,
    /// `[sample]`: weight of the cell's value n slots later: the discount of n slots, or 0 where the time limit ends it.
    pub later_weight: Vec<f32>,
    /// `[sample][vehicle]`: weight of a vehicle's own value n slots later: as the cell's, and 0 where its agent has ended.
    pub own_later_weight: Vec<f32>,
    /// `[sample]`.
    pub present: Vec<u8>,
}

/// How far a return looks ahead (Sutton and Barto 2018, section 7.1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Return {
    /// Slots whose rewards it adds up, n.
    pub steps: usize,
    /// Factor from a slot to the next.
    pub discount: f32,
    /// Whether a world is worth nothing at the time limit, instead of what its critics say.
    pub ends_at_limit: bool,
}

impl Replay {
    /// An empty one.
    pub fn new(extent: Extent) -> Self {
        let [known, actions, rewards, ended] = extent.lengths().map(|length| length * extent.episodes);
        Self {
            known: vec![0.0; known],
            actions: vec![0.0; actions],
            rewards: vec![0.0; rewards],
            ended: vec![0; ended],
            present: vec![0; extent.episodes],
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

    /// The slot is done, and with it these agents, `[world][vehicle]`.
    pub fn advance(&mut self, ended: &[bool]) {
        let place = self.newest() * self.extent.slots + self.filled;
        let room = &mut self.ended[place * ended.len()..][..ended.len()];
        for (room, &ended) in room.iter_mut().zip(ended) {
            *room = u8::from(ended);
        }
        self.filled += 1;
    }

    /// Uniform samples of transitions, with what was known n slots later: the last slots of an episode are only looked at from n
    /// slots before its end. An agent that ends is paid for nothing after it; the cell goes on.
    pub fn sample(&self, count: usize, sought: Return, stream: &mut Stream, batch: &mut Batch) {
        let (extent, n) = (&self.extent, sought.steps);
        let (total, whole) = self.starts(n);
        let each = (extent.slots + 1 - n) * extent.worlds;
        batch.clear();
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
            batch.own_rewards.resize(first + rows, 0.0);
            batch.own_later_weight.resize(first + rows, 1.0);
            let mut factor = 1.0;
            for step in 0..n {
                let place = place(slot + step) * rows;
                for row in 0..rows {
                    let reward = factor * self.rewards[place + row];
                    batch.rewards[first + row] += reward;
                    let acts = &mut batch.own_later_weight[first + row];
                    batch.own_rewards[first + row] += *acts * reward;
                    *acts *= f32::from(1 - self.ended[place + row]);
                }
                factor *= sought.discount;
            }
            if sought.ends_at_limit && slot + n == extent.slots {
                factor = 0.0;
            }
            batch.later_weight.push(factor);
            batch.own_later_weight[first..]
                .iter_mut()
                .for_each(|weight| *weight *= factor);
            batch.present.push(self.present[episode]);
        }
    }

    /// Writes everything into a state, an episode a part.
    pub fn save(&self, state: &mut State) -> (u64, usize) {
        let [known, actions, rewards, ended] = self.extent.shapes();
        for number in self.held() {
            let episode = self.place(number);
            let mut part = Part::default();
            part.put("known", &known, of(&self.known, episode, &known).to_vec());
            part.put("actions", &actions, of(&self.actions, episode, &actions).to_vec());
            part.put("rewards", &rewards, of(&self.rewards, episode, &rewards).to_vec());
            part.put("ended", &ended, of(&self.ended, episode, &ended).to_vec());
            part.put("present", &[1], vec![self.present[episode]]);
            let before = state.parts.insert(part_name(number), part);
            assert!(before.is_none(), "episode {number} twice");
        }
        (self.begun, self.filled)
    }

    /// Reads everything from a state.
    ///
    /// # Errors
    /// The part or tensor that is missing or has another shape.
    pub fn load(&mut self, state: &mut State, (begun, filled): (u64, usize)) -> Result<()> {
        let [known, actions, rewards, ended] = self.extent.shapes();
        (self.begun, self.filled) = (begun, filled.min(self.extent.slots));
        for number in self.held() {
            let (name, episode) = (part_name(number), self.place(number));
            let mut part = state.take_part(&name)?;
            let mut read = || -> Result<()> {
                of_mut(&mut self.known, episode, &known).copy_from_slice(&part.take_f32("known", &known)?);
                of_mut(&mut self.actions, episode, &actions)
                    .copy_from_slice(&part.take_f32("actions", &actions)?);
                of_mut(&mut self.rewards, episode, &rewards)
                    .copy_from_slice(&part.take_f32("rewards", &rewards)?);
                of_mut(&mut self.ended, episode, &ended).copy_from_slice(&part.take_u8("ended", &ended)?);
                self.present[episode] = part.take_u8("present", &[1])?[0];
                Ok(())
            };
            read().map_err(|error| error.within(&name))?;
        }
        Ok(())
    }

    /// Bytes of its parts when it is full.
    pub fn bytes(&self) -> u64 {
        let [known, actions, rewards, ended] = self.extent.lengths().map(|length| length as u64);
        self.extent.episodes as u64 * (4 * (known + actions + rewards) + ended + 1)
    }

    /// The episodes that it holds, counted from the run's first.
    fn held(&self) -> Range<u64> {
        self.begun.saturating_sub(self.extent.episodes as u64)..self.begun
    }

    /// Where an episode lies.
    fn place(&self, number: u64) -> usize {
        (number % self.extent.episodes as u64) as usize
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
        self.place(self.begun.saturating_sub(1))
    }

    fn rows(&self) -> usize {
        self.extent.worlds * self.extent.vehicles
    }
}

/// The part of a state that holds an episode.
fn part_name(number: u64) -> String {
    format!("replay.{number:08}")
}

/// An episode's values, of this shape.
fn of<'v, T>(values: &'v [T], episode: usize, shape: &[usize]) -> &'v [T] {
    let length: usize = shape.iter().product();
    &values[episode * length..][..length]
}

fn of_mut<'v, T>(values: &'v mut [T], episode: usize, shape: &[usize]) -> &'v mut [T] {
    let length: usize = shape.iter().product();
    &mut values[episode * length..][..length]
}

impl Batch {
    fn clear(&mut self) {
        for values in [
            &mut self.known,
            &mut self.later,
            &mut self.actions,
            &mut self.rewards,
            &mut self.own_rewards,
            &mut self.later_weight,
            &mut self.own_later_weight,
        ] {
            values.clear();
        }
        self.present.clear();
    }

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

    /// Three slots at half the value each.
    const SOUGHT: Return = Return {
        steps: 3,
        discount: 0.5,
        ends_at_limit: false,
    };

    fn play(replay: &mut Replay, episode: usize, slots: usize, ended: impl Fn(usize) -> [bool; 4]) {
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
                replay.advance(&ended(slot));
            }
        }
    }

    #[test]
    fn samples_look_ahead_within_their_episode_and_the_oldest_makes_room() {
        let mut replay = Replay::new(EXTENT);
        (0..4).for_each(|episode| play(&mut replay, episode, 6, |_| [false; 4]));
        play(&mut replay, 4, 3, |_| [false; 4]);
        // Episodes 2 and 3 are whole, with 4 starts each; episode 4 has 1: times two worlds.
        assert_eq!(replay.transitions(3), 2 * (4 + 4 + 1));
        let (mut batch, mut stream) = (Batch::default(), initial(1, 0));
        replay.sample(2000, SOUGHT, &mut stream, &mut batch);
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
    /// The second vehicle of the first world is replaced with slot 2: by hand, what each start is then paid and how much the value
    /// three slots later counts.
    #[test]
    fn who_is_replaced_is_paid_for_nothing_after_it() {
        let mut replay = Replay::new(Extent {
            episodes: 1,
            ..EXTENT
        });
        play(&mut replay, 0, 6, |slot| [false, slot == 2, false, false]);
        let sample = |ends_at_limit| {
            let (mut batch, mut stream) = (Batch::default(), initial(1, 0));
            let sought = Return {
                ends_at_limit,
                ..SOUGHT
            };
            replay.sample(200, sought, &mut stream, &mut batch);
            let mut found = std::collections::BTreeMap::new();
            for (index, known) in batch.known.chunks(2).enumerate() {
                let of = |values: &[f32]| [values[2 * index], values[2 * index + 1]];
                let cell = batch.later_weight[index];
                let (slot, world) = (known[0] as usize / 10, known[0] as usize % 10);
                let own = (of(&batch.own_rewards), of(&batch.own_later_weight));
                let _same = found.insert((world, slot), (of(&batch.rewards), own, cell));
            }
            found
        };
        let found = sample(false);
        assert_eq!(found.len(), 8, "four starts in each of two worlds");
        let rewards =
            |row, slot| mark(0, slot, row) + 0.5 * mark(0, slot + 1, row) + 0.25 * mark(0, slot + 2, row);
        for (&(world, slot), &(all, (own, own_weight), weight)) in &found {
            let both = [rewards(2 * world, slot), rewards(2 * world + 1, slot)];
            assert_eq!((all, weight), (both, 0.125));
            let (paid, counts) = match (world, slot) {
                (0, 0) => (both[1], 0.0),
                (0, 1) => (10.1 + 0.5 * 20.1, 0.0),
                (0, 2) => (20.1, 0.0),
                _ => (both[1], 0.125),
            };
            assert_eq!(
                (own, own_weight),
                ([both[0], paid], [0.125, counts]),
                "{world}, {slot}"
            );
        }
        // Start 3 looks to the time limit, where nothing may be left.
        let limited = sample(true);
        for (start, (all, (own, own_weight), weight)) in limited {
            let (all_before, (own_before, weight_before), _) = found[&start];
            assert_eq!((all, own), (all_before, own_before));
            let expected = if start.1 == 3 {
                (0.0, [0.0; 2])
            } else {
                (0.125, weight_before)
            };
            assert_eq!((weight, own_weight), expected);
        }
    }
}
