//! The learner as a whole, on a toy and in the cell; its gradients against finite differences.

use super::loss::{Taken, clipped_surrogate, huber};
use super::rollout::{Experience, play};
use super::rules::CellPlace;
use super::update::{ActorCritic, Part, Rates, normalised_by_cell};
use super::{PpoLearner, Recipe};
use crate::configuration::{Algorithm, Configuration, Preset};
use crate::game::cell::Cell;
use crate::game::toy::Turns;
use crate::game::{Game as _, Tally};
use crate::laboratory::learner::{Learner, Metrics, name};
use crate::laboratory::random;
use crate::network::Network;

use firmware::form::{ObservationForm, OutputForm};
use firmware::observation::INPUTS;
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
    let last = network.layers().len() - 1;
    for (index, layer) in network.layers().enumerate() {
        let rows = layer.weights.chunks_exact(layer.inputs).zip(layer.biases);
        let next = rows.map(|(row, &bias)| {
            let products = row.iter().zip(&values);
            let sum: f64 = products.map(|(&weight, value)| value * f64::from(weight)).sum();
            let sum = sum + f64::from(bias);
            if index < last { sum.max(0.0) } else { sum }
        });
        values = next.collect();
    }
    values
}

/// Compares a gradient with central differences of an independent loss in f64: distance over length.
fn assert_gradient(network: &Network, gradient: &[f32], loss: impl Fn(&Network) -> f64) {
    let (mut distance, mut length) = (0.0, 0.0);
    for (index, &found) in gradient.iter().enumerate() {
        let mut changed = network.clone();
        let middle = changed.parameters[index];
        // Small, so that few units change between silence and activity.
        let (low, high) = (middle - 2e-5, middle + 2e-5);
        changed.parameters[index] = low;
        let below = loss(&changed);
        changed.parameters[index] = high;
        let slope = (loss(&changed) - below) / (f64::from(high) - f64::from(low));
        let distant = slope - f64::from(found);
        distance += distant * distant;
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
        let mut networks = ActorCritic {
            actor: Part::new(actor),
            critic: Part::new(critic),
        };
        for update in 0..400_u16 {
            let left = 1.0 - f32::from(update) / 400.0;
            let rates = Rates {
                actor: 1e-2 * left,
                critic: 1e-2 * left,
                entropy: 2e-2 * left,
            };
            // Rewards are a tenth of the mean over both, so that values are near one.
            let mut toy = Turns::new(128).paying(true, 0.1);
            let (actor, critic) = (&networks.actor.network, &networks.critic.network);
            let tally = &mut Tally::default();
            let experience = play(&mut toy, actor, critic, &recipe, &mut stream, tally);
            let _ = networks.update(&experience, &recipe, rates, &mut stream);
        }
        let (found, best) = (
            Turns::mean_age(20, |observed, _| networks.actor.network.forward(observed)),
            Turns::best_age(20),
        );
        assert!((found - best).abs() < 1e-9, "seed {seed}: {found} of {best}");
    }
}

/// Three cells of different loads, links and numbers of sub-channels, one of them varied.
const MIXTURE: &str = "mixture=[{ preset = 'paper', weight = 1, vehicles = [2, 9] }, { preset = 'edge', weight = 1, \
                       set = ['radio.sub_channels=2'] }, { preset = 'street', weight = 2, varied = true }]";

/// A run of seconds in these cells.
fn small(mixture: &str) -> Configuration {
    read(&[
        "ppo.episodes=4",
        "ppo.batches=4",
        "ppo.updates=2",
        "ppo.slots=8",
        "ppo.minibatch=500",
        "ppo.max_vehicles=20",
        mixture,
    ])
    .unwrap()
}

