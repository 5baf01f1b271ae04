//! A toy game learned: two vehicles share one sub-channel, and a learner finds out that they have to take turns.
//!
//! The best play of this game is known exactly, so it shows whether a learning algorithm learns. A game of one's own implements
//! [`Game`] as [`Turns`] does, and is played in the same way.
//!
//! ```console
//! $ cargo run --release -p trainer --example toy
//! ```

use kit::error::{Error, Result};
use trainer::configuration::{Algorithm, ConfigurationSource, Preset};
use trainer::game::Game;
use trainer::game::toy::Turns;
use trainer::laboratory::learner::name;
use trainer::maddpg::learner::MaddpgLearner;
use trainer::maddpg::options::Maddpg;

/// Worlds side by side: one for each pair of ages to start from.
const WORLDS: usize = 16;

/// Slots of an episode.
const SLOTS: u32 = 12;

fn main() -> Result<()> {
    let options = options()?;
    // Rewards in quarters, so that critics learn values near one.
    let toy = || Turns::new(WORLDS).paying(false, 0.25);
    let mut learner = MaddpgLearner::new(toy().shape(), &options, 1);
    println!("episode  mean age with exploration");
    for episode in 1..=options.episodes {
        let metrics = learner.episode(&mut toy());
        if episode.is_power_of_two() || episode == options.episodes {
            println!("{episode:7}  {:.3}", metrics.get(name::AGE).unwrap_or(f64::NAN));
        }
    }
    let actors = learner.networks();
    let age = Turns::mean_age(SLOTS, |observed, agent| {
        actors[agent % actors.len()].forward(observed)
    });
    println!(
        "learned: mean age {age:.4} slots; best play: {:.4}",
        Turns::best_age(SLOTS)
    );
    Ok(())
}

/// The preset `freshlane` of the modified MADDPG, made small.
fn options() -> Result<Maddpg> {
    let source = ConfigurationSource {
        preset: Preset::Freshlane,
        file: None,
        settings: Vec::new(),
    };
    let algorithm = source.read()?.algorithm;
    let Algorithm::Maddpg(options) = algorithm else {
        return Err(Error::input("preset", algorithm.name(), "maddpg"));
    };
    Ok(Maddpg {
        episodes: 400,
        worlds: WORLDS as u64,
        slots: SLOTS,
        actor_hidden: vec![32],
        local_critic_hidden: vec![32],
        set_hidden: 32,
        set_sum: 16,
        replay: 4096,
        warm_up_slots: 192,
        batch: 64,
        first_share: 1.0,
        silence_bias: 0.0,
        full_power_bias: 0.0,
        actor_learning_rate: 5e-3,
        critic_learning_rate: 1e-2,
        entropy: 0.1,
        last_entropy: 0.005,
        gradient_clip: 0.0,
        discount: 0.8,
        n_step: 1,
        target_rate: 0.05,
        ..options
    })
}
