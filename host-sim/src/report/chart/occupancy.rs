//! Who used the sub-channels: one row a sub-channel, one square a slot.

use super::Axis;
use super::axis::Ticks;
use super::canvas::{
    Anchor, Canvas, FAINT, LABEL_PX, LINE_HEIGHT, NOTE_PX, PALETTE, Plot, RIM_PX, TITLE_PX, Type, WIDTH_PX,
    draw_svg,
};
use kit::error::{Error, Result};
use plotters::style::RGBColor;

/// Height of a sub-channel's row, and between two groups of rows, px.
const ROW_PX: f64 = 13.0;
const GROUP_GAP_PX: f64 = 10.0;

/// Length of a legend's sample, and between two entries, px.
const SAMPLE_PX: f64 = 13.0;
const ENTRY_GAP_PX: f64 = 22.0;

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

    /// The kinds that are drawn: name, colour, and share of the row's height, so that they differ without colour too.
    const DRAWN: [(Self, &'static str, RGBColor, f64); 4] = [
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
    /// [`Error::Input`] names the figure when it has no slot.
    pub fn to_svg(&self) -> Result<String> {
        let slots = self
            .groups
            .iter()
            .flat_map(|group| &group.rows)
            .map(Vec::len)
            .max();
        let Some(slots) = slots.filter(|&slots| slots > 0) else {
            return Err(Error::input(
                format!("figure '{}'", self.title),
                "no slot",
                "at least one",
            ));
        };
        let inner = WIDTH_PX - 2.0 * RIM_PX;
        let (title, note) = (
            Type::TITLE.wrap(&self.title, inner),
            Type::NOTE.wrap(&self.note, inner),
        );
        let names = self.groups.iter().map(|group| Type::LABEL.width(&group.name));
        let legend = self.legend();
        let legend_lines = legend.last().map_or(0.0, |(_, line, _)| line + 1.0);
        let top = RIM_PX
            + title.len() as f64 * TITLE_PX * LINE_HEIGHT
            + 14.0
            + legend_lines * LABEL_PX * LINE_HEIGHT
            + 8.0;
        let rows: f64 = self.groups.iter().map(group_height).sum();
        let label = [Axis::linear("slot (ms)").label];
        let height =
            top + rows + 40.0 + LABEL_PX * LINE_HEIGHT + note.len() as f64 * NOTE_PX * LINE_HEIGHT + RIM_PX;
        let plot = Plot {
            left: RIM_PX + names.fold(0.0, f64::max) + 14.0,
            top,
            right: WIDTH_PX - RIM_PX,
            bottom: top + rows,
        };
        let first = f64::from(self.first_slot);
        let ticks = Ticks::tight(super::Scale::Linear, [first, first + slots as f64]);
        draw_svg(&self.title, (WIDTH_PX, height), |canvas| {
            canvas.title_and_note(&title, &note, height)?;
            for (x, line, kind) in &legend {
                let (_, name, colour, share) = SlotUse::DRAWN[*kind];
                let y = top - 8.0 - (legend_lines - line - 0.5) * LABEL_PX * LINE_HEIGHT;
                let half = share * SAMPLE_PX / 2.0;
                canvas.rectangle((*x, y - half), (x + SAMPLE_PX, y + half), colour)?;
                canvas.text(name, (x + SAMPLE_PX + 7.0, y), Type::LABEL, Anchor::Left)?;
            }
            canvas.horizontal_axis(&plot, &ticks, &label)?;
            let mut y = plot.top;
            for group in &self.groups {
                let middle = y + group.rows.len() as f64 * ROW_PX / 2.0;
                canvas.text(
                    &group.name,
                    (plot.left - 10.0, middle),
                    Type::LABEL,
                    Anchor::Right,
                )?;
                for row in &group.rows {
                    self.draw_row(canvas, &plot, &ticks, (row, y))?;
                    y += ROW_PX;
                }
                y += GROUP_GAP_PX;
            }
            Ok(())
        })
    }

    fn draw_row(
        &self,
        canvas: &Canvas<'_>,
        plot: &Plot,
        ticks: &Ticks,
        (row, y): (&[SlotUse], f64),
    ) -> Result<()> {
        let floor = y + ROW_PX - 1.0;
        canvas.path(&[(plot.left, floor), (plot.right, floor)], FAINT, 1.0, None)?;
        for (index, slot_use) in row.iter().enumerate() {
            let drawn = SlotUse::DRAWN.iter().find(|(kind, ..)| kind == slot_use);
            if let Some((_, _, colour, share)) = drawn {
                let slot = f64::from(self.first_slot) + index as f64;
                let (left, right) = (plot.x(ticks.share(slot)), plot.x(ticks.share(slot + 1.0)));
                canvas.rectangle(
                    (left, floor - share * (ROW_PX - 2.0)),
                    (right - 0.5, floor),
                    *colour,
                )?;
            }
        }
        Ok(())
    }

    /// Where each kind's entry stands: from the left in px, in which line, and which kind.
    fn legend(&self) -> Vec<(f64, f64, usize)> {
        let (mut x, mut line) = (RIM_PX, 0.0);
        let mut entries = Vec::new();
        for (kind, (_, name, ..)) in SlotUse::DRAWN.iter().enumerate() {
            let width = SAMPLE_PX + 7.0 + Type::LABEL.width(name);
            if x > RIM_PX && x + width > WIDTH_PX - RIM_PX {
                (x, line) = (RIM_PX, line + 1.0);
            }
            entries.push((x, line, kind));
            x += width + ENTRY_GAP_PX;
        }
        entries
    }
}

fn group_height(group: &OccupancyGroup) -> f64 {
    group.rows.len() as f64 * ROW_PX + GROUP_GAP_PX
}
