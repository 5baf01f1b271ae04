//! A batch as global critics see it.

/// A batch of joint observations.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Vehicles that a sample has room for.
    pub vehicles: usize,
    /// `[sample][vehicle][width]`.
    pub observations: &'a [f32],
    /// Values that a vehicle has in `observations`.
    pub width: usize,
    /// How many of them, from the first on, the vehicle itself observes.
    pub observed: usize,
    /// `[sample]`: vehicles from this one on are absent.
    pub present: &'a [u8],
}

impl View<'_> {
    /// Samples.
    pub fn samples(&self) -> usize {
        self.present.len()
    }

    /// Whether a vehicle takes part in a sample.
    pub fn takes_part(&self, sample: usize, vehicle: usize) -> bool {
        vehicle < usize::from(self.present[sample])
    }

    /// What is known of a vehicle in a sample.
    pub fn row(&self, sample: usize, vehicle: usize) -> &[f32] {
        &self.observations[(sample * self.vehicles + vehicle) * self.width..][..self.width]
    }
}
