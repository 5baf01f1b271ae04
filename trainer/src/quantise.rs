//! From the float network to the firmware's integers: per-row weight scales, calibrated activations.

use crate::distil::as_float;
use crate::network::{Layer, Network};
use firmware::observation::{INPUTS, ONE};
pub use host_sim::pack::IntegerLayer as QuantisedLayer;

/// A network in integers.
#[derive(Clone, Debug, PartialEq)]
pub struct QuantisedNetwork {
    /// From the input on.
    pub layers: Vec<QuantisedLayer>,
    /// Real value of one step of the inputs, then of each layer's outputs.
    pub scales: Vec<f64>,
}

/// Why a network cannot be quantised.
#[derive(Debug, thiserror::Error)]
pub enum QuantiseError {
    /// A parameter is not finite.
    #[error("layer {layer}: found a parameter that is not finite, expected finite weights and biases")]
    NotFinite {
        /// Which layer, from 0.
        layer: usize,
    },
    /// A row's scale leaves the range of its multiplier.
    #[error(
        "layer {layer} row {row}: found a scale ratio of {ratio:.3}, expected below 0.5: its activations are too small"
    )]
    Ratio {
        /// Which layer, from 0.
        layer: usize,
        /// Which row, from 0.
        row: usize,
        /// Accumulator step over activation step.
        ratio: f64,
    },
    /// A bias leaves the accumulator's range.
    #[error("layer {layer} row {row}: found a bias of {bias:.0} accumulator steps, expected less than 2^30")]
    Bias {
        /// Which layer, from 0.
        layer: usize,
        /// Which row, from 0.
        row: usize,
        /// The bias.
        bias: f64,
    },
}

/// Quantises a network. Weights: each row's largest magnitude becomes 127. Hidden activations: the largest one over the
/// calibration inputs becomes 255. Outputs: one common step, as fine as the multipliers allow.
///
/// # Errors
/// [`QuantiseError`] names the layer and row that do not fit.
pub fn quantise(network: &Network, calibration: &[[i8; INPUTS]]) -> Result<QuantisedNetwork, QuantiseError> {
    let floats: Vec<[f32; INPUTS]> = calibration.iter().map(as_float).collect();
    let largest = network.largest_activations(floats.iter().map(<[f32; INPUTS]>::as_slice));
    let mut scales = vec![1.0 / f64::from(ONE)];
    let mut layers = Vec::new();
    for (index, (layer, &largest)) in network.layers.iter().zip(&largest).enumerate() {
        if !layer
            .weights
            .iter()
            .chain(&layer.biases)
            .all(|parameter| parameter.is_finite())
        {
            return Err(QuantiseError::NotFinite { layer: index });
        }
        let input_scale = scales[index];
        let steps: Vec<f64> = (0..layer.outputs)
            .map(|row| row_scale(layer, row) * input_scale)
            .collect();
        let output_scale = if index + 1 < network.layers.len() {
            f64::from(largest) / 255.0
        } else {
            // Just above twice the coarsest row's step, so that every ratio is below a half.
            steps.iter().fold(0.0, |coarsest: f64, &step| coarsest.max(step)) * 2.001
        };
        layers.push(quantise_layer(index, layer, &steps, output_scale)?);
        scales.push(output_scale);
    }
    Ok(QuantisedNetwork { layers, scales })
}

/// Real value of one weight step of a row.
fn row_scale(layer: &Layer, row: usize) -> f64 {
    let largest = (0..layer.inputs).fold(0.0_f32, |largest, input| {
        largest.max(weight(layer, row, input).abs())
    });
    // A row of zeros has any scale.
    if largest > 0.0 {
        f64::from(largest) / 127.0
    } else {
        1.0
    }
}

fn weight(layer: &Layer, row: usize, input: usize) -> f32 {
    layer.weights[input * layer.outputs + row]
}

fn quantise_layer(
    index: usize,
    layer: &Layer,
    steps: &[f64],
    output_scale: f64,
) -> Result<QuantisedLayer, QuantiseError> {
    let mut quantised = QuantisedLayer {
        inputs: layer.inputs,
        biases: Vec::new(),
        multipliers: Vec::new(),
        weights: Vec::new(),
    };
    for (row, &step) in steps.iter().enumerate() {
        let ratio = step / output_scale;
        // Also refuses an infinite ratio: a layer that never activates.
        if ratio.is_nan() || ratio >= 0.5 {
            return Err(QuantiseError::Ratio {
                layer: index,
                row,
                ratio,
            });
        }
        let bias = (f64::from(layer.biases[row]) / step).round();
        if bias.abs() >= f64::from(1 << 30) {
            return Err(QuantiseError::Bias {
                layer: index,
                row,
                bias,
            });
        }
        quantised.biases.push(bias as i32);
        quantised
            .multipliers
            .push((ratio * 4_294_967_296.0).round() as i32);
        let scale = row_scale(layer, row);
        quantised.weights.extend(
            (0..layer.inputs).map(|input| (f64::from(weight(layer, row, input)) / scale).round() as i8),
        );
    }
    Ok(quantised)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn single(weights: Vec<f32>, biases: Vec<f32>) -> Network {
        let (inputs, outputs) = (weights.len() / biases.len(), biases.len());
        Network {
            layers: vec![Layer {
                inputs,
                outputs,
                weights,
                biases,
            }],
        }
    }

    #[test]
    fn rows_have_their_own_scales() {
        // [inputs][outputs]: row 0 is (1, -0.5), row 1 is (0.01, 0.02).
        let quantised = quantise(&single(vec![1.0, 0.01, -0.5, 0.02], vec![0.5, 0.0]), &[]).unwrap();
        let layer = &quantised.layers[0];
        assert_eq!(layer.weights, [127, -64, 64, 127]);
        // 0.5 in steps of 1/127/64
        assert_eq!(layer.biases, [4064, 0]);
        let real: Vec<f64> = layer
            .multipliers
            .iter()
            .map(|&m| f64::from(m) / 4_294_967_296.0 * quantised.scales[1])
            .collect();
        assert!((real[0] - 1.0 / 127.0 / 64.0).abs() < 1e-9 && (real[1] - 0.02 / 127.0 / 64.0).abs() < 1e-9);
    }

    #[test]
    fn what_does_not_fit_is_named() {
        let message = |network: &Network| quantise(network, &[]).unwrap_err().to_string();
        assert!(message(&single(vec![f32::NAN], vec![0.0])).starts_with("layer 0: found a parameter"));
        assert!(message(&single(vec![1e-9], vec![1e3])).starts_with("layer 0 row 0: found a bias"));
        let mut deep = single(vec![1.0], vec![0.0]);
        deep.layers.push(deep.layers[0].clone());
        assert!(message(&deep).starts_with("layer 0 row 0: found a scale ratio"));
    }
}
