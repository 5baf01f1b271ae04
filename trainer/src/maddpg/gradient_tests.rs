//! Every gradient against finite differences.

use super::critic::{Critic, CriticPass, Question};
use super::flat_critic::FlatCritic;
use super::group::{Group, Role};
use super::options::Loss;
use super::set_critic::SetCritic;
use super::view::View;
use crate::game::actions::ActionSpace;
use crate::laboratory::random::initial;
use crate::network::categorical::{entropy, entropy_slope, expectation_slopes, probabilities};
use crate::network::perceptron::{Pass, Perceptron, Rows};
use host_sim::stream::Stream;

/// Half the distance of the two points of a difference. The functions are f32 inside, so a smaller one drowns in rounding.
const STEP: f32 = 2e-3;

/// The bar of relative error, over all parameters together.
const MOST: f64 = 1e-3;

/// Slopes to the left and to the right that differ by more than this share of the mean slope lie on two sides of a ReLU's
/// corner.
const CORNER: f64 = 2e-2;

/// Compares a gradient with central differences, by the length of the error over that of the gradient. A difference across a
/// corner says nothing and is left out; not more than a tenth may be.
fn check(name: &str, at: &[f32], gradient: &[f32], function: impl Fn(&[f32]) -> f64) {
    let mut moved = at.to_vec();
    let middle = function(at);
    let mut value = |index: usize, change: f32| {
        moved[index] = at[index] + change;
        let slope = (function(&moved) - middle) / f64::from(moved[index] - at[index]);
        moved[index] = at[index];
        slope
    };
    let differences: Vec<[f64; 2]> = (0..gradient.len())
        .map(|index| [value(index, STEP), value(index, -STEP)])
        .collect();
    let length: f64 = differences.iter().map(|[a, b]| (a + b) * (a + b) / 4.0).sum();
    let typical = libm::sqrt(length / gradient.len() as f64);
    let smooth: Vec<usize> = (0..gradient.len())
        .filter(|&index| (differences[index][0] - differences[index][1]).abs() <= CORNER * typical)
        .collect();
    assert!(
        10 * smooth.len() >= 9 * gradient.len(),
        "{name}: {} smooth of {}",
        smooth.len(),
        gradient.len()
    );
    let error: f64 = smooth
        .iter()
        .map(|&index| (differences[index][0] + differences[index][1]) / 2.0 - f64::from(gradient[index]))
        .map(|error| error * error)
        .sum();
    let relative = libm::sqrt(error / length);
    assert!(
        relative < MOST,
        "{name}: relative error {relative:.2e} over {} slopes",
        smooth.len()
    );
}

fn numbers(stream: &mut Stream, count: usize) -> Vec<f32> {
    (0..count).map(|_| stream.normal() as f32).collect()
}

/// `sum of weight x value`, in f64.
fn weighted(weights: &[f32], values: &[f32]) -> f64 {
    weights
        .iter()
        .zip(values)
        .map(|(&a, &b)| f64::from(a) * f64::from(b))
        .sum()
}

#[test]
fn perceptrons() {
    let mut stream = initial(3, 0);
    let (network, columns) = (Perceptron::new(5, &[19, 8], 3), 21);
    let (parameters, inputs) = (network.initial(&mut stream), numbers(&mut stream, 5 * columns));
    let weights = numbers(&mut stream, 3 * columns);
    let run = |parameters: &[f32], inputs: &[f32]| {
        let mut pass = Pass::default();
        pass.input(&network, columns).copy_from_slice(inputs);
        network.forward(parameters, &mut pass);
        pass
    };
    let mut pass = run(&parameters, &inputs);
    pass.output_slopes().copy_from_slice(&weights);
    let mut gradient = vec![0.0; network.parameters()];
    network.backward(&parameters, &mut pass, Some(&mut gradient), true);
    check("parameters", &parameters, &gradient, |at| {
        weighted(&weights, run(at, &inputs).output())
    });
    check("inputs", &inputs, pass.input_slopes(), |at| {
        weighted(&weights, run(&parameters, at).output())
    });
}

