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
use crate::observation::{Observation, Quantities};
use crate::units::Level;

/// What the clock does: the expert that networks imitate.
pub fn act(observation: &Observation, required_sinr: Level) -> Action {
    let chosen = choose(observation.quantities(), i32::from(required_sinr.to_bits()));
    Action::ALL
        .get(chosen as usize)
        .copied()
        .unwrap_or(Action::Silent)
}

/// The index of the action that the clock takes; `required_sinr` is in 1/256 dB. Bits and no branch: the simulator calls it for a row of
/// worlds, lane by lane.
#[inline(always)]
pub const fn choose(known: &Quantities, required_sinr: i32) -> i32 {
    let sight = &known.sight;
    let nobody_waits = sight.best < 0;
    let own_turn =
        !known.turn_lost() & known.own_turn() & (nobody_waits | known.reaches(sight.own_gain, required_sinr));
    let may_contend = !own_turn & (known.awaits == 0);
    let contends =
        may_contend & known.is_called() & !nobody_waits & known.reaches(sight.best_gain, required_sinr);
    let is_guest = may_contend & !contends & known.is_guest(required_sinr);
    let joiner = (Action::Joiner1 as i32).wrapping_add(known.level());
    mask(own_turn) & Action::FullPower as i32
        | mask(contends) & joiner
        | mask(is_guest) & Action::Guest as i32
}

/// All bits set for a yes.
#[inline(always)]
const fn mask(condition: bool) -> i32 {
    (condition as i32).wrapping_neg()
}
