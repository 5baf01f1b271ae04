//! A trace from the elements of a file, whoever reads them, with every check.

use super::{Position, Record, Step, Trace};
use kit::error::{Error, Result};
use std::collections::HashMap;

/// Elements that SUMO writes beside vehicles and that are none.
const NOT_VEHICLES: [&str; 2] = ["person", "container"];

/// Decimals of a second that a time may have: a slot is 1 ms.
const TIME_DECIMALS: usize = 3;

/// Coordinates lie so near to their origin, in m (chosen: the circumference of the Earth, which no projection exceeds).
const FARTHEST_M: f64 = 4e7;

/// No vehicle is faster (chosen: as fast as sound).
const FASTEST_M_PER_S: f64 = 343.0;

/// An element that holds something.
struct Element<'a> {
    tag: &'a str,
    attribute: Attribute<'a>,
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

/// A trace on the way: it is told of the elements of a file in their order, each with its line, from 1.
#[derive(Default)]
pub struct TraceBuilder {
    /// What errors call the file.
    name: String,
    scope: Scope,
    first_time_ms: i64,
    steps: Vec<Step>,
    vehicle_ids: Vec<String>,
    vehicle_by_id: HashMap<String, usize>,
    /// Per vehicle, how many steps there were when it was last seen.
    last_seen: Vec<usize>,
}

/// The value of an element's attribute, by its name.
pub type Attribute<'a> = &'a dyn Fn(&str) -> Result<Option<String>>;

impl TraceBuilder {
    /// Nothing yet. `name` is what errors call the text, usually its file's name.
    pub fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            ..Self::default()
        }
    }

    /// An error at a line.
    pub fn error(&self, line: usize, found: impl ToString, expected: impl ToString) -> Error {
        Error::input(format!("{}:{line}", self.name), found, expected)
    }

    /// What stands where only certain elements may.
    pub(super) fn unexpected(&self, line: usize, found: &str) -> Error {
        self.error(line, found, self.scope.expected())
    }

    /// An element begins.
    ///
    /// # Errors
    /// [`Error::Input`] if it may not stand here, or lacks an attribute, or has one that makes no sense.
    pub fn open(&mut self, line: usize, tag: &str, attribute: Attribute<'_>) -> Result<()> {
        self.scope = match (self.scope, tag) {
            (Scope::BeforeRoot, "fcd-export") => Scope::Root,
            (Scope::Root, "timestep") => {
                self.add_step(line, &Element { tag, attribute })?;
                Scope::Step
            }
            (Scope::Step, "vehicle") => {
                self.add_vehicle(line, &Element { tag, attribute })?;
                Scope::Vehicle
            }
            (Scope::Step, tag) if NOT_VEHICLES.contains(&tag) => Scope::Skipped(1),
            (Scope::Skipped(depth), _) => Scope::Skipped(depth + 1),
            (_, tag) => return Err(self.unexpected(line, &format!("<{}>", shortened(tag)))),
        };
        Ok(())
    }

    /// The innermost element ends. Whoever reads has already refused an end tag that closes another element.
    pub fn close(&mut self) {
        self.scope = match self.scope {
            Scope::Skipped(depth) if depth > 1 => Scope::Skipped(depth - 1),
            Scope::Vehicle | Scope::Skipped(_) => Scope::Step,
            Scope::Step => Scope::Root,
            Scope::Root | Scope::BeforeRoot | Scope::AfterRoot => Scope::AfterRoot,
        };
    }

    /// Text between elements, which begins at this line.
    ///
    /// # Errors
    /// [`Error::Input`] if it is not blank.
    pub fn text(&self, line: usize, text: &str) -> Result<()> {
        let shown = text.trim();
        if shown.is_empty() {
            return Ok(());
        }
        let leading = &text[..text.len() - text.trim_start().len()];
        let line = line + leading.matches('\n').count();
        Err(self.unexpected(line, &format!("text '{}'", shortened(shown))))
    }

    fn add_step(&mut self, line: usize, element: &Element<'_>) -> Result<()> {
        let time_ms = self.time_ms(line, element)?;
        let slot = match self.steps.last() {
            None => {
                self.first_time_ms = time_ms;
                0
            }
            Some(previous) => {
                let since_first = i128::from(time_ms) - i128::from(self.first_time_ms);
                let previous_ms = self.first_time_ms + i64::from(previous.slot);
                if since_first <= i128::from(previous.slot) {
                    return Err(self.error(
                        line,
                        format!("time={} s", Seconds(time_ms)),
                        format!("a time after the previous step's {} s", Seconds(previous_ms)),
                    ));
                }
                u32::try_from(since_first).map_err(|_| {
                    self.error(
                        line,
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

    fn add_vehicle(&mut self, line: usize, element: &Element<'_>) -> Result<()> {
        let id = self.attribute(line, element, "id")?;
        let position = Position {
            x_m: self.number(line, element, "x", (-FARTHEST_M, FARTHEST_M))?,
            y_m: self.number(line, element, "y", (-FARTHEST_M, FARTHEST_M))?,
            speed_m_per_s: self.number(line, element, "speed", (0.0, FASTEST_M_PER_S))?,
        };
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
            return Err(self.error(
                line,
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

    /// The attribute of an element that must have it.
    fn attribute(&self, line: usize, element: &Element<'_>, name: &str) -> Result<String> {
        (element.attribute)(name)?.ok_or_else(|| {
            let found = format!("<{}> without '{name}'", element.tag);
            self.error(line, found, format!("an attribute '{name}'"))
        })
    }

    /// A number within limits.
    fn number(
        &self,
        line: usize,
        element: &Element<'_>,
        name: &str,
        (least, most): (f64, f64),
    ) -> Result<f64> {
        let text = self.attribute(line, element, name)?;
        let number = text.trim().parse().ok();
        number
            .filter(|number| (least..=most).contains(number))
            .ok_or_else(|| {
                let found = format!("{name}=\"{}\"", shortened(&text));
                self.error(line, found, format!("a number from {least} to {most}"))
            })
    }

    /// Seconds in decimal digits, exactly, as milliseconds.
    fn time_ms(&self, line: usize, element: &Element<'_>) -> Result<i64> {
        let text = self.attribute(line, element, "time")?;
        exact_milliseconds(text.trim()).ok_or_else(|| {
            let found = format!("time=\"{}\"", shortened(&text));
            self.error(line, found, "seconds in decimal digits, in whole milliseconds")
        })
    }

    /// The trace, at the end of the file.
    ///
    /// # Errors
    /// [`Error::Input`] if the file ends too early, or holds no time step or no vehicle.
    pub fn finish(mut self, line: usize) -> Result<Trace> {
        match self.scope {
            Scope::AfterRoot => {}
            Scope::BeforeRoot => {
                return Err(self.error(line, "the end of the file", "<fcd-export>"));
            }
            scope => return Err(self.error(line, "the end of the file", scope.expected())),
        }
        if self.steps.is_empty() {
            return Err(self.error(line, "no time step", "at least one <timestep>"));
        }
        if self.vehicle_ids.is_empty() {
            return Err(self.error(line, "no vehicle in any time step", "at least one <vehicle>"));
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
