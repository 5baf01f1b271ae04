//! The DSP extension's way through a network: `kernel.s`, and the few lines that call it. Counts and cycles are a Cortex-M4's.
//!
//! # Method
//! A multiply-accumulate takes one cycle here, and SMLAD does two at once, but only on 16-bit halves: int8 weights must be
//! spread first, which costs more than the products. Three ideas avoid that (`kernel.s` has the instructions).
//!
//! **Two rows in one halfword.** The table stores `h = 256 a + b`, `a` from an even row, `b` from the odd row below. SMLAD on
//! two such halfwords as they come from memory accumulates `P = 256 A + B` modulo 2^32, where `A` and `B` are the rows'
//! accumulators: four products of weight and activation in one instruction, nothing unpacked.
//!
//! **Winograd's inner product** (S. Winograd, "A New Algorithm for Inner Product", IEEE Trans. Computers C-17, 1968) gives
//! the odd row with half the products. For activations `x0..x3` and odd weights `b0..b3` of four columns,
//!
//! ```text
//! (x2 + b0)(x0 + b2) + (x3 + b1)(x1 + b3) = x0 b0 + x1 b1 + x2 b2 + x3 b3  +  (x0 x2 + x1 x3)  +  (b0 b2 + b1 b3)
//! ```
//!
//! The left side is one SMLAD of two sums, and SXTAB16 makes such a sum straight from the halfwords: it adds the
//! sign-extended low bytes, which are the odd weights, to two activations. Of the right side's last two terms, the one
//! without activations is subtracted from the odd row's bias when the table is made; the one without weights, `S` summed
//! over all columns, is the same for all rows: it is computed once for a layer, while the layer before stores its outputs.
//!
//! **Separation at the end.** `A = (P - B) >> 8` is exact while `256 A` fits 32 bits, so even rows must stay below 2^23 in
//! magnitude; odd rows need not. [`DenseLayer::parse`] refuses a table in which some
//! activations could break this.
//!
//! All sums wrap modulo 2^32, so intermediate overflows cancel. No instruction depends on a value: for one network, the
//! number of instructions is the same for every input, and so is their order.
//!
//! # Flags
//! An observation has no one-hot part that could be a row gather instead of products: 11 of its 20 inputs are independent
//! flags, and any number of them may be set. They are multiplied like all other inputs. Adding a weight per set flag would
//! need unpacked weights and either a branch, which makes time depend on data, or a mask, which costs what the product
//! costs; the whole first layer of the shipped actor is a quarter of its inference.
//!
//! # Memory
//! Weights, sums to start from and multipliers of four rows follow each other in the order of use: the kernel reads the
//! table from front to back once, by LDM, which the flash interface serves by whole lines of four words.

#![allow(unsafe_code, reason = "the kernel is written in assembly")]

use super::activations::Scratch;
use super::dense::DenseLayer;
use super::geometry::{MAX_OUTPUTS, QUAD_ROWS};
use core::arch::global_asm;

global_asm!(include_str!("kernel.s"), options(raw));

unsafe extern "C" {
    /// `S` of `activations..end`.
    fn freshlane_pair_products(activations: *const i16, end: *const i16) -> i32;

    /// A layer whose rows become activations. Returns their `S`.
    fn freshlane_hidden_layer(
        stream: *const u8,
        activations: *const i16,
        next: *mut i16,
        columns: usize,
        next_end: *const i16,
        pair_products: i32,
    ) -> i32;

    /// A layer whose rows are outputs.
    fn freshlane_output_layer(
        stream: *const u8,
        activations: *const i16,
        outputs: *mut i32,
        columns: usize,
        outputs_end: *const i32,
        pair_products: i32,
    );
}

/// The outputs of a network of these layers, or `None` if its bytes are not aligned to a word.
pub(super) fn infer(
    hidden: &[DenseLayer<'_>],
    output: &DenseLayer<'_>,
    scratch: &mut Scratch,
    input: &[i8],
) -> Option<[i32; MAX_OUTPUTS]> {
    // A layer's biases and stream are whole words, so either all layers are aligned or none is.
    if !output.stream().as_ptr().cast::<u32>().is_aligned() {
        return None;
    }
    let [mut now, mut next] = scratch.0.each_mut();
    let first = hidden.first().unwrap_or(output).geometry();
    now.load(input, first);
    let mut outputs = [0; MAX_OUTPUTS];
    let columns = first.columns();
    // SAFETY: the kernel reads `columns` activations and writes a row's result for each of the geometry's `rows`; both are
    // at most MAX_WIDTH, the length of `Activations`, because MAX_WIDTH is a multiple of all padding, and rows of the last
    // layer are at most MAX_OUTPUTS. `DenseLayer::parse` has checked that a stream is as long as its geometry says, and the
    // test above that it is aligned; the activations are, by their type. The kernel keeps nothing.
    unsafe {
        let start = now.0.as_ptr();
        let mut pair_products = freshlane_pair_products(start, start.wrapping_add(columns));
        for layer in hidden {
            let end = next.0.as_ptr().wrapping_add(layer.geometry().rows());
            pair_products = freshlane_hidden_layer(
                layer.stream().as_ptr(),
                now.0.as_ptr(),
                next.0.as_mut_ptr(),
                layer.geometry().columns(),
                end,
                pair_products,
            );
            core::mem::swap(&mut now, &mut next);
        }
        freshlane_output_layer(
            output.stream().as_ptr(),
            now.0.as_ptr(),
            outputs.as_mut_ptr(),
            output.geometry().columns(),
            outputs.as_ptr().wrapping_add(output.geometry().rows()),
            pair_products,
        );
    }
    Some(outputs)
}

const _: () = assert!(MAX_OUTPUTS.is_multiple_of(QUAD_ROWS));
