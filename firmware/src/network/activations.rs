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
        let input = input.get(..layer.inputs).unwrap_or(input);
        let columns = self.0.get_mut(..layer.columns()).unwrap_or_default();
        let Some((activations, padding)) = columns.split_at_mut_checked(input.len()) else {
            return;
        };
        for (activation, &value) in activations.iter_mut().zip(input) {
            *activation = i16::from(value);
        }
        for padding in padding {
            // Kept from the optimiser, which would call a function that clears any length for at most seven.
            *core::hint::black_box(padding) = 0;
        }
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
