//! SUMO's programs: where they are, and a simulation that does not outlive who started it.

use super::traci::{Client, Version};
use crate::child::end_with_parent;
use kit::error::{Error, Result};
use std::ffi::OsString;
use std::fs::File;
use std::io::{Read as _, Seek as _};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::NamedTempFile;

/// For a network to be built or to load (chosen: a large city's takes a minute; a program that ends is noticed at once).
const START_LIMIT: Duration = Duration::from_secs(300);

/// How many ports are tried (chosen).
const PORTS: usize = 8;

/// Where SUMO's programs are.
#[derive(Clone, Debug)]
pub struct Programs {
    folder: PathBuf,
}

impl Programs {
    /// Looks for SUMO: below `SUMO_HOME`, on the `PATH`, and in Python's package `eclipse-sumo`.
    ///
    /// # Errors
    /// [`Error::Input`] says how to install it.
    pub fn find() -> Result<Self> {
        let home = std::env::var_os("SUMO_HOME").map(|home| PathBuf::from(home).join("bin"));
        let path = std::env::var_os("PATH").unwrap_or_default();
        let listed = std::env::split_paths(&path).collect::<Vec<_>>();
        home.into_iter()
            .chain(listed)
            .map(Self::in_folder)
            .find(Self::are_there)
            .or_else(|| Self::of_python().filter(Self::are_there))
            .ok_or_else(missing)
    }

    /// The programs in a folder.
    pub fn in_folder(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// As Python's package `eclipse-sumo` has them.
    fn of_python() -> Option<Self> {
        let mut python = Command::new("python3");
        python.args(["-c", "import sumo; print(sumo.SUMO_HOME)"]);
        let output = python.stdin(Stdio::null()).output().ok()?;
        let home = String::from_utf8(output.stdout).ok()?;
        let is_there = output.status.success() && !home.trim().is_empty();
        is_there.then(|| Self::in_folder(Path::new(home.trim()).join("bin")))
    }

    fn are_there(&self) -> bool {
        ["sumo", "netconvert"].iter().all(|name| {
            let program = self.folder.join(name);
            program.with_extension(std::env::consts::EXE_EXTENSION).is_file()
        })
    }

    /// Runs `netconvert` with these arguments.
    ///
    /// # Errors
    /// [`Error::Input`] with what it says.
    pub fn convert(&self, arguments: &[OsString]) -> Result<()> {
        Process::spawn(&self.folder.join("netconvert"), arguments)?.finish("netconvert", START_LIMIT)
    }

    /// Starts a simulation and takes its version. A port that somebody else takes is replaced by another; `first_port` is
    /// tried before any free one.
    ///
    /// # Errors
    /// [`Error::Input`] if it does not start, does not answer, or is no SUMO that is known.
    pub fn start(&self, arguments: &[OsString], first_port: Option<u16>) -> Result<(Client, Version)> {
        let mut first_port = first_port;
        for _ in 0..PORTS {
            let port = match first_port.take() {
                Some(port) => port,
                None => free_port()?,
            };
            match self.start_on(arguments, port) {
                Ok(started) => return Ok(started),
                Err(Failure::PortTaken) => {}
                Err(Failure::Other(error)) => return Err(error),
            }
        }
        let found = format!("{PORTS} ports taken one after the other");
        Err(Error::input("sumo", found, "a free port on 127.0.0.1"))
    }

    fn start_on(&self, arguments: &[OsString], port: u16) -> std::result::Result<(Client, Version), Failure> {
        let mut arguments = arguments.to_vec();
        arguments.extend(["--remote-port".into(), port.to_string().into()]);
        let mut process = Process::spawn(&self.folder.join("sumo"), &arguments)?;
        let deadline = Instant::now() + START_LIMIT;
        let stream = loop {
            if process.has_ended() {
                return Err(process.failure("a program that listens"));
            }
            match TcpStream::connect((Ipv4Addr::LOCALHOST, port)) {
                Ok(stream) => break stream,
                Err(error) if Instant::now() > deadline => {
                    let expected = format!("a program that listens within {} s", START_LIMIT.as_secs());
                    return Err(Error::input("sumo", error, expected).into());
                }
                Err(_) => std::thread::sleep(Duration::from_millis(5)),
            }
        };
        let mut client = Client::new(stream, Some(process))?;
        match client.version() {
            Ok(version) => Ok((client, version)),
            // Who answers may be somebody else, who had the port before.
            Err(error) => {
                let process = client.process_mut();
                let is_taken = process.is_some_and(|process| process.lacks_port(Duration::from_secs(1)));
                Err(if is_taken {
                    Failure::PortTaken
                } else {
                    error.into()
                })
            }
        }
    }
}

/// Why a simulation does not start.
enum Failure {
    PortTaken,
    Other(Error),
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Other(error)
    }
}

fn missing() -> Error {
    let found = "no program of this name below SUMO_HOME, on the PATH, or in Python";
    let expected = "SUMO installed (`pip install eclipse-sumo`, or Debian's package `sumo`)";
    Error::input("sumo", found, expected)
}

