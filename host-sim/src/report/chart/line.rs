//! Line charts: how a quantity depends on another, one line per series.

use super::axis::Ticks;
use super::canvas::{
    Anchor, Canvas, DASHES, Dash, GREY, HEIGHT_PX, LABEL_PX, LINE_HEIGHT, NOTE_PX, PALETTE, Plot, RIM_PX,
    TITLE_PX, Type, WIDTH_PX, draw_svg,
};
use super::{Axis, Reference};
use kit::error::{Error, Result};

/// Markers that a long series carries; a short one has one at every point.
const MARKERS: usize = 12;

/// Points up to which every one gets its marker.
const ALL_MARKED: usize = 30;

/// Length of a line's sample in the legend, px.
const SAMPLE_PX: f64 = 36.0;

/// Widest text in the legend, px.
const LEGEND_TEXT_PX: f64 = 180.0;

/// Dash of the reference lines.
const REFERENCE_DASH: Dash = Some((2, 2));

/// A point of a series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Where, in the unit of the horizontal axis.
    pub x: f64,
    /// How much, in the unit of the vertical axis.
    pub y: f64,
    /// Lower and upper end of the interval around `y`, usually of 95 % confidence.
    pub band: Option<(f64, f64)>,
}

/// A named line.
#[derive(Debug, Clone)]
pub struct Series {
    /// What the legend calls it.
    pub name: String,
    /// Its points, in the order in which the line joins them.
    pub points: Vec<Point>,
}

/// A figure of lines, with a legend to the right of the data.
#[derive(Debug, Clone)]
pub struct LineChart {
    /// What the figure shows.
    pub title: String,
    /// What stands behind it (worlds, slots, meaning of the bands); may be empty.
    pub note: String,
    /// The independent variable.
    pub horizontal: Axis,
    /// The quantity.
    pub vertical: Axis,
    /// The lines; the legend keeps their order.
    pub series: Vec<Series>,
    /// Horizontal lines across the whole figure.
    pub references: Vec<Reference>,
}

impl LineChart {
    /// The figure as SVG text.
    ///
    /// # Errors
    /// [`Error::Input`] names the figure when it has no point, a number is not finite, or a number on a logarithmic
    /// axis is not above zero.
    pub fn to_svg(&self) -> Result<String> {
        let points = || self.series.iter().flat_map(|series| &series.points);
        if points().next().is_none() {
            let place = format!("figure '{}'", self.title);
            return Err(Error::input(place, "no point", "at least one"));
        }
        let heights = || {
            let of_points = points().flat_map(|point| {
                let band = point.band.into_iter().flat_map(|(lower, upper)| [lower, upper]);
                std::iter::once(point.y).chain(band)
            });
            of_points.chain(self.references.iter().map(|reference| reference.value))
        };
        for point in points() {
            self.horizontal.check(&self.title, point.x)?;
        }
        for height in heights() {
            self.vertical.check(&self.title, height)?;
        }
        let horizontal = Ticks::tight(self.horizontal.scale, points().map(|point| point.x));
        let vertical = Ticks::around(self.vertical.scale, heights());

        let legend = self.legend();
        let legend_height: f64 = legend.iter().map(Entry::height).sum();
        let legend_width = legend.iter().map(Entry::width).fold(0.0, f64::max);
        let title = Type::TITLE.wrap(&self.title, WIDTH_PX - 2.0 * RIM_PX);
        let note = if self.note.is_empty() {
            Vec::new()
        } else {
            Type::NOTE.wrap(&self.note, WIDTH_PX - 2.0 * RIM_PX)
        };
        let top = RIM_PX + title.len() as f64 * TITLE_PX * LINE_HEIGHT + 14.0;
        let note_height = note.len() as f64 * NOTE_PX * LINE_HEIGHT;
        let right = WIDTH_PX - RIM_PX - legend_width - 20.0;
        let left_without_label = RIM_PX + Type::LABEL.width(vertical.longest_label()) + 26.0;
        let x_label = Type::LABEL.wrap(&self.horizontal.label, right - left_without_label);
        let below = 40.0 + x_label.len() as f64 * LABEL_PX * LINE_HEIGHT + note_height + RIM_PX;
        let height = HEIGHT_PX.max(top + legend_height + below);
        let bottom = height - below;
        let y_label = Type::LABEL.wrap(&self.vertical.label, bottom - top);
        let y_label_width = y_label.len() as f64 * LABEL_PX * LINE_HEIGHT;
        let plot = Plot {
            left: left_without_label + y_label_width,
            top,
            right,
            bottom,
        };
        draw_svg(&self.title, (WIDTH_PX, height), |canvas| {
            canvas.title_and_note(&title, &note, height)?;
            canvas.horizontal_axis(&plot, &horizontal, &x_label)?;
            canvas.vertical_axis(
                &plot,
                &vertical,
                &y_label,
                RIM_PX + y_label_width - LABEL_PX / 2.0,
            )?;
            let pixel = |x: f64, y: f64| (plot.x(horizontal.share(x)), plot.y(vertical.share(y)));
            for (look, series) in self.series.iter().enumerate() {
                draw_bands(canvas, look, &series.points, &pixel)?;
            }
            for reference in &self.references {
                let y = plot.y(vertical.share(reference.value));
                canvas.path(&[(plot.left, y), (plot.right, y)], GREY, 1.75, REFERENCE_DASH)?;
            }
            for (look, series) in self.series.iter().enumerate() {
                draw_line(canvas, look, &series.points, &pixel)?;
            }
            let mut y = plot.top;
            for entry in &legend {
                entry.draw(canvas, (plot.right + 20.0, y))?;
                y += entry.height();
            }
            Ok(())
        })
    }

