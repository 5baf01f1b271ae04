//! The Cortex-M4 kernel computes the specification's bits: as a model of its instructions on the host, and itself in QEMU.
#![allow(clippy::unwrap_used, reason = "a helper that fails is a test that fails")]

use firmware::network::{DenseLayer, MAX_OUTPUTS, Network, QUAD_ROWS, Scratch};
use firmware::table::{CHECKSUM, Table};
use firmware::tables::DISTILLED;
use host_sim::deadline::cycles::{AROUND_INFERENCE, kernel_cost};
use host_sim::deadline::network::PackedNetwork;
use host_sim::deadline::{Images, NetworkCounts, Subject, fold, measure_networks, measure_slots};
use rand_core::Rng;
use rand_pcg::{Pcg32, Pcg64Mcg};
use std::collections::BTreeMap;
use system_tests::below;
use system_tests::table_builder::Contents;

/// The instructions of `kernel.s` that compute, as the ARMv7-M Architecture Reference Manual defines them.
mod instruction {
    fn halves(word: u32) -> [i32; 2] {
        [i32::from(word as i16), i32::from((word >> 16) as i16)]
    }

    pub fn smlad(n: u32, m: u32, accumulator: u32) -> u32 {
        let ([n_0, n_1], [m_0, m_1]) = (halves(n), halves(m));
        let products = i64::from(n_0 * m_0) + i64::from(n_1 * m_1);
        accumulator.wrapping_add(products as u32)
    }

    pub fn sxtab16(n: u32, m: u32) -> u32 {
        let low = (n as u16).wrapping_add_signed(i16::from(m as i8));
        let high = ((n >> 16) as u16).wrapping_add_signed(i16::from((m >> 16) as i8));
        u32::from(high) << 16 | u32::from(low)
    }

    pub fn smmulr(n: u32, m: u32) -> u32 {
        let product = i64::from(n.cast_signed()) * i64::from(m.cast_signed());
        (product.wrapping_add(0x8000_0000) >> 32) as u32
    }

    pub fn asr(value: u32, amount: u32) -> u32 {
        (value.cast_signed() >> amount).cast_unsigned()
    }

    pub fn usat8(value: u32) -> u32 {
        value.cast_signed().clamp(0, 255).cast_unsigned()
    }

    pub fn pkhbt(low: u32, high: u32) -> u32 {
        low & 0xffff | high << 16
    }
}
use instruction::{asr, pkhbt, smlad, smmulr, sxtab16, usat8};

fn words(bytes: &[u8]) -> impl Iterator<Item = u32> + '_ {
    let (words, _) = bytes.as_chunks::<4>();
    words.iter().map(|word| u32::from_le_bytes(*word))
}

fn pair_products(activations: &[u32]) -> u32 {
    let (pairs, _) = activations.as_chunks::<2>();
    pairs.iter().fold(0, |sum, &[x01, x23]| smlad(x01, x23, sum))
}

/// A layer's four rows at a time, scaled. Activations are words of two.
fn quads(
    layer: &DenseLayer<'_>,
    activations: &[u32],
    products: u32,
    mut store: impl FnMut([u32; QUAD_ROWS]),
) {
    let mut stream = words(layer.stream());
    let mut next = || stream.next().unwrap();
    for _ in 0..layer.geometry().rows() / QUAD_ROWS {
        let [mut p_0, mut b_0, mut p_1, mut b_1] = [next(), next(), next(), next()];
        let (columns, _) = activations[..layer.geometry().columns() / 2].as_chunks::<2>();
        for &[x01, x23] in columns {
            let [h_0, h_1, g_0, g_1] = [next(), next(), next(), next()];
            p_0 = smlad(h_0, x01, p_0);
            p_1 = smlad(g_0, x01, p_1);
            p_0 = smlad(h_1, x23, p_0);
            p_1 = smlad(g_1, x23, p_1);
            b_0 = smlad(sxtab16(x23, h_0), sxtab16(x01, h_1), b_0);
            b_1 = smlad(sxtab16(x23, g_0), sxtab16(x01, g_1), b_1);
        }
        let multipliers = [next(), next(), next(), next()];
        b_0 = b_0.wrapping_sub(products);
        b_1 = b_1.wrapping_sub(products);
        p_0 = p_0.wrapping_sub(b_0);
        p_1 = p_1.wrapping_sub(b_1);
        let accumulators = [asr(p_0, 8), b_0, asr(p_1, 8), b_1];
        store(std::array::from_fn(|row| {
            smmulr(multipliers[row], accumulators[row])
        }));
    }
    assert!(stream.next().is_none(), "the kernel leaves a part of the stream");
}

