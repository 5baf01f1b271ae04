//! Bar charts: one quantity of several things, such as the mean age under each policy.

use super::axis::Ticks;
use super::canvas::{
    Anchor, Canvas, GREY, HEIGHT_PX, INK, LABEL_PX, LINE_HEIGHT, NOTE_PX, PALETTE, Plot, RIM_PX, TITLE_PX,
    Type, WIDTH_PX, draw_svg,
};
use super::{Axis, Reference, Scale};
use kit::error::{Error, Result};
use plotters::style::RGBColor;

/// Widest name beside a bar, px.
const NAME_PX: f64 = 210.0;

/// Least height of a bar's row, px.
const ROW_PX: f64 = 40.0;

/// Half the thickness of a bar and half the length of an error bar's cap, px.
const HALF_BAR_PX: f64 = 10.0;
const HALF_CAP_PX: f64 = 7.0;

/// A bar of ordinary things, and of those that the figure is about: tints of the first two colours of the palette.
const BAR_COLOURS: [(RGBColor, RGBColor); 2] = [
    (PALETTE[0], RGBColor(158, 202, 225)),
    (PALETTE[1], RGBColor(253, 190, 133)),
];

/// The digits of an emphasised bar.
const EMPHASIS: Type = Type {
    size_px: LABEL_PX,
    bold: true,
    colour: INK,
};

/// A named value.
#[derive(Debug, Clone)]
pub struct Bar {
    /// What stands beside it.
    pub name: String,
    /// The value, in the unit of the axis.
    pub value: f64,
    /// Lower and upper end of its interval, usually of 95 % confidence.
    pub interval: Option<(f64, f64)>,
    /// Whether the figure is about this one.
    pub emphasised: bool,
}

/// A figure of horizontal bars, from top to bottom in the order given, each with its value in digits.
///
/// Lengths must mean something. On a linear axis a bar begins at zero. On a logarithmic one it begins at the reference,
/// so that its length is the ratio to it; without a reference there is no bar, only the mark at the value.
#[derive(Debug, Clone)]
pub struct BarChart {
    /// What the figure shows.
    pub title: String,
    /// What stands behind it (worlds, slots, meaning of the intervals); may be empty.
    pub note: String,
    /// The quantity.
    pub axis: Axis,
    /// Decimals of the values in digits.
    pub decimals: usize,
    /// The bars.
    pub bars: Vec<Bar>,
    /// A vertical line across all bars, such as a bound.
    pub reference: Option<Reference>,
}

impl BarChart {
    /// The figure as SVG text.
    ///
    /// # Errors
    /// [`Error::Input`] names the figure when it has no bar, a number is not finite, or a number on a logarithmic axis
    /// is not above zero.
    pub fn to_svg(&self) -> Result<String> {
        if self.bars.is_empty() {
            let place = format!("figure '{}'", self.title);
            return Err(Error::input(place, "no bar", "at least one"));
        }
        let values = || {
            let of_bars = self.bars.iter().flat_map(|bar| {
                let interval = bar.interval.into_iter().flat_map(|(lower, upper)| [lower, upper]);
                std::iter::once(bar.value).chain(interval)
            });
            let reference = self.reference.iter().map(|reference| reference.value);
            let zero = (self.axis.scale == Scale::Linear).then_some(0.0);
            of_bars.chain(reference).chain(zero)
        };
        for value in values() {
            self.axis.check(&self.title, value)?;
        }
        let ticks = Ticks::around(self.axis.scale, values());

        let names: Vec<_> = self
            .bars
            .iter()
            .map(|bar| Type::LABEL.wrap(&bar.name, NAME_PX))
            .collect();
        let digits: Vec<_> = self.bars.iter().map(|bar| self.digits(bar)).collect();
        let widest = |texts: &mut dyn Iterator<Item = &String>, face: Type| {
            texts.map(|text| face.width(text)).fold(0.0, f64::max)
        };
        let title = Type::TITLE.wrap(&self.title, WIDTH_PX - 2.0 * RIM_PX);
        let note = if self.note.is_empty() {
            Vec::new()
        } else {
            Type::NOTE.wrap(&self.note, WIDTH_PX - 2.0 * RIM_PX)
        };
        let left = RIM_PX + widest(&mut names.iter().flatten(), Type::LABEL) + 14.0;
        let right = WIDTH_PX - RIM_PX - widest(&mut digits.iter(), EMPHASIS) - 16.0;
        let reference_height = if self.reference.is_some() {
            LABEL_PX * LINE_HEIGHT + 6.0
        } else {
            0.0
        };
        let top = RIM_PX + title.len() as f64 * TITLE_PX * LINE_HEIGHT + 14.0 + reference_height;
        let label = Type::LABEL.wrap(&self.axis.label, right - left);
        let note_height = note.len() as f64 * NOTE_PX * LINE_HEIGHT;
        let below = 40.0 + label.len() as f64 * LABEL_PX * LINE_HEIGHT + note_height + RIM_PX;
        let most_lines = names.iter().map(Vec::len).max().unwrap_or(1);
        let row = ROW_PX.max(most_lines as f64 * LABEL_PX * LINE_HEIGHT + 8.0);
        let height = HEIGHT_PX.max(top + below + row * self.bars.len() as f64);
        let plot = Plot {
            left,
            top,
            right,
            bottom: height - below,
        };
        let row = (plot.bottom - plot.top) / self.bars.len() as f64;
        draw_svg(&self.title, (WIDTH_PX, height), |canvas| {
            canvas.title_and_note(&title, &note, height)?;
            canvas.horizontal_axis(&plot, &ticks, &label)?;
            for (index, bar) in self.bars.iter().enumerate() {
                let y = plot.top + (index as f64 + 0.5) * row;
                self.draw_bar(canvas, (&plot, &ticks), bar, y)?;
                let above = (names[index].len() as f64 - 1.0) / 2.0 * LABEL_PX * LINE_HEIGHT;
                let name_at = (plot.left - 10.0, y - above);
                canvas.lines(&names[index], name_at, Type::LABEL, Anchor::Right)?;
            }
            self.draw_reference(canvas, &plot, &ticks)?;
            for (index, bar) in self.bars.iter().enumerate() {
                let y = plot.top + (index as f64 + 0.5) * row;
                self.draw_value(canvas, (&plot, &ticks), bar, (&digits[index], y))?;
            }
            Ok(())
        })
    }

