//! What layers pass to each other.

use super::geometry::{Geometry, MAX_WIDTH};

/// One layer's activations: int8 values before the first layer, 0 to 255 behind every other. Aligned to a word, because
/// the kernel loads them two at a time.
#[derive(Clone, Debug)]
#[repr(C, align(4))]
pub struct Activations(pub(super) [i16; MAX_WIDTH]);

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
