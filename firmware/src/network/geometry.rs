//! Shapes of layers, and the limits of what a table may hold.

/// Widest layer a table may have (the paper's actor has 1024 units in its first hidden layer).
pub const MAX_WIDTH: usize = 1024;

/// Most outputs of a network's last layer.
pub const MAX_OUTPUTS: usize = 8;

/// Rows of a quad: what the stream holds, and the kernel computes, together.
pub const QUAD_ROWS: usize = 4;

/// Columns are padded to a multiple of this: one unrolled step of the kernel.
pub const BLOCK_COLUMNS: usize = 8;

/// A layer's shape, and the place in its network that decides what its activations can be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Geometry {
    /// Row length.
    pub inputs: usize,
    /// Number of rows.
    pub outputs: usize,
    /// Whether its activations are the network's int8 input; otherwise they are 0 to 255.
    pub first: bool,
    /// Whether its rows are the network's outputs; otherwise they are another layer's activations.
    pub last: bool,
}

impl Geometry {
    /// Row length in the stream.
    pub const fn columns(&self) -> usize {
        self.inputs.next_multiple_of(BLOCK_COLUMNS)
    }

    /// Number of rows in the stream. A hidden layer's are whole blocks of the next layer's columns.
    pub const fn rows(&self) -> usize {
        self.outputs
            .next_multiple_of(if self.last { QUAD_ROWS } else { BLOCK_COLUMNS })
    }

    /// Bytes of a quad: four words of sums to start from, two bytes for four rows' weights in a column pair, four
    /// multipliers.
    pub(super) const fn quad_len(&self) -> usize {
        self.columns().saturating_mul(QUAD_ROWS).saturating_add(32)
    }

    /// Bytes of the stream.
    pub const fn stream_len(&self) -> usize {
        (self.rows() / QUAD_ROWS).saturating_mul(self.quad_len())
    }

    /// The least and the greatest activation.
    pub(super) const fn activation_range(&self) -> (i32, i32) {
        if self.first {
            (i8::MIN as i32, i8::MAX as i32)
        } else {
            (0, u8::MAX as i32)
        }
    }
}
