//! SUMO's control protocol TraCI: few typed commands over a loopback connection.
//!
//! Orders are collected and leave in one message before the next step; a step answers with two subscriptions: whom the
//! simulation let in and out, and all its vehicles. So a step costs two exchanges, however many vehicles there are. Every
//! answer is checked to its last byte: one that is too short, too long or of another kind is an error.
//!
//! # Source
//! SUMO's user documentation, <https://sumo.dlr.de/docs/TraCI/Protocol.html> and the pages on commands below it.

use super::program::Process;
use kit::error::{Error, Result};
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// How long an answer may take (chosen: a step takes milliseconds, on a loaded machine seconds).
const ANSWER_LIMIT: Duration = Duration::from_secs(60);

/// How often the process is looked at while its answer is awaited.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// Longest answer that is taken, in bytes (chosen: a million vehicles' places).
const LONGEST_ANSWER: usize = 1 << 28;

/// The first version of the interface that is taken: SUMO 1.2.
const OLDEST_API: i32 = 20;

/// "Always", as beginning and end of a subscription.
const ALWAYS: f64 = -1_073_741_824.0;

/// A range in m beyond every network's size.
const EVERYWHERE_M: f64 = 1e9;

/// Commands.
mod command {
    pub const VERSION: u8 = 0x00;
    pub const STEP: u8 = 0x02;
    pub const CLOSE: u8 = 0x7f;
    pub const SUBSCRIBE_JUNCTION_CONTEXT: u8 = 0x89;
    pub const GET_VEHICLE: u8 = 0xa4;
    pub const GET_JUNCTION: u8 = 0xa9;
    pub const GET_SIMULATION: u8 = 0xab;
    pub const SET_VEHICLE: u8 = 0xc4;
    pub const SET_ROUTE: u8 = 0xc6;
    pub const SET_EDGE: u8 = 0xca;
    pub const SUBSCRIBE_SIMULATION: u8 = 0xdb;
    /// What an answer's number is above its command's.
    pub const ANSWER: u8 = 0x10;
}

/// Variables of vehicles, edges, routes and the simulation.
mod variable {
    pub const NAMES: u8 = 0x00;
    pub const SPEED: u8 = 0x40;
    pub const MAX_SPEED: u8 = 0x41;
    pub const PLACE: u8 = 0x42;
    pub const TYPE: u8 = 0x4f;
    pub const ROAD: u8 = 0x50;
    pub const ALONG: u8 = 0x56;
    pub const ROUTE: u8 = 0x57;
    pub const DEPARTED: u8 = 0x74;
    pub const LET_THROUGH: u8 = 0x75;
    pub const ARRIVED: u8 = 0x7a;
    pub const STEP_LENGTH: u8 = 0x7b;
    pub const BOUNDARY: u8 = 0x7c;
    pub const ADD: u8 = 0x80;
    pub const ADD_VEHICLE: u8 = 0x85;
}

/// Types of values.
mod kind {
    pub const PLACE: u8 = 0x01;
    pub const POLYGON: u8 = 0x06;
    pub const BYTE: u8 = 0x07;
    pub const SIGNED_BYTE: u8 = 0x08;
    pub const INTEGER: u8 = 0x09;
    pub const NUMBER: u8 = 0x0b;
    pub const TEXT: u8 = 0x0c;
    pub const TEXTS: u8 = 0x0e;
    pub const COMPOUND: u8 = 0x0f;
}

/// What is at the other end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Version {
    /// The interface's number.
    pub api: i32,
    /// The program's name and version, such as `SUMO 1.28.0`.
    pub program: String,
}

/// A vehicle after a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Vehicle {
    /// SUMO's name for it.
    pub name: String,
    /// The name of its road.
    pub road: String,
    /// Way of its front from the beginning of its lane, in m.
    pub along_m: f64,
    /// Eastwards, in m.
    pub x_m: f64,
    /// Northwards, in m.
    pub y_m: f64,
    /// Its speed in m/s.
    pub speed_m_per_s: f64,
}

