//! Counts instructions: of one inference, and of each stage of a slot. For QEMU alone, never for a chip.
//!
//! The emulator is run with one instruction per nanosecond of its clock (`-icount shift=0`), and its TIM2 counts
//! nanoseconds: the difference of two readings is the number of instructions between them, exactly and repeatably. The job
//! stands in flash at [`JOB`], where the emulator's loader puts it; the results are lines of text over semihosting.
//!
//! # Job
//! Little-endian words: [`MAGIC`], seed, number of slots, sub-channels in them, length of the table that decides in them, the table, zeros to a
//! word, number of networks, then for each network: inputs to compute, number of widths, five widths, length of its bytes,
//! bytes to skip (0 to 3: the next ones are then not aligned to a word), its bytes, zeros to a word.
//!
//! # Results
//! * `network INDEX kernel MIN MAX portable MIN MAX mismatches N digest CRC`
//! * `stage NAME MIN MAX SUM`
//! * `done`
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    println!(
        "This program measures inside QEMU: `cargo run --release -- deadline` builds it for the target and runs it."
    );
}

#[cfg(target_os = "none")]
mod target {
    use core::fmt::Write as _;
    use core::hint::black_box;
    use cortex_m::asm::wfi;
    use firmware::actor::Actor;
    use firmware::decision::{Decision, PowerPlan};
    use firmware::form::{MAX_INPUTS, ObservationForm, OutputForm};
    use firmware::link::{
        Frame, MAX_FRAME, ModemFrame, Receiver, UnitFrame, UnitMessage, encode, encode_into, measurement,
    };
    use firmware::lots::Identity;
    use firmware::measurement::{Broadcast, Measurement, MeasurementError, Place, Readings};
    use firmware::network::{MAX_OUTPUTS, Network, Scratch};
    use firmware::observation::Observation;
    use firmware::ring::{MAX_PLACES, Open, Ring};
    use firmware::table::{CHECKSUM, Table};
    use firmware::unit::{Event, Report, Unit};
    use firmware::units::{Dbm, Level, MAX_SUB_CHANNELS, SlotIndex, SubChannels, Weight};
    use heapless::{String, Vec};
    use rand_core::Rng;
    use rand_pcg::Pcg32;

    /// Where the loader puts the job: in flash, far behind the program.
    const JOB: *const u32 = 0x0804_0000 as *const u32;
    /// First word of a job, `FLMJ`.
    const MAGIC: u32 = u32::from_le_bytes(*b"FLMJ");

    /// Interrupts are off, and nothing else runs: a counter between two points counts what is between them.
    mod counter {
        use stm32f4::stm32f405::{Peripherals, TIM2};

        pub struct Counter(TIM2);

        impl Counter {
            pub fn start() -> Option<Self> {
                let peripherals = Peripherals::take()?;
                peripherals.RCC.apb1enr().modify(|_, w| w.tim2en().set_bit());
                peripherals.TIM2.cr1().write(|w| w.cen().set_bit());
                Some(Self(peripherals.TIM2))
            }

            /// Instructions that `work` takes, and its result. The load that ends the measurement is none of them.
            #[inline(always)]
            pub fn count<T>(&self, work: impl FnOnce() -> T) -> (T, u32) {
                let start = self.0.cnt().read().bits();
                let result = core::hint::black_box(work());
                let end = self.0.cnt().read().bits();
                (result, end.wrapping_sub(start).wrapping_sub(1))
            }
        }
    }
    use counter::Counter;

    /// Least, greatest and sum of many counts.
    #[derive(Clone, Copy)]
    struct Counts {
        least: u32,
        greatest: u32,
        sum: u64,
    }

    impl Counts {
        const NONE: Self = Self {
            least: u32::MAX,
            greatest: 0,
            sum: 0,
        };

        fn add(&mut self, count: u32) {
            self.least = self.least.min(count);
            self.greatest = self.greatest.max(count);
            self.sum += u64::from(count);
        }
    }

    mod semihosting {
        use core::arch::asm;

        /// One request to the emulator (Arm, "Semihosting for AArch32 and AArch64", section 3).
        fn call(operation: u32, argument: usize) {
            // SAFETY: the emulator reads the argument and writes nothing but the result register.
            #[allow(unsafe_code, reason = "a breakpoint that the emulator serves")]
            unsafe {
                asm!("bkpt 0xab", inout("r0") operation => _, in("r1") argument, options(nostack));
            }
        }

        /// Writes text that ends in a zero byte.
        pub fn write(text: &[u8]) {
            if text.last() == Some(&0) {
                call(0x04, text.as_ptr() as usize);
            }
        }

        /// Ends the emulator: exit code 0, or 1 for a failure.
        pub fn exit(success: bool) {
            call(0x18, if success { 0x2_0026 } else { 0x2_0023 });
        }
    }

