//! The running table, read again and again.

use super::{SlotFlash, TableStore};
use crate::table::CHECKSUM;
use crc::{Digest, Table};

/// Bytes that one call reads (chosen): the longest table then takes 84 calls, one of 3 KB 16. With a call a slot of 1 ms damage is found
/// within twice as many: it may lie just behind the reading's place.
pub const PIECE: usize = 192;

/// How far the present reading has come.
#[derive(Clone)]
pub struct Check {
    at: usize,
    digest: Digest<'static, u32, Table<1>>,
}

impl Check {
    /// From the first byte on.
    pub const fn new() -> Self {
        Self {
            at: 0,
            digest: CHECKSUM.digest(),
        }
    }

    /// Takes in the next piece. `Some` at the end: whether the checksum fits.
    fn step(&mut self, table: &[u8]) -> Option<bool> {
        let (body, checksum) = match table.split_last_chunk::<4>() {
            Some((body, checksum)) => (body, u32::from_le_bytes(*checksum)),
            None => return Some(false),
        };
        let rest = body.get(self.at..).unwrap_or(&[]);
        self.digest.update(rest.get(..PIECE).unwrap_or(rest));
        self.at = self.at.saturating_add(PIECE);
        (self.at >= body.len()).then(|| {
            let check = core::mem::replace(self, Self::new());
            check.digest.finalize() == checksum
        })
    }
}

impl core::fmt::Debug for Check {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter
            .debug_struct("Check")
            .field("at", &self.at)
            .finish_non_exhaustive()
    }
}

impl<F: SlotFlash> TableStore<F> {
    /// Reads the next 192 bytes of the running table; a board calls it about once a slot, below all decisions. Says whether the table
    /// turned out to be damaged, so that another runs from now on ([`TableStore::running`]).
    #[inline(never)]
    pub fn check_running(&mut self) -> bool {
        let mut check = core::mem::replace(&mut self.check, Check::new());
        let outcome = check.step(self.running_bytes());
        self.check = check;
        let damaged = outcome == Some(false);
        if damaged {
            self.drop_running();
        }
        damaged
    }

    /// Gives the running table up until the next start. The built-in one cannot be given up: without any other it stays, and the unit
    /// that checks it stays silent.
    pub fn drop_running(&mut self) {
        crate::fmt::log_warning!("the running table is damaged");
        if let Some(stored) = self.running() {
            self.drop_slot(stored.slot);
        }
    }
}
