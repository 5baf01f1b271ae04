//! Line charts: how a quantity depends on another, one line per series.

use super::axis::Ticks;
use super::canvas::{
    Anchor, At, Colour, DASHES, Dash, Frame, GREY, HEIGHT_PX, INK, LABEL_LINE_PX, PALETTE, Plot, RIM_PX,
    Type, WIDTH_PX, line, marker, polygon, texts,
};
use super::{Axis, Reference, nothing_to_draw, policy_colours};
use crate::report::table::{Column, Table};
use kit::error::Result;
use kit::files::NamedText;
use maud::{Markup, html};

/// Markers that a long series carries; a short one has one at every point.
const MARKERS: usize = 12;

/// Points up to which every one gets its marker.
const ALL_MARKED: usize = 30;

/// Length of a line's sample in the legend, px.
const SAMPLE_PX: f64 = 36.0;

/// Widest text in the legend, px.
const LEGEND_TEXT_PX: f64 = 180.0;

/// Dash of the reference lines.
const REFERENCE_DASH: Dash = Some("2 2");

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

impl From<(f64, f64)> for Point {
    /// Without an interval.
    fn from((x, y): (f64, f64)) -> Self {
        Self { x, y, band: None }
    }
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
    /// [`Error::Input`](kit::error::Error::Input) names the figure when it has no point, a number is not finite, or a number on
    /// a logarithmic axis is not above zero.
    pub fn to_svg(&self) -> Result<String> {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let across: Vec<f64> = points().map(|point| point.x).collect();
        if across.is_empty() {
            return Err(nothing_to_draw(&self.title, "point"));
        }
        let of_points = points().flat_map(|point| {
            let band = point.band.into_iter().flat_map(|(lower, upper)| [lower, upper]);
            std::iter::once(point.y).chain(band)
        });
        let references = self.references.iter().map(|reference| reference.value);
        let heights: Vec<f64> = of_points.chain(references).collect();
        self.horizontal.check(&self.title, &across)?;
        self.vertical.check(&self.title, &heights)?;
        // A mark without a line cannot be read where it lies on the frame.
        let horizontal = if self.series.iter().any(|series| series.points.len() == 1) {
            Ticks::around(self.horizontal.scale, across)
        } else {
            Ticks::tight(self.horizontal.scale, across)
        };
        let vertical = Ticks::around(self.vertical.scale, heights);

        let frame = Frame::new(&self.title, &self.note);
        let looks = self.looks();
        let legend = self.legend(&looks);
        let legend_height: f64 = legend.iter().map(Entry::height).sum();
        let legend_width = Type::LABEL.widest(legend.iter().flat_map(|entry| &entry.lines));
        let right = WIDTH_PX - RIM_PX - SAMPLE_PX - 8.0 - legend_width - 20.0;
        let left_without_label = RIM_PX + Type::LABEL.width(vertical.longest_label()) + 26.0;
        let x_label = Type::LABEL.wrap(&self.horizontal.label, right - left_without_label);
        let (top, below) = (frame.top(), frame.below(x_label.len()));
        let height = HEIGHT_PX.max(top + legend_height + below);
        let bottom = height - below;
        let y_label = Type::LABEL.wrap(&self.vertical.label, bottom - top);
        let plot = Plot {
            left: left_without_label + y_label.len() as f64 * LABEL_LINE_PX,
            top,
            right,
            bottom,
        };
        let pixel = |x: f64, y: f64| (plot.x(horizontal.share(x)), plot.y(vertical.share(y)));
        let content = html! {
            (plot.horizontal_axis(&horizontal, &x_label))
            (plot.vertical_axis(&vertical, &y_label))
            @for (look, series) in looks.iter().zip(&self.series) {
                (series.bands(look.colour, &pixel))
            }
            @for reference in &self.references {
                @let y = plot.y(vertical.share(reference.value));
                (line(&[(plot.left, y), (plot.right, y)], GREY, 1.75, REFERENCE_DASH))
            }
            @for (look, series) in looks.iter().zip(&self.series) {
                (series.line(*look, &pixel))
            }
            @for (index, entry) in legend.iter().enumerate() {
                @let above: f64 = legend[..index].iter().map(Entry::height).sum();
                (entry.draw((plot.right + 20.0, plot.top + above)))
            }
        };
        Ok(frame.svg(height, &content))
    }

    /// The figure as `NAME.svg`, and as `NAME.csv` its points, one a row, under these names of series, x and y; where there are
    /// intervals, their ends follow as `lower` and `upper`.
    ///
    /// # Errors
    /// As [`LineChart::to_svg`].
    pub fn files(&self, name: &str, names: [&str; 3]) -> Result<[NamedText; 2]> {
        Ok([
            (format!("{name}.svg"), self.to_svg()?),
            (format!("{name}.csv"), self.to_csv(names)?),
        ])
    }

