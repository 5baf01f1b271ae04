//! From instructions to cycles of a Cortex-M4 at 168 MHz: a model, not a measurement.
//!
//! The kernel's instructions are few and known one by one (`firmware/src/network/kernel.s`), so its cycles are added up from
//! the Cortex-M4 Technical Reference Manual (revision r0p1, table 3-1). Everything else is the compiler's code, for which a
//! number of cycles for each instruction is assumed.

use firmware::network::{BLOCK_COLUMNS, Geometry, Network, QUAD_ROWS};

/// The core's clock.
pub const CORE_HZ: f64 = 168.0e6;

/// Cycles of a slot of 1 ms.
pub const SLOT_CYCLES: f64 = CORE_HZ / 1000.0;

/// Wait states of the flash at 168 MHz (RM0090 table 10): what the first use of a line of 16 bytes waits.
const WAIT_STATES: f64 = 5.0;
/// Bytes of a line of flash.
const LINE: f64 = 16.0;

/// Cycles for one instruction of compiled code without wait states (assumed: loads take 2 cycles, taken branches 3, most
/// others 1).
const CYCLES_PER_INSTRUCTION: f64 = 1.6;
/// Code bytes of a compiled instruction (2 or 4; assumed).
const INSTRUCTION_BYTES: f64 = 2.7;

/// Instructions and cycles without wait states of a stretch of the kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// Instructions.
    pub instructions: u64,
    /// Cycles: LDM and STM of n registers 1 + n, LDRD 3, LDR 2, a taken branch 3, arithmetic 1.
    pub cycles: u64,
}

impl Cost {
    const fn new(instructions: u64, cycles: u64) -> Self {
        Self { instructions, cycles }
    }

    const fn times(self, count: u64) -> Self {
        Self::new(self.instructions * count, self.cycles * count)
    }

    const fn and(self, other: Self) -> Self {
        Self::new(self.instructions + other.instructions, self.cycles + other.cycles)
    }
}

/// `freshlane_pair_products` around its loop, and a turn of the loop: eight activations.
const PRODUCTS: Cost = Cost::new(5, 11);
const PRODUCTS_BLOCK: Cost = Cost::new(5, 11);
/// `ENTER` and `LEAVE`.
const LAYER: Cost = Cost::new(15 + 3, 33 + 16);
/// `BEGIN_QUAD` and `END_QUAD`.
const QUAD: Cost = Cost::new(3 + 14, 11 + 20);
/// What a hidden layer does with a quad's results, and what the last does.
const HIDDEN_QUAD: Cost = Cost::new(12, 21);
const OUTPUT_QUAD: Cost = Cost::new(5, 14);
/// `BLOCK`: eight columns of four rows.
const BLOCK: Cost = Cost::new(23, 35);
/// The loop's test after a pass that is not the last: LDRD, CMP, a taken branch.
const PASS: Cost = Cost::new(3, 7);
/// Blocks of a pass.
const HIDDEN_PASS_BLOCKS: u64 = 8;
const OUTPUT_PASS_BLOCKS: u64 = 2;
/// Code of the kernel's three functions, in bytes: 736 + 184 of blocks and about 130 + 120 + 30 around them.
const KERNEL_BYTES: f64 = 1200.0;

/// The kernel alone, without the few instructions that call it.
pub fn kernel_cost(network: &Network<'_>) -> Cost {
    let blocks = |geometry: &Geometry| (geometry.columns() / BLOCK_COLUMNS) as u64;
    let first = network
        .layers()
        .next()
        .map_or(0, |layer| blocks(layer.geometry()));
    let products = PRODUCTS.and(PRODUCTS_BLOCK.times(first));
    network.layers().fold(products, |cost, layer| {
        let geometry = layer.geometry();
        let (results, pass) = if geometry.last {
            (OUTPUT_QUAD, OUTPUT_PASS_BLOCKS)
        } else {
            (HIDDEN_QUAD, HIDDEN_PASS_BLOCKS)
        };
        let blocks = blocks(geometry);
        let quad = QUAD
            .and(results)
            .and(BLOCK.times(blocks))
            .and(PASS.times(blocks.div_ceil(pass) - 1));
        cost.and(LAYER)
            .and(quad.times((geometry.rows() / QUAD_ROWS) as u64))
    })
}

/// Modelled cycles of an inference of this many instructions, wait states included: every line of weights is read once, in
/// order, and waits in full; so does every line of the kernel's code, once, since the rest of a slot has taken its place in
/// the instruction cache of 1 KiB, which holds the loop from then on.
pub fn inference_cycles(network: &Network<'_>, instructions: u64) -> f64 {
    let kernel = kernel_cost(network);
    let stream: usize = network.layers().map(|layer| layer.stream().len()).sum();
    let lines = (stream as f64 + KERNEL_BYTES) / LINE;
    let around = instructions.saturating_sub(kernel.instructions);
    kernel.cycles as f64 + lines * WAIT_STATES + compiled_cycles(around)
}

/// Instructions of a slot of three sub-channels around its inference (chosen: a little more than the longest slot has; `tests/deadline.rs`
/// holds it).
pub const AROUND_INFERENCE: u64 = 3_100;

/// Modelled cycles of the longest slot with this network, without an emulator.
pub fn slot_cycles(network: &Network<'_>) -> f64 {
    inference_cycles(network, kernel_cost(network).instructions) + compiled_cycles(AROUND_INFERENCE)
}

/// Modelled cycles of compiled code, pessimistic: every line of code is read from flash anew.
pub fn compiled_cycles(instructions: u64) -> f64 {
    instructions as f64 * (CYCLES_PER_INSTRUCTION + INSTRUCTION_BYTES / LINE * WAIT_STATES)
}