/// What a step brought.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Step {
    /// Who entered the network.
    pub departed: Vec<String>,
    /// Who ended its way.
    pub arrived: Vec<String>,
    /// How many were let through ("teleported") because they stood too long.
    pub let_through: u32,
    /// Everybody on a road; not who is being let through.
    pub vehicles: Vec<Vehicle>,
}

/// A value with its type.
#[derive(Clone, Debug, PartialEq)]
enum Value {
    Integer(i32),
    Number(f64),
    Text(String),
    Texts(Vec<String>),
    /// Places in m; one or several.
    Places(Vec<(f64, f64)>),
}

/// A connection to a SUMO that listens.
#[derive(Debug)]
pub struct Client {
    stream: TcpStream,
    /// The program, where it is a child of this one.
    process: Option<Process>,
    /// Orders that have not left yet.
    orders: Vec<u8>,
    /// By order: the command's number, and what to call it in messages.
    pending: Vec<(u8, String)>,
}

impl Client {
    /// Talks over a connection; with the process behind it, errors say how that ended.
    ///
    /// # Errors
    /// If the connection takes no time limit.
    pub fn new(stream: TcpStream, process: Option<Process>) -> Result<Self> {
        let ready = stream
            .set_nodelay(true)
            .and_then(|()| stream.set_read_timeout(Some(LOOK_EVERY)))
            .and_then(|()| stream.set_write_timeout(Some(ANSWER_LIMIT)));
        ready.map_err(|error| Error::input("sumo", error, "a connection on 127.0.0.1"))?;
        Ok(Self {
            stream,
            process,
            orders: Vec::new(),
            pending: Vec::new(),
        })
    }

    /// The program behind the connection, if it is a child.
    pub fn process_mut(&mut self) -> Option<&mut Process> {
        self.process.as_mut()
    }

    /// Asks who is there.
    ///
    /// # Errors
    /// [`Error::Input`] if it is no SUMO, or one too old.
    pub fn version(&mut self) -> Result<Version> {
        let answer = self.exchange(&framed(command::VERSION, &[]))?;
        let mut answer = Reader::new(&answer);
        answer.status(command::VERSION, "version")?;
        let mut body = answer.command(command::VERSION)?;
        let version = Version {
            api: body.integer()?,
            program: body.text()?,
        };
        body.end()?;
        answer.end()?;
        if !version.program.starts_with("SUMO") || version.api < OLDEST_API {
            let found = format!("{}, TraCI {}", version.program, version.api);
            let expected = format!("SUMO, TraCI {OLDEST_API} or later");
            return Err(Error::input("sumo", found, expected));
        }
        Ok(version)
    }

    /// The length of a step in s.
    ///
    /// # Errors
    /// If the answer is another.
    pub fn step_length_s(&mut self) -> Result<f64> {
        match self.get(command::GET_SIMULATION, variable::STEP_LENGTH)? {
            Value::Number(length) if length.is_finite() && length > 0.0 => Ok(length),
            other => Err(unsuitable(&other, "the length of a step in s")),
        }
    }

    /// South-west and north-east corner of the network, in m.
    ///
    /// # Errors
    /// If the answer is another.
    pub fn boundary_m(&mut self) -> Result<((f64, f64), (f64, f64))> {
        match self.get(command::GET_SIMULATION, variable::BOUNDARY)? {
            Value::Places(corners) if corners.len() == 2 => Ok((corners[0], corners[1])),
            other => Err(unsuitable(&other, "two corners of the network")),
        }
    }

