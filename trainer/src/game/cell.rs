//! The simulator's cell as a game: an agent is a vehicle, an age after the slot what it costs.

use super::actions::ActionSpace;
use super::{Game, Shape, Tally};
use crate::forms;
use firmware::decision::{Decision, PowerPlan};
use firmware::form::{ObservationForm, OutputForm};
use firmware::observation::Observation;
use firmware::units::{Age, Level};
use host_sim::decisions::Decisions;
use host_sim::environment::Environment;
use host_sim::policy::power_plan;

/// What an algorithm adds to the cell: what its critics know of vehicles, and what it pays them.
pub trait Rules: Send {
    /// Values that a critic knows of a vehicle beside its observation.
    fn extra(&self) -> usize;

    /// Writes them for the vehicles of a world; they are zeros beforehand.
    fn know<'r>(&self, world: &[Option<Sensed>], extras: impl Iterator<Item = &'r mut [f32]>);

    /// Writes the rewards of the vehicles of a world; they are zeros beforehand.
    fn pay(&self, world: &[Option<Outcome>], rewards: &mut [f32]);

    /// See [`Game::parts`].
    fn parts(&self, world: &[Option<Sensed>], parts: &mut [f32]) {
        let _of_itself = world;
        parts.fill(1.0);
    }
}

/// No critic and no reward: for who only counts ages.
pub struct Unpaid;

impl Rules for Unpaid {
    fn extra(&self) -> usize {
        0
    }

    fn know<'r>(&self, _world: &[Option<Sensed>], _extras: impl Iterator<Item = &'r mut [f32]>) {}

    fn pay(&self, _world: &[Option<Outcome>], _rewards: &mut [f32]) {}
}

/// What a vehicle senses before a slot.
#[derive(Clone, Copy, Debug)]
pub struct Sensed {
    /// As its unit sees it.
    pub observation: Observation,
}

/// What became of a vehicle in a slot.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// What it sensed before.
    pub observation: Observation,
    /// Whether it transmitted.
    pub sent: bool,
    /// Whether it was received.
    pub received: bool,
    /// Its age after the slot, also where it left for good then.
    pub age: Age,
}

/// Worlds of one scenario that are played at the same time.
pub struct Cell<'s, R> {
    environment: Environment<'s>,
    observation: ObservationForm,
    output: OutputForm,
    rules: R,
    /// Vehicles that a world has room for; those beyond the environment's are absent.
    room: usize,
    required: Level,
    plan: PowerPlan,
    /// `[world][vehicle]`, before the slot at hand.
    sensed: Vec<Option<Sensed>>,
    decisions: Decisions,
}

impl<'s, R: Rules> Cell<'s, R> {
    /// Worlds with the ages that they have, with room for at least so many vehicles.
    pub fn new(
        environment: Environment<'s>,
        room: usize,
        observation: ObservationForm,
        output: OutputForm,
        rules: R,
    ) -> Self {
        let mut cell = Self {
            observation,
            output,
            rules,
            room: room.max(environment.vehicles()),
            required: environment.scenario().radio.required_level(),
            plan: power_plan(environment.scenario()),
            sensed: Vec::new(),
            decisions: Decisions::new(environment.worlds(), environment.vehicles()),
            environment,
        };
        cell.sense();
        cell
    }

    /// The worlds as they stand.
    pub fn environment(&self) -> &Environment<'s> {
        &self.environment
    }

    fn sense(&mut self) {
        self.sensed.clear();
        for world in 0..self.environment.worlds() {
            self.sensed.extend((0..self.room).map(|vehicle| {
                let present = vehicle < self.environment.vehicles();
                let measurement = present.then(|| self.environment.measurement(world, vehicle))??;
                Some(Sensed {
                    observation: Observation::new(&measurement, self.environment.identity(world, vehicle)),
                })
            }));
        }
    }

    /// What became of the vehicles of a world, of which some sent.
    fn outcomes(&self, world: usize, sent: &[bool]) -> Vec<Option<Outcome>> {
        let vehicles = self.sensed[world * self.room..][..self.room].iter().zip(sent);
        let outcomes = vehicles.enumerate().map(|(vehicle, (sensed, &sent))| {
            Some(Outcome {
                observation: (*sensed)?.observation,
                sent,
                received: self.environment.received(world, vehicle),
                age: match self.environment.replacement(world, vehicle) {
                    Some(left) => left.last_age,
                    None => self.environment.age(world, vehicle),
                },
            })
        });
        outcomes.collect()
    }
}