/// A batch in which not all vehicles take part.
struct Sample {
    observations: Vec<f32>,
    present: Vec<u8>,
}

const VEHICLES: usize = 5;
const KNOWN: usize = 4;
const OBSERVED: usize = 3;

impl Sample {
    fn new(stream: &mut Stream) -> Self {
        let present = vec![5, 3, 4];
        let rows = present.len() * VEHICLES;
        Self {
            observations: numbers(stream, rows * KNOWN),
            present,
        }
    }

    fn view(&self) -> View<'_> {
        View {
            vehicles: VEHICLES,
            observations: &self.observations,
            width: KNOWN,
            observed: OBSERVED,
            present: &self.present,
        }
    }
}

fn critics() -> Vec<(&'static str, ActionSpace, Box<dyn Critic>)> {
    let flat = |set: ActionSpace| -> Box<dyn Critic> {
        Box::new(FlatCritic::new(VEHICLES, OBSERVED, set, &[17, 9]))
    };
    vec![
        (
            "flat, continuous",
            ActionSpace::Continuous,
            flat(ActionSpace::Continuous),
        ),
        (
            "flat, choice",
            ActionSpace::Choices(6),
            flat(ActionSpace::Choices(6)),
        ),
        (
            "set",
            ActionSpace::Choices(6),
            Box::new(SetCritic::new(6, KNOWN, 11, 6, &[10, 7])),
        ),
    ]
}

#[test]
fn global_critics_and_their_losses() {
    for (name, set, critic) in critics() {
        let mut stream = initial(5, 0);
        let sample = Sample::new(&mut stream);
        let view = sample.view();
        let parameters = critic.initial(&mut stream);
        let actions = numbers(&mut stream, sample.present.len() * VEHICLES * set.length());
        let targets = numbers(&mut stream, sample.present.len());
        for loss in [Loss::Squared, Loss::Huber] {
            let value = |parameters: &[f32], pass: &mut CriticPass| {
                let values = critic.forward(&Question::new(parameters, view, &actions), pass);
                let parts: Vec<(f32, f32)> =
                    values.iter().zip(&targets).map(|(v, t)| loss.of(v - t)).collect();
                let sum: f64 = parts.iter().map(|part| f64::from(part.0)).sum();
                (sum, parts.into_iter().map(|part| part.1).collect::<Vec<_>>())
            };
            let mut pass = CriticPass::default();
            let (_, slopes) = value(&parameters, &mut pass);
            let mut gradient = vec![0.0; parameters.len()];
            let asked = Question::new(&parameters, view, &actions);
            critic.backward(&asked, &slopes, &mut pass, &mut gradient);
            check(&format!("{name}, {loss:?}"), &parameters, &gradient, |at| {
                value(at, &mut CriticPass::default()).0
            });
        }
    }
}

#[test]
fn global_critics_along_actions() {
    for (name, set, critic) in critics().into_iter().filter(|(_, set, _)| !set.is_choice()) {
        let mut stream = initial(6, 0);
        let sample = Sample::new(&mut stream);
        let view = sample.view();
        // Twice as large as usual: slopes of small values would drown in the rounding of large ones.
        let parameters: Vec<f32> = critic.initial(&mut stream).iter().map(|p| 2.0 * p).collect();
        let actions = numbers(&mut stream, sample.present.len() * VEHICLES * set.length());
        let asked = Question::new(&parameters, view, &actions);
        let slopes = critic.gains(&asked, &mut CriticPass::default());
        check(name, &actions, &slopes, |at| {
            let values = critic.forward(&Question::new(&parameters, view, at), &mut CriticPass::default());
            values.iter().map(|&value| f64::from(value)).sum::<f64>()
        });
    }
}

