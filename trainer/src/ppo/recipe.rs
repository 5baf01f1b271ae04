//! How to learn.

use super::rules::{CellPlace, Costs};
use super::update::Rates;
use crate::mixture::{self, Mixture};
use firmware::network::{MAX_LAYERS, MAX_WIDTH};
use kit::error::{Error, Result};
use kit::{choices, keys};
use std::path::PathBuf;

keys! {
    /// The learner's parameters.
    pub struct Recipe {
        /// Folder of the run whose actor to go on from, such as one of `trainer distil`. Without one,
        /// learning starts from the first scores.
        #[key(source = "chosen")]
        pub first_actor: PathBuf,
        /// Factor of the first actor's scores: less than 1 makes it explore.
        #[key(range = 1e-3..=1e3, source = "chosen")]
        pub first_actor_sharpness: f32,
        /// Folder of the run of `train` whose critic to go on from, of the same form and widths. Without one, a new one.
        #[key(source = "chosen")]
        pub first_critics: PathBuf,
        /// Episodes at the start in which only the critic learns.
        #[key(range = 0.0..=1e6, unit = "episodes", source = "chosen")]
        pub critic_first_episodes: u64,
        /// Widths of the actor's hidden layers.
        #[key(range = 1.0..=MAX_WIDTH as f64, longest = MAX_LAYERS - 1, unit = "widths", source = "chosen")]
        pub hidden: Vec<usize>,
        /// Widths of the critic's hidden layers.
        #[key(range = 1.0..=MAX_WIDTH as f64, longest = MAX_LAYERS - 1, unit = "widths", source = "chosen")]
        pub critic_hidden: Vec<usize>,
        /// What the critic sees.
        #[key(source = "chosen")]
        pub critic_sees: CriticView,
        /// Episodes of the run; each begins with fresh worlds.
        #[key(range = 1.0..=1e6, unit = "episodes", source = "chosen")]
        pub episodes: u64,
        /// Batches of worlds in an episode. The worlds of one batch have the same number of vehicles; in a mixture each batch
        /// is of one cell, as many as its weight says.
        #[key(range = 1.0..=10_000.0, unit = "batches", source = "chosen")]
        pub batches: u32,
        /// Worlds in a batch.
        #[key(range = 1.0..=10_000.0, unit = "worlds", source = "chosen")]
        pub worlds: u32,
        /// Updates in an episode.
        #[key(range = 1.0..=10_000.0, unit = "updates", source = "chosen")]
        pub updates: u32,
        /// Slots played before each update.
        #[key(range = 1.0..=10_000.0, unit = "slots", source = "chosen")]
        pub slots: u32,
        /// Times that an update goes over what was played.
        #[key(range = 1.0..=1000.0, source = "chosen")]
        pub epochs: u32,
        /// Samples in a step of the optimiser.
        #[key(range = 1.0..=16_777_216.0, unit = "samples", source = "chosen")]
        pub minibatch: usize,
        /// Fewest vehicles of a batch, whose number is drawn; it replaces the scenario's. A cell of a mixture may have its own.
        #[key(range = 1.0..=300.0, unit = "vehicles", source = "chosen")]
        pub min_vehicles: u32,
        /// Most vehicles of a batch. A table serves at most so many, or as many as a cell of the mixture has.
        #[key(range = 1.0..=300.0, unit = "vehicles", source = "chosen")]
        pub max_vehicles: u32,
        /// Weight of the next slot's value.
        #[key(range = 0.0..=0.999_99, source = "chosen")]
        pub discount: f32,
        /// Lambda of generalised advantage estimation.
        #[key(range = 0.0..=1.0, source = "chosen")]
        pub trace: f32,
        /// Weight of each other vehicle's cost beside the own one in a reward.
        #[key(range = 0.0..=1.0, source = "chosen")]
        pub team: f32,
        /// Largest cost of a slot, which costs the age in frames: rounds of the ring.
        #[key(range = 1.0..=100.0, unit = "frames", source = "chosen")]
        pub most_frames: f32,
        /// Cost of a transmission in the same unit: where everybody sends and nobody is heard, only this
        /// tells anybody to stop.
        #[key(range = 0.0..=100.0, unit = "frames", source = "chosen")]
        pub transmission: f32,
        /// How far a probability ratio may leave 1.
        #[key(range = 1e-3..=1.0, source = "chosen")]
        pub clip: f32,
        /// Largest norm of the actor's gradient.
        #[key(range = 1e-6..=1e6, source = "chosen")]
        pub gradient_limit: f32,
        /// Learning rates of the actor at the start and at the end, linear between; Adam.
        #[key(range = 1e-9..=1.0, source = "chosen")]
        pub learning_rate: [f32; 2],
        /// Learning rates of the critic at the start and at the end, linear between; Adam.
        #[key(range = 1e-9..=1.0, source = "chosen")]
        pub critic_learning_rate: [f32; 2],
        /// Weights of the entropy at the start and at the end, geometric between.
        #[key(range = 1e-12..=1e3, source = "chosen")]
        pub entropy: [f32; 2],
        /// Scores of silence, full power and each joiner level, a guest's too, before anything is learned; not used
        /// after a first actor.
        #[key(range = -100.0..=100.0, source = "chosen: so few contend that they are heard, and it is learned that contending pays")]
        pub first_scores: [f32; 3],
    }
}

