//! The actor against its specification, computed independently in wide integers and in real numbers.

use crate::table_builder::{Contents, Layer};
use firmware::actor::Actor;
use firmware::decision::ACTIONS;
use firmware::observation::INPUTS;
use firmware::table::Table;
use proptest::prelude::*;
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;

/// `(accumulator * multiplier + 2^31) >> 32` as floor(x / 2^32 + 1/2), in integers too wide to overflow. Also checks that it
/// is the nearest integer to the real quotient.
fn scaled(layer: &Layer, activations: &[i128]) -> Vec<i128> {
    let rows = layer.weights.iter().zip(&layer.biases).zip(&layer.multipliers);
    rows.map(|((row, &bias), &multiplier)| {
        let sum: i128 = row
            .iter()
            .zip(activations)
            .map(|(&w, &a)| i128::from(w) * a)
            .sum();
        let accumulator = i128::from(bias) + sum;
        assert!(i32::try_from(accumulator).is_ok(), "an accumulator overflows");
        let product = accumulator * i128::from(multiplier);
        let scaled = (product + (1 << 31)).div_euclid(1 << 32);
        let real = product as f64 / 4_294_967_296.0;
        assert!((scaled as f64 - real).abs() <= 0.5 + 1e-6, "{scaled} for {real}");
        scaled
    })
    .collect()
}

fn reference(contents: &Contents, input: &[i8; INPUTS]) -> Vec<i128> {
    let mut activations: Vec<i128> = input.iter().map(|&value| i128::from(value)).collect();
    let (output, hidden) = contents.layers.split_last().unwrap();
    for layer in hidden {
        activations = scaled(layer, &activations)
            .iter()
            .map(|&value| value.clamp(0, 255))
            .collect();
    }
    scaled(output, &activations)
}

fn agrees(contents: &Contents, inputs: &[[i8; INPUTS]]) {
    let bytes = contents.bytes();
    let mut actor = Actor::new(Table::parse(&bytes).unwrap());
    for input in inputs {
        let outputs = actor.infer(input).map(i128::from);
        assert_eq!(outputs[..ACTIONS], reference(contents, input), "input {input:?}");
    }
}

fn random_inputs(seed: u64, count: usize) -> Vec<[i8; INPUTS]> {
    let mut rng = Pcg64Mcg::new(u128::from(seed) << 1 | 1);
    (0..count)
        .map(|_| std::array::from_fn(|_| rng.next_u32().to_le_bytes()[0].cast_signed()))
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_geometry_follows_the_specification(
        seed in any::<u64>(),
        hidden in prop::collection::vec(1_usize..80, 0..=3),
    ) {
        let widths: Vec<usize> = [INPUTS].into_iter().chain(hidden).chain([ACTIONS]).collect();
        agrees(&Contents::random(seed, &widths), &random_inputs(seed, 20));
    }
}

#[test]
fn the_widest_layers_and_the_extremes_follow_the_specification() {
    let mut contents = Contents::random(1, &[INPUTS, 1024, 1024, ACTIONS]);
    let extreme_inputs = [[i8::MIN; INPUTS], [i8::MAX; INPUTS], [0; INPUTS]];
    agrees(&contents, &extreme_inputs);
    for layer in &mut contents.layers {
        let inputs = layer.weights[0].len();
        for (index, row) in layer.weights.iter_mut().enumerate() {
            // An even row may use 24 bits: 259 hidden inputs at full weight. An odd row may use all, with any bias.
            let (weight, length, bias) = match index % 4 {
                0 => (
                    i8::MAX,
                    inputs.min(259),
                    (1 << 23) - 1 - 127 * 255 * inputs.min(259) as i32,
                ),
                1 => (i8::MIN, inputs, -(1 << 30)),
                2 => (
                    -127,
                    inputs.min(259),
                    -(1 << 23) + 127 * 255 * inputs.min(259) as i32,
                ),
                _ => (i8::MAX, inputs, 1 << 30),
            };
            row.fill(0);
            row[..length].fill(weight);
            layer.biases[index] = bias;
            layer.multipliers[index] = if index % 4 < 2 { i32::MIN } else { i32::MAX };
        }
    }
    agrees(&contents, &extreme_inputs);
}

#[test]
fn one_inference_leaves_no_trace_in_the_next() {
    let bytes = Contents::random(2, &[INPUTS, 64, 9, ACTIONS]).bytes();
    let mut used = Actor::new(Table::parse(&bytes).unwrap());
    for input in random_inputs(2, 50) {
        let mut fresh = Actor::new(Table::parse(&bytes).unwrap());
        assert_eq!(used.infer(&input), fresh.infer(&input));
    }
}