/// A port of this machine that nobody listens on, for now.
fn free_port() -> Result<u16> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|listener| listener.local_addr());
    listener
        .map(|address| address.port())
        .map_err(|error| Error::input("sumo", error, "a free port on 127.0.0.1"))
}

/// What matters of a program's words: its errors, or else its last lines.
fn last_words(log: &str) -> String {
    let lines: Vec<&str> = log
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty())
        .collect();
    let errors: Vec<&str> = lines
        .iter()
        .copied()
        .filter(|line| line.starts_with("Error"))
        .take(4)
        .collect();
    let lines = if errors.is_empty() {
        &lines[lines.len().saturating_sub(4)..]
    } else {
        &errors[..]
    };
    if lines.is_empty() {
        "nothing".to_owned()
    } else {
        lines.join(" | ")
    }
}

/// A running simulation, which does not outlive this value, nor on Linux the thread that starts it.
#[derive(Debug)]
pub struct Process {
    child: Child,
    /// What it writes, in a file without a name.
    log: File,
}

impl Process {
    fn spawn(program: &Path, arguments: &[OsString]) -> Result<Self> {
        let in_file = |source| Error::file(&std::env::temp_dir(), source);
        let file = NamedTempFile::new().map_err(in_file)?;
        // A position of its own: what is read here does not move where the program writes.
        let log = file.reopen().map_err(in_file)?;
        let output = file.into_file();
        let errors = output.try_clone().map_err(in_file)?;
        let mut command = Command::new(program);
        command.args(arguments);
        command.stdin(Stdio::null()).stdout(output).stderr(errors);
        end_with_parent(&mut command);
        let child = command.spawn();
        let child =
            child.map_err(|error| Error::input(program.display(), error, "SUMO's program of this name"))?;
        Ok(Self { child, log })
    }

    /// Its number in the system.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Whether it has ended.
    pub(super) fn has_ended(&mut self) -> bool {
        !matches!(self.child.try_wait(), Ok(None))
    }

    /// Waits until it ends, so long at most.
    pub(super) fn wait(&mut self, limit: Duration) {
        let deadline = Instant::now() + limit;
        while !self.has_ended() && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Waits until it has done its work, so long at most.
    fn finish(mut self, name: &str, limit: Duration) -> Result<()> {
        self.wait(limit);
        let (found, expected) = match self.child.try_wait() {
            Ok(Some(status)) if status.success() => return Ok(()),
            Ok(Some(status)) => (
                format!("{status}; it wrote: {}", last_words(&self.log())),
                "a network that SUMO can build".to_owned(),
            ),
            _ => (
                "no end".to_owned(),
                format!("one within {} s", limit.as_secs_f64()),
            ),
        };
        Err(Error::input(name, found, expected))
    }

    fn log(&self) -> String {
        let mut bytes = Vec::new();
        let mut log = &self.log;
        let read = log.rewind().and_then(|()| log.read_to_end(&mut bytes));
        read.map_or_else(
            |_| String::new(),
            |_| String::from_utf8_lossy(&bytes).into_owned(),
        )
    }

    /// How it ended, with what it wrote before.
    pub(super) fn describe_end(&mut self) -> String {
        // Its sockets close before it ends.
        self.wait(Duration::from_secs(2));
        let ended = match self.child.try_wait() {
            Ok(Some(status)) => format!("ended with {status}"),
            _ => "still runs".to_owned(),
        };
        format!("{ended}; it wrote: {}", last_words(&self.log()))
    }

    /// Whether it ended, or ends so soon, because its port is somebody else's.
    fn lacks_port(&mut self, limit: Duration) -> bool {
        self.wait(limit);
        self.has_ended() && self.log().to_lowercase().contains("address already in use")
    }

    fn failure(&mut self, expected: &str) -> Failure {
        if self.lacks_port(Duration::ZERO) {
            return Failure::PortTaken;
        }
        let found = format!("the program {}", self.describe_end());
        Failure::Other(Error::input("sumo", found, expected))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    fn finish(script: &str, seconds: f64) -> Result<()> {
        let process = Process::spawn(Path::new("/bin/sh"), &["-c".into(), script.into()])?;
        process.finish("netconvert", Duration::from_secs_f64(seconds))
    }

    #[test]
    fn a_program_that_does_not_end_is_ended_and_one_that_fails_says_why() {
        let begun = Instant::now();
        let said = finish("kill -STOP $$", 0.2).unwrap_err().to_string();
        assert_eq!(said, "netconvert: found no end, expected one within 0.2 s");
        assert!(begun.elapsed() < Duration::from_secs(20));
        let said = finish("echo 'Error: no lanes'; exit 3", 60.0)
            .unwrap_err()
            .to_string();
        assert!(said.contains("it wrote: Error: no lanes,"), "{said}");
        finish("exit 0", 60.0).unwrap();
    }
}