choices! {
    /// What the critic sees of a cell.
    pub enum CriticView {
        /// What the vehicle sees, and how many of the others are at each age.
        Cell = "cell",
        /// What the vehicle sees.
        Vehicle = "vehicle",
    }
}

impl Recipe {
    /// Checks keys against each other.
    ///
    /// # Errors
    /// A key that does not go with another.
    pub fn check(&self) -> Result<()> {
        if self.min_vehicles > self.max_vehicles {
            let expected = format!("at most ppo.max_vehicles, which is {}", self.max_vehicles);
            return Err(Error::input("ppo.min_vehicles", self.min_vehicles, expected));
        }
        if self.critic_first_episodes >= self.episodes {
            let expected = format!("less than ppo.episodes, which is {}", self.episodes);
            return Err(Error::input(
                "ppo.critic_first_episodes",
                self.critic_first_episodes,
                expected,
            ));
        }
        self.check_first_actor()
    }

    /// Checks that every cell gets its part of an episode.
    ///
    /// # Errors
    /// The first that gets none.
    pub fn check_cells(&self, mixture: &Mixture) -> Result<()> {
        let split = mixture.split(self.batches as usize);
        let mut cells = mixture.cells().iter().enumerate();
        let Some((index, cell)) = cells.find(|(index, _)| !split.contains(index)) else {
            return Ok(());
        };
        let found = format!("{}, none for \"{}\"", cell.weight, cell.name);
        let expected = format!("enough for one of the {} ppo.batches", self.batches);
        Err(Error::input(
            format!("{}.weight", mixture::place(index)),
            found,
            expected,
        ))
    }

    /// Checks that what belongs to a first actor comes with one.
    fn check_first_actor(&self) -> Result<()> {
        let needs = if self.first_actor_sharpness != 1.0 {
            format!(
                "ppo.first_actor_sharpness, which is {}",
                self.first_actor_sharpness
            )
        } else if self.critic_first_episodes > 0 {
            format!(
                "ppo.critic_first_episodes, which is {}",
                self.critic_first_episodes
            )
        } else {
            return Ok(());
        };
        if self.first_actor.as_os_str().is_empty() {
            let expected = format!("the folder of a run, for {needs}");
            return Err(Error::input("ppo.first_actor", "none", expected));
        }
        Ok(())
    }

    /// How far to step when this part of the run is done.
    pub(super) fn rates(&self, progress: f64) -> Rates {
        let linear = |[first, last]: [f32; 2]| first + (last - first) * progress as f32;
        let [first, last] = self.entropy;
        let learns = progress * self.episodes as f64 >= self.critic_first_episodes as f64;
        Rates {
            actor: if learns { linear(self.learning_rate) } else { 0.0 },
            critic: linear(self.critic_learning_rate),
            entropy: first * libm::pow(f64::from(last / first), progress) as f32,
        }
    }

    pub(super) const fn costs(&self, place: CellPlace) -> Costs {
        Costs {
            team: self.team,
            most_frames: self.most_frames,
            transmission: self.transmission,
            scale: 1.0 - self.discount,
            sees: self.critic_sees,
            place,
        }
    }
}
