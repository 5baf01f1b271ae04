//! Ages that training begins with: a learner that always starts from the largest ages never sees how everybody takes turns.

use crate::laboratory::random::shuffle;
use firmware::units::Age;
use host_sim::environment::Environment;
use host_sim::stream::Stream;

/// Slots of the paper's time constraint.
const LARGEST: u32 = Age::TIME_CONSTRAINT.slots() as u32;

/// For learners that meet every load: in each world all at the largest age, or everybody in turn (some of them lost), or uniform
/// (chosen).
pub fn for_every_load(environment: &mut Environment<'_>, stream: &mut Stream) {
    let sub_channels = environment.sub_channels();
    for world in 0..environment.worlds() {
        let kind = stream.uniform();
        if kind < 0.35 {
            continue;
        }
        let uniform = |stream: &mut Stream| Age::after(1 + stream.below(LARGEST));
        let mut order: Vec<usize> = (0..environment.vehicles()).collect();
        shuffle(&mut order, stream);
        for (turn, &vehicle) in order.iter().enumerate() {
            let lost = kind < 0.55 && stream.chance(0.1);
            let age = if kind >= 0.65 || lost {
                uniform(stream)
            } else {
                Age::after(1 + (turn / sub_channels) as u32)
            };
            environment.set_age(world, vehicle, age);
        }
    }
}

/// For a load curriculum: in this share of the worlds everybody in turn (some of them lost); of the others half all at the largest
/// age, a quarter packed as many a slot as there are sub-channels, a quarter uniform up to 29 slots (chosen).
pub fn in_turn_or_else(share: f32, environment: &mut Environment<'_>, stream: &mut Stream) {
    let sub_channels = environment.sub_channels();
    for world in 0..environment.worlds() {
        let in_turn = stream.uniform() < share;
        let kind = stream.uniform();
        let lost_share = f64::from(0.1 * stream.uniform());
        if !in_turn && kind < 0.5 {
            continue;
        }
        let mut order: Vec<usize> = (0..environment.vehicles()).collect();
        shuffle(&mut order, stream);
        let frame = order.len().div_ceil(sub_channels) as u32;
        for (place, &vehicle) in order.iter().enumerate() {
            let turn = 1 + (place / sub_channels) as u32;
            let slots = if in_turn && stream.chance(lost_share) {
                if stream.chance(0.5) { LARGEST } else { turn + frame }
            } else if in_turn || kind < 0.75 {
                turn
            } else {
                1 + stream.below(29)
            };
            environment.set_age(world, vehicle, Age::after(slots));
        }
    }
}
