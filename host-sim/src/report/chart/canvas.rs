//! Pixels, strokes and type: the one look of all figures, as pieces of SVG.

use super::axis::Ticks;
use maud::{Markup, html};
use std::fmt;

/// Mean width of a character, in its font size. Chosen generously: DejaVu Sans, the widest face that `sans-serif`
/// usually means, has 0.56 for English text and 0.64 for digits.
const CHARACTER_WIDTH: f64 = 0.62;

/// Extra width of bold type.
const BOLD_FACTOR: f64 = 1.12;

/// From the middle of a letter down to the line that it stands on, in its font size.
const HALF_LETTER: f64 = 0.35;

/// Font size of labels and numbers, px.
pub(super) const LABEL_PX: f64 = 14.0;
/// Font size of titles, px.
const TITLE_PX: f64 = 17.0;
/// Font size of notes, px.
const NOTE_PX: f64 = 12.0;
/// Distance between two lines of text, in their font size.
const LINE_HEIGHT: f64 = 1.35;
/// Distance between two lines of labels, px.
pub(super) const LABEL_LINE_PX: f64 = LABEL_PX * LINE_HEIGHT;
/// Empty rim around everything, px.
pub(super) const RIM_PX: f64 = 18.0;
/// Default width of a figure, px.
pub(super) const WIDTH_PX: f64 = 900.0;
/// Least height of a figure, px.
pub(super) const HEIGHT_PX: f64 = 560.0;

/// Red, green and blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Colour(pub u8, pub u8, pub u8);

impl fmt::Display for Colour {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "#{:02x}{:02x}{:02x}", self.0, self.1, self.2)
    }
}

impl Colour {
    /// The colour of a surface whose mark has this one: nearer to white (chosen: by three fifths).
    pub(super) fn tint(self) -> Self {
        self.towards(WHITE)
    }

    /// Text of this colour, for terminals.
    pub fn on_terminal(self, text: &str) -> String {
        format!("\u{1b}[38;2;{};{};{}m{text}\u{1b}[0m", self.0, self.1, self.2)
    }

    /// Nearer to a ground, by three fifths.
    pub(super) fn towards(self, ground: Self) -> Self {
        let nearer = |own: u8, ground: u8| (2 * u16::from(own) + 3 * u16::from(ground)).div_ceil(5) as u8;
        Self(
            nearer(self.0, ground.0),
            nearer(self.1, ground.1),
            nearer(self.2, ground.2),
        )
    }
}

/// The ground.
pub(super) const WHITE: Colour = Colour(255, 255, 255);
/// Text and axes.
pub(super) const INK: Colour = Colour(34, 34, 34);
/// Secondary text and reference lines.
pub(super) const GREY: Colour = Colour(90, 90, 90);
/// Grid lines.
pub(super) const FAINT: Colour = Colour(225, 225, 225);

/// Colours that colour-blind readers can tell apart, the clearest on white first.
///
/// # Source
/// M. Okabe, K. Ito, "Color Universal Design" (2008), their eight colours; only the order is chosen here.
pub(super) const PALETTE: [Colour; 8] = [
    Colour(0, 114, 178),
    Colour(213, 94, 0),
    Colour(0, 158, 115),
    Colour(204, 121, 167),
    Colour(0, 0, 0),
    Colour(230, 159, 0),
    Colour(86, 180, 233),
    Colour(240, 228, 66),
];

/// How a line is broken: lengths of dash and gap, px; `None` is a solid line.
pub(super) type Dash = Option<&'static str>;

/// Dashes by series; their number and the palette's have no common divisor, so a look repeats after 40 series.
pub(super) const DASHES: [Dash; 5] = [None, Some("9 4"), Some("3 3"), Some("16 5"), Some("6 2")];

