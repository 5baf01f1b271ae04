//! The AoI clock: a decentralised protocol in which a vehicle's own age is its clock.
//!
//! A vehicle sends on its home sub-channel whenever its age is a multiple of its group's period, so the group's members take
//! turns without any message between them. After a fade it waits a whole period, which keeps its turn. A vehicle that has
//! lost its turn joins anew: with the broadcast probability, drawn from its own fading, at one of four received levels,
//! chosen low so that a vehicle in its turn captures the receiver.
//!
//! Networks imitate it, and a unit falls back on it in a slot without a measurement.

use crate::decision::{Action, JOINER_LEVELS};
use crate::observation::Observation;
use crate::units::Level;

/// What the clock does: the expert that networks imitate.
pub fn act(observation: &Observation, required_sinr: Level) -> Action {
    // Two strong vehicles on one turn would collide for ever: they part. Weak ones are more likely faded, and keep it.
    let known = observation.quantities();
    let joins = known.turn_lost() || (known.overdue() && known.strong());
    rule(observation, required_sinr, joins, known.thinned_uniform())
}

/// The clock's rule for a vehicle that is known to join anew, or not. If it does, it sends when `draw` is below 65536; the draw is
/// then uniform, so it also chooses the level.
pub(crate) fn rule(observation: &Observation, required_sinr: Level, joins: bool, draw: i32) -> Action {
    if observation.home_gain() < required_sinr {
        Action::Silent
    } else if joins {
        let level = (draw as usize).wrapping_mul(JOINER_LEVELS) >> 16;
        Action::JOINERS.get(level).copied().unwrap_or(Action::Silent)
    } else if observation.quantities().own_turn() {
        Action::FullPower
    } else {
        Action::Silent
    }
}
