//! Layers one after the other.

use super::dense::{DenseLayer, Geometry, MAX_OUTPUTS, MAX_WIDTH};
use crate::table::{MAX_LAYERS, TableError};
use heapless::Vec;

/// One layer's activations: int8 values before the first layer, 0 to 255 behind every other. Aligned to a word, because
/// the kernel loads them two at a time.
#[derive(Clone, Debug)]
#[repr(C, align(4))]
pub struct Activations(pub(super) [i16; MAX_WIDTH]);

/// The activations of one inference, so that no slot allocates or clears anything.
#[derive(Clone, Debug)]
pub struct Scratch(pub(super) [Activations; 2]);

impl Scratch {
    /// What an inference leaves here means nothing to the next.
    pub const fn new() -> Self {
        Self([const { Activations([0; MAX_WIDTH]) }; 2])
    }
}

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

/// A checked network. Copies nothing: the layers point into the bytes.
#[derive(Clone, Debug)]
pub struct Network<'t> {
    hidden: Vec<DenseLayer<'t>, { MAX_LAYERS - 1 }>,
    output: DenseLayer<'t>,
}

impl<'t> Network<'t> {
    /// Checks the layers in `bytes`, which they must fill. `widths` are the inputs, then each layer's outputs.
    ///
    /// # Errors
    /// [`TableError`] names the first field that does not fit.
    pub fn parse(widths: &[usize], bytes: &'t [u8]) -> Result<Self, TableError> {
        let layers = widths.len().saturating_sub(1);
        let out_of_range = TableError::field("layers", layers as i32, MAX_LAYERS as i32);
        let (mut hidden, mut output, mut rest) = (Vec::new(), None, bytes);
        for (index, window) in widths.windows(2).enumerate() {
            let [inputs, outputs] = *window else { continue };
            let geometry = Geometry {
                inputs,
                outputs,
                first: index == 0,
                last: index.saturating_add(1) == layers,
            };
            let (layer, behind) = DenseLayer::parse(geometry, rest)?;
            rest = behind;
            if let Some(previous) = output.replace(layer) {
                hidden.push(previous).map_err(|_| out_of_range)?;
            }
        }
        if !rest.is_empty() {
            return Err(TableError::field("left over bytes", rest.len() as i32, 0));
        }
        Ok(Self {
            hidden,
            output: output.ok_or(out_of_range)?,
        })
    }

    /// Number of inputs, then each layer's outputs.
    pub fn widths(&self) -> impl Iterator<Item = usize> {
        let outputs = self.layers().map(DenseLayer::outputs_len);
        core::iter::once(self.first_layer().inputs_len()).chain(outputs)
    }

    /// The layers before the last.
    pub fn hidden_layers(&self) -> &[DenseLayer<'t>] {
        &self.hidden
    }

    /// The last layer.
    pub const fn output_layer(&self) -> &DenseLayer<'t> {
        &self.output
    }

    /// The layer that takes the input.
    pub(super) fn first_layer(&self) -> &DenseLayer<'t> {
        self.hidden.first().unwrap_or(&self.output)
    }

    /// All layers in their order.
    pub fn layers(&self) -> impl Iterator<Item = &DenseLayer<'t>> {
        self.hidden.iter().chain([&self.output])
    }

    /// The outputs for an int8 input; those that the network does not have are 0. Inputs that are missing count as 0, and
    /// further ones are ignored.
    ///
    /// On a Cortex-M4 a kernel in assembly computes them, in the same number of instructions for every input; a table that
    /// is not aligned to a word, which the kernel could not load, and every other processor take the specification's own
    /// code. The bits are the same.
    pub fn infer(&self, scratch: &mut Scratch, input: &[i8]) -> [i32; MAX_OUTPUTS] {
        #[cfg(target_arch = "arm")]
        if let Some(outputs) = super::kernel::infer(self, scratch, input) {
            return outputs;
        }
        self.infer_portably(scratch, input)
    }

    /// [`Network::infer`] by the specification's own code, on any processor.
    pub fn infer_portably(&self, scratch: &mut Scratch, input: &[i8]) -> [i32; MAX_OUTPUTS] {
        let [mut now, mut next] = scratch.0.each_mut();
        now.load(input, self.first_layer().geometry());
        for layer in self.hidden_layers() {
            layer.hidden(now, next);
            core::mem::swap(&mut now, &mut next);
        }
        self.output.outputs(now)
    }
}

impl Activations {
    /// Takes the input of a layer of this shape, and zeros for the rest of its last block: the kernel multiplies padding, too.
    pub(super) fn load(&mut self, input: &[i8], layer: &Geometry) {
        let length = input.len().min(layer.inputs);
        for (activation, &value) in self.0.iter_mut().zip(input.iter().take(length)) {
            *activation = i16::from(value);
        }
        let padding = self.0.get_mut(length..layer.columns());
        padding.unwrap_or_default().fill(0);
    }
}