    fn say(arguments: core::fmt::Arguments<'_>) {
        let mut line = String::<192>::new();
        let _ = writeln!(line, "{arguments}");
        let mut bytes = line.into_bytes();
        if bytes.push(0).is_ok() {
            semihosting::write(&bytes);
        }
    }

    #[panic_handler]
    fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
        say(format_args!("failed: {info}"));
        semihosting::exit(false);
        loop {
            wfi();
        }
    }

    #[cortex_m_rt::entry]
    fn main() -> ! {
        let success = run();
        if success.is_none() {
            say(format_args!("failed: no job, or one that does not fit"));
        }
        semihosting::exit(success.is_some());
        loop {
            wfi();
        }
    }

    /// The job's words and bytes, in order.
    struct Job(&'static [u8]);

    impl Job {
        fn find() -> Option<Self> {
            const LENGTH: usize = 0x000c_0000;
            // SAFETY: the rest of the flash, constant memory that always exists.
            #[allow(unsafe_code, reason = "the loader puts the job at a fixed address")]
            let mut job = Self(unsafe { core::slice::from_raw_parts(black_box(JOB).cast(), LENGTH) });
            (job.word()? == MAGIC).then_some(job)
        }

        fn word(&mut self) -> Option<u32> {
            let (word, rest) = self.0.split_first_chunk()?;
            self.0 = rest;
            Some(u32::from_le_bytes(*word))
        }

        fn bytes(&mut self, length: usize) -> Option<&'static [u8]> {
            let (bytes, rest) = self.0.split_at_checked(length)?;
            self.0 = rest;
            Some(bytes)
        }
    }

    fn run() -> Option<()> {
        let counter = Counter::start()?;
        let mut job = Job::find()?;
        let seed = job.word()?;
        let slots = job.word()?;
        let sub_channels = SubChannels::new(job.word()? as usize)?;
        let length = job.word()? as usize;
        let table = job.bytes(length)?;
        let _ = job.bytes(length.next_multiple_of(4) - length)?;
        // Static, since the stack is short.
        let scratches = cortex_m::singleton!(: [Scratch; 2] = [const { Scratch::new() }; 2])?;
        for index in 0..job.word()? {
            let inputs = job.word()?;
            let width_count = job.word()? as usize;
            let mut widths = [0; 5];
            for width in &mut widths {
                *width = job.word()? as usize;
            }
            let length = job.word()? as usize;
            let skipped = job.word()? as usize;
            let _ = job.bytes(skipped)?;
            let bytes = job.bytes(length)?;
            let _ = job.bytes((skipped + length).next_multiple_of(4) - skipped - length)?;
            let network = match Network::parse(widths.get(..width_count)?, bytes) {
                Ok(network) => network,
                Err(error) => {
                    say(format_args!("failed: network {index}: {error}"));
                    return None;
                }
            };
            let rng = Pcg32::new(u64::from(seed), u64::from(index));
            measure_network(&counter, index, &network, inputs, rng, scratches)?;
        }
        if slots > 0 {
            let rng = Pcg32::new(u64::from(seed), 1 << 32);
            measure_slots(&counter, table, rng, slots, sub_channels)?;
        }
        say(format_args!("done"));
        Some(())
    }

    #[inline(never)]
    fn infer(network: &Network<'_>, scratch: &mut Scratch, input: &[i8]) -> [i32; MAX_OUTPUTS] {
        network.infer(scratch, input)
    }

    #[inline(never)]
    fn infer_portably(network: &Network<'_>, scratch: &mut Scratch, input: &[i8]) -> [i32; MAX_OUTPUTS] {
        network.infer_portably(scratch, input)
    }

    /// Inputs of the widest network in a job.
    const MOST_INPUTS: usize = 65;

    /// Extremes now and then, else any values.
    fn random_input(rng: &mut Pcg32, index: u32, input: &mut [i8]) {
        input.fill_with(|| {
            let random = rng.next_u32().to_le_bytes()[3].cast_signed();
            match index % 16 {
                0 => i8::MIN,
                1 => i8::MAX,
                2 => 0,
                3 if random < 0 => i8::MIN,
                3 => i8::MAX,
                _ => random,
            }
        });
    }

    fn measure_network(
        counter: &Counter,
        index: u32,
        network: &Network<'_>,
        inputs: u32,
        mut rng: Pcg32,
        [scratch, other_scratch]: &mut [Scratch; 2],
    ) -> Option<()> {
        let (mut kernel, mut portable) = (Counts::NONE, Counts::NONE);
        let (mut mismatches, mut digest) = (0_u32, CHECKSUM.digest());
        let mut input = [0; MOST_INPUTS];
        let input = input.get_mut(..network.layers().next()?.geometry().inputs)?;
        for index in 0..inputs {
            random_input(&mut rng, index, input);
            let input = &*input;
            let (outputs, count) = counter.count(|| infer(black_box(network), scratch, black_box(input)));
            kernel.add(count);
            let (expected, count) =
                counter.count(|| infer_portably(black_box(network), other_scratch, black_box(input)));
            portable.add(count);
            mismatches += u32::from(outputs != expected);
            for output in outputs {
                digest.update(&output.to_le_bytes());
            }
        }
        say(format_args!(
            "network {index} kernel {} {} portable {} {} mismatches {mismatches} digest {:08x}",
            kernel.least,
            kernel.greatest,
            portable.least,
            portable.greatest,
            digest.finalize()
        ));
        Some(())
    }

    #[inline(never)]
    fn frame_in<'r>(receiver: &'r mut Receiver, mut bytes: &[u8]) -> Option<&'r [u8]> {
        // At once, as a session takes what the line brought.
        receiver.take(&mut bytes)?.ok()
    }

    #[inline(never)]
    fn validate(fields: &[u8]) -> Option<Result<Event, MeasurementError>> {
        match measurement(fields) {
            Some(measurement) => Some(measurement.map(Event::Measured)),
            None => match ModemFrame::read(fields)? {
                ModemFrame::Missed { slot } => Some(Ok(Event::Missed(SlotIndex(slot)))),
                _ => None,
            },
        }
    }

    #[inline(never)]
    fn slot(unit: &mut Unit<'static>, event: &Event) -> Option<Report> {
        unit.slot(event)
    }

    /// What the slot's task does when another table is to run.
    #[inline(never)]
    fn activate(unit: &mut Unit<'static>, table: &Table<'static>) {
        unit.run_table(Ok(table.clone()));
    }

    #[inline(never)]
    fn observe(form: ObservationForm, measurement: &Measurement, required_sinr: Level) -> Observation {
        let observation = Observation::new(measurement, Identity(0));
        form.encode(&observation, required_sinr, |input| {
            let _ = black_box(input);
        });
        observation
    }

    #[inline(never)]
    fn actor_infer(actor: &mut Actor<'static>, input: &[i8]) -> [i32; MAX_OUTPUTS] {
        actor.infer(input)
    }

    #[inline(never)]
    fn decide(
        form: OutputForm,
        outputs: &[i32; MAX_OUTPUTS],
        observation: &Observation,
        plan: &PowerPlan,
    ) -> Decision {
        form.decision(outputs, observation, plan)
    }

    #[inline(never)]
    fn frame_out(report: &Report, room: &mut [u8; MAX_FRAME]) -> Option<usize> {
        encode_into(&UnitMessage::Decision(UnitFrame::from(report)), room).ok()
    }

    // Each is built on the stack before it moves to its place, so not both in one function.
    #[inline(never)]
    fn new_unit(table: &'static [u8]) -> Option<&'static mut Unit<'static>> {
        let unit = cortex_m::singleton!(: Unit<'static> = Unit::without_table(Identity(0)))?;
        unit.replace_table(table);
        Some(unit)
    }

    #[inline(never)]
    fn new_actor(table: &'static [u8]) -> Option<&'static mut Actor<'static>> {
        cortex_m::singleton!(: Actor<'static> = Actor::new(Table::parse(table).ok()?))
    }

    #[inline(never)]
    fn measure_slots(
        counter: &Counter,
        table: &'static [u8],
        mut rng: Pcg32,
        slots: u32,
        sub_channels: SubChannels,
    ) -> Option<()> {
        let (unit, actor) = (new_unit(table)?, new_actor(table)?);
        let (observation_form, output_form) =
            black_box((actor.table().observation_form(), actor.table().output_form()));
        let (required_sinr, plan) = (actor.table().required_sinr(), *actor.table().power_plan());
        let (mut receiver, mut room) = (Receiver::new(), [0; MAX_FRAME]);
        let mut total = Counts::NONE;
        let mut stages = [Counts::NONE; 9];
        let mut index = u32::MAX - 1000;
        let mut measured = false;
        for _ in 0..slots {
            // Now and then a modem leaves slots out, or cannot measure.
            let gap = if below(&mut rng, 64) == 0 {
                below(&mut rng, 150)
            } else {
                0
            };
            index = index.wrapping_add(1).wrapping_add(gap);
            let missed = below(&mut rng, 16) == 0;
            let frame = if missed {
                ModemFrame::Missed { slot: index }
            } else {
                ModemFrame::Measurement((&random_measurement(&mut rng, index, sub_channels)?).into())
            };
            let wire = encode(&frame).ok()?;
            let in_a_row = gap == 0 && measured;
            measured = !missed;

            let (fields, frame_in_count) = counter.count(|| frame_in(&mut receiver, black_box(&wire)));
            let fields = fields?;
            let (event, validate_count) = counter.count(|| validate(black_box(fields)));
            let event = event?.ok()?;
            let (report, slot_count) = counter.count(|| slot(unit, black_box(&event)));
            let report = report?;
            let unit_count = |kind: bool| if kind { slot_count } else { 0 };
            let (answer, frame_out_count) = counter.count(|| frame_out(black_box(&report), &mut room));
            let _ = answer?;
            total.add(frame_in_count + validate_count + slot_count + frame_out_count);

            let mut counts = [
                frame_in_count,
                validate_count,
                0,
                0,
                0,
                unit_count(!missed && in_a_row),
                unit_count(!missed && !in_a_row),
                unit_count(missed),
                frame_out_count,
            ];
            if let Event::Measured(measurement) = &event {
                let (observation, observe_count) = counter
                    .count(|| observe(observation_form, black_box(measurement), black_box(required_sinr)));
                let input = observation_form.encode(&observation, required_sinr, |input| {
                    Vec::<i8, MAX_INPUTS>::from_slice(input).ok()
                })?;
                let (outputs, infer_count) = counter.count(|| actor_infer(actor, black_box(&input)));
                let (decision, decide_count) = counter.count(|| {
                    decide(
                        output_form,
                        black_box(&outputs),
                        black_box(&observation),
                        black_box(&plan),
                    )
                });
                if decision != report.decision {
                    say(format_args!("failed: the stages decide otherwise than the unit"));
                    return None;
                }
                counts[2] = observe_count;
                counts[3] = infer_count;
                counts[4] = decide_count;
            }
            for (stage, count) in stages.iter_mut().zip(counts) {
                if count > 0 {
                    stage.add(count);
                }
            }
        }
        let names = [
            "frame_in",
            "validate",
            "observe",
            "infer",
            "decide",
            "unit",
            "unit_resuming",
            "unit_missed",
            "frame_out",
        ];
        let mut activation = Counts::NONE;
        let parsed = Table::parse(table).ok()?;
        let ((), count) = counter.count(|| activate(unit, black_box(&parsed)));
        activation.add(count);
        let others = [("activation", activation), ("slot", total)];
        for (name, counts) in names.into_iter().zip(stages).chain(others) {
            say(format_args!(
                "stage {name} {} {} {}",
                counts.least, counts.greatest, counts.sum
            ));
        }
        Some(())
    }

    /// Uniform on `0..limit`, to within 2^-32.
    fn below(rng: &mut Pcg32, limit: u32) -> u32 {
        ((u64::from(rng.next_u32()) * u64::from(limit)) >> 32) as u32
    }

    /// Spread over everything that a cell brings, and now and then over any level at all.
    fn random_measurement(rng: &mut Pcg32, slot: u32, sub_channels: SubChannels) -> Option<Measurement> {
        let wild = below(rng, 16) == 0;
        let mut levels = |lowest: i32, highest: i32| -> Vec<Level, MAX_SUB_CHANNELS> {
            let (lowest, highest) = if wild {
                (lowest.min(0) * 12, 127)
            } else {
                (lowest, highest)
            };
            let mut level = || {
                let bits = lowest * 256 + below(rng, (highest - lowest).unsigned_abs() * 256).cast_signed();
                Level::from_bits(bits.clamp(i32::from(i16::MIN), i32::from(i16::MAX)) as i16)
            };
            (0..sub_channels.count()).map(|_| level()).collect()
        };
        let (gain, interference) = (levels(-10, 70), levels(0, 40));
        let acknowledged = match below(rng, 10) {
            0 => None,
            1 => Some(1 + below(rng, 100_000)),
            _ => Some(1 + below(rng, 100)),
        };
        let count = sub_channels.count() as u32;
        let most = if wild { u32::from(MAX_PLACES) } else { 40 };
        let places = (count + below(rng, most.saturating_sub(count))) as u16;
        let place = match below(rng, 4) {
            0 => None,
            kind => Some(Place {
                index: below(rng, u32::from(places)) as u16,
                assigned: kind > 1,
            }),
        };
        Measurement::new(&Readings {
            slot: SlotIndex(slot),
            gain: &gain,
            interference: &interference,
            last_acknowledged: acknowledged.map(|slots| SlotIndex(slot.wrapping_sub(slots))),
            place,
            weight: Weight(below(rng, 256) as u8),
            awaits_acknowledgement: below(rng, 4) == 0,
            broadcast: Broadcast {
                ring: Ring::new(places, sub_channels)?,
                open: Open(below(rng, 1 << 16) as u16),
                threshold: below(rng, 1 << 28),
                salt: below(rng, 256) as u8,
                gains_hold: below(rng, 2) == 0,
                max_power: Dbm::from_bits(30 << 8),
            },
        })
        .ok()
    }
}
