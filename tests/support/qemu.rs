//! An emulated STM32F405 with the modem's end of its serial line in hand.

use firmware::link::{Receiver, UnitFrame};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const EMULATOR: &str = "qemu-system-arm";
/// For the emulator to open its sockets; a loaded machine needs seconds.
const START_LIMIT: Duration = Duration::from_secs(20);

/// A running image. Dropping it ends the emulator.
#[derive(Debug)]
pub struct Qemu {
    process: Child,
    line: UnixStream,
    monitor: BufReader<UnixStream>,
    directory: TempDir,
    receiver: Receiver,
    received: std::collections::VecDeque<u8>,
}

impl Qemu {
    /// Boots an image.
    ///
    /// # Panics
    /// If QEMU is missing or does not start: a check that cannot run has failed.
    pub fn boot(elf: &Path) -> Self {
        let directory = tempfile::tempdir().unwrap_or_else(|error| panic!("no temporary directory: {error}"));
        let socket = |name: &str| directory.path().join(name);
        let listen = |name: &str| format!("unix:{},server=on,wait=off", socket(name).display());
        let process = Command::new(EMULATOR)
            .args(["-machine", "netduinoplus2", "-display", "none", "-kernel"])
            .arg(elf)
            .arg("-serial")
            .arg(listen("line"))
            .args(["-monitor", "none", "-qmp"])
            .arg(listen("monitor"))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::inherit())
            .spawn()
            .unwrap_or_else(|error| {
                panic!(
                    "{EMULATOR} does not start: {error}; install it with `apt-get install qemu-system-arm` or `brew install qemu`"
                )
            });
        // From here on the process must not outlive a panic.
        let mut process = Ending(Some(process));
        let line = connect(&socket("line"), &mut process);
        let mut monitor = connect(&socket("monitor"), &mut process);
        let opened = monitor
            .set_read_timeout(Some(START_LIMIT))
            .and_then(|()| writeln!(monitor, "{}", json!({ "execute": "qmp_capabilities" })));
        opened.unwrap_or_else(|error| panic!("the emulator's monitor: {error}"));
        let process = process.0.take().unwrap_or_else(|| unreachable!("taken once"));
        let mut qemu = Self {
            process,
            line,
            monitor: BufReader::new(monitor),
            directory,
            receiver: Receiver::default(),
            received: std::collections::VecDeque::new(),
        };
        qemu.wait_until_it_listens();
        qemu
    }

    /// What comes before the receiver is on is lost, as on a real line.
    fn wait_until_it_listens(&mut self) {
        const USART1_CR1: u64 = 0x4001_100c;
        const ENABLED: u32 = 1 << 13 | 1 << 2;
        let deadline = Instant::now() + START_LIMIT;
        while self.register(USART1_CR1) & ENABLED != ENABLED {
            assert!(
                Instant::now() < deadline,
                "the image does not open its serial line"
            );
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// A peripheral's register.
    fn register(&mut self, address: u64) -> u32 {
        let answer = self.ask(&format!("xp /1wx {address:#x}"));
        let value = answer.split_once(": 0x").map(|(_, value)| value.trim());
        value
            .and_then(|value| u32::from_str_radix(value, 16).ok())
            .unwrap_or_else(|| panic!("the emulator's monitor answers {answer:?}"))
    }

    /// What the emulator's human monitor says to a command, over the machine protocol (QMP: a line of JSON each way).
    fn ask(&mut self, command: &str) -> String {
        let question = json!({
            "execute": "human-monitor-command",
            "arguments": { "command-line": command },
        });
        writeln!(self.monitor.get_mut(), "{question}")
            .unwrap_or_else(|error| panic!("the emulator's monitor is closed: {error}"));
        loop {
            let mut line = String::new();
            match self.monitor.read_line(&mut line) {
                Ok(0) => panic!("the emulator ended"),
                Err(error) => panic!("the emulator's monitor: {error}"),
                Ok(_) => {}
            }
            let message: Value = serde_json::from_str(&line)
                .unwrap_or_else(|error| panic!("the emulator's monitor says {line:?}: {error}"));
            assert!(message.get("error").is_none(), "{command}: {message}");
            // Greeting, events and the empty answer to the opening come by, too.
            if let Some(answer) = message.get("return").and_then(Value::as_str) {
                return answer.trim().to_owned();
            }
        }
    }

    /// Sends bytes to the unit.
    ///
    /// # Panics
    /// If the emulator is gone.
    pub fn send(&mut self, bytes: &[u8]) {
        self.line
            .write_all(bytes)
            .unwrap_or_else(|error| panic!("the emulator's line is closed: {error}"));
    }

    /// The unit's next frame, or `None` if none arrives in time.
    ///
    /// # Panics
    /// If the emulator is gone, or if what arrives is no frame: the emulated line does not lose bytes.
    pub fn receive(&mut self, limit: Duration) -> Option<UnitFrame> {
        let deadline = Instant::now() + limit;
        loop {
            while let Some(byte) = self.received.pop_front() {
                match self.receiver.push(byte) {
                    None => {}
                    Some(Ok(frame)) => return Some(frame),
                    Some(Err(error)) => panic!("the unit sent no frame: {error}"),
                }
            }
            let left = deadline.checked_duration_since(Instant::now())?;
            let mut bytes = [0; 4096];
            let _ = self
                .line
                .set_read_timeout(Some(left.max(Duration::from_millis(1))));
            match self.line.read(&mut bytes) {
                Ok(0) => panic!("the emulator ended"),
                Ok(count) => self.received.extend(&bytes[..count]),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    return None;
                }
                Err(error) => panic!("the emulator's line: {error}"),
            }
        }
    }

    /// A stretch of the emulated memory, as it is now.
    ///
    /// # Panics
    /// If the emulator does not answer.
    pub fn memory(&mut self, address: u64, length: usize) -> Vec<u8> {
        let file = self.directory.path().join("memory");
        let answer = self.ask(&format!(
            "pmemsave {address:#x} {length:#x} \"{}\"",
            file.display()
        ));
        let bytes = std::fs::read(&file).unwrap_or_default();
        assert_eq!(
            bytes.len(),
            length,
            "the emulator's monitor saved too little: {answer}"
        );
        bytes
    }
}

impl Drop for Qemu {
    fn drop(&mut self) {
        end(&mut self.process);
    }
}

struct Ending(Option<Child>);

impl Drop for Ending {
    fn drop(&mut self) {
        if let Some(process) = &mut self.0 {
            end(process);
        }
    }
}

fn end(process: &mut Child) {
    let _ = process.kill();
    let _ = process.wait();
}

fn connect(socket: &Path, process: &mut Ending) -> UnixStream {
    let deadline = Instant::now() + START_LIMIT;
    loop {
        match UnixStream::connect(socket) {
            Ok(stream) => return stream,
            Err(error) if Instant::now() > deadline => {
                panic!("{EMULATOR} opens no {}: {error}", socket.display())
            }
            Err(_) => {}
        }
        if let Some(Ok(Some(status))) = process.0.as_mut().map(Child::try_wait) {
            panic!("{EMULATOR} ended at once: {status}");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}
