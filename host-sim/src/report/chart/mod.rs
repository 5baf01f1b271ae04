//! Figures in one style, as SVG text.
//!
//! White ground (`dark` has each colour's like on a dark one), sans-serif type, at least 900 x 560 pixels; every label stands outside the data. Series differ by
//! colour, by dash and by marker, so that a figure survives a grey printer and a colour-blind reader. The same chart
//! gives the same bytes on every machine.

mod axis;
mod bar;
mod canvas;
pub(super) mod dark;
mod line;
mod map;
mod occupancy;
mod panels;
pub(super) mod policy_colours;
mod roads;
mod share_maps;

pub use bar::{Bar, BarChart};
pub use line::{LineChart, Point, Series};
pub use map::MapChart;
pub use occupancy::{OccupancyChart, OccupancyGroup, SlotUse};
pub use panels::side_by_side;
pub use roads::RoadMapChart;
pub use share_maps::{ShareMaps, Side, Squares};

use kit::error::{Error, Result};

/// How an axis maps values to length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Equal lengths are equal differences.
    Linear,
    /// Equal lengths are equal ratios; values must be above zero.
    Logarithmic,
}

/// What an axis shows.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Quantity and unit: `mean age (ms)`.
    pub label: String,
    /// How values become lengths.
    pub scale: Scale,
}

impl Axis {
    /// An axis of equal differences.
    pub fn linear(label: &str) -> Self {
        Self {
            label: label.to_owned(),
            scale: Scale::Linear,
        }
    }

    /// An axis of equal ratios.
    pub fn logarithmic(label: &str) -> Self {
        Self {
            label: label.to_owned(),
            scale: Scale::Logarithmic,
        }
    }

    /// Refuses values that this axis cannot show.
    fn check(&self, chart_title: &str, values: &[f64]) -> Result<()> {
        let expected = match self.scale {
            Scale::Linear => "a finite number",
            Scale::Logarithmic => "a finite number above 0",
        };
        let shown = |value: f64| value.is_finite() && (self.scale == Scale::Linear || value > 0.0);
        match values.iter().find(|value| !shown(**value)) {
            None => Ok(()),
            Some(value) => {
                let place = format!("figure '{chart_title}', axis '{}'", self.label);
                Err(Error::input(place, value, expected))
            }
        }
    }
}

/// A figure without any of what it is made of.
fn nothing_to_draw(title: &str, what: &str) -> Error {
    Error::input(format!("figure '{title}'"), format!("no {what}"), "at least one")
}

/// A line at a fixed value, such as a bound that no policy can beat.
#[derive(Debug, Clone)]
pub struct Reference {
    /// What the value is.
    pub name: String,
    /// The value, in the unit of its axis.
    pub value: f64,
}