/// A place, px from the left and from the top.
pub(super) type At = (f64, f64);

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

    /// The horizontal axis: grid, ticks, numbers and label below the plot.
    pub fn horizontal_axis(&self, ticks: &Ticks, label: &[String]) -> Markup {
        html! {
            @for tick in &ticks.ticks {
                @let x = self.x(ticks.share(tick.value));
                (line(&[(x, self.top), (x, self.bottom)], FAINT, 1.0, None))
                @if let Some(number) = &tick.label {
                    (line(&[(x, self.bottom), (x, self.bottom + 5.0)], INK, 1.0, None))
                    (text(number, (x, self.bottom + 16.0), Type::LABEL, Anchor::Middle))
                }
            }
            (line(&[(self.left, self.bottom), (self.right, self.bottom)], INK, 1.25, None))
            (texts(label, (self.x(0.5), self.bottom + 40.0), Type::LABEL, Anchor::Middle))
        }
    }

    /// The vertical axis: grid, ticks, numbers, and the label turned along it, at the left rim.
    pub fn vertical_axis(&self, ticks: &Ticks, label: &[String]) -> Markup {
        html! {
            @for tick in &ticks.ticks {
                @let y = self.y(ticks.share(tick.value));
                (line(&[(self.left, y), (self.right, y)], FAINT, 1.0, None))
                @if let Some(number) = &tick.label {
                    (line(&[(self.left - 5.0, y), (self.left, y)], INK, 1.0, None))
                    (text(number, (self.left - 9.0, y), Type::LABEL, Anchor::Right))
                }
            }
            (line(&[(self.left, self.top), (self.left, self.bottom)], INK, 1.25, None))
            (self.side_label(label))
        }
    }

    /// What is along the vertical axis, turned along it, at the left rim.
    pub fn side_label(&self, label: &[String]) -> Markup {
        let (label_x, middle) = (RIM_PX + LABEL_PX / 2.0, px(self.y(0.5)));
        html! {
            g transform={ "rotate(-90 " (label_x) " " (middle) ")" } {
                (texts(label, (label_x, middle), Type::LABEL, Anchor::Middle))
            }
        }
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
    pub colour: Colour,
}

impl Type {
    /// Labels and numbers.
    pub const LABEL: Self = Self {
        size_px: LABEL_PX,
        bold: false,
        colour: INK,
    };
    /// Titles.
    const TITLE: Self = Self {
        size_px: TITLE_PX,
        bold: true,
        colour: INK,
    };
    /// Notes.
    const NOTE: Self = Self {
        size_px: NOTE_PX,
        bold: false,
        colour: GREY,
    };

    /// An upper estimate of a text's width, px.
    pub fn width(self, text: &str) -> f64 {
        let factor = if self.bold { BOLD_FACTOR } else { 1.0 };
        text.chars().count() as f64 * CHARACTER_WIDTH * factor * self.size_px
    }

    /// The width of the widest text, px.
    pub fn widest<'t>(self, texts: impl IntoIterator<Item = &'t String>) -> f64 {
        texts.into_iter().map(|text| self.width(text)).fold(0.0, f64::max)
    }

    /// Breaks a text into lines of at most `width_px`, between words; a longer word is broken within. A no-break space
    /// (U+00A0) holds a number and its unit together.
    pub fn wrap(self, text: &str, width_px: f64) -> Vec<String> {
        let most = (width_px / self.width("x")).max(1.0) as usize;
        let mut lines: Vec<String> = Vec::new();
        for word in text.split_ascii_whitespace() {
            let word: Vec<char> = word.chars().collect();
            match lines.last_mut() {
                Some(line) if line.chars().count() + 1 + word.len() <= most => {
                    line.push(' ');
                    line.extend(word);
                }
                _ => lines.extend(word.chunks(most).map(|part| part.iter().collect::<String>())),
            }
        }
        lines
    }
}

/// What stands around every figure: the title above it and the note below.
pub(super) struct Frame<'t> {
    title: &'t str,
    title_lines: Vec<String>,
    note_lines: Vec<String>,
}

impl<'t> Frame<'t> {
    /// With texts that are broken into lines as the figure is wide.
    pub fn new(title: &'t str, note: &str) -> Self {
        let inner_px = WIDTH_PX - 2.0 * RIM_PX;
        Self {
            title,
            title_lines: Type::TITLE.wrap(title, inner_px),
            note_lines: Type::NOTE.wrap(note, inner_px),
        }
    }

    /// Where the space below the title begins, px.
    pub fn top(&self) -> f64 {
        RIM_PX + self.title_lines.len() as f64 * TITLE_PX * LINE_HEIGHT + 14.0
    }

    /// What the axis below the plot, its label of so many lines, and the note take, px.
    pub fn below(&self, label_lines: usize) -> f64 {
        40.0 + label_lines as f64 * LABEL_LINE_PX + self.note_height() + RIM_PX
    }

    fn note_height(&self) -> f64 {
        self.note_lines.len() as f64 * NOTE_PX * LINE_HEIGHT
    }

