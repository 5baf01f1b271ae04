//! The XML of floating-car data, read as a stream and checked line by line.

use super::{Position, Record, Step, Trace};
use kit::error::{Error, Result};
use quick_xml::XmlVersion;
use quick_xml::errors::{Error as XmlError, IllFormedError};
use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;
use std::collections::HashMap;
use std::io::{BufRead, Read};

/// Elements that SUMO writes beside vehicles and that are none.
const NOT_VEHICLES: [&str; 2] = ["person", "container"];

/// Decimals of a second that a time may have: a slot is 1 ms.
const TIME_DECIMALS: usize = 3;

/// Parses a whole trace; see [`Trace::parse`].
pub(super) fn parse(place_name: &str, reader: impl BufRead) -> Result<Trace> {
    let mut reader = Reader::from_reader(LineCounter {
        inner: reader,
        newlines: 0,
    });
    let mut builder = Builder::default();
    let mut buffer = Vec::new();
    loop {
        // Markup begins where the last event ended, so this is its line even when it spans several.
        let place = Place {
            name: place_name,
            line: reader.get_ref().newlines + 1,
        };
        buffer.clear();
        match reader.read_event_into(&mut buffer) {
            Ok(Event::Start(element)) => builder.open(&place, &element)?,
            Ok(Event::Empty(element)) => {
                builder.open(&place, &element)?;
                builder.close();
            }
            Ok(Event::End(_)) => builder.close(),
            Ok(Event::Eof) => return builder.finish(&place),
            Ok(Event::Text(text)) if text.trim().is_empty() => {}
            Ok(Event::Text(text)) => {
                let leading = text.len() - text.trim_start().len();
                let newlines = text.as_bytes()[..leading].iter().filter(|byte| **byte == b'\n');
                let place = Place {
                    line: place.line + newlines.count(),
                    ..place
                };
                return Err(builder.unexpected(&place, &format!("text '{}'", shortened(text.trim()))));
            }
            Ok(Event::CData(_)) => return Err(builder.unexpected(&place, "character data")),
            Ok(Event::GeneralRef(_)) => return Err(builder.unexpected(&place, "an entity")),
            Ok(Event::Decl(_) | Event::PI(_) | Event::Comment(_) | Event::DocType(_)) => {}
            Err(error) => return Err(place.malformed(&error)),
        }
    }
}

/// Counts the newlines of what has been consumed, so that an error can name a line without keeping the text.
struct LineCounter<R> {
    inner: R,
    newlines: usize,
}

impl<R: BufRead> Read for LineCounter<R> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let count = self.inner.read(into)?;
        self.newlines += into.iter().take(count).filter(|byte| **byte == b'\n').count();
        Ok(count)
    }
}

impl<R: BufRead> BufRead for LineCounter<R> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        self.inner.fill_buf()
    }

    fn consume(&mut self, count: usize) {
        // What is consumed is still buffered, so this reads nothing and cannot fail.
        if count > 0
            && let Ok(buffered) = self.inner.fill_buf()
        {
            self.newlines += buffered.iter().take(count).filter(|byte| **byte == b'\n').count();
        }
        self.inner.consume(count);
    }
}

/// Where a piece of markup begins.
struct Place<'name> {
    name: &'name str,
    line: usize,
}