    /// Lets every [`Client::step`] tell what happened.
    ///
    /// # Errors
    /// If the network has no junction, or the answer is another.
    pub fn subscribe(&mut self) -> Result<()> {
        let names = self.get(command::GET_JUNCTION, variable::NAMES)?;
        let Value::Texts(junctions) = names else {
            return Err(unsuitable(&names, "names of junctions"));
        };
        let junction = junctions
            .first()
            .ok_or_else(|| Error::input("sumo: network", "no junction", "at least one"))?;
        let mut simulation = Writer::default();
        simulation.number(ALWAYS);
        simulation.number(ALWAYS);
        simulation.text("");
        simulation.bytes(&[3, variable::DEPARTED, variable::ARRIVED, variable::LET_THROUGH]);
        let mut vehicles = Writer::default();
        vehicles.number(ALWAYS);
        vehicles.number(ALWAYS);
        vehicles.text(junction);
        vehicles.bytes(&[command::GET_VEHICLE]);
        vehicles.number(EVERYWHERE_M);
        vehicles.bytes(&[
            4,
            variable::ROAD,
            variable::ALONG,
            variable::PLACE,
            variable::SPEED,
        ]);
        for (number, content) in [
            (command::SUBSCRIBE_SIMULATION, simulation),
            (command::SUBSCRIBE_JUNCTION_CONTEXT, vehicles),
        ] {
            let answer = self.exchange(&framed(number, &content.0))?;
            let mut answer = Reader::new(&answer);
            answer.status(number, "subscription")?;
            answer.subscription(&mut Step::default())?;
            answer.end()?;
        }
        Ok(())
    }

    /// Orders a vehicle of a type that enters the first of these edges as soon as there is room.
    pub fn add_vehicle(&mut self, name: &str, kind: &str, route: &str, edges: &[String]) {
        let mut content = Writer::default();
        content.bytes(&[variable::ADD]);
        content.text(route);
        content.texts(edges);
        self.order(command::SET_ROUTE, &content, format!("route {route}"));
        let mut content = Writer::default();
        content.bytes(&[variable::ADD_VEHICLE]);
        content.text(name);
        content.bytes(&[kind::COMPOUND]);
        content.integer(14);
        // Route, type, departure, then lane, place and speed there and at arrival, two zones and a line.
        for part in [
            route, kind, "now", "best", "base", "max", "current", "max", "current", "", "", "",
        ] {
            content.bytes(&[kind::TEXT]);
            content.text(part);
        }
        // Seats, and persons in them.
        for part in [0, 0] {
            content.bytes(&[kind::INTEGER]);
            content.integer(part);
        }
        self.order(command::SET_VEHICLE, &content, format!("vehicle {name}"));
    }

    /// Orders that a vehicle drives these edges, the first of which is the one that it is on.
    pub fn set_route(&mut self, vehicle: &str, edges: &[String]) {
        let mut content = Writer::default();
        content.bytes(&[variable::ROUTE]);
        content.text(vehicle);
        content.texts(edges);
        self.order(
            command::SET_VEHICLE,
            &content,
            format!("route of vehicle {vehicle}"),
        );
    }

    /// Orders that a vehicle is of another type.
    pub fn set_type(&mut self, vehicle: &str, kind: &str) {
        let mut content = Writer::default();
        content.bytes(&[variable::TYPE]);
        content.text(vehicle);
        content.bytes(&[kind::TEXT]);
        content.text(kind);
        self.order(
            command::SET_VEHICLE,
            &content,
            format!("type of vehicle {vehicle}"),
        );
    }

    /// Orders the highest speed on all lanes of an edge, in m/s.
    pub fn set_edge_speed(&mut self, edge: &str, speed_m_per_s: f64) {
        let mut content = Writer::default();
        content.bytes(&[variable::MAX_SPEED]);
        content.text(edge);
        content.bytes(&[kind::NUMBER]);
        content.number(speed_m_per_s);
        self.order(command::SET_EDGE, &content, format!("speed on {edge}"));
    }

    fn order(&mut self, number: u8, content: &Writer, what: String) {
        self.orders.extend(framed(number, &content.0));
        self.pending.push((number, what));
    }

    /// Sends all orders, and drives one step.
    ///
    /// # Errors
    /// The first order that is refused, an answer that is not one, or a program that is gone.
    pub fn step(&mut self) -> Result<Step> {
        if !self.orders.is_empty() {
            let orders = std::mem::take(&mut self.orders);
            let answer = self.exchange(&orders)?;
            let mut answer = Reader::new(&answer);
            for (number, what) in std::mem::take(&mut self.pending) {
                answer.status(number, &what)?;
            }
            answer.end()?;
        }
        let answer = self.exchange(&framed(command::STEP, &0.0_f64.to_be_bytes()))?;
        step_of(&answer)
    }

