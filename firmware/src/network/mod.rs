//! Dense int8 layers one after the other, evaluated in integers only.
//!
//! [`DenseLayer`] holds the exact integer specification and portable code that is nothing else. On a processor with the DSP
//! extension (Cortex-M4 and M7; M33, M55 and M85 where the build names them) a kernel in assembly takes its place; `kernel.rs`
//! explains it.

mod activations;
mod dense;
mod error;
mod geometry;
#[cfg(dsp_extension)]
mod kernel;

pub use activations::{Activations, Scratch};
pub use dense::{DenseLayer, EVEN_ROW_LIMIT, Quad, scaled_product};
pub use error::ReadError;
pub use geometry::{BLOCK_COLUMNS, Geometry, MAX_OUTPUTS, MAX_WIDTH, QUAD_ROWS};

use heapless::Vec;

/// Most dense layers in a network.
pub const MAX_LAYERS: usize = 4;

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
    /// [`ReadError`] names the first field that does not fit.
    pub fn parse(widths: &[usize], bytes: &'t [u8]) -> Result<Self, ReadError> {
        let layers = widths.len().saturating_sub(1);
        let out_of_range = ReadError::field("layers", layers as i32, MAX_LAYERS as i32);
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
            return Err(ReadError::field("left over bytes", rest.len() as i32, 0));
        }
        Ok(Self {
            hidden,
            output: output.ok_or(out_of_range)?,
        })
    }

    /// Number of inputs, then each layer's outputs.
    pub fn widths(&self) -> impl Iterator<Item = usize> {
        let outputs = self.layers().map(|layer| layer.geometry().outputs);
        core::iter::once(self.first_layer().geometry().inputs).chain(outputs)
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
    fn first_layer(&self) -> &DenseLayer<'t> {
        self.hidden.first().unwrap_or(&self.output)
    }

    /// All layers in their order.
    pub fn layers(&self) -> impl Iterator<Item = &DenseLayer<'t>> {
        self.hidden.iter().chain([&self.output])
    }

    /// The outputs for an int8 input; those that the network does not have are 0. Inputs that are missing count as 0, and
    /// further ones are ignored.
    ///
    /// Where the processor has the DSP extension a kernel in assembly computes them, in the same number of instructions for every
    /// input; every other processor takes the specification's own code, and so do layers that are not aligned to a word, which
    /// the kernel could not load ([`Table`](crate::table::Table) refuses them). The bits are the same.
    pub fn infer(&self, scratch: &mut Scratch, input: &[i8]) -> [i32; MAX_OUTPUTS] {
        #[cfg(dsp_extension)]
        if let Some(outputs) = kernel::infer(&self.hidden, &self.output, scratch, input) {
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
