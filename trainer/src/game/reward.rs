//! What an age after a slot is worth to the vehicle that has it.

use firmware::units::Age;

/// Minus the age, cut and scaled, and something for being received: the paper's own reward, and others of its kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AgeReward {
    /// An age is divided by this.
    pub scale: f32,
    /// Larger ages, in slots, count as this.
    pub cap: f32,
    /// What being received adds.
    pub success: f32,
}

impl AgeReward {
    /// The reward of a vehicle with this age after the slot.
    pub fn of(&self, age: Age, received: bool) -> f32 {
        let age = f32::from(age.min(Age::TIME_CONSTRAINT).slots()).min(self.cap);
        -age / self.scale + if received { self.success } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rewards_by_hand() {
        let reward = AgeReward {
            scale: 20.0,
            cap: 50.0,
            success: 0.05,
        };
        assert_eq!(reward.of(Age::after(1), true), -1.0 / 20.0 + 0.05);
        assert_eq!(reward.of(Age::after(10), false), -10.0 / 20.0);
        assert_eq!(reward.of(Age::after(300), false), -50.0 / 20.0);
    }
}