/// What the kernel computes, in its words and its order.
fn model(network: &Network<'_>, input: &[i8]) -> [i32; MAX_OUTPUTS] {
    let first = network.layers().next().unwrap();
    let mut halves: Vec<i16> = input.iter().map(|&value| i16::from(value)).collect();
    halves.resize(first.geometry().columns(), 0);
    let (pairs, _) = halves.as_chunks::<2>();
    let mut activations: Vec<u32> = pairs
        .iter()
        .map(|&[low, high]| pkhbt(low as u32, high as u32))
        .collect();
    let mut products = pair_products(&activations);
    for layer in network.hidden_layers() {
        let mut next = Vec::new();
        let mut next_products = 0;
        quads(layer, &activations, products, |scaled| {
            let [y_0, y_1, y_2, y_3] = scaled.map(usat8);
            let (y01, y23) = (pkhbt(y_0, y_1), pkhbt(y_2, y_3));
            next_products = smlad(y01, y23, next_products);
            next.extend([y01, y23]);
        });
        (activations, products) = (next, next_products);
    }
    let mut outputs = Vec::new();
    quads(network.output_layer(), &activations, products, |scaled| {
        outputs.extend(scaled.map(u32::cast_signed));
    });
    outputs.resize(MAX_OUTPUTS, 0);
    outputs.try_into().unwrap()
}

/// A network that uses the format's ranges to their ends: any weights, any multipliers, biases that leave even rows just
/// inside 24 bits.
fn wild(seed: u64, widths: &[usize]) -> Contents {
    let mut contents = Contents::random(seed, widths);
    let mut rng = Pcg64Mcg::new(u128::from(seed) << 1 | 1);
    for (index, layer) in contents.layers.iter_mut().enumerate() {
        let extreme = below(&mut rng, 3) == 0;
        for row in 0..layer.biases.len() {
            for column in 0..layer.weights[row].len() {
                let any = rng.next_u32() as i8;
                let weight = match (extreme, any < 0) {
                    (true, true) => -128,
                    (true, false) => 127,
                    (false, _) => any,
                };
                let above = row % 2 == 1 && layer.weights[row - 1][column] == i8::MIN;
                layer.weights[row][column] = if above { weight.max(0) } else { weight };
            }
            let ends: [i64; 2] = if index == 0 { [-128, 127] } else { [0, 255] };
            let sum = |pick: fn(i64, i64) -> i64| -> i64 {
                let weights = layer.weights[row].iter().map(|&weight| i64::from(weight));
                weights
                    .map(|weight| pick(weight * ends[0], weight * ends[1]))
                    .sum()
            };
            layer.biases[row] = match (row % 2, rng.next_u32() % 2) {
                (0, 0) => (i64::from((1 << 23) - 1) - sum(i64::max)) as i32,
                (0, _) => (i64::from(-(1 << 23)) - sum(i64::min)) as i32,
                (_, 0) => 1 << 30,
                _ => (rng.next_u32().cast_signed()) >> 1,
            };
            layer.multipliers[row] = rng.next_u32().cast_signed() >> (rng.next_u32() % 16);
        }
    }
    contents
}