    fn get(&mut self, number: u8, wanted: u8) -> Result<Value> {
        let mut content = Writer::default();
        content.bytes(&[wanted]);
        content.text("");
        let answer = self.exchange(&framed(number, &content.0))?;
        value_of(&answer, number, wanted)
    }

    /// Sends commands as one message and reads the answer.
    fn exchange(&mut self, commands: &[u8]) -> Result<Vec<u8>> {
        let sent = u32::try_from(commands.len() + 4).map(|length| {
            let message = [&length.to_be_bytes(), commands].concat();
            self.stream.write_all(&message)
        });
        match sent {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err(self.gone(&error)),
            Err(_) => return Err(Error::input("sumo", "orders of over 4 GiB", "fewer in a step")),
        }
        let deadline = Instant::now() + ANSWER_LIMIT;
        let mut length = [0; 4];
        self.read(&mut length, deadline)?;
        let length = u32::from_be_bytes(length) as usize;
        if !(4..=LONGEST_ANSWER).contains(&length) {
            let found = format!("an answer of {length} bytes");
            return Err(Error::input("sumo", found, format!("4 to {LONGEST_ANSWER}")));
        }
        // Grows with what arrives, not with what is announced.
        let (mut answer, mut left) = (Vec::new(), length - 4);
        while left > 0 {
            let mut part = [0; 1 << 14];
            let part = &mut part[..left.min(1 << 14)];
            self.read(part, deadline)?;
            answer.extend_from_slice(part);
            left -= part.len();
        }
        Ok(answer)
    }

    /// Fills a buffer, in time and as long as the program lives.
    fn read(&mut self, buffer: &mut [u8], deadline: Instant) -> Result<()> {
        let mut filled = 0;
        while filled < buffer.len() {
            match self.stream.read(&mut buffer[filled..]) {
                Ok(0) => return Err(self.gone(&"the connection is closed")),
                Ok(count) => filled += count,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    if self.process.as_mut().is_some_and(Process::has_ended) {
                        return Err(self.gone(&"no answer"));
                    }
                    if Instant::now() > deadline {
                        let expected = format!("an answer within {} s", ANSWER_LIMIT.as_secs());
                        return Err(Error::input("sumo", "no answer", expected));
                    }
                }
                Err(error) => return Err(self.gone(&error)),
            }
        }
        Ok(())
    }

    /// The error for a program that no longer answers.
    fn gone(&mut self, reason: &dyn std::fmt::Display) -> Error {
        let ended = self.process.as_mut().map(Process::describe_end);
        let found = ended.map_or_else(
            || reason.to_string(),
            |ended| format!("the program {ended} ({reason})"),
        );
        Error::input("sumo", found, "a program that runs until it is told to end")
    }
}

impl Drop for Client {
    /// Lets the program end by itself, so that its own output files are whole; then it is ended.
    fn drop(&mut self) {
        let farewell = framed(command::CLOSE, &[]);
        let length = (farewell.len() as u32 + 4).to_be_bytes();
        let sent = self.stream.write_all(&[&length[..], &farewell].concat());
        if let (Ok(()), Some(process)) = (sent, &mut self.process) {
            process.wait(Duration::from_secs(2));
        }
    }
}

/// A command with its length before it.
fn framed(number: u8, content: &[u8]) -> Vec<u8> {
    let short = content.len() + 2;
    let mut bytes = Vec::with_capacity(content.len() + 6);
    match u8::try_from(short) {
        Ok(length) => bytes.push(length),
        Err(_) => {
            bytes.push(0);
            bytes.extend((short as u32 + 4).to_be_bytes());
        }
    }
    bytes.push(number);
    bytes.extend_from_slice(content);
    bytes
}

/// What a step brought, from the answer to it.
fn step_of(answer: &[u8]) -> Result<Step> {
    let mut answer = Reader::new(answer);
    answer.status(command::STEP, "step")?;
    let mut step = Step::default();
    for _ in 0..answer.count()? {
        answer.subscription(&mut step)?;
    }
    answer.end()?;
    Ok(step)
}

