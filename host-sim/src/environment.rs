//! A batch of worlds, slot by slot: reset, observe, step. It is the only radio-and-age loop there is; policies, the trainer,
//! sweeps and the tests all drive it.
//!
//! # Layout
//! Arrays are `[vehicle][world]`, those over sub-channels `[vehicle][sub_channel][world]`, and contiguous; worlds are padded to
//! whole rows of [`crate::lanes::LANES`]. A world's bytes follow from its key alone: they do not depend on the batch, the lane or
//! the thread that it is run in.

use crate::activity::Activity;
use crate::base_station::BaseStation;
use crate::channel::Channel;
use crate::churn::{Churn, Replacement};
use crate::decisions::{Decisions, SILENT};
use crate::imperfections::{Losses, sensing};
use crate::lanes::{LANES, Rows, Vectors};
use crate::mobility::{Mobility, MobilitySource, Place};
use crate::policy::{Decider, Setup};
use crate::presence::Presence;
use crate::radio::Radio;
use crate::scenario::Scenario;
use crate::senses::{AllSenses, Broadcasts, Readings, Senses, Sensing};
use crate::stream::{Purpose, WorldKey};
use crate::truth::{Knowledge, Truth};
use firmware::lots::Identity;
use firmware::measurement::{Broadcast, Measurement};
use firmware::units::{Age, SlotIndex};
use kit::error::{Error, Result};
use std::ops::Range;

/// Index of a world's first slot: every start age then has a slot in which the vehicle was last received.
const FIRST_SLOT: u32 = Age::TIME_CONSTRAINT.slots() as u32;

/// What the age of a vehicle that associates would be in the slot before.
const BEFORE_FIRST: Age = Age::after(Age::TIME_CONSTRAINT.slots() as u32 - 1);

/// Worlds of one scenario at the beginning of a slot, before anybody decides.
///
/// ```
/// use host_sim::decisions::Decisions;
/// use host_sim::mobility::Grid;
/// use host_sim::stream::Purpose;
/// use host_sim::{Environment, ScenarioSource};
///
/// # fn main() -> host_sim::Result<()> {
/// let scenario = ScenarioSource::default().read()?;
/// let mut environment = Environment::new(&scenario, &Grid, 1, Purpose::Evaluation, 0..2);
/// let mut decisions = Decisions::new(environment.worlds(), environment.vehicles());
/// // In world 0 vehicle 3 sends alone, on sub-channel 1 at full power.
/// decisions.transmit(0, 3, 1, scenario.radio.max_power());
/// environment.step(&decisions);
/// let age = if environment.received(0, 3) { 1 } else { 101 };
/// assert_eq!(environment.age(0, 3).slots(), age);
/// assert_eq!(environment.age(1, 3).slots(), 101);
/// # Ok(())
/// # }
/// ```
pub struct Environment<'s> {
    scenario: &'s Scenario,
    source: &'s dyn MobilitySource,
    vectors: Vectors,
    /// How many vehicles there is room for.
    vehicles: usize,
    /// By world.
    keys: Vec<WorldKey>,
    mobility: Vec<Box<dyn Mobility + 's>>,
    /// Why vehicles do not move any more.
    failure: Option<Error>,
    /// Of the present vehicles, by world.
    places: Vec<Vec<(usize, Place)>>,
    presence: Presence,
    arrivals: Vec<usize>,
    departures: Vec<usize>,
    /// By world; none where nobody is replaced.
    churn: Vec<Churn>,
    replaced: Vec<usize>,
    /// Of this slot, by world, then vehicle.
    replacements: Vec<Replacement>,
    channel: Channel<'s>,
    radio: Radio,
    base_station: BaseStation,
    sensing: Box<dyn Sensing>,
    /// Of a scheduler's grants, if any are lost.
    grant_losses: Option<Losses>,
    activity: Activity,
    /// In slots, `[vehicle][world]`.
    ages: Rows<u16>,
    /// 1 where a vehicle sent in the slot before, `[vehicle][world]`; where acknowledgements are late.
    sent: Option<Rows<u8>>,
    /// Whether vehicles decide for themselves, as far as is known, and so listen to whom the base station calls.
    listened_to: bool,
    /// The decisions of those who are present, where worlds have different vehicles.
    present_decisions: Option<Decisions>,
    slot: u32,
}

