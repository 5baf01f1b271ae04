//! Actions of a vehicle in a row of worlds as sub-channels and powers: [`PowerPlan::decision`], lane by lane.

use super::observer::{Observer, View};
use crate::decisions::{SILENT, VehicleDecisions};
use crate::lanes::{LANES, Row};
use crate::senses::Senses;
use firmware::decision::{Action, PowerPlan, power};
use firmware::observation::NOWHERE;
use firmware::units::Dbm;

/// Carries out actions that somebody else chose for a vehicle in the row of worlds that the observer heard last.
pub fn carry_out(
    observer: &Observer,
    plan: &PowerPlan,
    senses: &Senses<'_>,
    actions: &Row<i32>,
    decisions: &mut VehicleDecisions<'_>,
) {
    senses.vectors().run(
        #[inline(always)]
        || set(observer, plan, &observer.view(senses), actions, decisions),
    );
}

/// The same within a loop on the vector unit, with what the vehicle sees.
#[inline(always)]
pub(super) fn set(
    observer: &Observer,
    plan: &PowerPlan,
    view: &View,
    actions: &Row<i32>,
    decisions: &mut VehicleDecisions<'_>,
) {
    *decisions.sub_channel = sub_channels(view, actions);
    *decisions.power = powers(plan, observer.max_power(), view, actions);
}

/// All bits set where this action is the chosen one. Of a choice between two rows the compiler makes one between their addresses, lane
/// after lane.
#[inline(always)]
fn mask(chosen: i32, action: Action) -> i32 {
    i32::from(chosen == action as i32).wrapping_neg()
}

/// Where an action sends: its own place's sub-channel, the best one to contend on, the best one of others, or nowhere.
#[inline(always)]
fn sub_channels(view: &View, actions: &Row<i32>) -> Row<u8> {
    let mut chosen = [0; LANES];
    for lane in 0..LANES {
        let silent = mask(actions[lane], Action::Silent);
        // All bits set, as in no sub-channel.
        const _: () = assert!(SILENT == u8::MAX && NOWHERE as u8 == SILENT);
        let own = mask(actions[lane], Action::FullPower);
        let guest = mask(actions[lane], Action::Guest);
        let best = view.best[lane] & !(own | guest);
        let sub_channel = best | view.own[lane] & own | view.guest[lane] & guest;
        chosen[lane] = (sub_channel | silent) as u8;
    }
    chosen
}

/// Powers in 1/256 dBm as [`PowerPlan::decision`] gives them; without meaning for silence.
#[inline(always)]
fn powers(plan: &PowerPlan, max_power: Dbm, view: &View, actions: &Row<i32>) -> Row<i16> {
    let aims = Action::ALL.map(|action| i32::from(plan.aim(action).to_bits()));
    let mut powers = [0; LANES];
    for lane in 0..LANES {
        let mut chosen = 0;
        for (action, &aim) in Action::ALL.into_iter().zip(&aims) {
            chosen = if actions[lane] == action as i32 {
                aim
            } else {
                chosen
            };
        }
        let guest = mask(actions[lane], Action::Guest);
        let gain = view.guest_gain[lane] & guest | view.best_gain[lane] & !guest;
        // At full power no gain is reduced.
        powers[lane] = power(max_power, gain, chosen) as i16;
    }
    powers
}
