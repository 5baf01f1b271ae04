//! QEMU as an instruction counter and as a chip with a look into its memory.

use crate::hil::emulator::{Emulator as Chip, Setup, check_installed, machine};
use firmware::link::{ModemFrame, encode};
use firmware::slot_clock::SlotLength;
use kit::error::{Error, Result};
use std::io::Read;
use std::ops::Range;
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::mpsc::channel;
use std::time::Duration;

const EMULATOR: &str = "qemu-system-arm";
/// For one answer; a loaded machine needs seconds.
const ANSWER_LIMIT: Duration = Duration::from_secs(60);
/// For all measurements, which take seconds.
const MEASURE_LIMIT: Duration = Duration::from_secs(600);
/// Where the measuring image expects its job.
const JOB_ADDRESS: u64 = 0x0804_0000;

/// A running emulator; dropping it ends it.
struct Emulator(Child);

impl Drop for Emulator {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start(image: &Path, arguments: &[&str]) -> Result<Emulator> {
    check_installed()?;
    let mut command = machine(image);
    command
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null());
    command.spawn().map(Emulator).map_err(broken)
}

fn broken(found: impl ToString) -> Error {
    Error::input(EMULATOR, found, "a run to the end")
}

/// A path as an emulator's option; a comma would end it.
fn option_path(path: &Path) -> String {
    path.display().to_string().replace(',', ",,")
}

/// Gives the measuring image a job and returns its lines. One instruction takes one nanosecond of the emulator's clock.
pub fn measure(image: &Path, job: &[u8]) -> Result<Vec<String>> {
    let directory = tempfile::tempdir().map_err(|source| Error::file(&std::env::temp_dir(), source))?;
    let path = directory.path().join("job");
    std::fs::write(&path, job).map_err(|source| Error::file(&path, source))?;
    let loader = format!(
        "loader,file={},addr={JOB_ADDRESS:#x},force-raw=on",
        option_path(&path)
    );
    let arguments = [
        "-monitor",
        "none",
        "-serial",
        "none",
        "-icount",
        "shift=0",
        "-chardev",
        "stdio,id=out",
        "-semihosting-config",
        "enable=on,target=native,chardev=out",
        "-device",
        &loader,
    ];
    let mut emulator = start(image, &arguments)?;
    let mut output = emulator.0.stdout.take().ok_or_else(|| broken("no output"))?;
    let (sender, receiver) = channel();
    // Read by a thread of its own, so that waiting can end.
    let _ = std::thread::spawn(move || {
        let mut text = Vec::new();
        let _ = output.read_to_end(&mut text);
        let _ = sender.send(text);
    });
    let too_long = |_| broken(format!("no end after {} s", MEASURE_LIMIT.as_secs()));
    let text = receiver.recv_timeout(MEASURE_LIMIT).map_err(too_long)?;
    let lines: Vec<String> = String::from_utf8_lossy(&text)
        .lines()
        .map(str::to_owned)
        .collect();
    match lines.last().map(String::as_str) {
        Some("done") => Ok(lines),
        Some(last) => Err(broken(last.trim_start_matches("failed: "))),
        None => Err(broken("no measurements")),
    }
}

/// The deployed image's greatest stack in bytes over these frames, sent one after the other's answer.
///
/// RAM is zero when the emulator starts: the lowest byte of the stack's addresses that is not tells how far it went.
///
/// # Errors
/// As [`Chip::boot`], and for a unit that does not answer.
pub fn stack(image: &Path, addresses: &Range<u64>, frames: &[ModemFrame]) -> Result<u64> {
    let mut chip = Chip::boot(&Setup {
        name: "the image".to_owned(),
        elf: image.to_owned(),
        ..Setup::default()
    })?;
    // A loaded machine must not look like a silent modem.
    let slow = ModemFrame::SlotLength {
        microseconds: SlotLength::MAX_MICROSECONDS,
    };
    chip.send(&encode(&slow).map_err(broken)?)?;
    for frame in frames {
        chip.send(&encode(frame).map_err(broken)?)?;
        let _ = chip
            .receive(ANSWER_LIMIT)?
            .ok_or_else(|| broken("a unit that does not answer"))?;
    }
    let stack = chip.memory(addresses.start, (addresses.end - addresses.start) as usize)?;
    let free = stack.iter().position(|&byte| byte != 0).unwrap_or(stack.len());
    Ok((stack.len() - free) as u64)
}