/// The value that a command asked for.
fn value_of(answer: &[u8], number: u8, wanted: u8) -> Result<Value> {
    let mut answer = Reader::new(answer);
    answer.status(number, "question")?;
    let mut body = answer.command(number + command::ANSWER)?;
    body.expect(wanted, "variable")?;
    let _object = body.text()?;
    let value = body.value()?;
    body.end()?;
    answer.end()?;
    Ok(value)
}

/// The error for a value that is not what it should be.
fn unsuitable(value: &Value, expected: &str) -> Error {
    Error::input("sumo: answer", format!("{value:?}"), expected)
}

/// The content of a command on its way out.
#[derive(Debug, Default)]
struct Writer(Vec<u8>);

impl Writer {
    fn bytes(&mut self, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }

    fn integer(&mut self, value: i32) {
        self.bytes(&value.to_be_bytes());
    }

    fn number(&mut self, value: f64) {
        self.bytes(&value.to_be_bytes());
    }

    fn text(&mut self, text: &str) {
        self.bytes(&(text.len() as u32).to_be_bytes());
        self.bytes(text.as_bytes());
    }

    /// A list with its type.
    fn texts(&mut self, texts: &[String]) {
        self.bytes(&[kind::TEXTS]);
        self.bytes(&(texts.len() as u32).to_be_bytes());
        texts.iter().for_each(|text| self.text(text));
    }
}

/// What is left of an answer. Nothing is read beyond its end.
#[derive(Debug)]
struct Reader<'b> {
    rest: &'b [u8],
}

impl<'b> Reader<'b> {
    fn new(bytes: &'b [u8]) -> Self {
        Self { rest: bytes }
    }

    fn take(&mut self, count: usize) -> Result<&'b [u8]> {
        let Some((taken, rest)) = self.rest.split_at_checked(count) else {
            let found = format!("{} bytes", self.rest.len());
            return Err(Error::input("sumo: answer", found, format!("{count} more")));
        };
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn byte(&mut self) -> Result<u8> {
        Ok(self.array::<1>()?[0])
    }

    fn integer(&mut self) -> Result<i32> {
        self.array().map(i32::from_be_bytes)
    }

    fn number(&mut self) -> Result<f64> {
        self.array().map(f64::from_be_bytes)
    }

    /// A number of things that follow, each at least a byte.
    fn count(&mut self) -> Result<usize> {
        let count = self.integer()?;
        usize::try_from(count)
            .ok()
            .filter(|&count| count <= self.rest.len())
            .ok_or_else(|| Error::input("sumo: answer", format!("{count} things"), "as many as follow"))
    }

    fn text(&mut self) -> Result<String> {
        let length = self.count()?;
        Ok(String::from_utf8_lossy(self.take(length)?).into_owned())
    }

    fn expect(&mut self, expected: u8, what: &str) -> Result<()> {
        let found = self.byte()?;
        if found == expected {
            return Ok(());
        }
        let place = format!("sumo: {what} of an answer");
        Err(Error::input(
            place,
            format!("{found:#04x}"),
            format!("{expected:#04x}"),
        ))
    }

    fn end(&self) -> Result<()> {
        if self.rest.is_empty() {
            return Ok(());
        }
        let found = format!("{} bytes too many", self.rest.len());
        Err(Error::input("sumo: answer", found, "its end"))
    }

    /// The number and the content of a command that stands here.
    fn any_command(&mut self) -> Result<(u8, Self)> {
        let (length, before) = match self.byte()? {
            0 => (self.integer()?, 6),
            short => (i32::from(short), 2),
        };
        let number = self.byte()?;
        let content = usize::try_from(length)
            .ok()
            .and_then(|length| length.checked_sub(before));
        let Some(content) = content else {
            let found = format!("a command of {length} bytes");
            return Err(Error::input("sumo: answer", found, format!("at least {before}")));
        };
        Ok((number, Self::new(self.take(content)?)))
    }