fn learner(mixture: &str) -> PpoLearner {
    let configuration = small(mixture);
    match configuration.algorithm {
        Algorithm::Ppo(ref recipe) => PpoLearner::new(configuration.cells(), recipe.clone(), 7).unwrap(),
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
    for mixture in ["mixture=[]", MIXTURE] {
        let mut whole = learner(mixture);
        let metrics: Vec<Metrics> = pool(1).install(|| (0..4).map(|_| whole.advance()).collect());
        assert_eq!((whole.done(), whole.length()), (4, 4));
        let mut first = learner(mixture);
        pool(3).install(|| (0..2).for_each(|_| drop(first.advance())));
        assert_ne!(first.actors(), whole.actors());
        let mut second = learner(mixture);
        second.restore(first.state()).unwrap();
        pool(2).install(|| assert_eq!([second.advance(), second.advance()], metrics[2..]));
        assert_eq!(second.state(), whole.state());
        assert_eq!(second.actors(), whole.actors());
        whole.actors().check().unwrap();
    }
}

/// Every cell has its own metrics, which together make those of the episode.
#[test]
fn metrics_of_the_cells_are_parts_of_the_episodes() {
    let mut mixed = learner(MIXTURE);
    let metrics = mixed.advance();
    let of = |name: &str, cell: &str| metrics.get(&name::of_cell(name, cell)).unwrap();
    // Two batches of the street, one of each other; all of as many slots.
    let successes =
        of(name::SUCCESSES, "paper") + of(name::SUCCESSES, "edge") + 2.0 * of(name::SUCCESSES, "street");
    assert!((metrics.get(name::SUCCESSES).unwrap() - successes / 4.0).abs() < 1e-12);
    assert!(of(name::SUCCESSES, "edge") <= 2.0);
    let ages = ["paper", "edge", "street"].map(|cell| of(name::AGE, cell));
    let age = metrics.get(name::AGE).unwrap();
    assert!(
        ages.iter().any(|&own| own < age) && ages.iter().any(|&own| own > age),
        "{age}: {ages:?}"
    );
    let form = mixed.actors().form;
    assert_eq!((form.min_vehicles, form.max_vehicles), (2, 20));
    assert_eq!(learner("mixture=[]").advance().get("mean_age_ms/paper"), None);
}

/// The critic is told the cell, the actor, which has no such input on the road, is not. Of other vehicles it is told where it is to
/// see the cell.
#[test]
fn the_critic_alone_tells_cells_apart() {
    let seen = |view: &str, index, cells| {
        let scenario = small("mixture=[]").scenario;
        let view = format!("ppo.critic_sees={view}");
        let rules = recipe(&[&view]).costs(CellPlace { index, cells });
        let cell = Cell::new(
            random::worlds(&scenario, 1, 0..1),
            0,
            ObservationForm::Ring,
            OutputForm::Actions,
            rules,
        );
        let shape = cell.shape();
        let mut known = vec![0.0; shape.rows() * shape.known];
        cell.know(&mut known);
        known[..shape.known].to_vec()
    };
    let known = |index, cells| seen("cell", index, cells);
    let (alone, first, last) = (known(0, 0), known(0, 3), known(2, 3));
    assert_eq!(first[..alone.len()], alone);
    assert_eq!(last[..alone.len()], alone);
    assert_eq!(first[alone.len()..], [1.0, 0.0, 0.0]);
    assert_eq!(last[alone.len()..], [0.0, 0.0, 1.0]);
    let own = seen("vehicle", 2, 3);
    assert_eq!(own.len(), INPUTS + 3);
    assert_eq!(own[..INPUTS], alone[..INPUTS]);
    assert_eq!(own[INPUTS..], [0.0, 0.0, 1.0]);
}

/// A cell whose ages are a hundred times as large learns and is learned from as much as the others.
#[test]
fn advantages_are_compared_within_a_cell() {
    let part = |advantages: &[f32]| Experience {
        actions: vec![0.0; advantages.len()],
        advantages: advantages.to_vec(),
        cells: vec![advantages.len()],
        ..Experience::default()
    };
    let joined = Experience::join([
        (0, part(&[1.0])),
        (0, part(&[3.0, 2.0])),
        (2, part(&[700.0, 500.0])),
    ]);
    assert_eq!(joined.cells, [3, 2]);
    let normalised = normalised_by_cell(&joined);
    let expected = [-1.224_744_9, 1.224_744_9, 0.0, 1.0, -1.0];
    for (found, expected) in normalised.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6, "{normalised:?}");
    }
}

#[test]
fn states_of_another_geometry_are_refused() {
    let mut state = learner("mixture=[]").state();
    let _ = state.take_f32("critic.0.biases", &[64]).unwrap();
    assert_eq!(
        learner("mixture=[]").restore(state).unwrap_err().to_string(),
        "critic.0.biases: found no such tensor, expected f32 of shape [64]"
    );
    // The critic of a mixture has an input for each of its cells.
    let error = learner(MIXTURE)
        .restore(learner("mixture=[]").state())
        .unwrap_err();
    assert_eq!(
        error.to_string(),
        "critic.0.weights: found f32 of shape [52, 64], expected f32 of shape [55, 64]"
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