    /// The figure of this height. Who cannot see it hears its title, which is the first element, where readers of the screen
    /// look for a drawing's name.
    pub fn svg(&self, height_px: f64, content: &Markup) -> String {
        let (height, title_y) = (px(height_px), RIM_PX + TITLE_PX * LINE_HEIGHT / 2.0);
        let note_y = height_px - RIM_PX - self.note_height() + NOTE_PX * LINE_HEIGHT / 2.0;
        let svg = html! {
            svg role="img" width=(WIDTH_PX) height=(height) viewBox={ "0 0 " (WIDTH_PX) " " (height) }
                font-family="sans-serif" xmlns="http://www.w3.org/2000/svg" {
                "\n" title { (self.title) } "\n"
                rect width=(WIDTH_PX) height=(height) fill=(WHITE) {}
                (texts(&self.title_lines, (RIM_PX, title_y), Type::TITLE, Anchor::Left))
                (texts(&self.note_lines, (RIM_PX, note_y), Type::NOTE, Anchor::Left))
                (content)
            }
            "\n"
        };
        svg.into_string()
    }
}

/// Hundredths of a pixel are finer than any screen.
fn px(pixels: f64) -> f64 {
    // Saturating: what a share of an axis near the largest number cannot say lies at the rim.
    f64::from((pixels * 100.0).round() as i32) / 100.0
}

fn joined(points: &[At]) -> String {
    let each = points.iter().map(|&(x, y)| format!("{},{}", px(x), px(y)));
    each.collect::<Vec<_>>().join(" ")
}

/// A line through points.
pub(super) fn line(points: &[At], colour: Colour, width_px: f64, dash: Dash) -> Markup {
    html! {
        polyline points=(joined(points)) fill="none" stroke=(colour) stroke-width=(width_px) stroke-dasharray=[dash] {}
        "\n"
    }
}

/// A filled shape.
pub(super) fn polygon(points: &[At], colour: Colour, opacity: Option<f64>) -> Markup {
    html! { polygon points=(joined(points)) fill=(colour) fill-opacity=[opacity] {} "\n" }
}

/// A filled rectangle between two corners.
pub(super) fn rectangle(a: At, b: At, colour: Colour) -> Markup {
    framed(a, b, colour, None)
}

/// The same with a thin line around it, so that it is seen on a ground of its own colour.
pub(super) fn outlined(a: At, b: At, colour: Colour) -> Markup {
    framed(a, b, colour, Some(GREY))
}

fn framed((x0, y0): At, (x1, y1): At, colour: Colour, outline: Option<Colour>) -> Markup {
    let outline_px = outline.map(|_| 0.5);
    html! {
        rect x=(px(x0.min(x1))) y=(px(y0.min(y1))) width=(px((x1 - x0).abs())) height=(px((y1 - y0).abs())) fill=(colour)
            stroke=[outline] stroke-width=[outline_px] {}
        "\n"
    }
}

/// A filled circle.
pub(super) fn disc((x, y): At, radius_px: f64, colour: Colour) -> Markup {
    html! { circle cx=(px(x)) cy=(px(y)) r=(radius_px) fill=(colour) {} "\n" }
}

/// The marker of the `look`-th series.
pub(super) fn marker((x, y): At, look: usize, colour: Colour) -> Markup {
    let shape = |corners: &[At]| {
        let corners: Vec<_> = corners.iter().map(|(dx, dy)| (x + dx, y + dy)).collect();
        polygon(&corners, colour, None)
    };
    match look % 6 {
        0 => disc((x, y), 4.0, colour),
        1 => shape(&[(-3.6, -3.6), (3.6, -3.6), (3.6, 3.6), (-3.6, 3.6)]),
        2 => shape(&[(0.0, -5.0), (4.6, 3.4), (-4.6, 3.4)]),
        3 => shape(&[(0.0, -5.4), (4.4, 0.0), (0.0, 5.4), (-4.4, 0.0)]),
        4 => shape(&[(0.0, 5.0), (4.6, -3.4), (-4.6, -3.4)]),
        _ => html! { (disc((x, y), 4.4, colour)) (disc((x, y), 2.2, WHITE)) },
    }
}

/// A line of text, centred on its point vertically.
pub(super) fn text(text: &str, (x, y): At, face: Type, anchor: Anchor) -> Markup {
    let anchor = match anchor {
        Anchor::Left => None,
        Anchor::Middle => Some("middle"),
        Anchor::Right => Some("end"),
    };
    let weight = face.bold.then_some("bold");
    let y = px(y + HALF_LETTER * face.size_px);
    html! {
        text x=(px(x)) y=(y) text-anchor=[anchor] font-size=(face.size_px) font-weight=[weight] fill=(face.colour) { (text) }
        "\n"
    }
}

/// Lines of text, the first centred on the point vertically.
pub(super) fn texts(lines: &[String], (x, y): At, face: Type, anchor: Anchor) -> Markup {
    html! {
        @for (index, line) in lines.iter().enumerate() {
            (text(line, (x, y + index as f64 * LINE_HEIGHT * face.size_px), face, anchor))
        }
    }
}
