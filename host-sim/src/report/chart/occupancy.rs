//! Who used the sub-channels: one row a sub-channel, one square a slot.

use super::axis::Ticks;
use super::canvas::{
    Anchor, Colour, FAINT, Frame, LABEL_LINE_PX, PALETTE, Plot, RIM_PX, Type, WIDTH_PX, line, rectangle, text,
};
use super::{Scale, nothing_to_draw};
use kit::error::Result;
use maud::{Markup, html};

/// Height of a sub-channel's row, and between two groups of rows, px.
const ROW_PX: f64 = 13.0;
const GROUP_GAP_PX: f64 = 10.0;

/// Length of a legend's sample, and between two entries, px.
const SAMPLE_PX: f64 = 13.0;
const ENTRY_GAP_PX: f64 = 22.0;

/// A kind with its name, its colour, and its share of the row's height, so that kinds differ without colour too.
type Drawn = (SlotUse, &'static str, Colour, f64);

/// What became of a sub-channel in a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlotUse {
    /// Nobody sent.
    Idle,
    /// One vehicle sent and was received.
    Received,
    /// Several sent, and the strongest was received.
    Captured,
    /// One sent, and its fade was too deep.
    Faded,
    /// Several sent, and none was received.
    Collided,
}

impl SlotUse {
    /// Of this many transmissions, whether one was received.
    pub const fn of(transmissions: usize, received: bool) -> Self {
        match (transmissions, received) {
            (0, _) => Self::Idle,
            (1, true) => Self::Received,
            (1, false) => Self::Faded,
            (_, true) => Self::Captured,
            (_, false) => Self::Collided,
        }
    }

    /// The kinds that are drawn.
    const DRAWN: [Drawn; 4] = [
        (Self::Received, "received", PALETTE[0], 1.0),
        (
            Self::Captured,
            "several sent, the strongest received",
            PALETTE[6],
            0.75,
        ),
        (Self::Collided, "several sent, all lost", PALETTE[1], 0.5),
        (Self::Faded, "one sent, lost in a fade", PALETTE[4], 0.25),
    ];
}

/// One policy's rows.
#[derive(Clone, Debug)]
pub struct OccupancyGroup {
    /// The policy.
    pub name: String,
    /// `[sub_channel][slot]`.
    pub rows: Vec<Vec<SlotUse>>,
}

/// A figure of sub-channels over slots.
#[derive(Clone, Debug)]
pub struct OccupancyChart {
    /// What the figure shows.
    pub title: String,
    /// What stands behind it; may be empty.
    pub note: String,
    /// The first slot.
    pub first_slot: u32,
    /// From top to bottom.
    pub groups: Vec<OccupancyGroup>,
}

impl OccupancyChart {
    /// The figure as SVG text.
    ///
    /// # Errors
    /// [`Error::Input`](kit::error::Error::Input) names the figure when it has no slot.
    pub fn to_svg(&self) -> Result<String> {
        let rows = self.groups.iter().flat_map(|group| &group.rows);
        let slots = rows.map(Vec::len).max().unwrap_or(0);
        if slots == 0 {
            return Err(nothing_to_draw(&self.title, "slot"));
        }
        let frame = Frame::new(&self.title, &self.note);
        let legend = legend();
        let legend_lines = legend.last().map_or(0.0, |(_, line, _)| line + 1.0);
        let top = frame.top() + legend_lines * LABEL_LINE_PX + 8.0;
        let heights = || {
            self.groups
                .iter()
                .map(|group| group.rows.len() as f64 * ROW_PX + GROUP_GAP_PX)
        };
        let plot = Plot {
            left: RIM_PX + Type::LABEL.widest(self.groups.iter().map(|group| &group.name)) + 14.0,
            top,
            right: WIDTH_PX - RIM_PX,
            bottom: top + heights().sum::<f64>(),
        };
        let first = f64::from(self.first_slot);
        let ticks = Ticks::tight(Scale::Linear, [first, first + slots as f64]);
        let content = html! {
            @for (x, line, (_, name, colour, share)) in &legend {
                @let y = top - 8.0 - (legend_lines - line - 0.5) * LABEL_LINE_PX;
                @let half = share * SAMPLE_PX / 2.0;
                (rectangle((*x, y - half), (x + SAMPLE_PX, y + half), *colour))
                (text(name, (x + SAMPLE_PX + 7.0, y), Type::LABEL, Anchor::Left))
            }
            (plot.horizontal_axis(&ticks, &["slot (ms)".to_owned()]))
            @for (index, group) in self.groups.iter().enumerate() {
                @let above = plot.top + heights().take(index).sum::<f64>();
                @let middle = above + group.rows.len() as f64 * ROW_PX / 2.0;
                (text(&group.name, (plot.left - 10.0, middle), Type::LABEL, Anchor::Right))
                @for (row, uses) in group.rows.iter().enumerate() {
                    (self.draw_row(&plot, &ticks, uses, above + (row as f64 + 1.0) * ROW_PX - 1.0))
                }
            }
        };
        Ok(frame.svg(plot.bottom + frame.below(1), &content))
    }

    fn draw_row(&self, plot: &Plot, ticks: &Ticks, uses: &[SlotUse], floor: f64) -> Markup {
        let x = |index: usize| plot.x(ticks.share(f64::from(self.first_slot) + index as f64));
        html! {
            (line(&[(plot.left, floor), (plot.right, floor)], FAINT, 1.0, None))
            @for (index, slot_use) in uses.iter().enumerate() {
                @if let Some((_, _, colour, share)) = SlotUse::DRAWN.iter().find(|(kind, ..)| kind == slot_use) {
                    (rectangle((x(index), floor - share * (ROW_PX - 2.0)), (x(index + 1) - 0.5, floor), *colour))
                }
            }
        }
    }
}

/// Where each kind's entry stands, from the left in px and in which line.
fn legend() -> Vec<(f64, f64, Drawn)> {
    let (mut x, mut line) = (RIM_PX, 0.0);
    let place = |kind: Drawn| {
        let width = SAMPLE_PX + 7.0 + Type::LABEL.width(kind.1);
        if x > RIM_PX && x + width > WIDTH_PX - RIM_PX {
            (x, line) = (RIM_PX, line + 1.0);
        }
        let entry = (x, line, kind);
        x += width + ENTRY_GAP_PX;
        entry
    };
    SlotUse::DRAWN.map(place).into()
}
