//! Networks to measure: a table's, or random ones, since what an inference costs depends on the shape alone.

use crate::pack::{IntegerLayer, pack};
use firmware::table::{HEADER_LEN, Table};
use kit::error::{Error, Result};
use rand_core::Rng;
use rand_pcg::Pcg64Mcg;

/// A packed network with its widths: the inputs, then each layer's outputs.
#[derive(Clone, Debug)]
pub struct PackedNetwork {
    /// Inputs, then each layer's outputs.
    pub widths: Vec<usize>,
    /// For [`firmware::network::Network::parse`].
    pub bytes: Vec<u8>,
}

impl PackedNetwork {
    /// Its widths, as in 7-64-32-4.
    pub fn name(&self) -> String {
        let widths: Vec<String> = self.widths.iter().map(usize::to_string).collect();
        widths.join("-")
    }

    /// That of a table.
    pub fn of_table(table: &Table<'_>) -> Self {
        let bytes = table.bytes();
        Self {
            widths: table.network().widths().collect(),
            bytes: bytes[HEADER_LEN..bytes.len() - 4].to_vec(),
        }
    }

    /// A random network whose hidden units work in their range.
    ///
    /// # Errors
    /// If the draw does not fit the packed form.
    pub fn random(seed: u64, widths: &[usize]) -> Result<Self> {
        let mut rng = Pcg64Mcg::new(
            (u128::from(seed) << 1 | 1).wrapping_mul(0x2360_ed05_1fc6_5da4_4385_df64_9fcc_f645),
        );
        let layers: Vec<IntegerLayer> = widths
            .windows(2)
            .filter_map(|pair| match *pair {
                [inputs, outputs] => Some(random_layer(&mut rng, inputs, outputs)),
                _ => None,
            })
            .collect();
        let bytes =
            pack(&layers).map_err(|error| Error::input("random network", error, "one that can be packed"))?;
        Ok(Self {
            widths: widths.to_vec(),
            bytes,
        })
    }
}

/// Weights spread by about 42 like a trained network's; results by about 100.
fn random_layer(rng: &mut Pcg64Mcg, inputs: usize, outputs: usize) -> IntegerLayer {
    // An activation and a weight of typical size are 64 and 42.
    let spread = libm::sqrt(inputs as f64) * 64.0 * 42.0;
    let multiplier = (4_294_967_296.0 * 100.0 / spread) as i32;
    let mut weights = Vec::with_capacity(inputs * outputs);
    for _ in 0..outputs {
        let row: Vec<i32> = (0..inputs).map(|_| weight(rng)).collect();
        // Hidden activations are positive: a row with a mean would be 0 or saturated for every input.
        let mean = row.iter().sum::<i32>() / row.len().max(1) as i32;
        weights.extend(row.iter().map(|weight| (weight - mean).clamp(-127, 127) as i8));
    }
    IntegerLayer {
        inputs,
        biases: (0..outputs)
            .map(|_| (rng.next_u32() % 8192).cast_signed() - 4096)
            .collect(),
        multipliers: vec![multiplier; outputs],
        weights,
    }
}

/// The sum of four bytes is about Gaussian.
fn weight(rng: &mut Pcg64Mcg) -> i32 {
    let sum: i32 = rng
        .next_u32()
        .to_le_bytes()
        .iter()
        .map(|&byte| i32::from(byte))
        .sum();
    (sum - 510) * 2 / 7
}
