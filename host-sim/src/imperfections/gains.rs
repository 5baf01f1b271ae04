//! Gains as they were some slots ago, with an error.

use crate::lanes::{LANES, LaneStream, Rows, normals};
use crate::scenario::Scenario;
use crate::stream::{Role, WorldKey};

/// What units and base station know of the gains, `[vehicle][sub_channel][world]`.
#[derive(Clone)]
pub(super) struct KnownGains {
    sub_channels: usize,
    /// True gains of the last slots, `[slot modulo the ring's length]`.
    past: Vec<Rows<f32>>,
    /// Whether the first slot has filled them.
    filled: bool,
    /// Where the present slot's go.
    now: usize,
    deviation_db: f32,
    /// Of the errors; by block of worlds.
    streams: Vec<LaneStream>,
    /// Oldest gains of the ring, with errors if there are any.
    known: Option<Rows<f32>>,
    /// Worlds and vehicles whose unit begins in this slot: it has no older gain.
    beginners: Vec<(usize, usize)>,
}

impl KnownGains {
    pub(super) fn new(scenario: &Scenario, keys: &[WorldKey]) -> Option<Self> {
        let knowledge = &scenario.knowledge;
        (knowledge.gain_delay_slots > 0 || knowledge.gain_error_db > 0.0).then(|| Self {
            sub_channels: scenario.radio.sub_channels as usize,
            past: Vec::with_capacity(knowledge.gain_delay_slots as usize + 1),
            filled: false,
            now: knowledge.gain_delay_slots as usize,
            deviation_db: knowledge.gain_error_db as f32,
            streams: LaneStream::rows(keys, Role::GainErrors, 0),
            known: None,
            beginners: Vec::new(),
        })
    }

    pub(super) fn reset(&mut self, keys: &[WorldKey]) {
        LaneStream::reset_rows(&mut self.streams, keys);
        self.now = self.past.capacity() - 1;
        self.filled = false;
        self.beginners.clear();
    }

    pub(super) fn begin_unit(&mut self, world: usize, vehicle: usize) {
        self.beginners.push((world, vehicle));
    }

    pub(super) fn begin_slot(&mut self, gains_db: &Rows<f32>) {
        let ring = self.past.capacity();
        self.now = (self.now + 1) % ring;
        if !std::mem::replace(&mut self.filled, true) {
            // Before the first slot gains were as in it.
            for past in &mut self.past {
                past.clone_from(gains_db);
            }
            self.past.resize_with(ring, || gains_db.clone());
        }
        self.past[self.now]
            .as_flat_mut()
            .copy_from_slice(gains_db.as_flat());
        for (world, vehicle) in self.beginners.drain(..) {
            for item in vehicle * self.sub_channels..(vehicle + 1) * self.sub_channels {
                let first = gains_db.get(world, item);
                self.past.iter_mut().for_each(|past| past.set(world, item, first));
            }
        }
        if self.deviation_db > 0.0 {
            self.measure();
        }
    }

    /// Adds errors to the oldest gains.
    fn measure(&mut self) {
        let oldest = &self.past[(self.now + 1) % self.past.len()];
        let known = self.known.get_or_insert_with(|| oldest.clone());
        let items = oldest.as_flat().len() / (LANES * oldest.blocks().max(1));
        for (block, stream) in self.streams.iter_mut().enumerate() {
            for first in (0..items).step_by(2) {
                let words = (*stream.next_row(), *stream.next_row());
                let errors = normals(&words.0, &words.1);
                for (item, errors) in (first..items).zip(errors) {
                    let (oldest, known) = (oldest.row(block, item), known.row_mut(block, item));
                    for lane in 0..LANES {
                        known[lane] = oldest[lane] + self.deviation_db * errors[lane];
                    }
                }
            }
        }
    }

    pub(super) fn gains_db(&self) -> &Rows<f32> {
        self.known
            .as_ref()
            .unwrap_or_else(|| &self.past[(self.now + 1) % self.past.len()])
    }
}
