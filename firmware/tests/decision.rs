//! Decisions are total and keep the paper's C3 and C4.

use crate::observation::Readings;
use firmware::decision::{ACTIONS, Action, Decision, PowerPlan};
use firmware::units::{Dbm, Level};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_first_largest_output_wins(outputs in prop::array::uniform6(prop_oneof![any::<i32>(), -2..3, Just(i32::MIN)])) {
        let largest = *outputs.iter().max().unwrap();
        let first = outputs.iter().position(|&output| output == largest).unwrap();
        prop_assert_eq!(Action::from_outputs(&outputs) as usize, first);
    }

    #[test]
    fn every_decision_is_legal_and_joiners_meet_their_level(
        gain in prop::array::uniform3(any::<i16>()),
        home in 0_u8..3,
        max_power in any::<i16>(),
        levels in prop::array::uniform4(any::<i16>()),
    ) {
        let observation = Readings { gain, home, ..Readings::default() }.observation();
        let plan = PowerPlan { max_power: Dbm::from_bits(max_power), joiner_levels: levels.map(Level::from_bits) };
        for action in Action::ALL {
            let decision = plan.decision(action, &observation);
            let Decision::Transmit { sub_channel, power } = decision else {
                prop_assert_eq!(action, Action::Silent);
                continue;
            };
            prop_assert!(action != Action::Silent);
            prop_assert_eq!(sub_channel.index(), usize::from(home));
            prop_assert!(power <= plan.max_power);
            let joiner = Action::JOINERS.iter().position(|&joiner| joiner == action);
            let Some(joiner) = joiner else {
                prop_assert_eq!(power, plan.max_power);
                continue;
            };
            // Received at the level, at full power where that is not enough, and never below what 16 bits can say.
            let own = i32::from(gain[usize::from(home)]);
            let wanted = (i32::from(max_power) - (own - i32::from(levels[joiner])).clamp(0, i32::from(i16::MAX)))
                .max(i32::from(i16::MIN));
            prop_assert_eq!(i32::from(power.to_bits()), wanted);
        }
    }
}

#[test]
fn silence_wins_every_tie() {
    for value in [i32::MIN, -1, 0, i32::MAX] {
        assert_eq!(Action::from_outputs(&[value; ACTIONS]), Action::Silent);
    }
}