impl<'s> Environment<'s> {
    /// The worlds with these indices before their first slot. Every vehicle starts at the age of the time constraint.
    pub fn new(
        scenario: &'s Scenario,
        source: &'s dyn MobilitySource,
        seed: u64,
        purpose: Purpose,
        worlds: Range<u64>,
    ) -> Self {
        Self::with_room(scenario, source, seed, purpose, worlds, 0)
    }

    /// [`Environment::new`] with room for `vehicles` in all, where the source brings fewer: the others may
    /// [`Environment::join`]. As long as none does, the bytes are the same.
    pub fn with_room(
        scenario: &'s Scenario,
        source: &'s dyn MobilitySource,
        seed: u64,
        purpose: Purpose,
        worlds: Range<u64>,
        vehicles: usize,
    ) -> Self {
        let keys: Vec<WorldKey> = worlds.map(|world| WorldKey { seed, purpose, world }).collect();
        let (count, vehicles) = (keys.len(), vehicles.max(source.vehicles(scenario)));
        let differs = source.worlds_differ();
        let mut environment = Self {
            scenario,
            source,
            vectors: Vectors::widest(),
            vehicles,
            mobility: keys.iter().map(|key| source.open(scenario, key)).collect(),
            failure: None,
            places: vec![Vec::new(); count],
            presence: Presence::new(count, vehicles, differs),
            arrivals: Vec::new(),
            departures: Vec::new(),
            churn: keys
                .iter()
                .filter_map(|key| Churn::new(scenario.cell.replacement_probability, vehicles, key))
                .collect(),
            replaced: Vec::new(),
            replacements: Vec::new(),
            channel: Channel::new(scenario, vehicles, &keys),
            radio: Radio::new(scenario, &keys, vehicles),
            base_station: BaseStation::new(scenario, &keys, vehicles),
            sensing: sensing(scenario, vehicles, &keys),
            grant_losses: Losses::new(scenario.feedback.grant_loss, 4, &keys),
            activity: Activity::new(count),
            ages: Rows::new(count, vehicles, Age::TIME_CONSTRAINT.slots()),
            sent: (scenario.feedback.acknowledgement_delay_slots > 0).then(|| Rows::new(count, vehicles, 0)),
            listened_to: true,
            present_decisions: differs.then(|| Decisions::new(count, vehicles)),
            keys,
            slot: FIRST_SLOT,
        };
        environment.begin_slot();
        environment
    }

    /// Goes on with other worlds before their first slot, as [`Environment::with_room`] makes them. As many as there were take the
    /// memory of these.
    pub fn reset(&mut self, seed: u64, purpose: Purpose, worlds: Range<u64>) {
        if worlds.end.saturating_sub(worlds.start) != self.keys.len() as u64 {
            let vectors = self.vectors;
            *self = Self::with_room(self.scenario, self.source, seed, purpose, worlds, self.vehicles);
            self.vectors = vectors;
            return;
        }
        for (key, world) in self.keys.iter_mut().zip(worlds) {
            *key = WorldKey { seed, purpose, world };
        }
        let (scenario, source, keys) = (self.scenario, self.source, &self.keys);
        for (mobility, key) in self.mobility.iter_mut().zip(keys) {
            if !mobility.reset(key) {
                *mobility = source.open(scenario, key);
            }
        }
        self.failure = None;
        self.places.iter_mut().for_each(Vec::clear);
        self.presence.reset();
        for (churn, key) in self.churn.iter_mut().zip(keys) {
            churn.reset(key);
        }
        self.replacements.clear();
        self.channel.reset(keys);
        self.radio.reset(keys);
        self.base_station.reset(keys);
        if !self.sensing.reset(keys) {
            self.sensing = sensing(scenario, self.vehicles, keys);
        }
        if let Some(losses) = &mut self.grant_losses {
            losses.reset(keys);
        }
        self.activity.reset();
        self.ages.fill_all(Age::TIME_CONSTRAINT.slots());
        if let Some(sent) = &mut self.sent {
            sent.fill_all(0);
        }
        self.listened_to = true;
        self.slot = FIRST_SLOT;
        self.begin_slot();
    }