impl<R: Rules> Game for Cell<'_, R> {
    fn shape(&self) -> Shape {
        let observed = self.observation.inputs();
        Shape {
            worlds: self.environment.worlds(),
            agents: self.room,
            known: observed + self.rules.extra(),
            observed,
            actions: ActionSpace::from(self.output),
        }
    }

    fn know(&self, known: &mut [f32]) {
        let Shape {
            known: width,
            observed,
            ..
        } = self.shape();
        known.fill(0.0);
        for (row, sensed) in known.chunks_exact_mut(width).zip(&self.sensed) {
            if let Some(sensed) = sensed {
                let observed = &mut row[..observed];
                forms::observe(self.observation, &sensed.observation, self.required, observed);
            }
        }
        let worlds = known
            .chunks_exact_mut(width * self.room)
            .zip(self.sensed.chunks_exact(self.room));
        for (known, sensed) in worlds {
            let extras = known.chunks_exact_mut(width).map(|row| &mut row[observed..]);
            self.rules.know(sensed, extras);
        }
    }

    fn step(&mut self, actions: &[f32], rewards: &mut [f32], tally: &mut Tally) {
        let values = ActionSpace::from(self.output).values();
        let mut sent = vec![false; self.sensed.len()];
        for (row, (sensed, action)) in self.sensed.iter().zip(actions.chunks_exact(values)).enumerate() {
            let Some(sensed) = sensed else { continue };
            let decision = forms::decision(self.output, action, &sensed.observation, &self.plan);
            if let Decision::Transmit { power, .. } = decision {
                tally.power_mw += libm::exp10(power.value().to_num::<f64>() / 10.0);
                sent[row] = true;
            }
            self.decisions.set(row / self.room, row % self.room, decision);
        }
        self.environment.step(&self.decisions);
        rewards.fill(0.0);
        let worlds = rewards
            .chunks_exact_mut(self.room)
            .zip(sent.chunks_exact(self.room));
        for (world, (rewards, sent)) in worlds.enumerate() {
            let outcomes = self.outcomes(world, sent);
            self.rules.pay(&outcomes, rewards);
            for (vehicle, (outcome, &reward)) in outcomes.iter().zip(rewards.iter()).enumerate() {
                let Some(outcome) = outcome else { continue };
                // As evaluations count: of who is there now.
                let age = self.environment.age(world, vehicle);
                tally.age += f64::from(age.min(Age::TIME_CONSTRAINT).slots());
                tally.received += f64::from(u8::from(outcome.received));
                tally.reward += f64::from(reward);
                tally.agent_slots += 1.0;
            }
            tally.world_slots += 1.0;
        }
        self.sense();
    }

    fn ended(&self, ended: &mut [bool]) {
        ended.fill(false);
        for left in self.environment.replacements() {
            ended[left.world * self.room + left.vehicle] = true;
        }
    }

    fn parts(&self, parts: &mut [f32]) {
        let worlds = parts
            .chunks_exact_mut(self.room)
            .zip(self.sensed.chunks_exact(self.room));
        for (parts, sensed) in worlds {
            self.rules.parts(sensed, parts);
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::game::reward::AgeReward;
    use host_sim::mobility::Grid;
    use host_sim::scenario::ScenarioSource;
    use host_sim::stream::Purpose;

    /// What some vehicle sees.
    pub fn observation() -> Observation {
        let scenario = ScenarioSource::default().read().unwrap();
        let environment = Environment::new(&scenario, &Grid, 1, Purpose::Training, 0..1);
        let measurement = environment.measurement(0, 0).unwrap();
        Observation::new(&measurement, environment.identity(0, 0))
    }

    /// Minus the age.
    struct Ages;

    impl Rules for Ages {
        fn extra(&self) -> usize {
            0
        }

        fn know<'r>(&self, _world: &[Option<Sensed>], _extras: impl Iterator<Item = &'r mut [f32]>) {}

        fn pay(&self, world: &[Option<Outcome>], rewards: &mut [f32]) {
            let reward = AgeReward {
                scale: 1.0,
                cap: 100.0,
                success: 0.0,
            };
            for (outcome, paid) in world.iter().zip(rewards) {
                *paid = outcome.map_or(0.0, |outcome| reward.of(outcome.age, outcome.received));
            }
        }
    }

    #[test]
    fn who_is_replaced_ends_and_is_paid_for_its_own_age() {
        let source = ScenarioSource {
            settings: vec![
                "cell.vehicles=4".into(),
                "cell.replacement_probability=0.05".into(),
            ],
            ..ScenarioSource::default()
        };
        let scenario = source.read().unwrap();
        let environment = Environment::new(&scenario, &Grid, 1, Purpose::Training, 0..2);
        // Room for one more, who is absent.
        let mut cell = Cell::new(environment, 5, ObservationForm::Ring, OutputForm::Actions, Ages);
        let (mut rewards, mut ended, mut tally) = (vec![0.0; 10], vec![false; 10], Tally::default());
        let (mut ages, mut ends, mut young) = (vec![100.0_f32; 10], 0, 0);
        for _ in 0..300 {
            // Full power where one's own place is.
            cell.step(&[1.0; 10], &mut rewards, &mut tally);
            cell.ended(&mut ended);
            for row in 0..10 {
                let (world, vehicle) = (row / 5, row % 5);
                if vehicle == 4 {
                    assert!(rewards[row] == 0.0 && !ended[row]);
                    continue;
                }
                let received = cell.environment.received(world, vehicle);
                let age = if received {
                    1.0
                } else {
                    (ages[row] + 1.0).min(100.0)
                };
                assert_eq!(rewards[row], -age);
                ends += u32::from(ended[row]);
                young += u32::from(ended[row] && age < 50.0);
                ages[row] = if ended[row] { 100.0 } else { age };
            }
        }
        // 120 expected.
        assert!(ends > 80 && young > 40, "{ends}, {young}");
    }
}
