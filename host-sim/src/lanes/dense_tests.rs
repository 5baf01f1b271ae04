use super::*;
use firmware::network::scaled_product;

/// A layer whose numbers are the ends of their ranges as often as something between.
fn layer(next: &mut impl FnMut(i32, i32) -> i32, columns: usize, rows: usize) -> Vec<DenseRow> {
    let mut row = || DenseRow {
        bias: next(-1 << 20, 1 << 20),
        multiplier: next(0, 1 << 30),
        weights: (0..columns).map(|_| next(-128, 127)).collect(),
    };
    (0..rows).map(|_| row()).collect()
}

/// The rows of a layer as the firmware specifies them, before any clamp.
fn expected(layer: &[DenseRow], activations: &[Row<i32>]) -> Vec<Row<i32>> {
    let rows = layer.iter().map(|row| {
        std::array::from_fn(|lane| {
            let products = row.weights.iter().zip(activations);
            let sum: i32 = products.map(|(weight, row)| weight * row[lane]).sum();
            (scaled_product((row.bias + sum).into(), row.multiplier.into()) >> 32) as i32
        })
    });
    rows.collect()
}

#[test]
fn every_unit_computes_the_specification() {
    let mut word = 1_u32;
    let mut next = |least: i32, most: i32| {
        word = word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let between = (word >> 8) as i32 % (most - least + 1);
        match word >> 30 {
            0 => least,
            1 => most,
            _ => least + between,
        }
    };
    for (inputs, hidden, outputs) in [(22, 32, 6), (1, 1, 1), (37, 19, 11), (4, 8, 3), (7, 10, 4)] {
        let [first, second] =
            [(inputs, hidden), (hidden, outputs)].map(|(columns, rows)| layer(&mut next, columns, rows));
        let inputs: Vec<Row<i32>> = (0..inputs)
            .map(|_| std::array::from_fn(|_| next(-128, 127)))
            .collect();
        let activations: Vec<Row<i32>> = expected(&first, &inputs)
            .into_iter()
            .map(|row| row.map(|scaled| scaled.clamp(0, 255)))
            .collect();
        let outputs = expected(&second, &activations);
        let layers = [Dense::new(&first, true), Dense::new(&second, false)];
        for vectors in Vectors::all() {
            // What an earlier inference left means nothing.
            let mut activations = Activations::new(40);
            activations.now.fill([-1; LANES]);
            activations.next.fill([-1; LANES]);
            let mut found = vec![[-1; LANES]; outputs.len().next_multiple_of(4)];
            vectors.infer(&layers, &inputs, &mut activations, &mut found);
            found.truncate(outputs.len());
            assert_eq!(found, outputs, "{}", vectors.name());
        }
    }
}