impl Place<'_> {
    fn error(&self, found: impl ToString, expected: impl ToString) -> Error {
        Error::input(format!("{}:{}", self.name, self.line), found, expected)
    }

    fn malformed(&self, error: &XmlError) -> Error {
        match error {
            XmlError::Io(error) => {
                self.error(format!("unreadable data ({error})"), "a whole, undamaged file")
            }
            XmlError::Syntax(error) => self.error(format!("broken XML ({error})"), "well-formed XML"),
            XmlError::IllFormed(IllFormedError::MismatchedEndTag { expected, found }) => {
                self.error(format!("</{found}>"), format!("</{expected}>"))
            }
            XmlError::Encoding(_) => self.error("bytes that are not UTF-8", "UTF-8 text"),
            other => self.error(format!("broken XML ({other})"), "well-formed XML"),
        }
    }

    /// The value of an attribute that must be there.
    fn attribute(&self, element: &BytesStart<'_>, name: &str) -> Result<String> {
        let mut value = None;
        // All attributes are gone through, so that one given twice is seen.
        for attribute in element.attributes() {
            let attribute = attribute.map_err(|error| self.malformed(&error.into()))?;
            if attribute.key.as_ref() == name {
                let text = attribute.normalized_value(XmlVersion::Implicit1_0);
                value = Some(text.map_err(|error| self.malformed(&error))?.into_owned());
            }
        }
        value.ok_or_else(|| {
            let tag = element.name();
            self.error(
                format!("<{}> without '{name}'", tag.as_ref()),
                format!("an attribute '{name}'"),
            )
        })
    }

    /// A finite number.
    fn number(&self, element: &BytesStart<'_>, name: &str) -> Result<f64> {
        let text = self.attribute(element, name)?;
        match text.trim().parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(self.error(format!("{name}=\"{}\"", shortened(&text)), "a finite number")),
        }
    }

    /// Seconds in decimal digits, exactly, as milliseconds.
    fn time_ms(&self, element: &BytesStart<'_>) -> Result<i64> {
        let text = self.attribute(element, "time")?;
        exact_milliseconds(text.trim()).ok_or_else(|| {
            self.error(
                format!("time=\"{}\"", shortened(&text)),
                "seconds in decimal digits, in whole milliseconds",
            )
        })
    }
}

/// Decimal seconds as milliseconds: `None` for anything else, for a fraction of a millisecond and for overflow.
fn exact_milliseconds(text: &str) -> Option<i64> {
    let (sign, digits) = text.strip_prefix('-').map_or((1, text), |digits| (-1, digits));
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, "0"));
    let is_digits = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
    if !is_digits(whole) || !is_digits(fraction) {
        return None;
    }
    let kept = fraction.get(..TIME_DECIMALS).unwrap_or(fraction);
    let dropped = fraction.get(TIME_DECIMALS..).unwrap_or("");
    if dropped.bytes().any(|byte| byte != b'0') {
        return None;
    }
    let milliseconds: i64 = format!("{kept:0<TIME_DECIMALS$}").parse().ok()?;
    let seconds: i64 = whole.parse().ok()?;
    Some(sign * seconds.checked_mul(1_000)?.checked_add(milliseconds)?)
}

/// Enough of a text to recognise it in a message of one line.
fn shortened(text: &str) -> String {
    const MAX_CHARACTERS: usize = 40;
    let mut short: String = text
        .chars()
        .take(MAX_CHARACTERS)
        .map(|character| if character.is_control() { ' ' } else { character })
        .collect();
    if text.chars().nth(MAX_CHARACTERS).is_some() {
        short.push('…');
    }
    short
}

/// Which element is open.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Scope {
    #[default]
    BeforeRoot,
    Root,
    Step,
    Vehicle,
    /// Inside something that is no vehicle, so many elements deep.
    Skipped(usize),
    AfterRoot,
}

impl Scope {
    /// What may stand here, for messages.
    const fn expected(self) -> &'static str {
        match self {
            Self::BeforeRoot => "<fcd-export>",
            Self::Root => "<timestep> or </fcd-export>",
            Self::Step | Self::Skipped(_) => "<vehicle> or </timestep>",
            Self::Vehicle => "</vehicle>",
            Self::AfterRoot => "nothing after </fcd-export>",
        }
    }
}

/// A trace on the way.
#[derive(Default)]
struct Builder {
    scope: Scope,
    first_time_ms: i64,
    steps: Vec<Step>,
    vehicle_ids: Vec<String>,
    vehicle_by_id: HashMap<String, usize>,
    /// Per vehicle, how many steps there were when it was last seen.
    last_seen: Vec<usize>,
}

impl Builder {
    fn unexpected(&self, place: &Place<'_>, found: &str) -> Error {
        place.error(found, self.scope.expected())
    }

    fn open(&mut self, place: &Place<'_>, element: &BytesStart<'_>) -> Result<()> {
        let tag = element.name();
        self.scope = match (self.scope, tag.as_ref()) {
            (Scope::BeforeRoot, "fcd-export") => Scope::Root,
            (Scope::Root, "timestep") => {
                self.add_step(place, element)?;
                Scope::Step
            }
            (Scope::Step, "vehicle") => {
                self.add_vehicle(place, element)?;
                Scope::Vehicle
            }
            (Scope::Step, tag) if NOT_VEHICLES.contains(&tag) => Scope::Skipped(1),
            (Scope::Skipped(depth), _) => Scope::Skipped(depth + 1),
            (_, tag) => return Err(self.unexpected(place, &format!("<{}>", shortened(tag)))),
        };
        Ok(())
    }