    /// A value and, if it has an interval, the larger of its two arms.
    fn digits(&self, bar: &Bar) -> String {
        let decimals = self.decimals;
        match bar.interval {
            None => format!("{:.decimals$}", bar.value),
            Some((lower, upper)) => {
                let arm = (bar.value - lower).max(upper - bar.value);
                let least = libm::pow(10.0, -(decimals as f64));
                if arm > 0.0 && arm < least / 2.0 {
                    // An interval of nothing would be wrong.
                    format!("{:.decimals$} ± <{least:.decimals$}", bar.value)
                } else {
                    format!("{:.decimals$} ± {arm:.decimals$}", bar.value)
                }
            }
        }
    }

    fn draw_bar(&self, canvas: &Canvas<'_>, (plot, ticks): (&Plot, &Ticks), bar: &Bar, y: f64) -> Result<()> {
        let base = match (self.axis.scale, &self.reference) {
            (Scale::Linear, _) => Some(0.0),
            (Scale::Logarithmic, Some(reference)) => Some(reference.value),
            (Scale::Logarithmic, None) => None,
        };
        let Some(base) = base else { return Ok(()) };
        let (from, to) = (plot.x(ticks.share(base)), plot.x(ticks.share(bar.value)));
        let (_, tint) = BAR_COLOURS[usize::from(bar.emphasised)];
        canvas.rectangle((from, y - HALF_BAR_PX), (to, y + HALF_BAR_PX), tint)
    }

    /// The mark, the error bar and the digits, above everything else.
    fn draw_value(
        &self,
        canvas: &Canvas<'_>,
        (plot, ticks): (&Plot, &Ticks),
        bar: &Bar,
        (digits, y): (&str, f64),
    ) -> Result<()> {
        let pixel = |value: f64| plot.x(ticks.share(value));
        let (colour, _) = BAR_COLOURS[usize::from(bar.emphasised)];
        let mut end = pixel(bar.value) + 5.0;
        if let Some((lower, upper)) = bar.interval {
            let (lower, upper) = (pixel(lower), pixel(upper));
            canvas.path(&[(lower, y), (upper, y)], INK, 1.5, None)?;
            for x in [lower, upper] {
                canvas.path(&[(x, y - HALF_CAP_PX), (x, y + HALF_CAP_PX)], INK, 1.5, None)?;
            }
            end = end.max(upper);
        }
        canvas.disc((pixel(bar.value), y), 3.5, colour)?;
        if let Some(reference) = &self.reference {
            // The digits would stand on the line.
            let line = pixel(reference.value);
            let width = Type::LABEL.width(digits);
            if end - 2.0 < line && line < end + 8.0 + width {
                end = line;
            }
        }
        let face = if bar.emphasised { EMPHASIS } else { Type::LABEL };
        canvas.text(digits, (end + 8.0, y), face, Anchor::Left)
    }

    fn draw_reference(&self, canvas: &Canvas<'_>, plot: &Plot, ticks: &Ticks) -> Result<()> {
        let Some(reference) = &self.reference else {
            return Ok(());
        };
        let x = plot.x(ticks.share(reference.value));
        canvas.path(&[(x, plot.top - 4.0), (x, plot.bottom)], GREY, 1.75, Some((5, 3)))?;
        let text = format!("{} {:.*}", reference.name, self.decimals, reference.value);
        let half = Type::LABEL.width(&text) / 2.0;
        let middle = x.min(WIDTH_PX - RIM_PX - half).max(RIM_PX + half);
        let y = plot.top - 4.0 - LABEL_PX * LINE_HEIGHT / 2.0;
        let face = Type {
            colour: GREY,
            ..Type::LABEL
        };
        canvas.text(&text, (middle, y), face, Anchor::Middle)
    }
}
