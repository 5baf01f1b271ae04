//! Maps: a quantity by place.

use super::Scale;
use super::axis::Ticks;
use super::canvas::{
    Anchor, FAINT, INK, LABEL_PX, LINE_HEIGHT, NOTE_PX, Plot, RIM_PX, TITLE_PX, Type, WIDTH_PX, draw_svg,
};
use kit::error::{Error, Result};
use plotters::style::RGBColor;

/// Height of a map, px; its width follows from the place's shape.
const MAP_PX: f64 = 620.0;

/// Width of the colour scale's bar, its distance from the map, and its steps.
const BAR_PX: f64 = 18.0;
const BAR_GAP_PX: f64 = 40.0;
const BAR_STEPS: u32 = 64;

/// Colours from the least to the largest value, in equal steps: dark blue to yellow, in order of lightness, also for
/// colour-blind readers.
///
/// # Source
/// J. Nuñez, C. Anderton, R. Renslow, "Optimizing colormaps with consideration for color vision deficiency", PLOS ONE 2018
/// (cividis), at every eighth of its range.
const COLOURS: [RGBColor; 9] = [
    RGBColor(0, 34, 78),
    RGBColor(26, 56, 111),
    RGBColor(64, 77, 108),
    RGBColor(94, 98, 110),
    RGBColor(124, 123, 120),
    RGBColor(155, 147, 118),
    RGBColor(189, 174, 108),
    RGBColor(223, 203, 89),
    RGBColor(254, 232, 56),
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
    /// [`Error::Input`] names the figure when it has no value, or one that is not above zero.
    pub fn to_svg(&self) -> Result<String> {
        let values = || self.values.iter().flatten().flatten().copied();
        let place = || format!("figure '{}'", self.title);
        if let Some(wrong) = values().find(|value| !(value.is_finite() && *value > 0.0)) {
            return Err(Error::input(place(), wrong, "finite numbers above 0"));
        }
        if values().next().is_none() {
            return Err(Error::input(place(), "no value", "at least one"));
        }
        let scale = Ticks::around(Scale::Logarithmic, values());
        let inner = WIDTH_PX - 2.0 * RIM_PX;
        let (title, note) = (
            Type::TITLE.wrap(&self.title, inner),
            Type::NOTE.wrap(&self.note, inner),
        );
        let (ground_x, ground_y) = self.ground_m;
        let top = RIM_PX + title.len() as f64 * TITLE_PX * LINE_HEIGHT + 14.0;
        let left = RIM_PX + LABEL_PX * LINE_HEIGHT + 70.0;
        let most_width = WIDTH_PX - RIM_PX - left - BAR_GAP_PX - BAR_PX - 130.0;
        let pixels_per_m = (MAP_PX / ground_y).min(most_width / ground_x);
        let plot = Plot {
            left,
            top,
            right: left + pixels_per_m * ground_x,
            bottom: top + pixels_per_m * ground_y,
        };
        let height =
            plot.bottom + 40.0 + LABEL_PX * LINE_HEIGHT + note.len() as f64 * NOTE_PX * LINE_HEIGHT + RIM_PX;
        let horizontal = Ticks::tight(Scale::Linear, [0.0, ground_x]);
        let vertical = Ticks::tight(Scale::Linear, [0.0, ground_y]);
        draw_svg(&self.title, (WIDTH_PX, height), |canvas| {
            canvas.title_and_note(&title, &note, height)?;
            canvas.horizontal_axis(&plot, &horizontal, &["x (m)".to_owned()])?;
            canvas.vertical_axis(&plot, &vertical, &["y (m)".to_owned()], RIM_PX + LABEL_PX / 2.0)?;
            let rows = self.values.len() as f64;
            for (row, columns) in self.values.iter().enumerate() {
                let width = 1.0 / columns.len() as f64;
                for (column, value) in columns.iter().enumerate() {
                    if let Some(value) = value {
                        let (x, y) = (column as f64 * width, row as f64 / rows);
                        let corners = (
                            (plot.x(x), plot.y(y)),
                            (plot.x(x + width), plot.y(y + 1.0 / rows)),
                        );
                        canvas.rectangle(corners.0, corners.1, colour(scale.share(*value)))?;
                    }
                }
            }
            let bar = Plot {
                left: plot.right + BAR_GAP_PX,
                right: plot.right + BAR_GAP_PX + BAR_PX,
                ..plot
            };
            for step in 0..BAR_STEPS {
                let (from, to) = (
                    f64::from(step) / f64::from(BAR_STEPS),
                    f64::from(step + 1) / f64::from(BAR_STEPS),
                );
                canvas.rectangle(
                    (bar.left, bar.y(from)),
                    (bar.right, bar.y(to)),
                    colour((from + to) / 2.0),
                )?;
            }
            for tick in &scale.ticks {
                let y = bar.y(scale.share(tick.value));
                if let Some(number) = &tick.label {
                    canvas.path(&[(bar.left, y), (bar.right + 5.0, y)], FAINT, 1.0, None)?;
                    canvas.text(number, (bar.right + 9.0, y), Type::LABEL, Anchor::Left)?;
                }
            }
            let quantity = Type::LABEL.wrap(&self.quantity, WIDTH_PX - RIM_PX - bar.left);
            let below = plot.bottom + 20.0;
            canvas.lines(&quantity, (bar.left, below), Type::LABEL, Anchor::Left)?;
            let Some((x, y, name)) = &self.mark else {
                return Ok(());
            };
            let legend = (
                (bar.left + bar.right) / 2.0,
                below + quantity.len() as f64 * LABEL_PX * LINE_HEIGHT,
            );
            for at in [(plot.x(x / ground_x), plot.y(y / ground_y)), legend] {
                canvas.disc(at, 6.5, INK)?;
                canvas.disc(at, 4.0, COLOURS[8])?;
            }
            canvas.text(name, (bar.right + 9.0, legend.1), Type::LABEL, Anchor::Left)
        })
    }
}

/// The colour of a share of the scale, between its neighbours.
fn colour(share: f64) -> RGBColor {
    let position = share.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f64;
    let below = (position.floor() as usize).min(COLOURS.len() - 2);
    let rest = position - below as f64;
    let (a, b) = (COLOURS[below], COLOURS[below + 1]);
    let mix = |a: u8, b: u8| (f64::from(a) + rest * (f64::from(b) - f64::from(a))).round() as u8;
    RGBColor(mix(a.0, b.0), mix(a.1, b.1), mix(a.2, b.2))
}