    /// The content of the command with this number.
    fn command(&mut self, expected: u8) -> Result<Self> {
        let (number, content) = self.any_command()?;
        if number == expected {
            return Ok(content);
        }
        let found = format!("command {number:#04x}");
        Err(Error::input(
            "sumo: answer",
            found,
            format!("command {expected:#04x}"),
        ))
    }

    /// Whether a command was done.
    fn status(&mut self, number: u8, what: &str) -> Result<()> {
        let mut content = self.command(number)?;
        let (result, said) = (content.byte()?, content.text()?);
        content.end()?;
        if result == 0 {
            return Ok(());
        }
        Err(Error::input(
            format!("sumo: {what}"),
            said,
            "an order that SUMO can follow",
        ))
    }

    fn value(&mut self) -> Result<Value> {
        Ok(match self.byte()? {
            kind::BYTE => Value::Integer(self.byte()?.into()),
            kind::SIGNED_BYTE => Value::Integer(self.byte()?.cast_signed().into()),
            kind::INTEGER => Value::Integer(self.integer()?),
            kind::NUMBER => Value::Number(self.number()?),
            kind::TEXT => Value::Text(self.text()?),
            kind::TEXTS => {
                let texts = (0..self.count()?).map(|_| self.text());
                Value::Texts(texts.collect::<Result<_>>()?)
            }
            kind::PLACE => Value::Places(vec![(self.number()?, self.number()?)]),
            kind::POLYGON => {
                let places = (0..self.byte()?).map(|_| Ok((self.number()?, self.number()?)));
                Value::Places(places.collect::<Result<_>>()?)
            }
            other => {
                let found = format!("a value of type {other:#04x}");
                return Err(Error::input("sumo: answer", found, "a type that was asked for"));
            }
        })
    }

    /// A variable that was subscribed to, with its value.
    fn variable(&mut self) -> Result<(u8, Value)> {
        let (variable, status, value) = (self.byte()?, self.byte()?, self.value()?);
        if status == 0 {
            return Ok((variable, value));
        }
        Err(unsuitable(&value, "a variable that SUMO knows"))
    }

    /// One of the two subscriptions.
    fn subscription(&mut self, step: &mut Step) -> Result<()> {
        const SIMULATION: u8 = command::SUBSCRIBE_SIMULATION + command::ANSWER;
        const VEHICLES: u8 = command::SUBSCRIBE_JUNCTION_CONTEXT + command::ANSWER;
        let (number, mut content) = self.any_command()?;
        let _object = content.text()?;
        match number {
            SIMULATION => {
                for _ in 0..content.byte()? {
                    match content.variable()? {
                        (variable::DEPARTED, Value::Texts(names)) => step.departed = names,
                        (variable::ARRIVED, Value::Texts(names)) => step.arrived = names,
                        (variable::LET_THROUGH, Value::Integer(count)) => {
                            step.let_through = u32::try_from(count).unwrap_or(0);
                        }
                        (_, other) => return Err(unsuitable(&other, "departures and arrivals")),
                    }
                }
            }
            VEHICLES => {
                content.expect(command::GET_VEHICLE, "domain")?;
                let variables = content.byte()?;
                for _ in 0..content.count()? {
                    step.vehicles.push(content.vehicle(variables)?);
                }
            }
            other => {
                let found = format!("command {other:#04x}");
                return Err(Error::input(
                    "sumo: answer",
                    found,
                    "a subscription of this client",
                ));
            }
        }
        content.end()
    }

