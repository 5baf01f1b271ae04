//! Links, and how the nodes between them are numbered.

use crate::volume_delay::VolumeDelay;
use kit::error::{Error, Result};

/// More nodes than this are taken for a typing error rather than for a network.
const NODE_LIMIT: u32 = 10_000_000;

/// One directed link, as a network file states it. Units are the file's own; only costs must be in units of
/// `free_flow_time`, and capacity in units of the demand.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Number of the node it leaves, from 1.
    pub init_node: u32,
    /// Number of the node it enters, from 1.
    pub term_node: u32,
    /// Flow at which the BPR function adds `b` times the free-flow time.
    pub capacity: f64,
    /// Length, which costs [`CostWeights::distance`] per unit.
    pub length: f64,
    /// Travel time of an empty link.
    pub free_flow_time: f64,
    /// BPR's B; 0 for a link that never congests.
    pub b: f64,
    /// BPR's power, not necessarily an integer.
    pub power: f64,
    /// Toll, which costs [`CostWeights::toll`] per unit.
    pub toll: f64,
}

/// Most that 8 J over the capacity may be in Akcelik's function (chosen: roads have a hundredth; from a hundred million on the root in it
/// has no digit left where nobody drives).
const SHARPEST_BEND: f64 = 1e4;

/// How a link's travel time grows with its flow. The formulas stand in [`volume_delay`](crate::volume_delay).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum DelayFunction {
    /// BPR, with the link's own B and power.
    #[default]
    Bpr,
    /// Conical, of this steepness, more than 1. The link's own B and power count for nothing.
    Conical {
        /// Spiess' alpha.
        alpha: f64,
    },
    /// Time-dependent, after Akcelik. The link's own B and power count for nothing.
    Akcelik {
        /// His J, from 0.1 on a motorway to 1.6 on a street with much friction.
        delay_parameter: f64,
        /// Length of the time in which demand and capacity count vehicles, in units of the free-flow time.
        period: f64,
    },
}

impl DelayFunction {
    /// Refuses parameters that give no function.
    ///
    /// # Errors
    /// [`Error::Input`] at `place`.
    pub fn check(&self, place: &str) -> Result<()> {
        match *self {
            Self::Bpr => Ok(()),
            Self::Conical { alpha } if alpha.is_finite() && alpha > 1.0 => Ok(()),
            Self::Conical { alpha } => Err(Error::input(
                format!("{place}: alpha of the conical function"),
                alpha,
                "a finite number, more than 1, such as conical=4",
            )),
            Self::Akcelik {
                delay_parameter,
                period,
            } => {
                check_not_negative(&format!("{place}: Akcelik's J"), delay_parameter)?;
                if period.is_finite() && period > 0.0 {
                    return Ok(());
                }
                Err(Error::input(
                    format!("{place}: period of Akcelik's function"),
                    period,
                    "a positive number",
                ))
            }
        }
    }
}

