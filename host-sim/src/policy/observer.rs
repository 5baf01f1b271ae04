//! Observations of a row of worlds at a time: [`Quantities::encode`], which also encodes the firmware's
//! [`Observation`](firmware::observation::Observation), is called lane by lane, and so is [`Sight::with`].

use crate::lanes::{LANES, Row, widened};
use crate::senses::{self, Broadcasts, Senses};
use firmware::lots::Identity;
use firmware::observation::{INPUTS, Quantities, Sight, liking, places_reciprocal, until_turn};
use firmware::ring::{Open, Ring, carrier, hop};
use firmware::units::{Dbm, Level, SubChannels};

/// What is heard in every world of a block.
#[derive(Clone, Debug)]
struct Heard {
    places: Row<i32>,
    /// [`places_reciprocal`] of them.
    places_reciprocal: Row<i32>,
    /// Bits of the open sub-channels.
    open: Row<i32>,
    /// The ring's frame.
    frame: Row<i32>,
    /// The first place of the slot.
    first: Row<i32>,
    /// The least priority with which to contend.
    threshold: Row<i32>,
    /// What the sub-channels that vehicles like are drawn with.
    salt: Row<i32>,
}

/// What one vehicle knows in every world of a block: a row of [`Quantities`].
#[derive(Clone, Debug)]
pub struct View {
    heard: Heard,
    age: Row<i32>,
    place: Row<i32>,
    assigned: Row<i32>,
    awaits: Row<i32>,
    lot: Row<i32>,
    weight: Row<i32>,
    /// The parts of [`Sight`].
    pub own: Row<i32>,
    own_gain: Row<i32>,
    pub best: Row<i32>,
    best_liking: Row<i32>,
    pub best_gain: Row<i32>,
    pub guest: Row<i32>,
    pub guest_gain: Row<i32>,
}

/// Sees for the vehicles of a row of worlds, in cells of one required SINR.
#[derive(Clone, Debug)]
pub struct Observer {
    /// In 1/256 dB.
    required: i32,
    max_power: Dbm,
    sub_channels: i32,
    gains_hold: i32,
    /// Of the block in work.
    heard: Heard,
}

impl Observer {
    /// For cells of this required SINR, in which nothing was heard yet.
    pub fn new(required: Level) -> Self {
        Self {
            required: i32::from(required.to_bits()),
            max_power: Dbm::from_bits(0),
            sub_channels: 0,
            gains_hold: 0,
            heard: Heard::NOTHING,
        }
    }

    /// The most that vehicles may send with, as it was heard last.
    #[inline(always)]
    pub fn max_power(&self) -> Dbm {
        self.max_power
    }

    /// Goes on with another block of worlds, or another slot.
    pub fn hear(&mut self, broadcasts: &Broadcasts<'_>) {
        self.max_power = broadcasts.max_power();
        self.gains_hold = broadcasts.gains_hold().into();
        for lane in 0..broadcasts.worlds() {
            if let Some(ring) = broadcasts.ring(lane) {
                self.sub_channels = ring.sub_channels().count() as i32;
                self.heard.set(
                    lane,
                    &ring,
                    broadcasts.first_places()[lane],
                    broadcasts.open()[lane],
                    broadcasts.thresholds()[lane],
                    broadcasts.salts()[lane],
                );
            }
        }
    }

    /// What a vehicle knows in every world of the block that was heard last.
    #[inline(always)]
    pub fn view(&self, senses: &Senses<'_>) -> View {
        let mut heard = self.heard.clone();
        if let Some(last) = senses.heard() {
            heard.replace(&last, senses);
        }
        let (places, told) = senses.places();
        let (mut lot, mut place) = ([0; LANES], [0; LANES]);
        let (slot, identities) = (senses.slot(), senses.identities());
        for lane in 0..LANES {
            lot[lane] = (Identity(identities[lane]).lot(slot) >> 16) as i32;
            // No place is the last of all codes, and so negative.
            place[lane] = i32::from(places[lane].cast_signed());
        }
        let none = Sight::NOTHING;
        let mut view = View {
            heard,
            age: widened(senses.ages()),
            place,
            assigned: widened(told),
            awaits: widened(&senses.awaits()),
            lot,
            weight: widened(senses.weights()),
            own: [none.own; LANES],
            own_gain: [none.own_gain; LANES],
            best: [none.best; LANES],
            best_liking: [none.best_liking; LANES],
            best_gain: [none.best_gain; LANES],
            guest: [none.guest; LANES],
            guest_gain: [none.guest_gain; LANES],
        };
        view.look(senses, self.gains_hold);
        view
    }

