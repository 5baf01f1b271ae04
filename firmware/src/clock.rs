//! The ring clock: a protocol in which the slot's index tells every vehicle when its turn is.
//!
//! A vehicle sends at full power whenever a sub-channel carries its place, whatever its gain seems to be: the place is nobody else's. The
//! base station also says in every slot which places are nobody's, and how great a priority it takes
//! to contend there ([`Quantities::priority`](crate::observation::Quantities::priority)): whoever has that, by an old age or for want of
//! a place, sends on the open sub-channel that it likes best, at one of four received levels, of which a higher one captures the receiver.
//! It waits while an acknowledgement is under way. Where its own turn comes in the same slot, it contends only if it would not be received
//! in its place. Where a vehicle without a place is received, it has found one.
//!
//! Whoever is far above the threshold and cannot contend may be a guest: it sends where another one's place is, at the lowest level. That
//! is worth something because in such slots owners whose gain does not suffice are silent.
//!
//! Networks imitate it, and a unit falls back on it in a slot without a measurement.

use crate::decision::Action;
use crate::observation::Observation;
use crate::units::Level;

/// What the clock does: the expert that networks imitate.
pub fn act(observation: &Observation, required_sinr: Level) -> Action {
    let known = observation.quantities();
    let required = i32::from(required_sinr.to_bits());
    let reaches = |gain: i32| (gain >= required) | (known.gains_hold == 0);
    let contends =
        known.is_called() & (known.sight.best >= 0) & reaches(known.sight.best_gain) & (known.awaits == 0);
    let is_guest = known.is_guest(required) & (known.awaits == 0);
    let own_turn = !known.turn_lost() & known.own_turn();
    let nobody_waits = known.sight.best < 0;
    if own_turn & (nobody_waits | reaches(known.sight.own_gain)) {
        Action::FullPower
    } else if contends {
        Action::JOINERS
            .get(known.level() as usize)
            .copied()
            .unwrap_or(Action::Silent)
    } else if is_guest {
        Action::Guest
    } else {
        Action::Silent
    }
}
