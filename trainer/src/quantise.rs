//! From the float network to the firmware's integers: per-row weight scales, calibrated activations.

use crate::network::{Layer, Network};
use firmware::network::EVEN_ROW_LIMIT;
use firmware::observation::ONE;
pub use host_sim::pack::IntegerLayer as QuantisedLayer;
use kit::error::{Error, Result};

/// A network in integers.
#[derive(Clone, Debug, PartialEq)]
pub struct QuantisedNetwork {
    /// From the input on.
    pub layers: Vec<QuantisedLayer>,
    /// Real value of one step of the inputs, then of each layer's outputs.
    pub scales: Vec<f64>,
}

/// Quantises a network. Weights: each row's largest magnitude becomes 127, or less where the kernel could not add up so long a
/// row. Hidden activations: the largest one over the calibration inputs, `[sample][input]`, becomes 255. Outputs: one common
/// step, the given one or as fine as the multipliers allow.
///
/// # Errors
/// [`Error::Input`] names the layer and row that do not fit.
pub fn quantise(network: &Network, calibration: &[i8], output_step: Option<f64>) -> Result<QuantisedNetwork> {
    let floats: Vec<f32> = calibration
        .iter()
        .map(|&code| f32::from(code) / f32::from(ONE))
        .collect();
    let largest = network.largest_activations(&floats);
    let mut scales = vec![1.0 / f64::from(ONE)];
    let mut layers = Vec::new();
    let count = network.layers().len();
    for (index, (layer, &largest)) in network.layers().zip(&largest).enumerate() {
        let mut parameters = layer.weights.iter().chain(layer.biases);
        if !parameters.all(|parameter| parameter.is_finite()) {
            return Err(Error::input(
                format!("layer {index}"),
                "a parameter that is not finite",
                "finite weights and biases",
            ));
        }
        let input_scale = scales[index];
        let range = if index == 0 { [-128.0, 127.0] } else { [0.0, 255.0] };
        let rows: Vec<Option<f64>> = (0..layer.outputs)
            .map(|row| row_scale(&layer, row, input_scale, range))
            .collect();
        let output_scale = if index + 1 < count {
            if largest <= 0.0 {
                return Err(Error::input(
                    format!("layer {index}"),
                    "no activation above 0 on calibration's inputs",
                    "some: it computes constants",
                ));
            }
            f64::from(largest) / 255.0
        } else {
            // Just above twice the coarsest row's step, so that every ratio is below a half.
            let coarsest = rows.iter().flatten().copied().reduce(f64::max);
            output_step.unwrap_or(coarsest.unwrap_or(1.0) * input_scale * 2.001)
        };
        // A row of zeros is its bias alone, in a quarter of its result's steps (chosen).
        let constant = output_scale / input_scale / 4.0;
        let rows: Vec<f64> = rows.into_iter().map(|scale| scale.unwrap_or(constant)).collect();
        layers.push(quantise_layer(index, &layer, &rows, input_scale, output_scale)?);
        scales.push(output_scale);
    }
    Ok(QuantisedNetwork { layers, scales })
}

/// How much coarser than its finest a row's weights may become. The widest layer's weights need no more; a bias that does is
/// refused, since weights would vanish beside it.
const COARSEST: f64 = 4.0;

/// Real value of one weight step of a row whose activations have this range; none for a row of zeros.
fn row_scale(layer: &Layer<'_>, row: usize, input_scale: f64, [least, greatest]: [f64; 2]) -> Option<f64> {
    let weights = || weights(layer, row).iter().map(|&weight| f64::from(weight));
    let largest = weights().fold(0.0, |largest: f64, weight| largest.max(weight.abs()));
    if largest == 0.0 {
        return None;
    }
    let finest = largest / 127.0;
    // Only even rows have a limit, but which of two rows is even should not change what it computes.
    let bias = f64::from(layer.biases[row]) / input_scale;
    let sum = |pick: fn(f64, f64) -> f64| -> f64 {
        bias + weights()
            .map(|weight| pick(weight * least, weight * greatest))
            .sum::<f64>()
    };
    // Rounding moves each weight by half a step, and the bias.
    let rounding = 0.5 * greatest.max(-least) * layer.inputs as f64 + 1.0;
    let limit = f64::from(EVEN_ROW_LIMIT) - rounding;
    let needed = sum(f64::max).max(-sum(f64::min)) / limit;
    Some(needed.clamp(finest, COARSEST * finest))
}

