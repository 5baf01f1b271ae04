//! Pixels, strokes and type: the one look of all figures.

use super::axis::Ticks;
use kit::error::{Error, Result};
use maud::html;
use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::{
    Circle, Color as _, DrawingArea, FontStyle, FontTransform, IntoDrawingArea as _, IntoFont as _,
    PathElement, Polygon, RGBColor, Rectangle, SVGBackend, WHITE,
};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{ShapeStyle, TextStyle};

/// Plotters places everything on whole units; this many to a pixel keep curves smooth.
const UNITS_PER_PIXEL: u32 = 8;

/// Plotters' SVG backend divides the size of a font by this.
const BACKEND_FONT_DIVISOR: f64 = 1.24;

/// Mean width of a character, in its font size. Chosen generously: DejaVu Sans, the widest face that `sans-serif`
/// usually means, has 0.56 for English text and 0.64 for digits.
const CHARACTER_WIDTH: f64 = 0.62;

/// Extra width of bold type.
const BOLD_FACTOR: f64 = 1.12;

/// Font size of labels and numbers, px.
pub(super) const LABEL_PX: f64 = 14.0;
/// Font size of titles, px.
pub(super) const TITLE_PX: f64 = 17.0;
/// Font size of notes, px.
pub(super) const NOTE_PX: f64 = 12.0;
/// Distance between two lines of text, in their font size.
pub(super) const LINE_HEIGHT: f64 = 1.35;
/// Empty rim around everything, px.
pub(super) const RIM_PX: f64 = 18.0;
/// Default width of a figure, px.
pub(super) const WIDTH_PX: f64 = 900.0;
/// Least height of a figure, px.
pub(super) const HEIGHT_PX: f64 = 560.0;

/// Text and axes.
pub(super) const INK: RGBColor = RGBColor(34, 34, 34);
/// Secondary text and reference lines.
pub(super) const GREY: RGBColor = RGBColor(90, 90, 90);
/// Grid lines.
pub(super) const FAINT: RGBColor = RGBColor(225, 225, 225);

/// Colours that colour-blind readers can tell apart, the clearest on white first.
///
/// # Source
/// M. Okabe, K. Ito, "Color Universal Design" (2008), their eight colours; only the order is chosen here.
pub(super) const PALETTE: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(0, 0, 0),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(240, 228, 66),
];

/// How a line is broken: lengths of dash and gap, px; `None` is a solid line.
pub(super) type Dash = Option<(u32, u32)>;

/// Dashes by series; their number and the palette's have no common divisor, so a look repeats after 40 series.
pub(super) const DASHES: [Dash; 5] = [None, Some((9, 4)), Some((3, 3)), Some((16, 5)), Some((6, 2))];

/// The rectangle in which data are drawn, px.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plot {
    pub left: f64,
    pub top: f64,
    pub right: f64,
    pub bottom: f64,
}

impl Plot {
    /// The pixel of a share of the width.
    pub fn x(&self, share: f64) -> f64 {
        self.left + share * (self.right - self.left)
    }

    /// The pixel of a share of the height, from the bottom.
    pub fn y(&self, share: f64) -> f64 {
        self.bottom - share * (self.bottom - self.top)
    }
}

/// Where a text stands relative to its point.
#[derive(Debug, Clone, Copy)]
pub(super) enum Anchor {
    Left,
    Middle,
    Right,
}

/// A type of letters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Type {
    pub size_px: f64,
    pub bold: bool,
    pub colour: RGBColor,
}

impl Type {
    /// Labels and numbers.
    pub const LABEL: Self = Self {
        size_px: LABEL_PX,
        bold: false,
        colour: INK,
    };
    /// Titles.
    pub const TITLE: Self = Self {
        size_px: TITLE_PX,
        bold: true,
        colour: INK,
    };
    /// Notes.
    pub const NOTE: Self = Self {
        size_px: NOTE_PX,
        bold: false,
        colour: GREY,
    };

    /// An upper estimate of a text's width, px.
    pub fn width(self, text: &str) -> f64 {
        let factor = if self.bold { BOLD_FACTOR } else { 1.0 };
        text.chars().count() as f64 * CHARACTER_WIDTH * factor * self.size_px
    }

    /// Breaks a text into lines of at most `width_px`, between words; a longer word is broken within. A no-break space
    /// (U+00A0) holds a number and its unit together.
    pub fn wrap(self, text: &str, width_px: f64) -> Vec<String> {
        let mut lines = vec![String::new()];
        for word in text.split_ascii_whitespace() {
            let mut rest: Vec<char> = word.chars().collect();
            while !rest.is_empty() {
                let line = lines.last().map_or("", String::as_str);
                let joined: String = if line.is_empty() {
                    rest.iter().collect()
                } else {
                    format!("{line} {}", rest.iter().collect::<String>())
                };
                if self.width(&joined) <= width_px {
                    let _replaced = lines.pop();
                    lines.push(joined);
                    rest.clear();
                } else if line.is_empty() {
                    let mut kept = rest.len();
                    while kept > 1 && self.width(&rest[..kept].iter().collect::<String>()) > width_px {
                        kept -= 1;
                    }
                    let later = rest.split_off(kept);
                    let _empty = lines.pop();
                    lines.push(rest.into_iter().collect());
                    rest = later;
                    if !rest.is_empty() {
                        lines.push(String::new());
                    }
                } else {
                    lines.push(String::new());
                }
            }
        }
        lines
    }
}

