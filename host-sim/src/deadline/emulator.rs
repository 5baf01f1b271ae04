//! QEMU as an instruction counter and as a chip with a look into its memory.

use super::image::RAM;
use crate::error::{Error, Result};
use firmware::link::{ModemFrame, encode};
use std::io::{Read, Write};
use std::ops::Range;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

const EMULATOR: &str = "qemu-system-arm";
/// For the emulator to start and for the unit to answer; a loaded machine needs seconds.
const START_LIMIT: Duration = Duration::from_secs(60);
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
    let process = Command::new(EMULATOR)
        .args(["-machine", "netduinoplus2", "-display", "none", "-kernel"])
        .arg(image)
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn();
    process.map(Emulator).map_err(|error| {
        Error::input(
            EMULATOR,
            error,
            "QEMU (`apt-get install qemu-system-arm` or `brew install qemu`)",
        )
    })
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
    let output = reader(&mut emulator)?;
    let mut text = Vec::new();
    let deadline = Instant::now() + MEASURE_LIMIT;
    loop {
        match output.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
            Ok(bytes) => text.extend(bytes),
            Err(RecvTimeoutError::Disconnected) => break,
            Err(RecvTimeoutError::Timeout) => {
                return Err(broken(format!("no end after {} s", MEASURE_LIMIT.as_secs())));
            }
        }
    }
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

/// What the emulator's standard output brings, read by a thread of its own, so that waiting can end.
fn reader(emulator: &mut Emulator) -> Result<Receiver<Vec<u8>>> {
    let mut output = emulator.0.stdout.take().ok_or_else(|| broken("no output"))?;
    let (sender, receiver) = channel();
    let _ = std::thread::spawn(move || {
        let mut bytes = [0; 4096];
        while let Ok(count @ 1..) = output.read(&mut bytes) {
            if sender.send(bytes[..count].to_vec()).is_err() {
                break;
            }
        }
    });
    Ok(receiver)
}

/// The deployed image's greatest stack in bytes over these frames, sent one after the other's answer.
///
/// RAM is zero when the emulator starts: the lowest byte of the stack's addresses that is not tells how far it went.
pub fn stack(image: &Path, addresses: &Range<u64>, frames: &[ModemFrame]) -> Result<u64> {
    let directory = tempfile::tempdir().map_err(|source| Error::file(&std::env::temp_dir(), source))?;
    let (monitor, memory) = (directory.path().join("monitor"), directory.path().join("memory"));
    let listen = format!("unix:{},server=on,wait=off", option_path(&monitor));
    let mut emulator = start(
        image,
        &[
            "-chardev",
            "stdio,id=line",
            "-serial",
            "chardev:line",
            "-monitor",
            &listen,
        ],
    )?;
    let answers = reader(&mut emulator)?;
    let mut line = emulator.0.stdin.take().ok_or_else(|| broken("no line"))?;
    wait_for_unit(&mut line, &answers)?;
    for frame in frames {
        send(&mut line, frame)?;
        wait_for_answer(&answers, START_LIMIT)?;
    }
    let saved = save_memory(&monitor, &memory);
    saved.map_err(|error| broken(format!("a closed monitor ({error})")))?;
    let _ = emulator.0.wait();
    let bytes = std::fs::read(&memory).map_err(|source| Error::file(&memory, source))?;
    let offset = |address: u64| address.saturating_sub(RAM.start) as usize;
    let stack = bytes.get(offset(addresses.start)..offset(addresses.end));
    let stack = stack.ok_or_else(|| broken("a stack outside of RAM"))?;
    let free = stack.iter().position(|&byte| byte != 0).unwrap_or(stack.len());
    Ok((stack.len() - free) as u64)
}

fn save_memory(monitor: &Path, memory: &Path) -> std::io::Result<()> {
    let mut monitor = UnixStream::connect(monitor)?;
    let length = RAM.end - RAM.start;
    writeln!(
        monitor,
        "pmemsave {:#x} {length:#x} \"{}\"",
        RAM.start,
        memory.display()
    )?;
    writeln!(monitor, "quit")?;
    // Until the emulator hangs up, which it does when all is saved.
    let _ = monitor.read_to_end(&mut Vec::new());
    Ok(())
}

/// What arrives before the unit listens is lost, as on a real line: asks until it answers.
fn wait_for_unit(line: &mut ChildStdin, answers: &Receiver<Vec<u8>>) -> Result<()> {
    const PATIENCE: Duration = Duration::from_millis(200);
    let deadline = Instant::now() + START_LIMIT;
    for slot in 0.. {
        send(line, &ModemFrame::Missed { slot })?;
        if wait_for_answer(answers, PATIENCE).is_ok() {
            break;
        }
        if Instant::now() > deadline {
            return Err(broken("a unit that does not answer"));
        }
    }
    // Late answers to earlier questions.
    while wait_for_answer(answers, PATIENCE).is_ok() {}
    Ok(())
}

fn send(line: &mut ChildStdin, frame: &ModemFrame) -> Result<()> {
    let wire = encode(frame).map_err(broken)?;
    line.write_all(&wire)
        .and_then(|()| line.flush())
        .map_err(|error| broken(format!("a closed line ({error})")))
}

/// Waits for the zero byte that ends a frame.
fn wait_for_answer(answers: &Receiver<Vec<u8>>, limit: Duration) -> Result<()> {
    let deadline = Instant::now() + limit;
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        let bytes = answers
            .recv_timeout(left)
            .map_err(|_| broken("a unit that does not answer"))?;
        if bytes.contains(&0) {
            return Ok(());
        }
    }
}
