//! The boot loader's state, which embassy-boot keeps in a sector of its own.

use embassy_boot::{BlockingFirmwareState, FirmwareUpdaterError, State};
use embedded_storage::nor_flash::NorFlash;
use firmware::image_store::Exchange;

/// What this flash writes at once.
const WORD: usize = 4;

/// The state's flash, from its first byte on.
#[derive(Debug)]
pub struct BootState<F>(pub F);

impl<F: NorFlash> BootState<F> {
    fn with<T>(
        &mut self,
        act: impl FnOnce(&mut BlockingFirmwareState<'_, &mut F>) -> Result<T, FirmwareUpdaterError>,
    ) -> Option<T> {
        const { assert!(F::WRITE_SIZE == WORD) };
        let mut word = [0; WORD];
        act(&mut BlockingFirmwareState::new(&mut self.0, &mut word)).ok()
    }
}

impl<F: NorFlash> Exchange for BootState<F> {
    fn is_on_trial(&mut self) -> Option<bool> {
        let state = self.with(|state| state.get_state())?;
        Some(state == State::Swap)
    }

    fn exchange_at_next_start(&mut self) -> Option<()> {
        self.with(|state| state.mark_updated())
    }

    fn keep(&mut self) -> Option<()> {
        self.with(|state| state.mark_booted())
    }
}