/// A drawing in pixels.
pub(super) struct Canvas<'text> {
    area: DrawingArea<SVGBackend<'text>, Shift>,
}

/// Draws a figure of the given size and gives its SVG. Who cannot see it hears its title.
pub(super) fn draw_svg(
    title: &str,
    (width_px, height_px): (f64, f64),
    draw: impl FnOnce(&Canvas<'_>) -> Result<()>,
) -> Result<String> {
    let size = (units(width_px).unsigned_abs(), units(height_px).unsigned_abs());
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        drawn(area.fill(&WHITE))?;
        draw(&Canvas { area: area.clone() })?;
        drawn(area.present())?;
    }
    // The view box keeps the fine units; the figure's own size is in pixels.
    let fine = format!("<svg width=\"{}\" height=\"{}\"", size.0, size.1);
    let coarse = format!(
        "<svg role=\"img\" width=\"{}\" height=\"{}\"",
        size.0 / UNITS_PER_PIXEL,
        size.1 / UNITS_PER_PIXEL
    );
    // As the first element, where readers of the screen look for a drawing's name.
    let name = html! { title { (title) } }.into_string();
    Ok(text
        .replacen(&fine, &coarse, 1)
        .replacen(">\n", &format!(">\n{name}\n"), 1))
}

fn units(pixels: f64) -> i32 {
    // Saturating, and every figure is some thousand pixels at most.
    (pixels * f64::from(UNITS_PER_PIXEL)).round() as i32
}

/// Writing into a string does not fail, but the drawing library's signature says that it could.
fn drawn<E: std::fmt::Display>(outcome: std::result::Result<(), E>) -> Result<()> {
    outcome.map_err(|error| Error::input("figure", error, "a drawing"))
}