/// The measuring image's inputs: extremes now and then, else any values.
fn random_input(rng: &mut Pcg32, index: u32, length: usize) -> Vec<i8> {
    let value = |_| {
        let random = rng.next_u32().to_le_bytes()[3].cast_signed();
        match index % 16 {
            0 => i8::MIN,
            1 => i8::MAX,
            2 => 0,
            3 if random < 0 => i8::MIN,
            3 => i8::MAX,
            _ => random,
        }
    };
    (0..length).map(value).collect()
}

/// Calls `each` with every random input's outputs by the specification, and the input.
fn specification(
    network: &Network<'_>,
    mut rng: Pcg32,
    count: u32,
    mut each: impl FnMut(&[i8], [i32; MAX_OUTPUTS]),
) {
    let mut scratch = Scratch::new();
    let inputs = network.widths().next().unwrap();
    for index in 0..count {
        let input = random_input(&mut rng, index, inputs);
        each(&input, network.infer_portably(&mut scratch, &input));
    }
}

#[test]
fn a_model_of_the_kernel_gives_the_specifications_bits() {
    const SHAPES: u64 = 1_000;
    const INPUTS: u32 = 1_050;
    let mut rng = Pcg64Mcg::new(11);
    let mut compared = 0_u64;
    for seed in 0..SHAPES {
        let mut widths = vec![[1, 3, 7, 8, 13, 20][below(&mut rng, 6) as usize]];
        for _ in 0..below(&mut rng, 3) {
            widths.push(1 + below(&mut rng, 20) as usize);
        }
        widths.push(1 + below(&mut rng, 8) as usize);
        let contents = if seed % 2 == 0 {
            Contents::random(seed, &widths)
        } else {
            wild(seed, &widths)
        };
        let bytes = contents.network_bytes();
        let network =
            Network::parse(&widths, &bytes).unwrap_or_else(|error| panic!("seed {seed} {widths:?}: {error}"));
        specification(&network, Pcg32::new(seed, 0), INPUTS, |input, outputs| {
            assert_eq!(model(&network, input), outputs, "{widths:?} for {input:?}");
            compared += 1;
        });
    }
    println!("{compared} inputs, {SHAPES} shapes, 0 mismatches");
    assert!(compared >= 1_000_000);
}

#[test]
fn the_widest_layers_fit_the_model() {
    for (seed, widths) in [(1, [20, 1024, 1024, 6]), (2, [7, 1024, 512, 4])] {
        let bytes = Contents::random(seed, &widths).network_bytes();
        let network = Network::parse(&widths, &bytes).unwrap();
        specification(&network, Pcg32::new(seed, 0), 40, |input, outputs| {
            assert_eq!(model(&network, input), outputs, "{widths:?} for {input:?}");
        });
    }
}

fn subject(contents: &Contents, widths: &[usize], misalignment: usize) -> Subject {
    Subject {
        network: PackedNetwork {
            widths: widths.to_vec(),
            bytes: contents.network_bytes(),
        },
        inputs: 2_000,
        misalignment,
    }
}

/// The host's CRC-32 over all outputs.
fn digest(subject: &Subject, seed: u64, index: u64) -> u32 {
    let network = Network::parse(&subject.network.widths, &subject.network.bytes).unwrap();
    let mut digest = CHECKSUM.digest();
    let rng = Pcg32::new(u64::from(fold(seed)), index);
    specification(&network, rng, subject.inputs, |_, outputs| {
        outputs
            .iter()
            .for_each(|output| digest.update(&output.to_le_bytes()));
    });
    digest.finalize()
}

/// A wide one among odd ones; `wild` ones take all of the ranges.
const SHAPES: [&[usize]; 11] = [
    &[7, 64, 32, 4],
    &[20, 32, 32, 6],
    &[20, 6],
    &[1, 1, 1],
    &[3, 5, 2],
    &[13, 70, 9, 5],
    &[65, 33, 8],
    &[8, 200, 7],
    &[7, 64, 40, 8],
    &[7, 129, 65, 1],
    &[20, 17, 19, 23, 6],
];

