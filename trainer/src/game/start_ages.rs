//! Ages that training begins with: a learner that always starts from the largest ages never sees how everybody takes turns.

use crate::laboratory::random::shuffle;
use firmware::units::{Age, SUB_CHANNELS};
use host_sim::environment::Environment;
use host_sim::stream::Stream;

/// For learners that meet every load: in each world all at the largest age, or everybody in turn (some of them lost), or uniform
/// (chosen).
pub fn for_every_load(environment: &mut Environment<'_>, stream: &mut Stream) {
    for world in 0..environment.worlds() {
        let kind = stream.uniform();
        if kind < 0.35 {
            continue;
        }
        let uniform = |stream: &mut Stream| Age::after(1 + stream.below(u32::from(Age::MAX.slots())));
        let mut members: [Vec<usize>; SUB_CHANNELS] = Default::default();
        for vehicle in 0..environment.vehicles() {
            if let Some(broadcast) = environment.broadcast(world, vehicle) {
                members[broadcast.home.index()].push(vehicle);
            }
        }
        for group in &mut members {
            shuffle(group, stream);
            for (age, &vehicle) in (1..).zip(group.iter()) {
                let lost = kind < 0.55 && stream.chance(0.1);
                let age = if kind >= 0.65 || lost {
                    uniform(stream)
                } else {
                    Age::after(age)
                };
                environment.set_age(world, vehicle, age);
            }
        }
    }
}

/// For a load curriculum: in this share of the worlds everybody in turn (some of them lost); of the others half all at the largest
/// age, a quarter packed as three a slot, a quarter uniform up to 29 slots (chosen).
pub fn in_turn_or_else(share: f32, environment: &mut Environment<'_>, stream: &mut Stream) {
    for world in 0..environment.worlds() {
        let in_turn = stream.uniform() < share;
        let kind = stream.uniform();
        let lost_share = f64::from(0.1 * stream.uniform());
        if !in_turn && kind < 0.5 {
            continue;
        }
        let mut order: Vec<usize> = (0..environment.vehicles()).collect();
        shuffle(&mut order, stream);
        let mut turns = [0; SUB_CHANNELS];
        for (place, &vehicle) in order.iter().enumerate() {
            let Some(broadcast) = environment.broadcast(world, vehicle) else {
                continue;
            };
            let turn = &mut turns[broadcast.home.index()];
            *turn += 1;
            let slots = if in_turn && stream.chance(lost_share) {
                if stream.chance(0.5) {
                    u32::from(Age::MAX.slots())
                } else {
                    *turn + u32::from(broadcast.period.slots())
                }
            } else if in_turn {
                *turn
            } else if kind < 0.75 {
                1 + (place / SUB_CHANNELS) as u32
            } else {
                1 + stream.below(29)
            };
            environment.set_age(world, vehicle, Age::after(slots));
        }
    }
}