    fn vehicle(&mut self, variables: u8) -> Result<Vehicle> {
        let mut vehicle = Vehicle {
            name: self.text()?,
            ..Vehicle::default()
        };
        for _ in 0..variables {
            match self.variable()? {
                (variable::ROAD, Value::Text(road)) => vehicle.road = road,
                (variable::ALONG, Value::Number(along_m)) => vehicle.along_m = along_m,
                (variable::SPEED, Value::Number(speed)) => vehicle.speed_m_per_s = speed,
                (variable::PLACE, Value::Places(places)) if places.len() == 1 => {
                    (vehicle.x_m, vehicle.y_m) = places[0];
                }
                (_, other) => return Err(unsuitable(&other, "road, way, place and speed of a vehicle")),
            }
        }
        Ok(vehicle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    // What SUMO 1.28.0 answered on a road of 500 m with one vehicle.
    const BOUNDARY: &str =
        "07ab000000000029bb7c00000000060200000000000000000000000000000000407f4000000000000000000000000000";
    const JUNCTIONS: &str = "07a9000000000016b900000000000e0000000200000001300000000131";
    const NOBODY: &str = "07020000000000000000020000000020eb000000000374000e000000007a000e00000000750009000000000000000011\
                          990000000130a40400000000";
    const SOMEBODY: &str = "07020000000000000000020000000025eb000000000374000e0000000100000001377a000e0000000075000900000000\
                            0000000047990000000130a40400000001000000013750000c000000013056000b401466666666666642000140146666\
                            66666666bff999999999999a40000b402bcccccccccccd";
    const REFUSED: &str = "1ccaff000000154564676520277827206973206e6f74206b6e6f776e";

    fn bytes(digits: &str) -> Vec<u8> {
        (0..digits.len() / 2)
            .map(|index| u8::from_str_radix(&digits[2 * index..2 * index + 2], 16).expect("hexadecimal"))
            .collect()
    }

    #[test]
    fn recorded_answers_are_understood() {
        let corners =
            value_of(&bytes(BOUNDARY), command::GET_SIMULATION, variable::BOUNDARY).expect("corners");
        assert_eq!(corners, Value::Places(vec![(0.0, 0.0), (500.0, 0.0)]));
        let names = value_of(&bytes(JUNCTIONS), command::GET_JUNCTION, variable::NAMES).expect("names");
        assert_eq!(names, Value::Texts(vec!["0".to_owned(), "1".to_owned()]));
        assert_eq!(step_of(&bytes(NOBODY)).expect("a step"), Step::default());
        let expected = Step {
            departed: vec!["7".to_owned()],
            vehicles: vec![Vehicle {
                name: "7".to_owned(),
                road: "0".to_owned(),
                along_m: 5.1,
                x_m: 5.1,
                y_m: -1.6,
                speed_m_per_s: 13.9,
            }],
            ..Step::default()
        };
        let step = step_of(&bytes(SOMEBODY)).expect("a step");
        assert!((step.vehicles[0].along_m - 5.1).abs() < 1e-9);
        assert_eq!(format!("{step:.3?}"), format!("{expected:.3?}"));
        let refused = bytes(REFUSED);
        let error = Reader::new(&refused).status(command::SET_EDGE, "speed on x");
        assert_eq!(
            error.expect_err("refused").to_string(),
            "sumo: speed on x: found Edge 'x' is not known, expected an order that SUMO can follow"
        );
    }

    #[test]
    fn a_short_or_long_answer_is_an_error() {
        let whole = bytes(SOMEBODY);
        for length in 0..whole.len() {
            assert!(step_of(&whole[..length]).is_err(), "{length}");
        }
        assert!(step_of(&[&whole[..], &[0]].concat()).is_err());
    }

    #[test]
    fn long_commands_have_long_lengths() {
        assert_eq!(framed(1, &[9; 3]), [5, 1, 9, 9, 9]);
        let long = framed(1, &[9; 254]);
        assert_eq!((&long[..6], long.len()), (&[0, 0, 0, 1, 4, 1][..], 260));
    }

    proptest! {
        #[test]
        fn any_bytes_are_an_answer_or_an_error(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let _ = step_of(&bytes);
            let _ = value_of(&bytes, command::GET_JUNCTION, variable::NAMES);
        }

        #[test]
        fn any_change_of_an_answer_is_an_answer_or_an_error(place in 0_usize..140, byte in any::<u8>()) {
            let mut answer = bytes(SOMEBODY);
            let place = place % answer.len();
            answer[place] = byte;
            let _ = step_of(&answer);
        }
    }
}
