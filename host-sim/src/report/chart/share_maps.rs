//! Shares over two quantities: panels side by side and below each other, with one scale of colours.

use super::axis::Ticks;
use super::canvas::{
    Anchor, FAINT, Frame, LABEL_LINE_PX, Plot, RIM_PX, Type, WIDTH_PX, line, outlined, text, texts,
};
use super::map::{self, BAR_GAP_PX, BAR_PX, colour, colour_bar};
use super::{Scale, nothing_to_draw};
use kit::error::Result;
use maud::html;

/// Height of a panel, and between two panels, px.
const PANEL_PX: f64 = 190.0;
const GAP_PX: f64 = 22.0;

/// A quantity along one side of all panels.
#[derive(Clone, Debug)]
pub struct Side {
    /// Its name and unit.
    pub label: String,
    /// Where the first square begins and the last one ends; all are equally wide.
    pub range: (f64, f64),
}

/// A figure of shares, such as of decisions that send, over two quantities.
#[derive(Clone, Debug)]
pub struct ShareMaps {
    /// What the figure shows.
    pub title: String,
    /// What stands behind it; may be empty.
    pub note: String,
    /// What is shared.
    pub quantity: String,
    /// From left to right in every panel.
    pub horizontal: Side,
    /// From the bottom up in every panel.
    pub vertical: Side,
    /// Names of the columns of panels.
    pub columns: Vec<String>,
    /// Names of the rows of panels, each with its panels: `[column][square from the bottom][square from the left]`, from 0 to 1; `None`
    /// where nothing was seen.
    pub rows: Vec<(String, Vec<Squares>)>,
}

/// The squares of a panel.
pub type Squares = Vec<Vec<Option<f64>>>;

impl ShareMaps {
    /// The figure as SVG text.
    ///
    /// # Errors
    /// [`Error::Input`](kit::error::Error::Input) names the figure when it has no value.
    pub fn to_svg(&self) -> Result<String> {
        let panels = || self.rows.iter().flat_map(|(_, panels)| panels);
        if !panels().flatten().flatten().any(Option::is_some) {
            return Err(nothing_to_draw(&self.title, "value"));
        }
        let frame = Frame::new(&self.title, &self.note);
        let [horizontal, vertical] = [&self.horizontal, &self.vertical]
            .map(|side| Ticks::tight(Scale::Linear, [side.range.0, side.range.1]));
        let shares = Ticks::tight(Scale::Linear, [0.0, 1.0]);
        let left = RIM_PX + LABEL_LINE_PX + 44.0;
        let right = WIDTH_PX - RIM_PX - BAR_GAP_PX - BAR_PX - 130.0;
        let width = (right - left + GAP_PX) / self.columns.len() as f64 - GAP_PX;
        let names = self.columns.iter().map(|name| Type::LABEL.wrap(name, width));
        let names: Vec<Vec<String>> = names.collect();
        let name_lines = names.iter().map(Vec::len).max().unwrap_or(0) as f64;
        let row_top = |row: usize| {
            let name = (row as f64 + 1.0) * (LABEL_LINE_PX + 6.0);
            frame.top() + name_lines * LABEL_LINE_PX + name + row as f64 * (PANEL_PX + GAP_PX)
        };
        let plot = |row: usize, column: usize| {
            let x = left + column as f64 * (width + GAP_PX);
            let top = row_top(row);
            Plot {
                left: x,
                top,
                right: x + width,
                bottom: top + PANEL_PX,
            }
        };
        let last = self.rows.len().saturating_sub(1);
        let whole = Plot {
            right,
            bottom: plot(last, 0).bottom,
            ..plot(0, 0)
        };
        let bar = Plot {
            left: right + BAR_GAP_PX,
            right: right + BAR_GAP_PX + BAR_PX,
            bottom: plot(0, 0).bottom,
            ..whole
        };
        let content = html! {
            @for (column, lines) in names.iter().enumerate() {
                (texts(lines, (plot(0, column).left, frame.top() + 6.0), Type::LABEL, Anchor::Left))
            }
            @for (row, (name, panels)) in self.rows.iter().enumerate() {
                (text(name, (left, row_top(row) - 14.0), Type { bold: true, ..Type::LABEL }, Anchor::Left))
                @for (column, squares) in panels.iter().enumerate() {
                    @let plot = plot(row, column);
                    @for tick in &vertical.ticks {
                        @let y = plot.y(vertical.share(tick.value));
                        (line(&[(plot.left - 4.0, y), (plot.right, y)], FAINT, 1.0, None))
                        @if let (0, Some(number)) = (column, &tick.label) {
                            (text(number, (plot.left - 9.0, y), Type::LABEL, Anchor::Right))
                        }
                    }
                    @for tick in &horizontal.ticks {
                        @let x = plot.x(horizontal.share(tick.value));
                        (line(&[(x, plot.top), (x, plot.bottom + 4.0)], FAINT, 1.0, None))
                        @if let (true, Some(number)) = (row == last, &tick.label) {
                            (text(number, (x, plot.bottom + 16.0), Type::LABEL, Anchor::Middle))
                        }
                    }
                    (map::squares(&plot, squares, |a, b, share| outlined(a, b, colour(share))))
                }
            }
            (texts(
                std::slice::from_ref(&self.horizontal.label),
                (whole.x(0.5), whole.bottom + 40.0),
                Type::LABEL,
                Anchor::Middle,
            ))
            (whole.side_label(std::slice::from_ref(&self.vertical.label)))
            (colour_bar(&bar, &shares, &self.quantity))
        };
        Ok(frame.svg(whole.bottom + frame.below(1), &content))
    }
}
