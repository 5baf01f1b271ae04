//! The learner as a whole, on a toy and in the cell; its gradients against finite differences.

use super::loss::{Taken, clipped_surrogate, huber};
use super::optimiser::{Optimiser, Rates};
use super::rollout::{Arena, play};
use super::{PpoLearner, Recipe};
use crate::laboratory::configuration::{Algorithm, Configuration, Preset};
use crate::laboratory::game::Game;
use crate::laboratory::learner::{Learner, Metrics};
use crate::laboratory::random;
use crate::network::{Adam, Network};
use crate::toy::Turns;
use host_sim::stream::Stream;
use kit::error::Result;

fn read(settings: &[&str]) -> Result<Configuration> {
    Preset::Ppo.with(settings)
}

fn recipe(settings: &[&str]) -> Recipe {
    match read(settings).unwrap().algorithm {
        Algorithm::Ppo(recipe) => recipe,
        other => panic!("{}", other.name()),
    }
}

/// The network's outputs in f64.
fn outputs(network: &Network, input: &[f32]) -> Vec<f64> {
    let mut values: Vec<f64> = input.iter().map(|&value| f64::from(value)).collect();
    for (index, layer) in network.layers.iter().enumerate() {
        let next = (0..layer.outputs).map(|output| {
            let products = values.iter().enumerate();
            let sum: f64 = products
                .map(|(input, value)| value * f64::from(layer.weights[input * layer.outputs + output]))
                .sum();
            let sum = sum + f64::from(layer.biases[output]);
            if index + 1 < network.layers.len() {
                sum.max(0.0)
            } else {
                sum
            }
        });
        values = next.collect();
    }
    values
}

/// The parameter with this index, over all layers' weights and biases.
fn parameter(network: &mut Network, mut index: usize) -> Option<&mut f32> {
    for layer in &mut network.layers {
        for parameters in [&mut layer.weights, &mut layer.biases] {
            if index < parameters.len() {
                return parameters.get_mut(index);
            }
            index -= parameters.len();
        }
    }
    None
}

/// Compares a gradient with central differences of an independent loss in f64: distance over length.
fn assert_gradient(network: &Network, gradient: &Network, loss: impl Fn(&Network) -> f64) {
    let (mut distance, mut length) = (0.0, 0.0);
    for index in 0.. {
        let mut changed = network.clone();
        let Some(value) = parameter(&mut changed, index) else {
            break;
        };
        let middle = *value;
        // Small, so that few units change between silence and activity.
        let (low, high) = (middle - 2e-5, middle + 2e-5);
        *value = low;
        let below = loss(&changed);
        *parameter(&mut changed, index).unwrap() = high;
        let slope = (loss(&changed) - below) / (f64::from(high) - f64::from(low));
        let found = f64::from(*parameter(&mut gradient.clone(), index).unwrap());
        distance += (slope - found) * (slope - found);
        length += slope * slope;
    }
    let error = libm::sqrt(distance / length);
    assert!(error < 1e-3 && length > 0.0, "relative error {error}");
}

fn inputs(stream: &mut Stream, count: usize, width: usize) -> Vec<Vec<f32>> {
    let mut row = || (0..width).map(|_| stream.uniform() * 2.0 - 1.0).collect();
    (0..count).map(|_| row()).collect()
}