    /// Worlds in the same state, which go on by themselves: equal decisions give equal bytes.
    ///
    /// # Errors
    /// [`Error::Input`] where an outside program moves the vehicles.
    pub fn copy(&self) -> Result<Self> {
        let copies: Option<Vec<_>> = self.mobility.iter().map(|mobility| mobility.copy()).collect();
        let moved_outside = || {
            let found = "vehicles that another program moves";
            Error::input("copy of an environment", found, "the grid's or a trace's")
        };
        Ok(Self {
            scenario: self.scenario,
            source: self.source,
            vectors: self.vectors,
            vehicles: self.vehicles,
            keys: self.keys.clone(),
            mobility: copies.ok_or_else(moved_outside)?,
            failure: None,
            places: self.places.clone(),
            presence: self.presence.clone(),
            arrivals: self.arrivals.clone(),
            departures: self.departures.clone(),
            churn: self.churn.clone(),
            replaced: self.replaced.clone(),
            replacements: self.replacements.clone(),
            channel: self.channel.clone(),
            radio: self.radio.clone(),
            base_station: self.base_station.clone(),
            sensing: self.sensing.copy(),
            grant_losses: self.grant_losses.clone(),
            activity: self.activity.clone(),
            ages: self.ages.clone(),
            sent: self.sent.clone(),
            listened_to: self.listened_to,
            present_decisions: self.present_decisions.clone(),
            slot: self.slot,
        })
    }

    /// Goes on with another vector unit. The bytes are the same.
    pub fn set_vectors(&mut self, vectors: Vectors) {
        self.vectors = vectors;
    }

    /// Lets something come between the truth and all units, from this slot on.
    pub fn set_sensing(&mut self, sensing: Box<dyn Sensing>) {
        self.sensing = sensing;
        self.begin_sensing();
    }

    /// The vector unit that does the work.
    pub fn vectors(&self) -> Vectors {
        self.vectors
    }

