//! Every form of observation and output against real-valued formulas in f64, and against plain searches.

use crate::readings::Readings;
use crate::table_builder::Contents;
use firmware::actor::Actor;
use firmware::decision::{Decision, PowerPlan, SUB_CHANNEL_CHOICES};
use firmware::form::{CONTINUOUS_ONE, ObservationForm, OutputForm};
use firmware::network::MAX_OUTPUTS;
use firmware::observation::{ONE, ONE_HOT_AGES, ONE_HOT_INPUTS, Observation, UNIFORM_ONE};
use firmware::table::Table;
use firmware::units::{Dbm, Level, MAX_SUB_CHANNELS, SlotIndex, SubChannel};
use proptest::prelude::*;

const STEP: f64 = 256.0;

/// The paper's three levels.
fn three(levels: [i16; 3]) -> [i16; MAX_SUB_CHANNELS] {
    std::array::from_fn(|n| levels.get(n).copied().unwrap_or(0))
}

fn encoded(form: ObservationForm, observation: &Observation, required_sinr: Level) -> Vec<i8> {
    let inputs = form.encode(observation, required_sinr, <[i8]>::to_vec);
    assert_eq!(inputs.len(), form.inputs());
    inputs
}

#[test]
fn the_papers_state_is_in_the_cells_order_and_rounded_to_the_nearest_code() {
    let nearest = |code: i8, real: f64, what: &str| {
        let clamped = real.clamp(-128.0, 127.0);
        assert!(
            (f64::from(code) - clamped).abs() <= 0.62,
            "{what}: {code} for {real}"
        );
    };
    for bits in (i16::MIN..=i16::MAX).step_by(7) {
        for home in 0..3 {
            let readings = Readings {
                gain: three([bits, bits / 2, bits / 3]),
                interference: three([bits, bits / 2, bits / 3].map(|bits| bits.max(0))),
                age: Some(1 + u32::from(bits.unsigned_abs()) % 130),
                place: Some((home, true)),
                ..Readings::default()
            };
            let inputs = encoded(ObservationForm::Paper, &readings.observation(), Level::ZERO);
            assert_eq!(inputs.len(), 7);
            for n in 0..3 {
                let decibels = |levels: [i16; MAX_SUB_CHANNELS]| f64::from(levels[n]) / STEP;
                nearest(inputs[n], 64.0 * (decibels(readings.gain) - 35.0) / 20.0, "gain");
                nearest(
                    inputs[3 + n],
                    64.0 * decibels(readings.interference) / 40.0,
                    "interference",
                );
            }
            assert_eq!(inputs[6] as u32, readings.slots().min(100));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn an_age_is_one_flag_beside_the_levels_from_the_places_remainder_on(
        gain in prop::array::uniform3(any::<i16>()),
        interference in prop::array::uniform3(0..i16::MAX),
        (age, place, identity) in (prop_oneof![1..60_u32, 1..70_000_u32], any::<Option<u16>>(), any::<u32>()),
        required in any::<i16>(),
    ) {
        let readings = Readings {
            gain: three(gain),
            interference: three(interference),
            age: Some(age),
            place: place.map(|index| (index, false)),
            identity,
            ..Readings::default()
        };
        let (observation, level) = (readings.observation(), Level::from_bits(required));
        prop_assert_eq!(encoded(ObservationForm::Ring, &observation, level), observation.encode(level));
        let inputs = encoded(ObservationForm::AgeOneHot, &observation, level);
        prop_assert_eq!(inputs.len(), ONE_HOT_INPUTS);
        let (ages, rest) = inputs.split_at(ONE_HOT_AGES);
        for (slots, &flag) in (1..).zip(ages) {
            prop_assert_eq!(flag, if (age as usize).min(ONE_HOT_AGES) == slots { ONE } else { 0 });
        }
        let near = |code: i8, real: f64| (f64::from(code) - real.clamp(-128.0, 127.0)).abs() <= 1.06;
        for offset in 0..3 {
            let sub_channel = (usize::from(place.unwrap_or(0)) + offset) % 3;
            let (gain, noise) = (gain[sub_channel], interference[sub_channel]);
            prop_assert!(near(rest[offset], 64.0 * (f64::from(gain) / STEP - 35.0) / 20.0));
            prop_assert_eq!(rest[3 + offset], if gain >= required { ONE } else { 0 });
            prop_assert!(near(rest[6 + offset], 64.0 * f64::from(noise) / STEP / 40.0));
        }
        let lot = f64::from(readings.identity().lot(SlotIndex(readings.slot)) >> 16);
        let uniform = lot / 65_536.0 * f64::from(UNIFORM_ONE);
        prop_assert!((f64::from(rest[9]) - (uniform + 0.5).floor()).abs() < 1e-9);
    }

    #[test]
    fn the_first_largest_choice_is_carried_out(
        scores in prop::array::uniform8(prop_oneof![any::<i32>(), -2..3, Just(i32::MIN)]),
        gain in prop::array::uniform3(any::<i16>()),
        place in any::<Option<u16>>(),
        first_level in any::<i16>(),
    ) {
        let readings = Readings {
            gain: three(gain),
            place: place.map(|index| (index, true)),
            ..Readings::default()
        };
        let (observation, full) = (readings.observation(), i32::from(readings.max_power));
        let plan = PowerPlan { joiner_levels: [first_level; 4].map(Level::from_bits) };
        for (form, least) in [(OutputForm::SubChannels, 0), (OutputForm::SendingSubChannels, 1)] {
            let choices = &scores[least..SUB_CHANNEL_CHOICES];
            let largest = choices.iter().max().unwrap();
            let choice = least + choices.iter().position(|score| score == largest).unwrap();
            let found = form.decision(&scores, &observation, &plan);
            let Some(sending) = choice.checked_sub(1) else {
                prop_assert_eq!(found, Decision::Silent);
                continue;
            };
            let index = (usize::from(place.unwrap_or(0)) + sending % 3) % 3;
            let reduction = if sending < 3 { 0 } else { (i32::from(gain[index]) - i32::from(first_level)).clamp(0, 32_767) };
            let power = Dbm::from_bits((full - reduction).max(-32_768) as i16);
            let sub_channel = SubChannel::new(index as u8).unwrap();
            prop_assert_eq!(found, Decision::Transmit { sub_channel, power });
        }
    }
}

fn continuous(a: i32, b: i32, max_power: i16) -> Decision {
    let plan = PowerPlan {
        joiner_levels: [Level::ZERO; 4],
    };
    let readings = Readings {
        max_power,
        ..Readings::default()
    };
    let mut outputs = [77; MAX_OUTPUTS];
    outputs[..2].copy_from_slice(&[a, b]);
    OutputForm::SubChannelAndPower.decision(&outputs, &readings.observation(), &plan)
}

#[test]
fn continuous_outputs_are_the_papers_sub_channel_and_power() {
    let full = 30 << 8;
    let mut worst = 0.0_f64;
    for b in -20 * CONTINUOUS_ONE..=20 * CONTINUOUS_ONE {
        let real = f64::from(b) / f64::from(CONTINUOUS_ONE);
        // (1 + tanh b) / 2 in 1/256 dB below full power.
        let reduction = 2560.0 * libm::log1p(libm::exp(-2.0 * real)) / std::f64::consts::LN_10;
        match continuous(0, b, full) {
            Decision::Transmit { power, .. } => {
                let error = f64::from(full) - reduction - f64::from(power.to_bits());
                worst = worst.max(error.abs());
                assert!(power.to_bits() <= full, "{b}");
            }
            Decision::Silent => assert!(reduction > 75.0 * STEP - 2.0, "{b}: {reduction}"),
        }
    }
    println!("power: at most {worst:.2} / 256 dB off");
    assert!(worst < 1.7, "{worst}");

    for a in -20 * CONTINUOUS_ONE..=20 * CONTINUOUS_ONE {
        let place = 3.0 * (1.0 + libm::tanh(f64::from(a) / f64::from(CONTINUOUS_ONE))) / 2.0;
        let Decision::Transmit { sub_channel, .. } = continuous(a, 0, full) else {
            panic!("half the power is not silence");
        };
        assert_eq!(sub_channel.index(), (place as usize).min(2), "{a}");
    }

    let last = SubChannel::new(2).unwrap();
    assert_eq!(
        continuous(i32::MAX, i32::MAX, i16::MAX),
        Decision::Transmit {
            sub_channel: last,
            power: Dbm::from_bits(i16::MAX)
        }
    );
    assert_eq!(continuous(i32::MIN, i32::MIN, i16::MIN), Decision::Silent);
    // Half of the least full power is less than a unit can say: it stays there.
    assert_eq!(
        continuous(0, 0, i16::MIN),
        Decision::Transmit {
            sub_channel: SubChannel::new(1).unwrap(),
            power: Dbm::from_bits(i16::MIN)
        }
    );
}

/// An actor is its parts one after the other, whatever the form.
#[test]
fn actors_of_all_forms_decide_by_their_forms() {
    for (index, observation_form) in (0..).zip(ObservationForm::ALL) {
        for (code, output_form) in (0..).zip(OutputForm::ALL) {
            let bytes = Contents::in_form(5, index, code).bytes();
            let table = Table::parse(&bytes).unwrap();
            assert_eq!(table.observation_form(), observation_form);
            assert_eq!(table.output_form(), output_form);
            let mut actor = Actor::new(table.clone());
            let mut decisions = Vec::new();
            for age in 1..=100_i16 {
                let gain = three([40 - age / 4, age / 3, 20].map(|level| level << 8));
                let readings = Readings {
                    gain,
                    age: Some(age.unsigned_abs().into()),
                    place: Some((age.unsigned_abs() % 20, true)),
                    open: 0b111,
                    ..Readings::default()
                };
                let observation = readings.observation();
                let outputs = actor.infer(&encoded(observation_form, &observation, table.required_sinr()));
                let expected = output_form.decision(&outputs, &observation, table.power_plan());
                assert_eq!(actor.decide(&observation), expected);
                if !decisions.contains(&expected) {
                    decisions.push(expected);
                }
            }
            assert!(
                decisions.len() > 1,
                "{observation_form:?} {output_form:?} always decides alike"
            );
        }
    }
}
