//! An integer network in the order in which the firmware's kernel reads it. [`firmware::table`] describes the bytes,
//! [`firmware::network`] what they are for.

use firmware::network::{EVEN_ROW_LIMIT, Geometry, QUAD_ROWS};
use kit::error::{Error, Result};

/// One layer in plain integers; see [`firmware::network::DenseLayer`] for what they mean.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IntegerLayer {
    /// Row length.
    pub inputs: usize,
    /// `[outputs]`.
    pub biases: Vec<i32>,
    /// `[outputs]`, in 2^-32.
    pub multipliers: Vec<i32>,
    /// `[outputs][inputs]`.
    pub weights: Vec<i8>,
}

/// A table's layers: for each its biases, then its stream.
///
/// # Errors
/// [`Error::Input`] names the layer and row that have no packed form which computes the same.
pub fn pack(layers: &[IntegerLayer]) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    for (index, layer) in layers.iter().enumerate() {
        let geometry = Geometry {
            inputs: layer.inputs,
            outputs: layer.biases.len(),
            first: index == 0,
            last: index + 1 == layers.len(),
        };
        let mut biases = layer.biases.clone();
        biases.resize(geometry.rows(), 0);
        bytes.extend(biases.iter().flat_map(|bias| bias.to_le_bytes()));
        for first in (0..geometry.rows()).step_by(QUAD_ROWS) {
            let rows: [Row; QUAD_ROWS] = std::array::from_fn(|row| Row::new(layer, &geometry, first + row));
            check(index, first, &geometry, &rows)?;
            bytes.extend(quad(&rows).iter().flat_map(|word| word.to_le_bytes()));
        }
    }
    Ok(bytes)
}

/// A row with its padding.
struct Row {
    bias: i32,
    multiplier: i32,
    weights: Vec<i8>,
}

impl Row {
    fn new(layer: &IntegerLayer, geometry: &Geometry, row: usize) -> Self {
        let mut weights = match layer.weights.chunks_exact(layer.inputs).nth(row) {
            Some(weights) => weights.to_vec(),
            None => Vec::new(),
        };
        weights.resize(geometry.columns(), 0);
        Self {
            bias: layer.biases.get(row).copied().unwrap_or(0),
            multiplier: layer.multipliers.get(row).copied().unwrap_or(0),
            weights,
        }
    }

    /// Of the least and the greatest sum that activations from `least` to `greatest` can give, the one further from 0.
    fn worst_sum(&self, least: i64, greatest: i64) -> i64 {
        let sum = |pick: fn(i64, i64) -> i64| -> i64 {
            let weights = self.weights.iter().map(|&weight| i64::from(weight));
            i64::from(self.bias)
                + weights
                    .map(|weight| pick(weight * least, weight * greatest))
                    .sum::<i64>()
        };
        let (low, high) = (sum(i64::min), sum(i64::max));
        if high >= -low { high } else { low }
    }
}

/// Checks that an even row keeps to its 24 bits of accumulator, and that the weights of two rows share halfwords.
fn check(layer: usize, first: usize, geometry: &Geometry, rows: &[Row; QUAD_ROWS]) -> Result<()> {
    let (least, greatest) = if geometry.first { (-128, 127) } else { (0, 255) };
    for (pair, rows) in rows.chunks_exact(2).enumerate() {
        let [even, odd] = rows else { continue };
        let row = first + 2 * pair;
        let sum = even.worst_sum(least, greatest);
        // The firmware takes -2^23, too; one rule is simpler to say.
        if sum.abs() >= i64::from(EVEN_ROW_LIMIT) {
            let expected = format!(
                "less than 2^23 = 8388608 in magnitude for an even row: its weights are too large for {} inputs",
                geometry.inputs
            );
            return Err(Error::input(
                format!("layer {layer} row {row}"),
                format!("a sum of {sum} for some activations"),
                expected,
            ));
        }
        for (input, (&above, &below)) in even.weights.iter().zip(&odd.weights).enumerate() {
            if above == i8::MIN && below < 0 {
                return Err(Error::input(
                    format!("layer {layer} row {row} input {input}"),
                    format!("a weight of -128 above {below}"),
                    "at least -127: the two share a halfword",
                ));
            }
        }
    }
    Ok(())
}

/// Four rows as words.
fn quad(rows: &[Row; QUAD_ROWS]) -> Vec<i32> {
    let mut words = Vec::new();
    for pair in rows.chunks_exact(2) {
        let [even, odd] = pair else { continue };
        let own_products: i32 = odd.weights.chunks_exact(4).map(own_products).sum();
        words.push(even.bias.wrapping_mul(256).wrapping_add(odd.bias));
        words.push(odd.bias.wrapping_sub(own_products));
    }
    for column in (0..rows[0].weights.len()).step_by(4) {
        for pair in rows.chunks_exact(2) {
            for column in [column, column + 2] {
                let half = |column: usize| {
                    let (even, odd) = (pair[0].weights[column], pair[1].weights[column]);
                    256 * i32::from(even) + i32::from(odd)
                };
                words.push(half(column) & 0xffff | half(column + 1) << 16);
            }
        }
    }
    words.extend(rows.iter().map(|row| row.multiplier));
    words
}

/// The surplus of Winograd's inner product that four weights of an odd row bring by themselves.
fn own_products(weights: &[i8]) -> i32 {
    match weights
        .iter()
        .map(|&weight| i32::from(weight))
        .collect::<Vec<_>>()[..]
    {
        [w0, w1, w2, w3] => w0 * w2 + w1 * w3,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware::network::Network;

    fn network(inputs: usize, rows: &[i8]) -> Vec<IntegerLayer> {
        let layer = |inputs: usize, rows: &[i8]| IntegerLayer {
            inputs,
            biases: vec![0; rows.len()],
            multipliers: vec![1 << 20; rows.len()],
            weights: rows
                .iter()
                .flat_map(|&weight| std::iter::repeat_n(weight, inputs))
                .collect(),
        };
        vec![layer(3, &vec![1; inputs]), layer(inputs, rows)]
    }

    #[test]
    fn what_fits_is_a_network_for_the_firmware() {
        for inputs in [1, 4, 7, 259] {
            let bytes = pack(&network(inputs, &[127, -128, -127, 5, -3])).unwrap();
            let parsed = Network::parse(&[3, inputs, 5], &bytes).unwrap();
            assert_eq!(parsed.output_layer().geometry().inputs, inputs);
        }
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let message = |inputs, rows: &[i8]| pack(&network(inputs, rows)).unwrap_err().to_string();
        assert_eq!(
            message(260, &[0, 127, 127, 0]),
            "layer 1 row 2: found a sum of 8420100 for some activations, expected less than 2^23 = 8388608 in \
             magnitude for an even row: its weights are too large for 260 inputs"
        );
        assert!(message(260, &[-127, 0, 0, 0]).starts_with("layer 1 row 0: found a sum of -8420100 "));
        assert_eq!(
            message(2, &[-128, -1, 0, 0]),
            "layer 1 row 0 input 0: found a weight of -128 above -1, expected at least -127: the two share a halfword"
        );
        // Odd rows may be as heavy as they like.
        assert!(pack(&network(1024, &[0, 127, 0, -128])).is_ok());
    }
}