#[test]
fn the_actors_gradient_is_that_of_finite_differences() {
    const ENTROPY: f32 = 0.1;
    let mut stream = random::initial(1, 0);
    let network = Network::random(&[5, 8, 7, 4], &mut stream);
    let rows = inputs(&mut stream, 60, 5);
    let log_probability = |network: &Network, row: usize, action: usize| {
        let scores = outputs(network, &rows[row]);
        let sum: f64 = scores.iter().map(|&score| libm::exp(score)).sum();
        scores[action] - libm::log(sum)
    };
    // Probability ratios on both sides of the clip and within it, with advantages of both signs.
    let taken: Vec<Taken> = (0..rows.len())
        .map(|row| Taken {
            action: row % 4,
            log_probability: (log_probability(&network, row, row % 4)
                - libm::log([0.6, 0.9, 1.0, 1.1, 1.5][row % 5])) as f32,
            advantage: stream.uniform() * 4.0 - 2.0,
        })
        .collect();
    let loss = |network: &Network| {
        let terms = taken.iter().enumerate().map(|(row, taken)| {
            let ratio =
                libm::exp(log_probability(network, row, taken.action) - f64::from(taken.log_probability));
            let advantage = f64::from(taken.advantage);
            let entropy: f64 = (0..4)
                .map(|action| log_probability(network, row, action))
                .map(|log| -log * libm::exp(log))
                .sum();
            -(ratio * advantage).min(ratio.clamp(0.8, 1.2) * advantage) - f64::from(ENTROPY) * entropy
        });
        terms.sum::<f64>() / taken.len() as f64
    };
    let views: Vec<&[f32]> = rows.iter().map(Vec::as_slice).collect();
    let ([mean, clipped], gradient) = network.gradient(&views, |row, outputs, slope| {
        let terms = clipped_surrogate(outputs, taken[row], 0.2, ENTROPY, slope);
        [terms.loss, terms.clipped]
    });
    assert!((f64::from(mean) - loss(&network)).abs() < 1e-5);
    assert!(clipped > 0.1 && clipped < 0.9, "{clipped}");
    assert_gradient(&network, &gradient, loss);
}

#[test]
fn the_critics_gradient_is_that_of_finite_differences() {
    let mut stream = random::initial(2, 0);
    let network = Network::random(&[6, 9, 5, 1], &mut stream);
    let rows = inputs(&mut stream, 60, 6);
    // Both branches of the loss.
    let targets: Vec<f32> = rows.iter().map(|_| stream.uniform() * 6.0 - 3.0).collect();
    let loss = |network: &Network| {
        let terms = rows.iter().zip(&targets).map(|(row, &target)| {
            let error = (outputs(network, row)[0] - f64::from(target)).abs();
            if error <= 1.0 {
                0.5 * error * error
            } else {
                error - 0.5
            }
        });
        terms.sum::<f64>() / rows.len() as f64
    };
    let views: Vec<&[f32]> = rows.iter().map(Vec::as_slice).collect();
    let ([mean], gradient) = network.gradient(&views, |row, outputs, slope| {
        let (loss, against_value) = huber(outputs[0], targets[row]);
        slope[0] = against_value;
        [loss]
    });
    assert!((f64::from(mean) - loss(&network)).abs() < 1e-5);
    assert_gradient(&network, &gradient, loss);
}

/// The toy as an arena: an agent's reward is the mean over both, and the critic sees what the agent sees.
struct Toy(Turns);

impl Arena for Toy {
    fn agents(&self) -> usize {
        self.0.worlds() * self.0.agents()
    }

    fn observe(&mut self, inputs: &mut Vec<f32>, views: &mut Vec<f32>) {
        let first = inputs.len();
        inputs.resize(first + self.agents() * self.0.observation_length(), 0.0);
        self.0.observe(&mut inputs[first..]);
        views.extend_from_slice(&inputs[first..]);
    }

    fn step(&mut self, actions: &[u8], rewards: &mut Vec<f32>, weights: &mut Vec<f32>) {
        let mut own = vec![0.0; self.agents()];
        self.0.step(actions, &mut own);
        for world in own.chunks_exact(self.0.agents()) {
            let mean = world.iter().sum::<f32>() / world.len() as f32;
            rewards.extend(world.iter().map(|_| mean * 0.1));
            weights.extend(world.iter().map(|_| 1.0));
        }
    }
}

/// Mean global reward of the greedy actor over an episode from every start.
fn greedy_reward(actor: &Network, slots: u32) -> f64 {
    let mut game = Turns::new(16);
    let width = game.observation_length();
    let mut observations = vec![0.0; 32 * width];
    let (mut rewards, mut sum) = (vec![0.0; 32], 0.0);
    for _ in 0..slots {
        game.observe(&mut observations);
        let scores = observations.chunks_exact(width).map(|row| actor.forward(row));
        let actions: Vec<u8> = scores.map(|scores| u8::from(scores[1] > scores[0])).collect();
        game.step(&actions, &mut rewards);
        sum += rewards.iter().map(|&reward| f64::from(reward)).sum::<f64>();
    }
    sum / 32.0 / f64::from(slots)
}