    /// The parser has already refused an end tag that closes another element.
    fn close(&mut self) {
        self.scope = match self.scope {
            Scope::Skipped(depth) if depth > 1 => Scope::Skipped(depth - 1),
            Scope::Vehicle | Scope::Skipped(_) => Scope::Step,
            Scope::Step => Scope::Root,
            Scope::Root | Scope::BeforeRoot | Scope::AfterRoot => Scope::AfterRoot,
        };
    }

    fn add_step(&mut self, place: &Place<'_>, element: &BytesStart<'_>) -> Result<()> {
        let time_ms = place.time_ms(element)?;
        let slot = match self.steps.last() {
            None => {
                self.first_time_ms = time_ms;
                0
            }
            Some(previous) => {
                let since_first = i128::from(time_ms) - i128::from(self.first_time_ms);
                let previous_ms = self.first_time_ms + i64::from(previous.slot);
                if since_first <= i128::from(previous.slot) {
                    return Err(place.error(
                        format!("time={} s", Seconds(time_ms)),
                        format!("a time after the previous step's {} s", Seconds(previous_ms)),
                    ));
                }
                u32::try_from(since_first).map_err(|_| {
                    place.error(
                        format!("time={} s", Seconds(time_ms)),
                        format!(
                            "at most {} s after the first step's {} s",
                            Seconds(i64::from(u32::MAX)),
                            Seconds(self.first_time_ms)
                        ),
                    )
                })?
            }
        };
        self.steps.push(Step {
            slot,
            records: Vec::new(),
        });
        Ok(())
    }

    fn add_vehicle(&mut self, place: &Place<'_>, element: &BytesStart<'_>) -> Result<()> {
        let id = place.attribute(element, "id")?;
        let position = Position {
            x_m: place.number(element, "x")?,
            y_m: place.number(element, "y")?,
            speed_m_per_s: place.number(element, "speed")?,
        };
        if position.speed_m_per_s < 0.0 {
            return Err(place.error(
                format!("speed=\"{}\"", position.speed_m_per_s),
                "a speed of at least 0 m/s",
            ));
        }
        let steps_so_far = self.steps.len();
        let vehicle = match self.vehicle_by_id.get(&id) {
            Some(&vehicle) => vehicle,
            None => {
                let vehicle = self.vehicle_ids.len();
                self.vehicle_ids.push(id.clone());
                self.last_seen.push(0);
                let _none = self.vehicle_by_id.insert(id.clone(), vehicle);
                vehicle
            }
        };
        if self.last_seen[vehicle] == steps_so_far {
            return Err(place.error(
                format!("vehicle '{}' a second time", shortened(&id)),
                "every vehicle once in a time step",
            ));
        }
        self.last_seen[vehicle] = steps_so_far;
        if let Some(step) = self.steps.last_mut() {
            step.records.push(Record { vehicle, position });
        }
        Ok(())
    }

    fn finish(mut self, place: &Place<'_>) -> Result<Trace> {
        match self.scope {
            Scope::AfterRoot => {}
            Scope::BeforeRoot => {
                return Err(place.error("the end of the file", "<fcd-export>"));
            }
            scope => return Err(place.error("the end of the file", scope.expected())),
        }
        if self.steps.is_empty() {
            return Err(place.error("no time step", "at least one <timestep>"));
        }
        if self.vehicle_ids.is_empty() {
            return Err(place.error("no vehicle in any time step", "at least one <vehicle>"));
        }
        for step in &mut self.steps {
            step.records.sort_unstable_by_key(|record| record.vehicle);
            step.records.shrink_to_fit();
        }
        Ok(Trace {
            vehicle_ids: self.vehicle_ids,
            steps: self.steps,
        })
    }
}

/// Milliseconds, shown as seconds.
struct Seconds(i64);

impl std::fmt::Display for Seconds {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let magnitude = self.0.unsigned_abs();
        write!(formatter, "{sign}{}.{:03}", magnitude / 1_000, magnitude % 1_000)
    }
}
