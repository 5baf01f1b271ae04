//! Maps of roads: a quantity of each as the colour of its line.

use super::axis::Ticks;
use super::canvas::{Frame, LABEL_LINE_PX, Plot, RIM_PX, WIDTH_PX, line};
use super::map::{BAR_GAP_PX, BAR_PX, MAP_PX, colour, colour_bar};
use super::{Axis, Scale, nothing_to_draw};
use kit::error::Result;
use maud::html;

/// Width of a road's line, px. Both directions lie beside each other, on the right.
const LINE_PX: f64 = 2.0;

/// Room for the numbers beside the colours, px.
const NUMBERS_PX: f64 = 130.0;

/// A figure of roads.
#[derive(Clone, Debug)]
pub struct RoadMapChart {
    /// What the figure shows.
    pub title: String,
    /// What stands behind it; may be empty.
    pub note: String,
    /// The quantity with its unit.
    pub quantity: String,
    /// Every road: its points in units of the same length along both axes, and its value.
    pub roads: Vec<(Vec<(f64, f64)>, f64)>,
}

impl RoadMapChart {
    /// The figure as SVG text, the roads with the largest values on top.
    ///
    /// # Errors
    /// [`Error::Input`](kit::error::Error::Input) names the figure when it has no road, or one whose value is not finite.
    pub fn to_svg(&self) -> Result<String> {
        let points = || self.roads.iter().flat_map(|(line, _)| line.iter().copied());
        if points().next().is_none() {
            return Err(nothing_to_draw(&self.title, "road"));
        }
        let values: Vec<f64> = self.roads.iter().map(|(_, value)| *value).collect();
        Axis::linear(&self.quantity).check(&self.title, &values)?;
        let scale = Ticks::around(Scale::Linear, values.into_iter().chain([0.0]));
        let range = |of: fn((f64, f64)) -> f64| {
            let least = points().map(of).fold(f64::INFINITY, f64::min);
            let most = points().map(of).fold(f64::NEG_INFINITY, f64::max);
            (least, (most - least).max(f64::MIN_POSITIVE))
        };
        let ((left, width), (bottom, height)) = (range(|point| point.0), range(|point| point.1));
        let frame = Frame::new(&self.title, &self.note);
        let most_width = WIDTH_PX - 2.0 * RIM_PX - BAR_GAP_PX - BAR_PX - NUMBERS_PX;
        let pixels = (MAP_PX / height).min(most_width / width);
        let plot = Plot {
            left: RIM_PX,
            top: frame.top(),
            right: RIM_PX + pixels * width,
            bottom: frame.top() + (pixels * height).max(MAP_PX / 2.0),
        };
        let at = |(x, y): (f64, f64)| {
            (
                plot.left + pixels * (x - left),
                plot.bottom - pixels * (y - bottom),
            )
        };
        let mut order: Vec<usize> = (0..self.roads.len()).collect();
        order.sort_by(|&a, &b| self.roads[a].1.total_cmp(&self.roads[b].1));
        let bar = Plot {
            left: plot.right + BAR_GAP_PX,
            right: plot.right + BAR_GAP_PX + BAR_PX,
            ..plot
        };
        let content = html! {
            @for (points, value) in order.into_iter().map(|road| &self.roads[road]) {
                @let points: Vec<(f64, f64)> = points.iter().map(|&point| at(point)).collect();
                (line(&beside(&points), colour(scale.share(*value)), LINE_PX, None))
            }
            (colour_bar(&bar, &scale, &self.quantity))
        };
        Ok(frame.svg(plot.bottom + 20.0 + LABEL_LINE_PX + frame.below(1), &content))
    }
}

/// The line moved to its right by half its width, as traffic on the right sees the other direction to its left.
fn beside(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let (Some(&(x1, y1)), Some(&(x2, y2))) = (points.first(), points.last()) else {
        return Vec::new();
    };
    let length = libm::hypot(x2 - x1, y2 - y1);
    if length == 0.0 {
        return points.to_vec();
    }
    // Downwards is positive on a screen.
    let (dx, dy) = (
        0.5 * LINE_PX * (y1 - y2) / length,
        0.5 * LINE_PX * (x2 - x1) / length,
    );
    points.iter().map(|(x, y)| (x + dx, y + dy)).collect()
}
