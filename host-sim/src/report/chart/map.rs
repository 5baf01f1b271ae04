//! Maps: a quantity by place.

use super::axis::Ticks;
use super::canvas::{
    Anchor, At, Colour, FAINT, Frame, INK, LABEL_LINE_PX, Plot, RIM_PX, Type, WIDTH_PX, disc, line,
    rectangle, text, texts,
};
use super::{Axis, Scale, nothing_to_draw};
use kit::error::Result;
use maud::{Markup, html};

/// Height of a map, px; its width follows from the place's shape.
pub(super) const MAP_PX: f64 = 620.0;

/// Width of the colour scale's bar, its distance from the map, and its steps.
pub(super) const BAR_PX: f64 = 18.0;
pub(super) const BAR_GAP_PX: f64 = 40.0;
const BAR_STEPS: u32 = 64;

/// From the plot to the name of the quantity below it, px.
const LABEL_BELOW_PX: f64 = 20.0;

/// Colours from the least to the largest value, in equal steps: dark blue to yellow, in order of lightness, also for
/// colour-blind readers.
///
/// # Source
/// J. Nuñez, C. Anderton, R. Renslow, "Optimizing colormaps with consideration for color vision deficiency", PLOS ONE 2018
/// (cividis), at every eighth of its range.
const COLOURS: [Colour; 9] = [
    Colour(0, 34, 78),
    Colour(26, 56, 111),
    Colour(64, 77, 108),
    Colour(94, 98, 110),
    Colour(124, 123, 120),
    Colour(155, 147, 118),
    Colour(189, 174, 108),
    Colour(223, 203, 89),
    Colour(254, 232, 56),
];

/// A figure of a quantity over a rectangle of ground.
#[derive(Clone, Debug)]
pub struct MapChart {
    /// What the figure shows.
    pub title: String,
    /// What stands behind it; may be empty.
    pub note: String,
    /// The quantity with its unit.
    pub quantity: String,
    /// Least and largest value of its colours, the same for maps that are compared; values beyond have the colour of the end.
    pub range: (f64, f64),
    /// Ground along x and along y in metres.
    pub ground_m: (f64, f64),
    /// `[row][column]`, rows from y = 0 up, columns from x = 0 on; `None` where nothing was measured.
    pub values: Vec<Vec<Option<f64>>>,
    /// A marked place with its name, which stands beside the map: x and y in metres.
    pub mark: Option<(f64, f64, String)>,
}

impl MapChart {
    /// The figure as SVG text; its colours are logarithmic.
    ///
    /// # Errors
    /// [`Error::Input`](kit::error::Error::Input) names the figure when it has no value, or one that is not above zero.
    pub fn to_svg(&self) -> Result<String> {
        let values: Vec<f64> = self.values.iter().flatten().flatten().copied().collect();
        if values.is_empty() {
            return Err(nothing_to_draw(&self.title, "value"));
        }
        Axis::logarithmic(&self.quantity).check(&self.title, &values)?;
        let (least, largest) = self.range;
        let scale = Ticks::around(Scale::Logarithmic, [least, largest]);
        let frame = Frame::new(&self.title, &self.note);
        let (ground_x, ground_y) = self.ground_m;
        let top = frame.top();
        let left = RIM_PX + LABEL_LINE_PX + 70.0;
        let most_width = WIDTH_PX - RIM_PX - left - BAR_GAP_PX - BAR_PX - 130.0;
        let pixels_per_m = (MAP_PX / ground_y).min(most_width / ground_x);
        let plot = Plot {
            left,
            top,
            right: left + pixels_per_m * ground_x,
            bottom: top + pixels_per_m * ground_y,
        };
        let bar = Plot {
            left: plot.right + BAR_GAP_PX,
            right: plot.right + BAR_GAP_PX + BAR_PX,
            ..plot
        };
        let horizontal = Ticks::tight(Scale::Linear, [0.0, ground_x]);
        let vertical = Ticks::tight(Scale::Linear, [0.0, ground_y]);
        let label_lines = bar_label(&bar, &self.quantity).len() as f64;
        let content = html! {
            (plot.horizontal_axis(&horizontal, &["x (m)".to_owned()]))
            (plot.vertical_axis(&vertical, &["y (m)".to_owned()]))
            (squares(&plot, &self.values, |a, b, value| rectangle(a, b, colour(scale.share(value)))))
            (colour_bar(&bar, &scale, &self.quantity))
            @if let Some((x, y, name)) = &self.mark {
                @let legend_y = plot.bottom + LABEL_BELOW_PX + label_lines * LABEL_LINE_PX;
                @for at in [(plot.x(x / ground_x), plot.y(y / ground_y)), (bar.x(0.5), legend_y)] {
                    (disc(at, 6.5, INK))
                    (disc(at, 4.0, COLOURS[8]))
                }
                (text(name, (bar.right + 9.0, legend_y), Type::LABEL, Anchor::Left))
            }
        };
        Ok(frame.svg(plot.bottom + frame.below(1), &content))
    }
}

/// `draw` of every square that has a value, between two of its corners: rows from the bottom up, columns from the left on.
pub(super) fn squares(
    plot: &Plot,
    rows: &[Vec<Option<f64>>],
    draw: impl Fn(At, At, f64) -> Markup,
) -> Markup {
    html! {
        @for (row, columns) in rows.iter().enumerate() {
            @let corner = |column: usize, row: usize| {
                (plot.x(column as f64 / columns.len() as f64), plot.y(row as f64 / rows.len() as f64))
            };
            @for (column, value) in columns.iter().enumerate() {
                @if let Some(value) = value {
                    (draw(corner(column, row), corner(column + 1, row + 1), *value))
                }
            }
        }
    }
}

/// The lines of a quantity's name below its colours.
fn bar_label(bar: &Plot, quantity: &str) -> Vec<String> {
    Type::LABEL.wrap(quantity, WIDTH_PX - RIM_PX - bar.left)
}

/// The colours of a scale, with its numbers beside them and the name of the quantity below.
pub(super) fn colour_bar(bar: &Plot, scale: &Ticks, quantity: &str) -> Markup {
    html! {
        @for step in 0..BAR_STEPS {
            @let share = |part: f64| (f64::from(step) + part) / f64::from(BAR_STEPS);
            (rectangle((bar.left, bar.y(share(0.0))), (bar.right, bar.y(share(1.0))), colour(share(0.5))))
        }
        @for tick in &scale.ticks {
            @let y = bar.y(scale.share(tick.value));
            @if let Some(number) = &tick.label {
                (line(&[(bar.left, y), (bar.right + 5.0, y)], FAINT, 1.0, None))
                (text(number, (bar.right + 9.0, y), Type::LABEL, Anchor::Left))
            }
        }
        (texts(&bar_label(bar, quantity), (bar.left, bar.bottom + LABEL_BELOW_PX), Type::LABEL, Anchor::Left))
    }
}

/// The colour of a share of the scale, between its neighbours.
pub(super) fn colour(share: f64) -> Colour {
    let position = share.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f64;
    let below = (position.floor() as usize).min(COLOURS.len() - 2);
    let rest = position - below as f64;
    let (a, b) = (COLOURS[below], COLOURS[below + 1]);
    let mix = |a: u8, b: u8| (f64::from(a) + rest * (f64::from(b) - f64::from(a))).round() as u8;
    Colour(mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2))
}
