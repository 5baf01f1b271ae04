//! What every learning algorithm says of itself: the section of its keys implements [`LearningAlgorithm`].

use crate::game::reward::RewardName;
use crate::laboratory::learner::Learner;
use crate::mixture::Mixture;
use firmware::form::{ObservationForm, OutputForm};
use host_sim::scenario::Scenario;
use kit::error::Result;

/// What is to be learned.
#[derive(Clone, Debug)]
pub struct Task<'a> {
    /// The cell to learn in.
    pub scenario: &'a Scenario,
    /// The cells to learn in, for who learns in mixtures: without one, the scenario alone.
    pub cells: Mixture,
    /// What vehicles are paid for, unless the algorithm's own keys say it.
    pub reward: Option<RewardName>,
}

/// A learning algorithm, told what to do. One more is a file with such a section and its [`Learner`], and a line in
/// [`crate::configuration`]; a preset chooses it.
pub trait LearningAlgorithm {
    /// Episodes of the run.
    fn episodes_mut(&mut self) -> &mut u64;

    /// What its actors see and do: as the shipped form, unless it can do otherwise.
    fn forms(&self) -> (ObservationForm, OutputForm) {
        (ObservationForm::Ring, OutputForm::Actions)
    }

    /// Fewest and most vehicles of a cell that does not say.
    fn vehicles(&self, scenario: &Scenario) -> [u32; 2] {
        [scenario.cell.vehicles; 2]
    }

    /// Whether it learns in several cells; otherwise in the scenario alone.
    fn learns_in_mixtures(&self) -> bool {
        false
    }

    /// Which losses, where users write them.
    fn losses_checksum(&self) -> Option<String> {
        None
    }

    /// Checks keys against each other and the scenario.
    ///
    /// # Errors
    /// A key that does not go with another.
    fn check(&self, scenario: &Scenario) -> Result<()>;

    /// Checks keys against the cells to learn in.
    ///
    /// # Errors
    /// A key that does not go with a cell.
    fn check_cells(&self, _cells: &Mixture) -> Result<()> {
        Ok(())
    }

    /// The learner before its first episode.
    ///
    /// # Errors
    /// What it reads besides, such as an actor to begin with.
    fn learner(&self, task: Task<'_>, seed: u64) -> Result<Box<dyn Learner>>;
}
