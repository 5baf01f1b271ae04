//! Bar charts: one quantity of several things, such as the mean age under each policy.

use super::axis::Ticks;
use super::canvas::{
    Anchor, Colour, Frame, GREY, HEIGHT_PX, INK, LABEL_LINE_PX, LABEL_PX, PALETTE, Plot, RIM_PX, Type,
    WIDTH_PX, disc, line, rectangle, text, texts,
};
use super::{Axis, Reference, Scale, nothing_to_draw, policy_colours};
use kit::error::Result;
use maud::{Markup, html};

/// Widest name beside a bar, px.
const NAME_PX: f64 = 210.0;

/// Least height of a bar's row, px.
const ROW_PX: f64 = 40.0;

/// Half the thickness of a bar and half the length of an error bar's cap, px.
const HALF_BAR_PX: f64 = 10.0;
const HALF_CAP_PX: f64 = 7.0;

/// A bar of ordinary things, and of those that the figure is about: tints of the first two colours of the palette.
pub(super) const BAR_COLOURS: [(Colour, Colour); 2] = [
    (PALETTE[0], Colour(158, 202, 225)),
    (PALETTE[1], Colour(253, 190, 133)),
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

impl Bar {
    /// Its mark's colour, and the bar's.
    fn colours(&self) -> (Colour, Colour) {
        policy_colours::of(&self.name).map_or(BAR_COLOURS[usize::from(self.emphasised)], |colour| {
            (colour, colour.tint())
        })
    }
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
    /// [`Error::Input`](kit::error::Error::Input) names the figure when it has no bar, a number is not finite, or a number on a
    /// logarithmic axis is not above zero.
    pub fn to_svg(&self) -> Result<String> {
        if self.bars.is_empty() {
            return Err(nothing_to_draw(&self.title, "bar"));
        }
        let of_bars = self.bars.iter().flat_map(|bar| {
            let interval = bar.interval.into_iter().flat_map(|(lower, upper)| [lower, upper]);
            std::iter::once(bar.value).chain(interval)
        });
        let reference = self.reference.iter().map(|reference| reference.value);
        let zero = (self.axis.scale == Scale::Linear).then_some(0.0);
        let values: Vec<f64> = of_bars.chain(reference).chain(zero).collect();
        self.axis.check(&self.title, &values)?;
        let ticks = Ticks::around(self.axis.scale, values);

        let name_lines = |bar: &Bar| Type::LABEL.wrap(&bar.name, NAME_PX);
        let names: Vec<Vec<String>> = self.bars.iter().map(name_lines).collect();
        let digits: Vec<String> = self.bars.iter().map(|bar| self.digits(bar)).collect();
        let frame = Frame::new(&self.title, &self.note);
        let left = RIM_PX + Type::LABEL.widest(names.iter().flatten()) + 14.0;
        let right = WIDTH_PX - RIM_PX - EMPHASIS.widest(&digits) - 16.0;
        let reference_height = self.reference.as_ref().map_or(0.0, |_| LABEL_LINE_PX + 6.0);
        let top = frame.top() + reference_height;
        let label = Type::LABEL.wrap(&self.axis.label, right - left);
        let below = frame.below(label.len());
        let most_lines = names.iter().map(Vec::len).max().unwrap_or(1);
        let row = ROW_PX.max(most_lines as f64 * LABEL_LINE_PX + 8.0);
        let height = HEIGHT_PX.max(top + below + row * self.bars.len() as f64);
        let plot = Plot {
            left,
            top,
            right,
            bottom: height - below,
        };
        let row = (plot.bottom - plot.top) / self.bars.len() as f64;
        let y = |index: usize| plot.top + (index as f64 + 0.5) * row;
        let pixel = |value: f64| plot.x(ticks.share(value));
        let content = html! {
            (plot.horizontal_axis(&ticks, &label))
            @for (index, (bar, name)) in self.bars.iter().zip(&names).enumerate() {
                @if let Some(base) = self.base() {
                    @let (from, to) = (pixel(base), pixel(bar.value));
                    (rectangle((from, y(index) - HALF_BAR_PX), (to, y(index) + HALF_BAR_PX), bar.colours().1))
                }
                @let above = (name.len() as f64 - 1.0) / 2.0 * LABEL_LINE_PX;
                (texts(name, (plot.left - 10.0, y(index) - above), Type::LABEL, Anchor::Right))
            }
            (self.draw_reference(&plot, &pixel))
            // The marks, the error bars and the digits, above everything else.
            @for (index, (bar, digits)) in self.bars.iter().zip(&digits).enumerate() {
                (self.draw_value(&pixel, bar, digits, y(index)))
            }
        };
        Ok(frame.svg(height, &content))
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

    /// Where bars begin.
    fn base(&self) -> Option<f64> {
        match self.axis.scale {
            Scale::Linear => Some(0.0),
            Scale::Logarithmic => self.reference.as_ref().map(|reference| reference.value),
        }
    }

    fn draw_value(&self, pixel: &impl Fn(f64) -> f64, bar: &Bar, digits: &str, y: f64) -> Markup {
        let interval = bar.interval.map(|(lower, upper)| (pixel(lower), pixel(upper)));
        let mut end = pixel(bar.value) + 5.0;
        if let Some((_, upper)) = interval {
            end = end.max(upper);
        }
        // Digits do not stand on the reference line.
        if let Some(reference) = &self.reference {
            let line = pixel(reference.value);
            if end - 2.0 < line && line < end + 8.0 + Type::LABEL.width(digits) {
                end = line;
            }
        }
        let face = if bar.emphasised { EMPHASIS } else { Type::LABEL };
        html! {
            @if let Some((lower, upper)) = interval {
                (line(&[(lower, y), (upper, y)], INK, 1.5, None))
                @for x in [lower, upper] {
                    (line(&[(x, y - HALF_CAP_PX), (x, y + HALF_CAP_PX)], INK, 1.5, None))
                }
            }
            (disc((pixel(bar.value), y), 3.5, bar.colours().0))
            (text(digits, (end + 8.0, y), face, Anchor::Left))
        }
    }

    fn draw_reference(&self, plot: &Plot, pixel: &impl Fn(f64) -> f64) -> Markup {
        let Some(reference) = &self.reference else {
            return Markup::default();
        };
        let x = pixel(reference.value);
        let name = format!("{} {:.*}", reference.name, self.decimals, reference.value);
        let half = Type::LABEL.width(&name) / 2.0;
        let middle = x.min(WIDTH_PX - RIM_PX - half).max(RIM_PX + half);
        let above = plot.top - 4.0;
        let face = Type {
            colour: GREY,
            ..Type::LABEL
        };
        html! {
            (line(&[(x, above), (x, plot.bottom)], GREY, 1.75, Some("5 3")))
            (text(&name, (middle, above - LABEL_LINE_PX / 2.0), face, Anchor::Middle))
        }
    }
}