impl Link {
    /// The link's volume-delay function with toll and distance weighed in.
    ///
    /// # Errors
    /// [`Error::Input`] at `place` for an attribute that is negative or not finite, a capacity of 0 on a link that can
    /// congest, parameters that give no function, or coefficients beyond floating point, such as `free_flow_time b /
    /// capacity^power`.
    pub fn volume_delay(
        &self,
        function: DelayFunction,
        weights: CostWeights,
        place: &str,
    ) -> Result<VolumeDelay> {
        for (name, value) in [
            ("capacity", self.capacity),
            ("length", self.length),
            ("free_flow_time", self.free_flow_time),
            ("b", self.b),
            ("power", self.power),
            ("toll", self.toll),
        ] {
            check_not_negative(&format!("{place}: {name}"), value)?;
        }
        function.check(place)?;
        let (congests, reason) = match function {
            DelayFunction::Bpr => (self.congests(), "b, power and free_flow_time are positive"),
            DelayFunction::Conical { .. } => (self.free_flow_time > 0.0, "free_flow_time is positive"),
            DelayFunction::Akcelik { delay_parameter, .. } => {
                (delay_parameter > 0.0, "Akcelik's J is positive")
            }
        };
        if congests && self.capacity == 0.0 {
            let expected = format!("a positive number where {reason}");
            return Err(Error::input(format!("{place}: capacity"), 0, expected));
        }
        if let DelayFunction::Akcelik { delay_parameter, .. } = function
            && 8.0 * delay_parameter > SHARPEST_BEND * self.capacity
        {
            let most = SHARPEST_BEND / 8.0 * self.capacity;
            let expected = format!("at most {most}, with a capacity of {}", self.capacity);
            return Err(Error::input(
                format!("{place}: Akcelik's J"),
                delay_parameter,
                expected,
            ));
        }
        let fixed_cost = weights.toll * self.toll + weights.distance * self.length;
        let (free, capacity) = (self.free_flow_time, self.capacity);
        let delay = match function {
            DelayFunction::Bpr => VolumeDelay::bpr(free, self.b, capacity, self.power, fixed_cost),
            DelayFunction::Conical { alpha } => VolumeDelay::conical(free, alpha, capacity, fixed_cost),
            DelayFunction::Akcelik {
                delay_parameter,
                period,
            } => VolumeDelay::akcelik(free, delay_parameter, capacity, period, fixed_cost),
        };
        if delay.is_finite() {
            Ok(delay)
        } else {
            Err(Error::input(
                place,
                "a cost that overflows",
                "attributes of a usual size",
            ))
        }
    }

    /// Whether the link's file lets its travel time grow with its flow: connectors do not.
    pub fn congests(&self) -> bool {
        self.free_flow_time > 0.0 && self.b > 0.0 && self.power > 0.0
    }
}

/// What a unit of toll and of distance costs, in units of time. Both 0 by default: cost is time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CostWeights {
    /// Time per unit of toll.
    pub toll: f64,
    /// Time per unit of length.
    pub distance: f64,
}

/// How nodes are numbered: zones first, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeNumbering {
    /// Nodes 1 to `zones` are where trips start and end.
    pub zones: u32,
    /// Nodes 1 to `nodes` exist.
    pub nodes: u32,
    /// Nodes with a smaller number can start or end a trip, but no trip passes through them; 1 lets all be passed.
    pub first_thru_node: u32,
}

impl NodeNumbering {
    /// Checks that the three numbers make sense together.
    ///
    /// # Errors
    /// [`Error::Input`] at `place` for no nodes, more than ten million, more zones than nodes, or a first thru node
    /// outside 1 to nodes + 1.
    pub fn check(&self, place: &str) -> Result<()> {
        let Self {
            zones,
            nodes,
            first_thru_node,
        } = *self;
        if !(1..=NODE_LIMIT).contains(&nodes) {
            let expected = format!("1 to {NODE_LIMIT}");
            return Err(Error::input(format!("{place}: NUMBER OF NODES"), nodes, expected));
        }
        if zones > nodes {
            let expected = format!("at most the {nodes} nodes");
            return Err(Error::input(format!("{place}: NUMBER OF ZONES"), zones, expected));
        }
        if !(1..=nodes + 1).contains(&first_thru_node) {
            let expected = format!("1 to {}", nodes + 1);
            return Err(Error::input(
                format!("{place}: FIRST THRU NODE"),
                first_thru_node,
                expected,
            ));
        }
        Ok(())
    }

    /// Checks that node `number` exists.
    ///
    /// # Errors
    /// [`Error::Input`] at `place`, for the column `name`.
    pub fn check_node(&self, place: &str, name: &str, number: u32) -> Result<()> {
        if (1..=self.nodes).contains(&number) {
            return Ok(());
        }
        let expected = format!("a node from 1 to {}", self.nodes);
        Err(Error::input(format!("{place}: {name}"), number, expected))
    }
}

/// Refuses what is negative, infinite or not a number.
pub fn check_not_negative(place: &str, value: f64) -> Result<()> {
    if value.is_finite() && value >= 0.0 {
        return Ok(());
    }
    Err(Error::input(place, value, "a finite number, not negative"))
}
