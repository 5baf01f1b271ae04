//! One image in an emulated STM32F405, with the modem's end of its serial line.
//!
//! QEMU calls back to sockets that are already bound, so no port is ever guessed and no other program can take it in between. The
//! process ends with its [`Emulator`], and on Linux with its parent, however that ends.

use crate::child::end_with_parent;
use firmware::link::{Receiver, UnitMessage};
use kit::error::{Error, Result};
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const PROGRAM: &str = "qemu-system-arm";
/// For the emulator to call back and for the image to boot; a loaded machine needs seconds.
const START_LIMIT: Duration = Duration::from_secs(60);

/// Checks that QEMU is there.
///
/// # Errors
/// [`Error::Input`] says how to install it.
pub fn check_installed() -> Result<()> {
    let mut version = Command::new(PROGRAM);
    version
        .arg("--version")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    version.status().map(drop).map_err(|error| missing(&error))
}

fn missing(error: &std::io::Error) -> Error {
    let expected = "it installed (`apt-get install qemu-system-arm` or `brew install qemu`)";
    Error::input(PROGRAM, error, expected)
}

/// How to start an image.
#[derive(Clone, Debug, Default)]
pub struct Setup {
    /// What to call it in messages.
    pub name: String,
    /// The image's ELF file.
    pub elf: PathBuf,
    /// Virtual time: an instruction takes 2^shift ns. Without it time is the machine's.
    pub instruction_shift: Option<u8>,
    /// Files that lie in memory from the start on, by their addresses.
    pub loaded: Vec<(u32, PathBuf)>,
    /// The serial line's port on this machine; any free one without it.
    pub port: Option<u16>,
}

/// A running image. Dropping it ends the emulator.
#[derive(Debug)]
pub struct Emulator {
    name: String,
    process: Process,
    line: TcpStream,
    monitor: BufReader<TcpStream>,
    directory: TempDir,
    receiver: Receiver,
    received: VecDeque<u8>,
}

impl Emulator {
    /// Boots an image and waits until it listens.
    ///
    /// # Errors
    /// [`Error::Input`]: QEMU is missing or ends, the port is taken, the image does not open its line.
    pub fn boot(setup: &Setup) -> Result<Self> {
        let directory = tempfile::tempdir().map_err(|source| Error::file(&std::env::temp_dir(), source))?;
        let line = listen(setup.port)?;
        let monitor = listen(None)?;
        let mut command = machine(&setup.elf);
        command.args(["-monitor", "none"]);
        for (id, listener) in [("line", &line), ("control", &monitor)] {
            let port = listener
                .local_addr()
                .map_err(|error| socket_error(&setup.name, &error))?
                .port();
            command.arg("-chardev");
            command.arg(format!("socket,id={id},host=127.0.0.1,port={port},nodelay=on"));
        }
        command.args(["-serial", "chardev:line", "-mon", "chardev=control,mode=control"]);
        if let Some(shift) = setup.instruction_shift {
            command.args(["-icount", &format!("shift={shift}")]);
        }
        for (address, file) in &setup.loaded {
            command.arg("-device");
            command.arg(format!(
                "loader,file={},addr={address:#x},force-raw=on",
                file.display()
            ));
        }
        let log = directory.path().join("log");
        let log_file = std::fs::File::create(&log).map_err(|source| Error::file(&log, source))?;
        command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log_file);
        let child = command.spawn().map_err(|error| missing(&error))?;
        let mut process = Process { child, log };
        let line = process.accept(&setup.name, &line)?;
        let monitor = process.accept(&setup.name, &monitor)?;
        let mut emulator = Self {
            name: setup.name.clone(),
            process,
            line,
            monitor: BufReader::new(monitor),
            directory,
            receiver: Receiver::default(),
            received: VecDeque::new(),
        };
        emulator.command("qmp_capabilities", &json!({}))?;
        emulator.wait_until_it_listens()?;
        Ok(emulator)
    }

    /// What comes before the receiver is on is lost, as on a real line.
    fn wait_until_it_listens(&mut self) -> Result<()> {
        const USART1_CR1: u64 = 0x4001_100c;
        const ENABLED: u32 = 1 << 13 | 1 << 2;
        let deadline = Instant::now() + START_LIMIT;
        while self.register(USART1_CR1)? & ENABLED != ENABLED {
            if Instant::now() > deadline {
                return Err(Error::input(
                    &self.name,
                    "a closed serial line",
                    "an image that opens USART1",
                ));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        Ok(())
    }

    /// A word of memory or a peripheral's register.
    ///
    /// # Errors
    /// If the emulator is gone.
    pub fn register(&mut self, address: u64) -> Result<u32> {
        let answer = self.ask(&format!("xp /1wx {address:#x}"))?;
        let value = answer.split_once(": 0x").map(|(_, value)| value.trim());
        value
            .and_then(|value| u32::from_str_radix(value, 16).ok())
            .ok_or_else(|| Error::input(&self.name, answer, "a word of memory from the monitor"))
    }

    /// A stretch of the emulated memory, as it is now.
    ///
    /// # Errors
    /// If the emulator is gone.
    pub fn memory(&mut self, address: u64, length: usize) -> Result<Vec<u8>> {
        let file = self.directory.path().join("memory");
        let _ = self.ask(&format!(
            "pmemsave {address:#x} {length:#x} \"{}\"",
            file.display()
        ))?;
        std::fs::read(&file).map_err(|source| Error::file(&file, source))
    }

    /// What the emulator's human monitor says to a command.
    fn ask(&mut self, command: &str) -> Result<String> {
        let answer = self.command("human-monitor-command", &json!({ "command-line": command }))?;
        Ok(answer.as_str().unwrap_or_default().trim().to_owned())
    }

    /// The answer to a command of the machine protocol: a line of JSON each way, with greeting and events between.
    fn command(&mut self, name: &str, arguments: &Value) -> Result<Value> {
        let question = json!({ "execute": name, "arguments": arguments });
        let sent = writeln!(self.monitor.get_mut(), "{question}");
        sent.map_err(|error| self.process.gone(&self.name, &error))?;
        loop {
            let mut line = String::new();
            match self.monitor.read_line(&mut line) {
                Ok(0) => return Err(self.process.gone(&self.name, &"its monitor is closed")),
                Err(error) => return Err(self.process.gone(&self.name, &error)),
                Ok(_) => {}
            }
            let mut message: Value = serde_json::from_str(&line).unwrap_or(Value::Null);
            if let Some(error) = message.get("error") {
                return Err(Error::input(&self.name, error, format!("an answer to {name}")));
            }
            if let Some(answer) = message.get_mut("return") {
                return Ok(answer.take());
            }
        }
    }

    /// Sends bytes to the unit.
    ///
    /// # Errors
    /// If the emulator is gone, with its last words.
    pub fn send(&mut self, bytes: &[u8]) -> Result<()> {
        let sent = self.line.write_all(bytes);
        sent.map_err(|error| self.process.gone(&self.name, &error))
    }

    /// The unit's next frame, or `None` if none arrives in time.
    ///
    /// # Errors
    /// If the emulator is gone, or if what arrives is no frame: the emulated line does not lose bytes.
    pub fn receive(&mut self, limit: Duration) -> Result<Option<UnitMessage>> {
        let deadline = Instant::now() + limit;
        loop {
            while let Some(byte) = self.received.pop_front() {
                match self.receiver.push(byte) {
                    None => {}
                    Some(Ok(message)) => return Ok(Some(message)),
                    Some(Err(error)) => return Err(Error::input(&self.name, error, "a frame from the unit")),
                }
            }
            let Some(left) = deadline.checked_duration_since(Instant::now()) else {
                return Ok(None);
            };
            let _ = self
                .line
                .set_read_timeout(Some(left.max(Duration::from_millis(1))));
            let mut bytes = [0; 4096];
            match self.line.read(&mut bytes) {
                Ok(0) => return Err(self.process.gone(&self.name, &"its line is closed")),
                Ok(count) => self.received.extend(&bytes[..count]),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    return Ok(None);
                }
                Err(error) => return Err(self.process.gone(&self.name, &error)),
            }
        }
    }

    /// The emulator's process.
    pub fn process_id(&self) -> u32 {
        self.process.child.id()
    }
}