impl Canvas<'_> {
    /// A line through points.
    pub fn path(&self, points: &[(f64, f64)], colour: RGBColor, width_px: f64, dash: Dash) -> Result<()> {
        let points: Vec<_> = points.iter().map(|&(x, y)| (units(x), units(y))).collect();
        let style = ShapeStyle {
            color: colour.to_rgba(),
            filled: false,
            stroke_width: units(width_px).unsigned_abs(),
        };
        match dash {
            None => drawn(self.area.draw(&PathElement::new(points, style))),
            Some((length, gap)) => {
                let (length, gap) = (length * UNITS_PER_PIXEL, gap * UNITS_PER_PIXEL);
                drawn(
                    self.area
                        .draw(&DashedPathElement::new(points, length, gap, style)),
                )
            }
        }
    }

    /// A filled shape.
    pub fn polygon(&self, points: &[(f64, f64)], colour: RGBColor, opacity: f64) -> Result<()> {
        let points: Vec<_> = points.iter().map(|&(x, y)| (units(x), units(y))).collect();
        drawn(self.area.draw(&Polygon::new(points, colour.mix(opacity))))
    }

    /// A filled rectangle between two corners.
    pub fn rectangle(&self, (x0, y0): (f64, f64), (x1, y1): (f64, f64), colour: RGBColor) -> Result<()> {
        let corners = [
            (units(x0.min(x1)), units(y0.min(y1))),
            (units(x0.max(x1)), units(y0.max(y1))),
        ];
        drawn(self.area.draw(&Rectangle::new(corners, colour.filled())))
    }

    /// The marker of the `look`-th series.
    pub fn marker(&self, (x, y): (f64, f64), look: usize, colour: RGBColor) -> Result<()> {
        let shape = |corners: &[(f64, f64)]| {
            let corners: Vec<_> = corners.iter().map(|(dx, dy)| (x + dx, y + dy)).collect();
            self.polygon(&corners, colour, 1.0)
        };
        match look % 6 {
            0 => self.disc((x, y), 4.0, colour),
            1 => shape(&[(-3.6, -3.6), (3.6, -3.6), (3.6, 3.6), (-3.6, 3.6)]),
            2 => shape(&[(0.0, -5.0), (4.6, 3.4), (-4.6, 3.4)]),
            3 => shape(&[(0.0, -5.4), (4.4, 0.0), (0.0, 5.4), (-4.4, 0.0)]),
            4 => shape(&[(0.0, 5.0), (4.6, -3.4), (-4.6, -3.4)]),
            _ => {
                self.disc((x, y), 4.4, colour)?;
                self.disc((x, y), 2.2, WHITE)
            }
        }
    }

    /// A filled circle.
    pub fn disc(&self, (x, y): (f64, f64), radius_px: f64, colour: RGBColor) -> Result<()> {
        let radius = units(radius_px).unsigned_abs();
        drawn(
            self.area
                .draw(&Circle::new((units(x), units(y)), radius, colour.filled())),
        )
    }

    /// A line of text, centred on its point vertically.
    pub fn text(&self, text: &str, (x, y): (f64, f64), face: Type, anchor: Anchor) -> Result<()> {
        self.turned_text(text, (x, y), face, anchor, FontTransform::None)
    }

    /// Lines of text, the first centred on the point vertically.
    pub fn lines(&self, lines: &[String], (x, y): (f64, f64), face: Type, anchor: Anchor) -> Result<()> {
        for (index, line) in lines.iter().enumerate() {
            let below = index as f64 * LINE_HEIGHT * face.size_px;
            self.text(line, (x, y + below), face, anchor)?;
        }
        Ok(())
    }

    fn turned_text(
        &self,
        text: &str,
        (x, y): (f64, f64),
        face: Type,
        anchor: Anchor,
        turn: FontTransform,
    ) -> Result<()> {
        let style = if face.bold {
            FontStyle::Bold
        } else {
            FontStyle::Normal
        };
        let size = face.size_px * BACKEND_FONT_DIVISOR * f64::from(UNITS_PER_PIXEL);
        let horizontal = match anchor {
            Anchor::Left => HPos::Left,
            Anchor::Middle => HPos::Center,
            Anchor::Right => HPos::Right,
        };
        let style = TextStyle::from(("sans-serif", size).into_font().style(style).transform(turn))
            .color(&face.colour)
            .pos(Pos::new(horizontal, VPos::Center));
        drawn(self.area.draw_text(text, &style, (units(x), units(y))))
    }

    /// Title lines at the top and note lines at the bottom.
    pub fn title_and_note(&self, title: &[String], note: &[String], height_px: f64) -> Result<()> {
        let title_y = RIM_PX + TITLE_PX * LINE_HEIGHT / 2.0;
        self.lines(title, (RIM_PX, title_y), Type::TITLE, Anchor::Left)?;
        let note_y = height_px - RIM_PX - (note.len() as f64 - 0.5) * NOTE_PX * LINE_HEIGHT;
        self.lines(note, (RIM_PX, note_y), Type::NOTE, Anchor::Left)
    }

    /// The horizontal axis: grid, ticks, numbers and label below the plot.
    pub fn horizontal_axis(&self, plot: &Plot, ticks: &Ticks, label: &[String]) -> Result<()> {
        for tick in &ticks.ticks {
            let x = plot.x(ticks.share(tick.value));
            self.path(&[(x, plot.top), (x, plot.bottom)], FAINT, 1.0, None)?;
            if let Some(number) = &tick.label {
                self.path(&[(x, plot.bottom), (x, plot.bottom + 5.0)], INK, 1.0, None)?;
                self.text(number, (x, plot.bottom + 16.0), Type::LABEL, Anchor::Middle)?;
            }
        }
        self.path(
            &[(plot.left, plot.bottom), (plot.right, plot.bottom)],
            INK,
            1.25,
            None,
        )?;
        let middle = (plot.left + plot.right) / 2.0;
        self.lines(label, (middle, plot.bottom + 40.0), Type::LABEL, Anchor::Middle)
    }

    /// The vertical axis: grid, ticks, numbers, and the label turned along it, its last line `label_x` from the left.
    pub fn vertical_axis(&self, plot: &Plot, ticks: &Ticks, label: &[String], label_x: f64) -> Result<()> {
        for tick in &ticks.ticks {
            let y = plot.y(ticks.share(tick.value));
            self.path(&[(plot.left, y), (plot.right, y)], FAINT, 1.0, None)?;
            if let Some(number) = &tick.label {
                self.path(&[(plot.left - 5.0, y), (plot.left, y)], INK, 1.0, None)?;
                self.text(number, (plot.left - 9.0, y), Type::LABEL, Anchor::Right)?;
            }
        }
        self.path(
            &[(plot.left, plot.top), (plot.left, plot.bottom)],
            INK,
            1.25,
            None,
        )?;
        let middle = (plot.top + plot.bottom) / 2.0;
        for (index, line) in label.iter().enumerate() {
            let x = label_x - (label.len() - 1 - index) as f64 * LINE_HEIGHT * LABEL_PX;
            self.turned_text(
                line,
                (x, middle),
                Type::LABEL,
                Anchor::Middle,
                FontTransform::Rotate270,
            )?;
        }
        Ok(())
    }
}
