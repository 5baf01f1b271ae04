//! Arrays of rows.

use super::{LANES, Row};

/// `[item][world]`: what an item, such as a vehicle, has in every world of a batch. Worlds are padded to whole rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows<T> {
    blocks: usize,
    /// `[item][block]`.
    rows: Vec<Row<T>>,
}

impl<T: Copy> Rows<T> {
    /// The same value everywhere.
    pub fn new(worlds: usize, items: usize, value: T) -> Self {
        let blocks = worlds.div_ceil(LANES);
        Self {
            blocks,
            rows: vec![[value; LANES]; items * blocks],
        }
    }

    /// How many rows an item has: worlds `block * LANES` and the following are in row `block`.
    #[inline(always)]
    pub fn blocks(&self) -> usize {
        self.blocks
    }

    /// An item's values in one block of worlds.
    #[inline(always)]
    pub fn row(&self, block: usize, item: usize) -> &Row<T> {
        &self.rows[item * self.blocks + block]
    }

    /// The same, to be written.
    #[inline(always)]
    pub fn row_mut(&mut self, block: usize, item: usize) -> &mut Row<T> {
        &mut self.rows[item * self.blocks + block]
    }

    /// An item's value in one world.
    #[inline(always)]
    pub fn get(&self, world: usize, item: usize) -> T {
        self.row(world / LANES, item)[world % LANES]
    }

    /// Sets an item's value in one world.
    #[inline(always)]
    pub fn set(&mut self, world: usize, item: usize, value: T) {
        self.row_mut(world / LANES, item)[world % LANES] = value;
    }

    /// Sets an item's value in all worlds.
    pub fn fill(&mut self, item: usize, value: T) {
        self.rows[item * self.blocks..][..self.blocks].fill([value; LANES]);
    }

    /// Sets all items' values.
    pub fn fill_all(&mut self, value: T) {
        self.rows.fill([value; LANES]);
    }

    /// All values, `[item][world]` with worlds padded to a multiple of [`LANES`].
    pub fn as_flat(&self) -> &[T] {
        self.rows.as_flattened()
    }

    /// The same, to be written.
    pub fn as_flat_mut(&mut self) -> &mut [T] {
        self.rows.as_flattened_mut()
    }
}