/// A process that does not outlive this value.
#[derive(Debug)]
struct Process {
    child: Child,
    log: PathBuf,
}

impl Process {
    fn accept(&mut self, name: &str, listener: &TcpListener) -> Result<TcpStream> {
        let deadline = Instant::now() + START_LIMIT;
        loop {
            match listener.accept() {
                Ok((stream, _)) => {
                    let ready = stream
                        .set_nonblocking(false)
                        .and_then(|()| stream.set_nodelay(true))
                        .and_then(|()| stream.set_read_timeout(Some(START_LIMIT)));
                    return ready.map(|()| stream).map_err(|error| socket_error(name, &error));
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock && Instant::now() < deadline => {}
                Err(error) => return Err(self.gone(name, &error)),
            }
            if matches!(self.child.try_wait(), Ok(Some(_))) {
                return Err(self.gone(name, &"it ended at once"));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// The error for a process that is no longer there, with what it wrote before.
    fn gone(&mut self, name: &str, reason: &dyn std::fmt::Display) -> Error {
        // Its sockets close before it ends.
        let deadline = Instant::now() + Duration::from_secs(2);
        let status = loop {
            match self.child.try_wait() {
                Ok(Some(status)) => break status.to_string(),
                _ if Instant::now() > deadline => break "still running".to_owned(),
                _ => std::thread::sleep(Duration::from_millis(5)),
            }
        };
        let log = std::fs::read_to_string(&self.log).unwrap_or_default();
        let log: Vec<&str> = log
            .lines()
            .map(str::trim)
            .filter(|line| !line.is_empty())
            .take(8)
            .collect();
        let log = if log.is_empty() {
            "nothing".to_owned()
        } else {
            log.join(" | ")
        };
        let found = format!("{PROGRAM} gone ({reason}; {status}); it wrote: {log}");
        Error::input(name, found, "a running emulator")
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn socket_error(name: &str, error: &std::io::Error) -> Error {
    Error::input(name, error, "a socket on 127.0.0.1")
}

fn listen(port: Option<u16>) -> Result<TcpListener> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port.unwrap_or(0)));
    listener
        .and_then(|listener| listener.set_nonblocking(true).map(|()| listener))
        .map_err(|error| {
            let place = port.map_or("127.0.0.1".to_owned(), |port| format!("port {port}"));
            Error::input(place, error, "a free port on 127.0.0.1")
        })
}

/// The machine with an image, without a screen; it does not outlive the thread that starts it.
pub(crate) fn machine(elf: &Path) -> Command {
    let mut command = Command::new(PROGRAM);
    command
        .args(["-machine", "netduinoplus2", "-display", "none", "-kernel"])
        .arg(elf);
    end_with_parent(&mut command);
    command
}