/// An alternative is worth what the critic says of the joint action with it, up to what all alternatives share.
#[test]
fn alternatives_are_values_of_changed_actions() {
    for (name, set, critic) in critics().into_iter().filter(|(_, set, _)| set.is_choice()) {
        let mut stream = initial(7, 0);
        let sample = Sample::new(&mut stream);
        let view = sample.view();
        let parameters = critic.initial(&mut stream);
        let (rows, length) = (sample.present.len() * VEHICLES, set.length());
        let chosen: Vec<usize> = (0..rows).map(|_| stream.below(length as u32) as usize).collect();
        let vectors = |chosen: &[usize]| -> Vec<f32> {
            let each = chosen
                .iter()
                .flat_map(|&one| (0..length).map(move |k| f32::from(u8::from(k == one))));
            each.collect()
        };
        let worth = |chosen: &[usize], sample: usize| -> f32 {
            let actions = vectors(chosen);
            let asked = Question::new(&parameters, view, &actions);
            critic.forward(&asked, &mut CriticPass::default())[sample]
        };
        let actions = vectors(&chosen);
        let asked = Question::new(&parameters, view, &actions);
        let found = critic.gains(&asked, &mut CriticPass::default());
        for row in (0..rows).filter(|row| view.takes_part(row / VEHICLES, row % VEHICLES)) {
            for action in 1..length {
                let with = |action: usize| {
                    let mut changed = chosen.clone();
                    changed[row] = action;
                    worth(&changed, row / VEHICLES)
                };
                let expected = with(action) - with(0);
                let difference = found[row * length + action] - found[row * length];
                assert!(
                    (difference - expected).abs() < 1e-5,
                    "{name}: {difference} and {expected}"
                );
            }
        }
    }
}

/// The paper's gradient of one actor: through its own network's parameters, tanh, and a local critic with the action as input.
#[test]
fn actors_through_local_critics() {
    let (vehicles, samples) = (2, 6);
    let mut stream = initial(8, 0);
    let mut actors = Group::new(Perceptron::new(3, &[9], 2), false, vehicles, &mut stream);
    let mut critics = Group::new(Perceptron::new(5, &[12, 6], 1), false, vehicles, &mut stream);
    let observations = numbers(&mut stream, samples * vehicles * 3);
    let rows = Rows::all(&observations, 3);
    let tanh = |outputs: Vec<f32>| -> Vec<f32> { outputs.into_iter().map(libm::tanhf).collect() };
    let actions = tanh(actors.forward(&[rows]));
    let along = critics.slopes_along_last(&[rows, Rows::all(&actions, 2)]);
    let slopes: Vec<f32> = along
        .iter()
        .zip(&actions)
        .map(|(along, a)| along * (1.0 - a * a))
        .collect();
    let gradients = actors.gradients(&slopes);
    for (copy, gradient) in gradients.iter().enumerate().take(vehicles) {
        let at = actors.learned[copy].parameters.clone();
        let cell = std::cell::RefCell::new((&mut actors, &mut critics));
        check(&format!("actor {copy}"), &at, gradient, |at| {
            let mut both = cell.borrow_mut();
            let (actors, critics) = &mut *both;
            actors.learned[copy].parameters.copy_from_slice(at);
            let actions = tanh(actors.forward(&[rows]));
            let values = critics.outputs(Role::Learner, &[rows, Rows::all(&actions, 2)]);
            values.iter().map(|&value| f64::from(value)).sum()
        });
        actors.learned[copy].parameters.copy_from_slice(&at);
    }
}

#[test]
fn expectations_and_entropy_along_scores() {
    let mut stream = initial(9, 0);
    for _ in 0..10 {
        let (scores, gains) = (numbers(&mut stream, 6), numbers(&mut stream, 6));
        let softmax = probabilities(&scores);
        let slopes = expectation_slopes(&softmax, &gains);
        check("expectation", &scores, &slopes, |at| {
            weighted(&probabilities(at), &gains)
        });
        let spread = entropy(&softmax);
        let slopes: Vec<f32> = softmax.iter().map(|&p| entropy_slope(p, spread)).collect();
        check("entropy", &scores, &slopes, |at| {
            f64::from(entropy(&probabilities(at)))
        });
    }
}
