//! Generalised advantage estimation (Schulman et al., "High-dimensional continuous control using generalized advantage
//! estimation", ICLR 2016, eqs. 11 to 16).

/// Advantages of every agent in every slot.
///
/// # Shape
/// `rewards` is `[slot][agent]`, `values` too, with one more slot: the state after the last reward. No slot ends an episode:
/// a rollout that stops is bootstrapped with the value of the state that it stopped in.
pub fn advantages(rewards: &[f32], values: &[f32], agents: usize, discount: f32, trace: f32) -> Vec<f32> {
    let mut advantages = vec![0.0; rewards.len()];
    let mut later = vec![0.0; agents];
    for start in (0..rewards.len()).step_by(agents.max(1)).rev() {
        for (agent, later) in later.iter_mut().enumerate() {
            let now = start + agent;
            let difference = rewards[now] + discount * values[now + agents] - values[now];
            *later = difference + discount * trace * *later;
            advantages[now] = *later;
        }
    }
    advantages
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_slots_by_hand() {
        // One agent, discount 1/2, trace 1/2. Differences: 2 + 4/2 - 2 = 2, 0 + 8/2 - 4 = 0, 4 + 4/2 - 8 = -2.
        let found = advantages(&[2.0, 0.0, 4.0], &[2.0, 4.0, 8.0, 4.0], 1, 0.5, 0.5);
        assert_eq!(found, [2.0 + 0.25 * (0.25 * -2.0), 0.25 * -2.0, -2.0]);
    }

    #[test]
    fn agents_do_not_mix_and_the_ends_of_trace_are_right() {
        let (rewards, values) = ([1.0, 10.0, 2.0, 20.0], [0.0, 5.0, 3.0, 0.0, 7.0, 1.0]);
        // Trace 0: one-step differences.
        let found = advantages(&rewards, &values, 2, 1.0, 0.0);
        assert_eq!(found, [1.0 + 3.0, 10.0 - 5.0, 2.0 + 7.0 - 3.0, 20.0 + 1.0]);
        // Trace 1: the whole return less the value.
        let found = advantages(&rewards, &values, 2, 1.0, 1.0);
        assert_eq!(
            found,
            [1.0 + 2.0 + 7.0, 10.0 + 20.0 + 1.0 - 5.0, 2.0 + 7.0 - 3.0, 21.0]
        );
    }
}