    /// Its points as CSV, as [`LineChart::files`] says.
    ///
    /// # Errors
    /// If two columns have the same name.
    pub fn to_csv(&self, [series, x, y]: [&str; 3]) -> Result<String> {
        let points = || {
            let series = self.series.iter();
            series.flat_map(|series| series.points.iter().map(|point| (&series.name, point)))
        };
        let mut columns = vec![
            Column::text(series, points().map(|(series, _)| series.clone())),
            Column::number(x, points().map(|(_, point)| point.x)),
            Column::number(y, points().map(|(_, point)| point.y)),
        ];
        if points().any(|(_, point)| point.band.is_some()) {
            let lower = points().map(|(_, point)| point.band.map(|(lower, _)| lower));
            let upper = points().map(|(_, point)| point.band.map(|(_, upper)| upper));
            columns.extend([Column::number("lower", lower), Column::number("upper", upper)]);
        }
        Ok(Table::new(columns)?.to_csv())
    }

    /// A policy has its own colour, a single line beside policies that of writing; others the palette's, in order.
    fn looks(&self) -> Vec<Look> {
        let own = |series: &Series| policy_colours::of(&series.name);
        let others = self.series.iter().filter(|series| own(series).is_none()).count();
        let is_alone = others == 1 && self.series.len() > 1;
        let palette = PALETTE.iter().cycle();
        let looks = self.series.iter().zip(palette).enumerate();
        let looks = looks.map(|(place, (series, &next))| Look {
            place,
            colour: own(series).unwrap_or(if is_alone { INK } else { next }),
        });
        looks.collect()
    }

    fn legend(&self, looks: &[Look]) -> Vec<Entry> {
        let series = looks.iter().zip(&self.series);
        let series = series.map(|(look, series)| (Some(*look), &series.name));
        let references = self.references.iter().map(|reference| (None, &reference.name));
        let entry = |(look, name): (_, &String)| Entry {
            look,
            lines: Type::LABEL.wrap(name, LEGEND_TEXT_PX),
        };
        series.chain(references).map(entry).collect()
    }
}

/// How a series is drawn: its place among the others, which decides its dash and its marker, and its colour.
#[derive(Clone, Copy)]
struct Look {
    place: usize,
    colour: Colour,
}

impl Look {
    fn dash(self) -> Dash {
        DASHES[self.place % DASHES.len()]
    }
}

/// A line of the legend; no look is a reference.
struct Entry {
    look: Option<Look>,
    lines: Vec<String>,
}

impl Entry {
    fn height(&self) -> f64 {
        self.lines.len() as f64 * LABEL_LINE_PX + 6.0
    }

    fn draw(&self, (x, top): At) -> Markup {
        let y = top + LABEL_LINE_PX / 2.0;
        let ends = [(x, y), (x + SAMPLE_PX, y)];
        html! {
            @if let Some(look) = self.look {
                (line(&ends, look.colour, 2.0, look.dash()))
                (marker((x + SAMPLE_PX / 2.0, y), look.place, look.colour))
            } @else {
                (line(&ends, GREY, 1.75, REFERENCE_DASH))
            }
            (texts(&self.lines, (x + SAMPLE_PX + 8.0, y), Type::LABEL, Anchor::Left))
        }
    }
}

impl Series {
    /// One filled shape for every run of points that have a band.
    fn bands(&self, colour: Colour, pixel: &impl Fn(f64, f64) -> At) -> Markup {
        let outline = |run: &[Point]| -> Vec<At> {
            let edge = |point: &Point, upper: bool| {
                let band = point.band.unwrap_or((point.y, point.y));
                pixel(point.x, if upper { band.1 } else { band.0 })
            };
            let there = run.iter().map(|point| edge(point, true));
            let back = run.iter().rev().map(|point| edge(point, false));
            there.chain(back).collect()
        };
        html! {
            @for run in self.points.split(|point| point.band.is_none()) {
                @match run.len() {
                    0 => {}
                    1 => { (line(&outline(run), colour, 1.5, None)) }
                    _ => { (polygon(&outline(run), colour, Some(0.18))) }
                }
            }
        }
    }

    fn line(&self, look: Look, pixel: &impl Fn(f64, f64) -> At) -> Markup {
        let pixels: Vec<At> = self.points.iter().map(|point| pixel(point.x, point.y)).collect();
        let (every, first) = if pixels.len() <= ALL_MARKED {
            (1, 0)
        } else {
            // Every series begins a little later, so that markers on lines that coincide do not hide one another.
            let every = pixels.len().div_ceil(MARKERS);
            (every, look.place * every / 4 % every)
        };
        html! {
            @if pixels.len() > 1 {
                (line(&pixels, look.colour, 2.0, look.dash()))
            }
            @for point in pixels.iter().skip(first).step_by(every) {
                (marker(*point, look.place, look.colour))
            }
        }
    }
}