    /// The scenario.
    pub fn scenario(&self) -> &'s Scenario {
        self.scenario
    }

    /// The worlds' keys.
    pub fn keys(&self) -> &[WorldKey] {
        &self.keys
    }

    /// How many worlds.
    pub fn worlds(&self) -> usize {
        self.keys.len()
    }

    /// A vehicle joins every world near a place in metres. It is present from the next update of places on. `None` if there is no
    /// room, or the vehicles' source takes none.
    pub fn join(&mut self, x_m: f64, y_m: f64) -> Option<usize> {
        let room = self.vehicles;
        let joined = self
            .mobility
            .iter_mut()
            .map(|mobility| mobility.join(x_m, y_m, room));
        joined.last().flatten()
    }

    /// Tells a vehicle of one world to drive these links of its source's roads.
    ///
    /// # Errors
    /// As [`Mobility::take_route`].
    pub fn tell_route(&mut self, world: usize, vehicle: usize, links: &[u32]) -> Result<()> {
        self.mobility[world].take_route(vehicle, links)
    }

    /// Why vehicles stand still since some update of their places, if their source failed.
    pub fn failure(&self) -> Option<&Error> {
        self.failure.as_ref()
    }

    /// [`Environment::failure`], to be handed on.
    pub fn take_failure(&mut self) -> Option<Error> {
        self.failure.take()
    }

    /// How many vehicles there is room for, at least all that ever appear in a world; their indices are below.
    pub fn vehicles(&self) -> usize {
        self.vehicles
    }

    /// How many sub-channels the cell has.
    pub fn sub_channels(&self) -> usize {
        self.scenario.radio.sub_channels as usize
    }

    /// Who is present where.
    pub fn presence(&self) -> &Presence {
        &self.presence
    }

    /// The vehicles that are present in some world, ascending ([`Presence::vehicles`]).
    pub fn present(&self) -> &[usize] {
        self.presence.vehicles()
    }

    /// The slot's index as units count it.
    pub fn slot(&self) -> SlotIndex {
        SlotIndex(self.slot)
    }

    /// Slots since the start.
    pub fn elapsed(&self) -> u32 {
        self.slot - FIRST_SLOT
    }

    /// Ages of information at the beginning of the slot, in slots: `[vehicle][world]`.
    pub fn ages(&self) -> &Rows<u16> {
        &self.ages
    }

    /// Whether each vehicle was received in the slot before: 1 or 0, `[vehicle][world]`.
    pub fn receptions(&self) -> &Rows<u8> {
        self.radio.received()
    }

    /// How many vehicles were received in the slot before, in every world: one item.
    pub fn successes(&self) -> &Rows<u16> {
        self.radio.successes()
    }

    /// What the vehicles did in the slot before, in every world.
    pub fn activity(&self) -> &Activity {
        &self.activity
    }

    /// A vehicle's age of information at the beginning of the slot.
    pub fn age(&self, world: usize, vehicle: usize) -> Age {
        Age::after(u32::from(self.ages.get(world, vehicle)))
    }

    /// Sets a vehicle's age before its first decision, for training from many starts.
    pub fn set_age(&mut self, world: usize, vehicle: usize, age: Age) {
        self.ages.set(world, vehicle, age.slots());
        self.sensing.begin_unit(world, vehicle, age);
    }

    /// A vehicle's true gain on a sub-channel, in dB over noise at full power.
    pub fn gain_db(&self, world: usize, vehicle: usize, sub_channel: usize) -> f32 {
        let item = vehicle * self.sub_channels() + sub_channel;
        self.channel.gain_db().get(world, item)
    }

    /// Noise plus others' power on a sub-channel in the slot before, in dB over noise.
    pub fn interference_db(&self, world: usize, vehicle: usize, sub_channel: usize) -> f32 {
        let item = vehicle * self.sub_channels() + sub_channel;
        self.radio.interference_db().get(world, item)
    }

    /// The vehicle of whose index another one has had the use from the beginning of this slot on, if one has.
    pub fn replacement(&self, world: usize, vehicle: usize) -> Option<&Replacement> {
        let place = |one: &Replacement| (one.world, one.vehicle).cmp(&(world, vehicle));
        let found = self.replacements.binary_search_by(place);
        found.ok().map(|index| &self.replacements[index])
    }

    /// All of this slot, by world, then vehicle.
    pub fn replacements(&self) -> &[Replacement] {
        &self.replacements
    }

    /// Whether a vehicle was received in the slot before.
    pub fn received(&self, world: usize, vehicle: usize) -> bool {
        self.radio.received().get(world, vehicle) > 0
    }

    /// Where the present vehicles are, by ascending vehicle.
    pub fn places(&self, world: usize) -> &[(usize, Place)] {
        &self.places[world]
    }

    /// How vehicles move.
    pub fn mobility(&self, world: usize) -> &(dyn Mobility + 's) {
        self.mobility[world].as_ref()
    }

    /// What a vehicle senses in a row of worlds.
    #[inline(always)]
    pub fn senses(&self, block: usize, vehicle: usize) -> Senses<'_> {
        self.all_senses().of(block, vehicle)
    }

    /// What everybody in a row of worlds can hear.
    pub fn broadcasts(&self, block: usize) -> Broadcasts<'_> {
        self.all_senses().broadcasts(block)
    }

    /// The number under which a vehicle is known, which its unit's lots follow from.
    pub fn identity(&self, world: usize, vehicle: usize) -> Identity {
        self.base_station.announcements().identity(world, vehicle)
    }

    /// What a present vehicle hears from the base station: [`Senses::broadcast`].
    pub fn broadcast(&self, world: usize, vehicle: usize) -> Option<Broadcast> {
        self.senses(world / LANES, vehicle).broadcast(world % LANES)
    }

    /// What a present vehicle's modem measures: [`Senses::measurement`].
    pub fn measurement(&self, world: usize, vehicle: usize) -> Option<Measurement> {
        self.senses(world / LANES, vehicle).measurement(world % LANES)
    }

    /// What a decider is made for.
    pub fn setup(&self) -> Setup<'_> {
        let most_vehicles = self.source.most_vehicles(self.scenario);
        Setup::new(
            self.scenario,
            &self.keys,
            self.vehicles,
            most_vehicles.max(self.room_to_join()),
        )
    }

    /// How many vehicles may be present if others [`Environment::join`].
    fn room_to_join(&self) -> usize {
        let comes = self.source.vehicles(self.scenario);
        if self.vehicles > comes { self.vehicles } else { 0 }
    }

    /// Lets somebody decide for everybody, from what they may know. `decisions` are all silent beforehand.
    pub fn decide(&mut self, decider: &mut Decider<'_>, decisions: &mut Decisions) {
        self.listened_to = matches!(decider, Decider::Policy(_));
        match decider {
            Decider::Policy(policy) => {
                let senses = self.all_senses();
                for block in 0..self.ages.blocks() {
                    policy.hear(&senses.broadcasts(block));
                    for &vehicle in self.presence.vehicles() {
                        policy.decide(&senses.of(block, vehicle), &mut decisions.of(block, vehicle));
                    }
                }
                policy.conclude(self.vectors, decisions);
            }
            Decider::Scheduler(scheduler) => {
                scheduler.decide(&self.knowledge(), decisions);
                if let Some(losses) = &mut self.grant_losses {
                    losses.silence(self.presence.vehicles(), decisions);
                }
            }
            Decider::Oracle(oracle) => oracle.decide(
                &Truth {
                    known: self.knowledge(),
                    gains_db: self.channel.gain_db(),
                },
                decisions,
            ),
        }
    }

    /// Carries out the slot's decisions in all worlds and begins the next slot.
    pub fn step(&mut self, decisions: &Decisions) {
        let decisions = match (&mut self.present_decisions, self.presence.rows()) {
            (Some(present), Some(here)) => {
                present.copy_present(decisions, here);
                present
            }
            _ => decisions,
        };
        if self.presence.rows().is_none() {
            // Nobody asks the radio about who is not in the list.
            self.departures
                .iter()
                .for_each(|&vehicle| self.radio.leave(vehicle));
        }
        let present = self.presence.vehicles();
        self.radio
            .evaluate(self.vectors, present, decisions, self.channel.gain_db());
        let (ages, received) = (&mut self.ages, self.radio.received());
        self.activity
            .record(self.vectors, &self.presence, decisions, received, ages);
        self.base_station
            .receive(SlotIndex(self.slot), present, ages, |world, vehicle| {
                let sub_channel = decisions.transmission(world, vehicle)?.0;
                (received.get(world, vehicle) > 0).then_some(sub_channel)
            });
        if let Some(sent) = &mut self.sent {
            for block in 0..sent.blocks() {
                for &vehicle in present {
                    let (chosen, _) = decisions.rows(block, vehicle);
                    *sent.row_mut(block, vehicle) = chosen.map(|chosen| u8::from(chosen != SILENT));
                }
            }
        }
        for block in 0..ages.blocks() {
            self.vectors.run(
                #[inline(always)]
                || {
                    for &vehicle in present {
                        let received = received.row(block, vehicle);
                        let ages = ages.row_mut(block, vehicle);
                        for lane in 0..LANES {
                            // Paper eq. 4.
                            let older = ages[lane].saturating_add(1);
                            ages[lane] = if received[lane] > 0 {
                                Age::MIN.slots()
                            } else {
                                older
                            };
                        }
                    }
                },
            );
        }
        let (slot, received) = (self.elapsed(), self.radio.received());
        for (world, churn) in self.churn.iter_mut().enumerate() {
            churn.hear(slot, |vehicle| received.get(world, vehicle) > 0);
        }
        self.slot += 1;
        self.begin_slot();
    }

    /// How many slots those waited to be heard who joined a world that was running, from slot `first` after its start on and early
    /// enough to be counted; `None` who never was.
    pub fn joiner_waits(&self, world: usize, first: u32) -> Vec<Option<u32>> {
        let churn = self.churn.get(world);
        churn.map_or_else(Vec::new, |churn| churn.waits(first, self.elapsed()).collect())
    }

    #[inline(always)]
    fn all_senses(&self) -> AllSenses<'_> {
        AllSenses {
            slot: self.slot(),
            vectors: self.vectors,
            worlds: self.worlds(),
            sub_channels: self.sub_channels(),
            presence: &self.presence,
            elapsed: self.elapsed(),
            associated_at: self.base_station.associated_at(),
            readings: self.sensing.readings(true_readings(
                &self.channel,
                &self.radio,
                &self.ages,
                self.sent.as_ref(),
                &self.base_station,
            )),
        }
    }

    pub(crate) fn knowledge(&self) -> Knowledge<'_> {
        Knowledge {
            elapsed: self.elapsed(),
            worlds: self.worlds(),
            sub_channels: self.sub_channels(),
            presence: &self.presence,
            associated_at: self.base_station.associated_at(),
            ages: &self.ages,
            receptions: self.radio.received(),
            gains_db: self.all_senses().readings.gains_db,
            large_scale_db: self.channel.large_scale_db(),
            doppler_hz: self.channel.doppler_hz(),
            announcements: self.base_station.announcements(),
            vectors: self.vectors,
        }
    }

    /// Moves vehicles where it is time, draws the slot's fading, prepares the broadcasts and lets the units sense.
    fn begin_slot(&mut self) {
        if self
            .elapsed()
            .is_multiple_of(self.scenario.radio.slow_update_slots)
        {
            self.move_vehicles();
        }
        if self.elapsed() > 0 {
            self.replace_vehicles();
        }
        let present = self.presence.vehicles();
        self.channel.fade(self.vectors, present);
        self.base_station
            .prepare(SlotIndex(self.slot), present, &self.ages, self.listened_to);
        self.begin_sensing();
    }

    fn begin_sensing(&mut self) {
        let truth = true_readings(
            &self.channel,
            &self.radio,
            &self.ages,
            self.sent.as_ref(),
            &self.base_station,
        );
        self.sensing.begin_slot(SlotIndex(self.slot), &truth);
    }

    /// Lets vehicles leave, and others take their indices. A unit decides by its measurement alone as long as it has one in every
    /// slot, so a new one needs nothing besides.
    fn replace_vehicles(&mut self) {
        let slot = self.elapsed();
        self.replacements.clear();
        for (world, churn) in self.churn.iter_mut().enumerate() {
            churn.draw(self.presence.vehicles(), slot, &mut self.replaced);
            for &vehicle in &self.replaced {
                let Some(place) = self.mobility[world].replace(vehicle) else {
                    continue;
                };
                let places = &mut self.places[world];
                if let Ok(index) = places.binary_search_by_key(&vehicle, |&(known, _)| known) {
                    places[index].1 = place;
                }
                self.replacements.push(Replacement {
                    world,
                    vehicle,
                    last_age: Age::after(u32::from(self.ages.get(world, vehicle))),
                });
                self.channel.replace(world, vehicle, place);
                self.ages.set(world, vehicle, Age::TIME_CONSTRAINT.slots());
                let (slot, large_scale_db) = (SlotIndex(self.slot), self.channel.large_scale_db());
                self.base_station
                    .replace(world, vehicle, slot, &self.ages, large_scale_db);
                self.radio.arrive(world, vehicle);
                self.sensing.begin_unit(world, vehicle, BEFORE_FIRST);
            }
        }
    }

    fn move_vehicles(&mut self) {
        if self.failure.is_some() {
            return;
        }
        let elapsed = self.elapsed();
        for (world, (mobility, places)) in self.mobility.iter_mut().zip(&mut self.places).enumerate() {
            if let Err(error) = mobility.advance(elapsed, places) {
                self.failure = Some(error);
                return;
            }
            self.channel.move_to(world, places);
        }
        let worlds = self.worlds();
        if self.presence.rows().is_some() {
            for world in 0..worlds {
                self.let_in_and_out(world, world..world + 1);
            }
        } else if worlds > 0 {
            self.let_in_and_out(0, 0..worlds);
        }
    }

    /// Welcomes the vehicles that are new at a world's places, and lets go those that are gone, in all of these worlds.
    fn let_in_and_out(&mut self, world: usize, worlds: Range<usize>) {
        let (arrivals, departures) = (&mut self.arrivals, &mut self.departures);
        self.presence
            .update(world, &self.places[world], arrivals, departures);
        for world in worlds {
            for &vehicle in arrivals.iter() {
                self.ages.set(world, vehicle, Age::TIME_CONSTRAINT.slots());
                self.radio.arrive(world, vehicle);
                self.sensing.begin_unit(world, vehicle, BEFORE_FIRST);
            }
            let large_scale_db = self.channel.large_scale_db();
            let present = self.places[world].iter().map(|&(vehicle, _)| vehicle);
            self.base_station
                .update(world, arrivals, departures, present, large_scale_db);
        }
    }
}

