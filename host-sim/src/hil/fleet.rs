//! The slots of a cell whose first vehicles are emulated images, each shadowed by the library's unit.

use super::emulator::{Emulator, Setup};
use crate::age::{AgeCounter, AgeSummary};
use crate::decisions::Decisions;
use crate::environment::Environment;
use crate::image::Image;
use crate::mobility::Grid;
use crate::scenario::Scenario;
use crate::stream::Purpose;
use firmware::decision::Decision;
use firmware::link::{ModemFrame, UnitFrame, UnitMessage, encode};
use firmware::lots::Identity;
use firmware::slot_clock::SlotLength;
use firmware::tables::DISTILLED;
use firmware::unit::{Event, Unit};
use kit::error::{Error, Result};
use std::time::Duration;

/// An instruction takes 16 ns of virtual time, 2.7 cycles at 168 MHz. Modelled at zero wait states the decision path takes
/// 1.6 cycles an instruction, so a deadline that is met here has room for wait states.
pub const INSTRUCTION_SHIFT: u8 = 4;

/// TIM2 of the emulated machine counts nanoseconds.
const TIMER_STEPS_PER_INSTRUCTION: u32 = 1 << INSTRUCTION_SHIFT;

/// For one answer (chosen). An answer takes well under a millisecond; the machine may be loaded.
pub const ANSWER_LIMIT: Duration = Duration::from_secs(30);

/// How often an image is asked for its last answer's count, and how long apart (chosen).
const COUNT_TRIES: u32 = 100;
const COUNT_PAUSE: Duration = Duration::from_millis(5);

/// What is run.
#[derive(Clone, Debug)]
pub struct Fleet<'a> {
    /// The cell.
    pub scenario: &'a Scenario,
    /// The image.
    pub image: &'a Image,
    /// How many vehicles are emulated, from the first.
    pub units: u32,
    /// How many slots.
    pub slots: u32,
    /// The world's seed.
    pub seed: u64,
    /// First port of the units' serial lines; free ones without it.
    pub port: Option<u16>,
    /// How long a unit may take for an answer before its emulator counts as stopped.
    pub answer_limit: Duration,
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct FleetResult {
    /// Decisions of the images that are not the library's.
    pub mismatches: u64,
    /// Answers that took longer than the slot leaves, by the images' own timers.
    pub deadline_misses: u64,
    /// Answers of the images.
    pub answers: u64,
    /// Fewest instructions from a frame's last byte to its queued answer.
    pub min_instructions: u32,
    /// Most.
    pub max_instructions: u32,
    /// Ages of all vehicles.
    pub ages: AgeSummary,
}

/// A vehicle's emulated image and its shadow.
struct Pair {
    image: Emulator,
    shadow: Unit<'static>,
}