    fn legend(&self) -> Vec<Entry> {
        let series = self.series.iter().enumerate();
        let references = self.references.iter();
        let lines = |name: &str| Type::LABEL.wrap(name, LEGEND_TEXT_PX);
        series
            .map(|(look, series)| (Some(look), lines(&series.name)))
            .chain(references.map(|reference| (None, lines(&reference.name))))
            .map(|(look, lines)| Entry { look, lines })
            .collect()
    }
}

/// A line of the legend; no look is a reference.
struct Entry {
    look: Option<usize>,
    lines: Vec<String>,
}

impl Entry {
    fn width(&self) -> f64 {
        let widths = self.lines.iter().map(|line| Type::LABEL.width(line));
        SAMPLE_PX + 8.0 + widths.fold(0.0, f64::max)
    }

    fn height(&self) -> f64 {
        self.lines.len() as f64 * LABEL_PX * LINE_HEIGHT + 6.0
    }

    fn draw(&self, canvas: &Canvas<'_>, (x, top): (f64, f64)) -> Result<()> {
        let y = top + LABEL_PX * LINE_HEIGHT / 2.0;
        let ends = [(x, y), (x + SAMPLE_PX, y)];
        match self.look {
            Some(look) => {
                let colour = PALETTE[look % PALETTE.len()];
                canvas.path(&ends, colour, 2.0, DASHES[look % DASHES.len()])?;
                canvas.marker((x + SAMPLE_PX / 2.0, y), look, colour)?;
            }
            None => canvas.path(&ends, GREY, 1.75, REFERENCE_DASH)?,
        }
        canvas.lines(&self.lines, (x + SAMPLE_PX + 8.0, y), Type::LABEL, Anchor::Left)
    }
}

/// One filled shape for every run of points that have a band.
fn draw_bands(
    canvas: &Canvas<'_>,
    look: usize,
    points: &[Point],
    pixel: &impl Fn(f64, f64) -> (f64, f64),
) -> Result<()> {
    for run in points.split(|point| point.band.is_none()) {
        let edge = |point: &Point, upper: bool| {
            let band = point.band.unwrap_or((point.y, point.y));
            pixel(point.x, if upper { band.1 } else { band.0 })
        };
        let there = run.iter().map(|point| edge(point, true));
        let back = run.iter().rev().map(|point| edge(point, false));
        let outline: Vec<_> = there.chain(back).collect();
        if run.len() > 1 {
            canvas.polygon(&outline, PALETTE[look % PALETTE.len()], 0.18)?;
        } else if let [upper, lower] = outline.as_slice() {
            canvas.path(&[*upper, *lower], PALETTE[look % PALETTE.len()], 1.5, None)?;
        }
    }
    Ok(())
}

fn draw_line(
    canvas: &Canvas<'_>,
    look: usize,
    points: &[Point],
    pixel: &impl Fn(f64, f64) -> (f64, f64),
) -> Result<()> {
    let colour = PALETTE[look % PALETTE.len()];
    let pixels: Vec<_> = points.iter().map(|point| pixel(point.x, point.y)).collect();
    if pixels.len() > 1 {
        canvas.path(&pixels, colour, 2.0, DASHES[look % DASHES.len()])?;
    }
    let (every, first) = if pixels.len() <= ALL_MARKED {
        (1, 0)
    } else {
        // Every series begins a little later, so that markers on lines that coincide do not hide one another.
        let every = pixels.len().div_ceil(MARKERS);
        (every, look * every / 4 % every)
    };
    for point in pixels.iter().skip(first).step_by(every) {
        canvas.marker(*point, look, colour)?;
    }
    Ok(())
}