/// What receivers take in where nothing comes between.
fn true_readings<'t>(
    channel: &'t Channel<'_>,
    radio: &'t Radio,
    ages: &'t Rows<u16>,
    sent: Option<&'t Rows<u8>>,
    base_station: &'t BaseStation,
) -> Readings<'t> {
    Readings {
        gains_db: channel.gain_db(),
        interferences_db: radio.interference_db(),
        ages,
        sent,
        found: base_station.announcements().found(),
        awaited: None,
        announcements: base_station.announcements(),
        heard: None,
        measured: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mobility::Grid;
    use crate::policy::clock;
    use crate::scenario::ScenarioSource;
    use firmware::observation::Observation;
    use firmware::table::Table;
    use firmware::units::Dbm;

    #[test]
    fn ages_follow_the_recursion() {
        let scenario = ScenarioSource {
            settings: vec!["cell.vehicles=2".into()],
            ..ScenarioSource::default()
        }
        .read()
        .unwrap();
        let worlds = LANES as u64 + 1;
        let source = Grid;
        let mut environment = Environment::new(&scenario, &source, 3, Purpose::Evaluation, 0..worlds);
        let mut decisions = Decisions::new(environment.worlds(), 2);
        let mut expected = vec![100_u16; environment.worlds()];
        for slot in 0..300 {
            // Vehicle 0 sends in every fifth slot, vehicle 1 never.
            decisions.clear();
            for (world, expected) in expected.iter_mut().enumerate() {
                if slot % 5 == 0 {
                    decisions.transmit(world, 0, 0, Dbm::from_bits(30 << 8));
                }
                let gain = libm::exp10(f64::from(environment.gain_db(world, 0, 0)) / 10.0);
                let success = slot % 5 == 0 && gain >= 7.0;
                assert_eq!(environment.age(world, 0).slots(), *expected);
                assert_eq!(
                    environment.measurement(world, 0).unwrap().age(),
                    environment.age(world, 0),
                    "the unit's age is the base station's"
                );
                *expected = if success { 1 } else { *expected + 1 };
                assert_eq!(environment.age(world, 1).slots(), 100 + slot);
            }
            environment.step(&decisions);
            for (world, expected) in expected.iter().enumerate() {
                assert_eq!(environment.received(world, 0), *expected == 1);
            }
        }
    }

    /// What the base station takes its vehicles to do is what their units do, as long as nothing gets lost between them: who is called,
    /// who has which place, who has lost it.
    #[test]
    fn the_base_station_counts_on_exactly_those_who_are_called() {
        for settings in [
            &["radio.carrier_ghz=5.9", "radio.max_power_dbm=20"][..],
            // Gains do not hold.
            &[
                "radio.carrier_ghz=5.9",
                "radio.max_power_dbm=20",
                "knowledge.gain_delay_slots=4",
            ],
            &["feedback.place_loss=1"],
            &[
                "feedback.place_loss=0.5",
                "cell.vehicles=40",
                "radio.sub_channels=8",
            ],
            &[
                "feedback.place_loss=1",
                "radio.sub_channels=1",
                "cell.vehicles=6",
                "cell.replacement_probability=1e-2",
            ],
            &["feedback.place_loss=0.5", "cell.replacement_probability=2e-3"],
        ] {
            let (called, finders) = compare_with_units(settings);
            assert!(called > 100, "{settings:?}: {called}");
            let may_find = settings.iter().any(|setting| setting.starts_with("feedback"));
            assert_eq!(finders > 1000, may_find, "{settings:?}: {finders}");
        }
    }

    /// How often vehicles were called, and how often they had a place that they had found.
    fn compare_with_units(settings: &[&str]) -> (u32, u32) {
        let scenario = ScenarioSource {
            settings: settings.iter().map(|&setting| setting.to_owned()).collect(),
            ..ScenarioSource::default()
        }
        .read()
        .unwrap();
        let table = Table::parse(firmware::tables::DISTILLED).unwrap();
        let mut environment = Environment::new(&scenario, &Grid, 3, Purpose::Evaluation, 0..4);
        let mut clock = (clock::KIND.build)(&environment.setup(), &table);
        let mut decisions = Decisions::new(environment.worlds(), environment.vehicles());
        let (mut called, mut finders) = (0, 0);
        for slot in 0..700 {
            for world in 0..environment.worlds() {
                let mut places = vec![false; firmware::ring::MAX_PLACES.into()];
                for vehicle in 0..environment.vehicles() {
                    let measurement = environment.measurement(world, vehicle).unwrap();
                    let observation = Observation::new(&measurement, environment.identity(world, vehicle));
                    let known = observation.quantities();
                    let station = &environment.base_station;
                    let place = format!("{settings:?}, slot {slot}, world {world}, vehicle {vehicle}");
                    // Who sends in its own place needs no call.
                    let own = known.own_turn() && !known.turn_lost();
                    let is_called = known.is_called() && !own;
                    assert_eq!(is_called, station.counts_on(world, vehicle), "{place}");
                    assert_eq!(
                        !known.turn_lost(),
                        station.keeps(world, vehicle, &environment.ages),
                        "{place}"
                    );
                    called += u32::from(is_called);
                    let Some(own) = measurement.place().filter(|_| !known.turn_lost()) else {
                        continue;
                    };
                    assert!(own.index < measurement.broadcast().ring.places(), "{place}");
                    let taken = std::mem::replace(&mut places[usize::from(own.index)], true);
                    assert!(!taken, "place {} is two vehicles', {place}", own.index);
                    assert_eq!(
                        station.announcements().booked().get(world, vehicle),
                        own.index,
                        "{place}"
                    );
                    finders += u32::from(!own.assigned);
                }
            }
            decisions.clear();
            environment.decide(&mut clock, &mut decisions);
            environment.step(&decisions);
        }
        (called, finders)
    }
}
