//! Generalised advantage estimation (Schulman et al., "High-dimensional continuous control using generalized advantage
//! estimation", ICLR 2016, eqs. 11 to 16).

/// Advantages of every agent in every slot.
///
/// # Shape
/// `rewards` and `ended` are `[slot][agent]`, `values` too, with one more slot: the state after the last reward. Where an agent
/// ended nothing follows for it: the next value in its row is another's. A rollout that stops ends nobody: it is bootstrapped with the
/// value of the state that it stopped in.
pub fn advantages(
    rewards: &[f32],
    values: &[f32],
    ended: &[bool],
    agents: usize,
    discount: f32,
    trace: f32,
) -> Vec<f32> {
    let mut advantages = vec![0.0; rewards.len()];
    let mut later = vec![0.0; agents];
    for start in (0..rewards.len()).step_by(agents.max(1)).rev() {
        for (agent, later) in later.iter_mut().enumerate() {
            let now = start + agent;
            let (next, after) = if ended[now] {
                (0.0, 0.0)
            } else {
                (values[now + agents], *later)
            };
            let difference = rewards[now] + discount * next - values[now];
            *later = difference + discount * trace * after;
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
        let found = advantages(&[2.0, 0.0, 4.0], &[2.0, 4.0, 8.0, 4.0], &[false; 3], 1, 0.5, 0.5);
        assert_eq!(found, [2.0 + 0.25 * (0.25 * -2.0), 0.25 * -2.0, -2.0]);
    }

    #[test]
    fn agents_do_not_mix_and_the_ends_of_trace_are_right() {
        let (rewards, values) = ([1.0, 10.0, 2.0, 20.0], [0.0, 5.0, 3.0, 0.0, 7.0, 1.0]);
        // Trace 0: one-step differences.
        let found = advantages(&rewards, &values, &[false; 4], 2, 1.0, 0.0);
        assert_eq!(found, [1.0 + 3.0, 10.0 - 5.0, 2.0 + 7.0 - 3.0, 20.0 + 1.0]);
        // Trace 1: the whole return less the value.
        let found = advantages(&rewards, &values, &[false; 4], 2, 1.0, 1.0);
        assert_eq!(
            found,
            [1.0 + 2.0 + 7.0, 10.0 + 20.0 + 1.0 - 5.0, 2.0 + 7.0 - 3.0, 21.0]
        );
    }

    #[test]
    fn nothing_that_comes_after_its_end_is_an_agent_s() {
        let (rewards, values) = ([1.0, 10.0, 2.0, 20.0], [0.0, 5.0, 3.0, 0.0, 7.0, 1.0]);
        // The first agent ends with the first slot, the second one stays. Trace and discount 1.
        let found = advantages(&rewards, &values, &[true, false, false, false], 2, 1.0, 1.0);
        assert_eq!(found, [1.0, 10.0 + 20.0 + 1.0 - 5.0, 2.0 + 7.0 - 3.0, 21.0]);
        // Another stranger's state changes nothing of it.
        let other = advantages(
            &[1.0, 10.0, -50.0, 20.0],
            &[0.0, 5.0, -90.0, 0.0, 70.0, 1.0],
            &[true, false, false, false],
            2,
            1.0,
            1.0,
        );
        assert_eq!((other[0], other[1]), (found[0], found[1]));
    }
}