fn weights<'a>(layer: &Layer<'a>, row: usize) -> &'a [f32] {
    &layer.weights[row * layer.inputs..][..layer.inputs]
}

fn quantise_layer(
    index: usize,
    layer: &Layer<'_>,
    rows: &[f64],
    input_scale: f64,
    output_scale: f64,
) -> Result<QuantisedLayer> {
    let mut quantised = QuantisedLayer {
        inputs: layer.inputs,
        biases: Vec::new(),
        multipliers: Vec::new(),
        weights: Vec::new(),
    };
    for (row, &scale) in rows.iter().enumerate() {
        let place = || format!("layer {index} row {row}");
        let step = scale * input_scale;
        let ratio = step / output_scale;
        if ratio.is_nan() || ratio >= 0.5 {
            return Err(Error::input(
                place(),
                format!("weights whose products are {ratio:.3} steps of a result apart"),
                "less than half a step: they are too large for its results",
            ));
        }
        let bias = (f64::from(layer.biases[row]) / step).round();
        if bias.abs() >= f64::from(1 << 30) {
            let found = format!("a bias of {bias:.0} accumulator steps");
            return Err(Error::input(place(), found, "less than 2^30"));
        }
        quantised.biases.push(bias as i32);
        quantised
            .multipliers
            .push((ratio * 4_294_967_296.0).round() as i32);
        let weights = weights(layer, row).iter();
        quantised
            .weights
            .extend(weights.map(|&weight| (f64::from(weight) / scale).round() as i8));
    }
    Ok(quantised)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn single(weights: Vec<f32>, biases: Vec<f32>) -> Network {
        let widths = [weights.len() / biases.len(), biases.len()];
        Network::new(&widths, [weights, biases].concat())
    }

    #[test]
    fn rows_have_their_own_scales() {
        let quantised = quantise(&single(vec![1.0, -0.5, 0.01, 0.02], vec![0.5, 0.0]), &[], None).unwrap();
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
        let message = |network: &Network| quantise(network, &[], None).unwrap_err().to_string();
        assert!(message(&single(vec![f32::NAN], vec![0.0])).starts_with("layer 0: found a parameter"));
        assert!(message(&single(vec![1e-9], vec![1e3])).starts_with("layer 0 row 0: found a bias"));
        let deep = Network::new(&[1, 1, 1], vec![1.0, 0.0, 1.0, 0.0]);
        assert!(message(&deep).starts_with("layer 0: found no activation"));
        let coarse = quantise(&single(vec![1e3], vec![0.0]), &[], Some(1.0 / 256.0));
        let coarse = coarse.unwrap_err().to_string();
        assert!(coarse.starts_with("layer 0 row 0: found weights whose products are 31."));
    }

    #[test]
    fn a_row_of_zeros_is_its_bias_and_costs_the_others_nothing() {
        let with = quantise(&single(vec![1.0, 0.0], vec![0.5, 0.25]), &[], None).unwrap();
        let without = quantise(&single(vec![1.0], vec![0.5]), &[], None).unwrap();
        assert_eq!(with.scales, without.scales);
        let layer = &with.layers[0];
        let real =
            f64::from(layer.biases[1]) * f64::from(layer.multipliers[1]) / 4_294_967_296.0 * with.scales[1];
        assert!((real - 0.25).abs() <= with.scales[1] / 8.0, "{real}");
    }
}
