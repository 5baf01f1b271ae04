//! The algorithm as the laboratory sees it: episodes, checkpoints, actors.

use super::arena::Beginning;
use super::learner::{LEARNING, Losses, MaddpgLearner, Played};
use super::optimiser::{Learned, Powers};
use crate::laboratory::actors::{ActorForm, Actors};
use crate::laboratory::learner::{Learner, Metrics, name};
use crate::laboratory::random;
use crate::laboratory::state::State;
use crate::network::{Layer, Network};
use kit::error::Result;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What a checkpoint keeps besides tensors.
#[derive(Serialize, Deserialize)]
struct Saved {
    counters: super::learner::Counters,
    replay: (u64, usize),
    actors: Vec<Powers>,
    local_critics: Vec<Powers>,
    twins: [Powers; 2],
}

impl Learner for MaddpgLearner {
    fn length(&self) -> u64 {
        self.options.episodes
    }

    fn done(&self) -> u64 {
        self.counters.done
    }

    fn advance(&mut self) -> Metrics {
        let present = self.present();
        let beginning = Beginning {
            episode: self.counters.done,
            present,
            // Never less often than a quarter of the first share (chosen).
            in_turn: self.options.phase_resets * (1.0 - self.progress()).max(0.25),
        };
        let mut stream = random::episode(self.seed, self.counters.done, LEARNING);
        self.losses = Losses::default();
        let mut played = Played::default();
        let arena = Arc::clone(&self.arena);
        arena.play(&beginning, &mut |worlds| {
            played = self.play(worlds, present, &mut stream)
        });
        self.counters.done += 1;
        let world_slots = (self.extent.slots * self.extent.worlds) as f64;
        self.counters.slots += world_slots as u64;
        let vehicle_slots = world_slots * present as f64;
        let Losses {
            global,
            global_count,
            local,
            entropy,
            delayed_count,
        } = self.losses;
        Metrics::default()
            .with(name::REWARD, played.reward / vehicle_slots)
            .with(name::AGE, played.tally.age / vehicle_slots)
            .with(name::SUCCESSES, played.tally.received / world_slots)
            .with(name::POWER, played.tally.power / vehicle_slots)
            .with(name::SLOTS, self.counters.slots as f64)
            .with(name::UPDATES, self.counters.updates as f64)
            .with("vehicles", present as f64)
            .with("global_loss", global / f64::from(global_count))
            .with("local_loss", local / f64::from(delayed_count))
            .with("entropy", entropy / f64::from(delayed_count))
    }

    fn state(&self) -> State {
        let mut state = State::default();
        let mut save = |name: &str, learned: &[Learned]| -> Vec<Powers> {
            let each = learned.iter().enumerate();
            each.map(|(index, learned)| learned.save(&format!("{name}.{index}"), &mut state))
                .collect()
        };
        let actors = save("actors", &self.actors.learned);
        let local = self
            .local_critics
            .as_ref()
            .map_or(&[][..], |critics| &critics.learned);
        let local_critics = save("local_critics", local);
        let twins = save("global_critics", &self.twins);
        let saved = Saved {
            counters: self.counters,
            replay: self.replay.save(&mut state),
            actors,
            local_critics,
            twins: [twins[0], twins[1]],
        };
        state.counters = serde_json::json!(saved);
        state
    }

    fn restore(&mut self, mut state: State) -> Result<()> {
        let saved: Saved = state.counters()?;
        let mut load = |name: &str, learned: &mut [Learned], powers: &[Powers]| -> Result<()> {
            for (index, (learned, &powers)) in learned.iter_mut().zip(powers).enumerate() {
                learned.load(&format!("{name}.{index}"), &mut state, powers)?;
            }
            Ok(())
        };
        load("actors", &mut self.actors.learned, &saved.actors)?;
        if let Some(critics) = &mut self.local_critics {
            load("local_critics", &mut critics.learned, &saved.local_critics)?;
        }
        load("global_critics", &mut self.twins, &saved.twins)?;
        self.replay.load(&mut state, saved.replay)?;
        self.counters = saved.counters;
        state.finish()
    }

    fn actors(&self) -> Actors {
        let network = &self.actors.network;
        let networks = self.actors.learned.iter().map(|learned| Network {
            layers: (0..network.layers())
                .map(|layer| {
                    let (inputs, outputs) = (network.widths()[layer], network.widths()[layer + 1]);
                    let rows = &learned.parameters[network.weights(layer)];
                    Layer {
                        inputs,
                        outputs,
                        weights: (0..inputs)
                            .flat_map(|input| rows[input..].iter().step_by(inputs).copied())
                            .collect(),
                        biases: learned.parameters[network.biases(layer)].to_vec(),
                    }
                })
                .collect(),
        });
        Actors {
            form: ActorForm {
                observation: self.options.observation,
                output: self.options.output_form(),
                min_vehicles: self.options.first_vehicles(self.extent.vehicles) as u32,
                max_vehicles: self.extent.vehicles as u32,
            },
            networks: networks.collect(),
        }
    }
}