    /// What the vehicle knows in one world of the row.
    #[inline(always)]
    pub fn quantities(&self, view: &View, lane: usize) -> Quantities {
        let heard = &view.heard;
        Quantities {
            age: view.age[lane],
            sub_channels: self.sub_channels,
            places: heard.places[lane],
            places_reciprocal: heard.places_reciprocal[lane],
            frame: heard.frame[lane],
            place: view.place[lane],
            assigned: view.assigned[lane],
            awaits: view.awaits[lane],
            places_until_turn: until_turn(view.place[lane], heard.first[lane], heard.places[lane]),
            weight: view.weight[lane],
            threshold: heard.threshold[lane],
            gains_hold: self.gains_hold,
            lot: view.lot[lane],
            sight: view.sight(lane),
        }
    }

    /// The required SINR in 1/256 dB.
    #[inline(always)]
    pub fn required(&self) -> i32 {
        self.required
    }

    /// The actor's inputs, each in the range of i8. `[input][world]`.
    #[inline(always)]
    pub fn encode(&self, view: &View, inputs: &mut [Row<i32>; INPUTS]) {
        for lane in 0..LANES {
            let codes = self.quantities(view, lane).encode(self.required);
            // No iterator over inputs: its end would be asked for in every lane, and the stores masked, which are slow.
            for input in 0..INPUTS {
                inputs[input][lane] = codes[input];
            }
        }
    }
}

impl Heard {
    const NOTHING: Self = Self {
        places: [1; LANES],
        places_reciprocal: [0; LANES],
        open: [0; LANES],
        frame: [0; LANES],
        first: [0; LANES],
        threshold: [Quantities::NEVER; LANES],
        salt: [0; LANES],
    };

    fn set(&mut self, lane: usize, ring: &Ring, first: u16, open: u16, threshold: u32, salt: u8) {
        self.salt[lane] = salt.into();
        self.places[lane] = ring.places().into();
        self.places_reciprocal[lane] = places_reciprocal(ring.places());
        self.open[lane] = open.into();
        self.frame[lane] = ring.frame();
        self.first[lane] = first.into();
        self.threshold[lane] = threshold.min(Quantities::NEVER as u32) as i32;
    }

    /// What the vehicle heard itself, where not everybody hears all.
    #[inline(never)]
    fn replace(&mut self, last: &senses::Heard<'_>, senses: &Senses<'_>) {
        for lane in 0..senses.worlds() {
            let ring = SubChannels::new(senses.sub_channels())
                .and_then(|sub_channels| Ring::new(last.places[lane], sub_channels));
            if let Some(ring) = ring {
                let first = ring.first_place(senses.slot());
                self.set(
                    lane,
                    &ring,
                    first,
                    last.open[lane],
                    last.thresholds[lane],
                    last.salts[lane],
                );
            }
        }
    }
}

impl View {
    /// Looks at all sub-channels in the order of the ring.
    #[inline(always)]
    fn look(&mut self, senses: &Senses<'_>, gains_hold: i32) {
        let Some(sub_channels) = SubChannels::new(senses.sub_channels()) else {
            return;
        };
        let hop = hop(senses.slot(), sub_channels);
        let mut place = self.heard.first;
        for offset in 0..sub_channels.count() {
            let sub_channel = carrier(offset, hop, sub_channels);
            let gain = senses.gain(sub_channel);
            // Where gains hold it likes what they are, and nothing is drawn.
            let mut likings = gain;
            if gains_hold == 0 {
                for lane in 0..LANES {
                    let (lot, salt) = (self.lot[lane], self.heard.salt[lane]);
                    likings[lane] = liking(gain[lane], gains_hold, lot, salt, sub_channel as i32);
                }
            }
            for lane in 0..LANES {
                let places = self.heard.places[lane];
                let open = Open(self.heard.open[lane] as u16).contains(sub_channel);
                let sight = self.sight(lane).with(
                    sub_channel as i32,
                    place[lane],
                    gain[lane],
                    self.place[lane],
                    open,
                    likings[lane],
                );
                self.own[lane] = sight.own;
                self.own_gain[lane] = sight.own_gain;
                self.best[lane] = sight.best;
                self.best_liking[lane] = sight.best_liking;
                self.best_gain[lane] = sight.best_gain;
                self.guest[lane] = sight.guest;
                self.guest_gain[lane] = sight.guest_gain;
                let after = place[lane] + 1;
                place[lane] = if after == places { 0 } else { after };
            }
        }
    }

    /// What the vehicle has seen so far in one world.
    #[inline(always)]
    fn sight(&self, lane: usize) -> Sight {
        Sight {
            own: self.own[lane],
            own_gain: self.own_gain[lane],
            best: self.best[lane],
            best_liking: self.best_liking[lane],
            best_gain: self.best_gain[lane],
            guest: self.guest[lane],
            guest_gain: self.guest_gain[lane],
        }
    }
}
