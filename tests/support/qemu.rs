//! An emulated unit for tests: what goes wrong with the emulator is a failed test.

use crate::image::{STACK, STACK_LENGTH};
use firmware::link::{ModemFrame, StatusFrame, UnitFrame, UnitMessage, UpdateAnswer, encode};
use firmware::slot_clock::SlotLength;
use host_sim::hil::emulator::{Emulator, Setup};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Most stack: the region that `memory.x` gives it, less a reserve for interrupts that came at no bad moment in a test.
const STACK_BUDGET: usize = STACK_LENGTH - 1536;

/// A running image. Dropping it ends the emulator.
#[derive(Debug)]
pub struct Qemu(Emulator);

impl Qemu {
    /// Boots an image whose slot clock waits for the test: a slot is a minute, so that a loaded machine decides nothing.
    ///
    /// # Panics
    /// If QEMU is missing or does not start: a check that cannot run has failed.
    pub fn boot(elf: &Path) -> Self {
        Self::boot_with(elf, Vec::new())
    }

    /// The same with files in memory.
    ///
    /// # Panics
    /// As [`Qemu::boot`].
    pub fn boot_with(elf: &Path, loaded: Vec<(u32, PathBuf)>) -> Self {
        let mut qemu = Self::boot_on_time(elf, loaded);
        qemu.set_slot_microseconds(SlotLength::MAX_MICROSECONDS);
        qemu
    }

    /// An image whose slots are 1 ms of the machine's time.
    ///
    /// # Panics
    /// As [`Qemu::boot`].
    pub fn boot_on_time(elf: &Path, loaded: Vec<(u32, PathBuf)>) -> Self {
        let setup = Setup {
            name: "unit under test".to_owned(),
            elf: elf.to_owned(),
            loaded,
            ..Setup::default()
        };
        Self(Emulator::boot(&setup).unwrap_or_else(|error| panic!("{error}")))
    }

    /// Sets how long a slot is.
    pub fn set_slot_microseconds(&mut self, microseconds: u32) {
        let frame = encode(&ModemFrame::SlotLength { microseconds }).unwrap();
        self.send(&frame);
    }

    /// Sends bytes to the unit.
    ///
    /// # Panics
    /// If the emulator is gone.
    pub fn send(&mut self, bytes: &[u8]) {
        self.0.send(bytes).unwrap_or_else(|error| panic!("{error}"));
    }

    /// The unit's next decision, or `None` if none arrives in time.
    ///
    /// # Panics
    /// If the emulator is gone, or if what arrives is no decision.
    pub fn receive(&mut self, limit: Duration) -> Option<UnitFrame> {
        match self.message(limit)? {
            UnitMessage::Decision(frame) => Some(frame),
            other => panic!("expected a decision, found {other:?}"),
        }
    }

    /// The unit's next answer to a step of an update, with the decisions that came before it.
    ///
    /// # Panics
    /// If the emulator is gone, or if none arrives in time.
    pub fn receive_update(&mut self, limit: Duration) -> (UpdateAnswer, Vec<UnitFrame>) {
        let mut decisions = Vec::new();
        loop {
            match self.message(limit) {
                None => panic!("no answer to an update"),
                Some(UnitMessage::Decision(frame)) => decisions.push(frame),
                Some(UnitMessage::Update(answer)) => return (answer, decisions),
                Some(other) => panic!("expected an answer to an update, found {other:?}"),
            }
        }
    }

    /// How the unit says it is.
    ///
    /// # Panics
    /// If the emulator is gone, or if it does not say.
    pub fn status(&mut self, limit: Duration) -> StatusFrame {
        self.send(&encode(&ModemFrame::Status).unwrap());
        match self.message(limit) {
            Some(UnitMessage::Status(status)) => status,
            other => panic!("expected a status, found {other:?}"),
        }
    }

    fn message(&mut self, limit: Duration) -> Option<UnitMessage> {
        self.0.receive(limit).unwrap_or_else(|error| panic!("{error}"))
    }

    /// A stretch of the emulated memory, as it is now.
    ///
    /// # Panics
    /// If the emulator does not answer.
    pub fn memory(&mut self, address: u64, length: usize) -> Vec<u8> {
        let bytes = self
            .0
            .memory(address, length)
            .unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(bytes.len(), length, "the emulator saved too little");
        bytes
    }

    /// RAM is zero when the emulator starts, so the lowest word of the stack that is not tells how far it went.
    ///
    /// # Panics
    /// If it went into the reserve.
    pub fn assert_stack_is_within_budget(&mut self) {
        let memory = self.memory(STACK, STACK_LENGTH);
        let stack = memory.len() - memory.iter().position(|&byte| byte != 0).unwrap_or(memory.len());
        println!("stack {stack} bytes at most of {STACK_LENGTH}");
        assert!(
            stack > 0 && stack <= STACK_BUDGET,
            "{stack} bytes of stack, budget {STACK_BUDGET}"
        );
    }
}