#[test]
fn the_best_play_of_the_toy_is_found() {
    let recipe = recipe(&[
        "ppo.discount=0.5",
        "ppo.trace=0.5",
        "ppo.slots=3",
        "ppo.epochs=4",
        "ppo.minibatch=512",
    ]);
    for seed in 0..5 {
        let mut stream = random::initial(seed, 0);
        let (actor, critic) = (
            Network::random(&[9, 64, 2], &mut stream),
            Network::random(&[9, 32, 1], &mut stream),
        );
        let mut optimiser = Optimiser {
            actor_adam: Adam::new(&actor),
            critic_adam: Adam::new(&critic),
            actor,
            critic,
        };
        for update in 0..400_u16 {
            let left = 1.0 - f32::from(update) / 400.0;
            let rates = Rates {
                actor: 1e-2 * left,
                critic: 1e-2 * left,
                entropy: 2e-2 * left,
            };
            let mut toy = Toy(Turns::new(128));
            let experience = play(
                &mut toy,
                &optimiser.actor,
                &optimiser.critic,
                &recipe,
                &mut stream,
            );
            let _ = optimiser.update(&experience, &recipe, rates, &mut stream);
        }
        let (found, best) = (greedy_reward(&optimiser.actor, 20), Turns::best_reward(20));
        assert!((found - best).abs() < 1e-9, "seed {seed}: {found} of {best}");
    }
}

/// A run of seconds in the cell.
fn small() -> Configuration {
    read(&[
        "ppo.episodes=4",
        "ppo.batches=3",
        "ppo.updates=2",
        "ppo.slots=8",
        "ppo.minibatch=500",
        "ppo.max_vehicles=20",
    ])
    .unwrap()
}

fn learner() -> PpoLearner {
    let configuration = small();
    match configuration.algorithm {
        Algorithm::Ppo(recipe) => PpoLearner::new(configuration.scenario, recipe, 7).unwrap(),
        other => panic!("{}", other.name()),
    }
}

#[test]
fn a_resumed_run_and_any_number_of_threads_give_the_same_bits() {
    let pool = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
    };
    let mut whole = learner();
    let metrics: Vec<Metrics> = pool(1).install(|| (0..4).map(|_| whole.advance()).collect());
    assert_eq!((whole.done(), whole.length()), (4, 4));
    let mut first = learner();
    pool(3).install(|| (0..2).for_each(|_| drop(first.advance())));
    assert_ne!(first.actors(), whole.actors());
    let mut second = learner();
    second.restore(first.state()).unwrap();
    pool(2).install(|| assert_eq!([second.advance(), second.advance()], metrics[2..]));
    assert_eq!(second.state(), whole.state());
    assert_eq!(second.actors(), whole.actors());
    whole.actors().check().unwrap();
}

#[test]
fn states_of_another_geometry_are_refused() {
    let mut state = learner().state();
    let _ = state.take_f32("critic.0.biases", &[64]).unwrap();
    assert_eq!(
        learner().restore(state).unwrap_err().to_string(),
        "critic.0.biases: found no such tensor, expected f32 of shape [64]"
    );
}

#[test]
fn bad_options_are_named() {
    let message = |setting: &str| read(&[setting]).unwrap_err().to_string();
    assert_eq!(
        message("ppo.min_vehicles=80"),
        "ppo.min_vehicles: found 80, expected at most ppo.max_vehicles, which is 72"
    );
    assert_eq!(
        message("ppo.max_vehicles=301"),
        "ppo.max_vehicles: found 301, expected 1 to 300 vehicles"
    );
    assert_eq!(
        message("ppo.discount=1.0"),
        "ppo.discount: found 1, expected 0 to 0.99999"
    );
    assert_eq!(
        message("ppo.hidden=[2000]"),
        "ppo.hidden: found [2000], expected at most 3 widths from 1 to 1024"
    );
    assert_eq!(
        message("ppo.critic_first_episodes=2"),
        "ppo.first_actor: found none, expected the folder of a run, for ppo.critic_first_episodes, which is 2"
    );
    assert_eq!(
        message("ppo.first_actor_sharpness=0.5"),
        "ppo.first_actor: found none, expected the folder of a run, for ppo.first_actor_sharpness, which is 0.5"
    );
    let learner = read(&["ppo.first_actor='nowhere'"]).unwrap().learner(1);
    let error = learner.err().map(|error| error.to_string()).unwrap_or_default();
    assert_eq!(
        error,
        "ppo.first_actor: found nowhere/actor.safetensors, which does not exist, expected the folder of a run, such as `trainer \
         distil` leaves"
    );
}