impl Fleet<'_> {
    /// Boots the images and runs the slots.
    ///
    /// # Errors
    /// As [`Emulator::boot`], and if an image ends before its time or does not answer.
    pub fn run(&self, mut each_slot: impl FnMut()) -> Result<FleetResult> {
        let slot_cost = self
            .image
            .address("SLOT_COST", "an image that counts what its answers cost")?;
        let source = Grid;
        let mut cell = Environment::new(self.scenario, &source, self.seed, Purpose::Evaluation, 0..1);
        let mut pairs = (0..self.units)
            .map(|unit| self.boot(unit, cell.identity(0, unit as usize)))
            .collect::<Result<Vec<_>>>()?;
        let mut others: Vec<Unit<'static>> = (0..cell.vehicles())
            .map(|vehicle| Unit::new(DISTILLED, cell.identity(0, vehicle)))
            .collect();
        let mut ages = AgeCounter::new(0, 1, cell.vehicles());
        let mut mismatches = 0;
        let mut decisions = Decisions::new(1, cell.vehicles());
        for slot in 0..self.slots {
            decisions.clear();
            let events: Vec<(usize, Event)> = cell
                .present()
                .iter()
                .map(|&vehicle| {
                    let measurement = cell.measurement(0, vehicle);
                    (
                        vehicle,
                        measurement.map_or(Event::Missed(cell.slot()), Event::Measured),
                    )
                })
                .collect();
            // All frames first: the emulators work side by side.
            for (vehicle, event) in &events {
                match pairs.get_mut(*vehicle) {
                    Some(pair) => pair.image.send(&frame(event)?)?,
                    None => {
                        let report = others[*vehicle].slot(event);
                        let decision = report.map_or(Decision::Silent, |report| report.decision);
                        decisions.set(0, *vehicle, decision);
                    }
                }
            }
            for (vehicle, event) in &events {
                let Some(pair) = pairs.get_mut(*vehicle) else {
                    continue;
                };
                let expected = pair.shadow.slot(event).map(|report| UnitFrame::from(&report));
                let message = pair.image.receive(self.answer_limit)?;
                let message = message.ok_or_else(|| self.silent(*vehicle, slot))?;
                let answer = match message {
                    UnitMessage::Decision(answer) => Some(answer),
                    _ => None,
                };
                mismatches += u64::from(answer != expected);
                let decision = answer.and_then(|answer| answer.decision());
                decisions.set(0, *vehicle, decision.unwrap_or(Decision::Silent));
            }
            cell.step(&decisions);
            ages.record(slot, &cell);
            each_slot();
        }
        let ages = AgeSummary::new(&ages.worlds())
            .ok_or_else(|| Error::input("slots", self.slots, "at least one"))?;
        let mut result = FleetResult {
            mismatches,
            deadline_misses: 0,
            answers: 0,
            min_instructions: u32::MAX,
            max_instructions: 0,
            ages,
        };
        for pair in &mut pairs {
            self.add_cost(&mut pair.image, slot_cost, &mut result)?;
        }
        Ok(result)
    }

    fn silent(&self, unit: usize, slot: u32) -> Error {
        let found = format!(
            "no answer to slot {slot} in {} s",
            self.answer_limit.as_secs_f64()
        );
        Error::input(
            format!("unit {unit}"),
            found,
            "one within a slot; its emulator may be stopped",
        )
    }

    fn boot(&self, unit: u32, identity: Identity) -> Result<Pair> {
        let port = self.port.map(|port| u32::from(port) + unit);
        let port = port
            .map(|port| u16::try_from(port).map_err(|_| Error::input("--port", port, "ports up to 65535")))
            .transpose()?;
        let mut image = Emulator::boot(&Setup {
            name: format!("unit {unit}"),
            elf: self.image.path().to_owned(),
            instruction_shift: Some(INSTRUCTION_SHIFT),
            loaded: Vec::new(),
            port,
        })?;
        // The simulation is this unit's modem, and steps as slowly as the machine lets it.
        image.send(&encoded(&ModemFrame::SlotLength {
            microseconds: SlotLength::MAX_MICROSECONDS,
        })?)?;
        let Identity(number) = identity;
        image.send(&encoded(&ModemFrame::Identity { number })?)?;
        Ok(Pair {
            image,
            shadow: Unit::new(DISTILLED, identity),
        })
    }

    /// What an image has counted so far.
    fn slot_cost(image: &mut Emulator, address: u64) -> Result<[u32; 4]> {
        let bytes = image.memory(address, 16)?;
        match bytes.as_chunks::<4>().0 {
            [answers, minimum, maximum, misses] => {
                Ok([answers, minimum, maximum, misses].map(|word| u32::from_le_bytes(*word)))
            }
            _ => Err(Error::input("SLOT_COST", bytes.len(), "16 bytes")),
        }
    }

    /// Adds what an image has counted: answers, fewest and most timer steps, missed deadlines.
    fn add_cost(&self, image: &mut Emulator, address: u64, result: &mut FleetResult) -> Result<()> {
        let mut words = Self::slot_cost(image, address)?;
        for _ in 0..COUNT_TRIES {
            // An image counts an answer after it has sent it.
            if words[0] >= self.slots {
                break;
            }
            std::thread::sleep(COUNT_PAUSE);
            words = Self::slot_cost(image, address)?;
        }
        let [answers, minimum, maximum, misses] = &words;
        result.answers += u64::from(*answers);
        result.deadline_misses += u64::from(*misses);
        result.min_instructions = result.min_instructions.min(minimum / TIMER_STEPS_PER_INSTRUCTION);
        result.max_instructions = result.max_instructions.max(maximum / TIMER_STEPS_PER_INSTRUCTION);
        Ok(())
    }
}

fn frame(event: &Event) -> Result<Vec<u8>> {
    encoded(&match event {
        Event::Measured(measurement) => ModemFrame::Measurement(measurement.into()),
        Event::Missed(slot) => ModemFrame::Missed { slot: slot.0 },
    })
}

fn encoded(frame: &ModemFrame) -> Result<Vec<u8>> {
    let bytes = encode(frame).map_err(|error| Error::input("frame", error, "a frame that fits"))?;
    Ok(bytes.to_vec())
}