#[test]
fn the_kernel_in_qemu_gives_the_specifications_bits_in_constant_instructions() {
    const SEED: u64 = 77;
    let table = Table::parse(DISTILLED).unwrap();
    let shipped = Subject {
        network: PackedNetwork::of_table(&table),
        inputs: 4_000,
        misalignment: 0,
    };
    let mut subjects = vec![shipped];
    for (seed, widths) in (1..).zip(SHAPES) {
        subjects.push(subject(&Contents::random(seed, widths), widths, 0));
        if widths[..widths.len() - 1].iter().all(|&width| width <= 250) {
            subjects.push(subject(&wild(seed, widths), widths, 0));
        }
    }
    let aligned = subjects.len();
    for misalignment in 1..4 {
        subjects.push(subject(&wild(9, SHAPES[1]), SHAPES[1], misalignment));
    }

    let images = Images::build(|_| {}).unwrap_or_else(|error| panic!("{error}"));
    let counts = measure_networks(&images, SEED, &subjects).unwrap_or_else(|error| panic!("{error}"));
    let mut around = BTreeMap::new();
    let mut compared = 0;
    for (index, (subject, counts)) in (0..).zip(subjects.iter().zip(&counts)) {
        let NetworkCounts {
            kernel, mismatches, ..
        } = *counts;
        let widths = &subject.network.widths;
        assert_eq!(
            mismatches, 0,
            "{widths:?}: kernel and specification differ on the target"
        );
        assert_eq!(
            counts.digest,
            digest(subject, SEED, index),
            "{widths:?}: target and host differ"
        );
        compared += subject.inputs;
        if index as usize >= aligned {
            // What the kernel cannot load takes the portable way.
            assert!(kernel.min + 100 > counts.portable.min, "{widths:?}: {kernel:?}");
            continue;
        }
        assert_eq!(
            kernel.min, kernel.max,
            "{widths:?}: the count depends on the input"
        );
        // Every instruction of the kernel is accounted for; what calls it depends on the input and the depth alone.
        let network = Network::parse(widths, &subject.network.bytes).unwrap();
        let calls = kernel
            .max
            .checked_sub(kernel_cost(&network).instructions)
            .unwrap();
        let first = around.entry((widths[0], widths.len())).or_insert(calls);
        assert_eq!(calls, *first, "{widths:?}: {kernel:?}");
    }
    println!(
        "{compared} inputs, {} networks, 0 mismatches; around the kernel {around:?}",
        subjects.len()
    );
    assert!(compared >= 20_000);
}

#[test]
fn every_form_takes_constant_instructions() {
    let images = Images::build(|_| {}).unwrap_or_else(|error| panic!("{error}"));
    for (observation, output, sub_channels) in [
        (0, 0, 3),
        (0, 0, 1),
        (0, 0, 8),
        (0, 0, 16),
        (0, 1, 3),
        (1, 2, 3),
        (2, 3, 3),
    ] {
        let bytes = Contents::in_form(3, observation, output).bytes();
        let table = Table::parse(&bytes).unwrap();
        let stages =
            measure_slots(&images, 5, 4_000, sub_channels, &table).unwrap_or_else(|error| panic!("{error}"));
        let stage = |name| stages.iter().find(|stage| stage.name == name).unwrap();
        let around = stage("slot").range.max - stage("infer").range.max;
        assert!(around < AROUND_INFERENCE || sub_channels > 3, "{around}");
        for name in ["observe", "infer", "decide", "unit"] {
            let stage = stage(name);
            println!(
                "{:?}, {:?}: {stage:?}",
                table.observation_form(),
                table.output_form()
            );
            assert_eq!(stage.range.min, stage.range.max, "{stage:?}");
        }
    }
}
