//! In which units lengths and speeds stand: as said, as `config.csv` says, or as the coordinates show.

use super::Folder;
use crate::csv_table::{CsvTable, file_name};
use crate::formats::ImportOptions;
use crate::report::{ImportReport, NoteKind, median};
use crate::units::{Length, Speed};
use kit::choice::Choice as _;
use kit::error::{Error, Result};

/// Mean radius of the earth (IUGG).
const EARTH_RADIUS_M: f64 = 6_371_008.8;

/// Lengths may exceed straight lines, and coordinates be rough: a ratio is a unit's up to this factor (chosen).
const SAME_UNIT: f64 = 1.6;

/// What is stated and what coordinates show may differ by this factor before they contradict each other (chosen: less than
/// any two units differ by, but for mile and kilometre).
const CONTRADICTION: f64 = 2.5;

/// Where nothing says the unit, lengths with a larger median than this are no miles or kilometres (chosen).
const LONGEST_MEDIAN: f64 = 30.0;

/// The units of a folder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scale {
    pub(super) length: Length,
    pub(super) speed: Speed,
}

/// What a link says of the unit of lengths.
pub(super) struct Span {
    pub(super) length: f64,
    /// Minutes times speed over length, where the file has both: 60 if speeds count an hour what lengths are in.
    pub(super) driven: Option<f64>,
    /// Coordinates of its ends, where the file has them.
    pub(super) ends: Option<[(f64, f64); 2]>,
}

impl Scale {
    /// Minutes that a length takes at a speed.
    pub(super) fn minutes(self, length: f64, speed: f64) -> f64 {
        let minutes = 60.0 * length / speed;
        if self.speed.length_per_hour() == Some(self.length) {
            return minutes;
        }
        minutes * self.length.metres() / (3_600.0 * self.speed.metres_per_second())
    }

    /// A length in metres over minutes, in km/h.
    pub(super) fn km_per_h(self, length: f64, minutes: f64) -> f64 {
        length * self.length.metres() * 0.06 / minutes
    }

    /// Finds the units.
    pub(super) fn find(
        folder: &Folder,
        options: &ImportOptions,
        spans: &[Span],
        report: &mut ImportReport,
    ) -> Result<Self> {
        let stated = Stated::read(folder.config.as_ref(), report)?;
        let (length, why) = length_unit(&stated, options, spans, report)?;
        report.say(
            NoteKind::Unit,
            "link.csv: length",
            format!("{}, {why}", length.name()),
        );
        let (speed, why) = match (options.speed_unit, stated.speed) {
            (Some(unit), _) => (unit, "as the option says".to_owned()),
            (None, Some(unit)) => (unit, "as config.csv says".to_owned()),
            (None, None) => (
                length.usual_speed(),
                format!("which goes with lengths in {}", length.name()),
            ),
        };
        report.say(
            NoteKind::Unit,
            "link.csv: free_speed",
            format!("{}, {why}", speed.name()),
        );
        Ok(Self { length, speed })
    }
}

/// What `config.csv` states.
#[derive(Default)]
struct Stated {
    place: String,
    length: Option<Length>,
    speed: Option<Speed>,
    /// The unit of coordinates on a plane, most likely.
    short_length: Option<Length>,
}

impl Stated {
    fn read(config: Option<&kit::files::Text>, report: &mut ImportReport) -> Result<Self> {
        let Some(config) = config else {
            return Ok(Self::default());
        };
        let table = CsvTable::parse(config)?;
        let [length, speed, short] =
            ["long_length", "speed", "short_length"].map(|column| table.optional_column(column));
        let mut rows = table.rows();
        let Some(row) = rows.next() else {
            return Ok(Self::default());
        };
        let unit = |column: Option<usize>| match column {
            Some(column) if !row.text(Some(column)).is_empty() => {
                let unit = Length::of_word(row.text(Some(column)));
                unit.map(Some)
                    .ok_or_else(|| row.refuse(column, "meter, kilometer, foot or mile"))
            }
            _ => Ok(None),
        };
        let stated = Self {
            place: format!("{}: long_length", row.place()),
            length: unit(length)?,
            short_length: unit(short)?,
            speed: match speed {
                Some(column) if !row.text(Some(column)).is_empty() => {
                    let unit = Speed::of_word(row.text(Some(column)));
                    Some(unit.ok_or_else(|| row.refuse(column, "mph, kph, m/s or ft/s"))?)
                }
                _ => None,
            },
        };
        table.report(report);
        Ok(stated)
    }
}

fn length_unit(
    stated: &Stated,
    options: &ImportOptions,
    spans: &[Span],
    report: &mut ImportReport,
) -> Result<(Length, String)> {
    if let Some(unit) = options.length_unit {
        return Ok((unit, "as the option says".to_owned()));
    }
    let measured = measured(spans);
    match (stated.length, measured) {
        (Some(stated_unit), Some(Measured::OnEarth(metres))) => {
            let factor = metres / stated_unit.metres();
            if !(1.0 / CONTRADICTION..=CONTRADICTION).contains(&factor)
                && let Some(unit) = nearest(metres)
            {
                let expected = format!(
                    "{}, in which the lengths are what the coordinates say; --length-unit decides",
                    unit.name()
                );
                return Err(Error::input(&stated.place, stated_unit.name(), expected));
            }
            Ok((stated_unit, "as config.csv says".to_owned()))
        }
        // Coordinates on a plane are in metres or feet, never in miles.
        (Some(stated_unit), Some(Measured::OnPlane))
            if matches!(stated_unit, Length::Mile | Length::Kilometre) =>
        {
            let unit = stated.short_length.unwrap_or(Length::Metre);
            report.say(
                NoteKind::Warning,
                file_name(&stated.place),
                format!(
                    "{} contradicts the coordinates, between which the lengths are straight lines: {} is taken",
                    stated_unit.name(),
                    unit.name()
                ),
            );
            Ok((unit, "as the coordinates show".to_owned()))
        }
        (Some(unit), _) => Ok((unit, "as config.csv says".to_owned())),
        (None, Some(Measured::OnEarth(metres))) if nearest(metres).is_some() => {
            let unit = nearest(metres).unwrap_or(Length::Metre);
            Ok((
                unit,
                format!("as longitudes and latitudes show: {metres:.4} m each"),
            ))
        }
        (None, _) => {
            let speed = options.speed_unit.or(stated.speed);
            Ok(by_time(spans, speed).unwrap_or_else(|| by_size(spans, speed, report)))
        }
    }
}

/// What lengths are against the distances between their ends.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Measured {
    /// Metres on the earth of a unit of length.
    OnEarth(f64),
    /// The same as the distances on a plane.
    OnPlane,
}

fn measured(spans: &[Span]) -> Option<Measured> {
    let on_earth = spans
        .iter()
        .filter_map(|span| span.ends)
        .flatten()
        .all(|(x, y)| (-180.0..=180.0).contains(&x) && (-90.0..=90.0).contains(&y));
    let ratios = spans.iter().filter_map(|span| {
        let [from, to] = span.ends?;
        let distance = if on_earth {
            distance_m(from, to)
        } else {
            libm::hypot(to.0 - from.0, to.1 - from.1)
        };
        (distance > 0.0 && span.length > 0.0).then(|| distance / span.length)
    });
    let ratio = median(ratios.collect())?;
    if on_earth {
        return Some(Measured::OnEarth(ratio));
    }
    (1.0 / SAME_UNIT..=SAME_UNIT)
        .contains(&ratio)
        .then_some(Measured::OnPlane)
}

/// The unit of so many metres.
fn nearest(metres: f64) -> Option<Length> {
    let off = |unit: Length| {
        let factor = metres / unit.metres();
        factor.max(1.0 / factor)
    };
    let best = Length::ALL
        .iter()
        .copied()
        .min_by(|a, b| off(*a).total_cmp(&off(*b)));
    best.filter(|unit| off(*unit) <= SAME_UNIT)
}

/// The unit by free-flow times and speeds, where they say that lengths are what speeds count an hour.
fn by_time(spans: &[Span], speed: Option<Speed>) -> Option<(Length, String)> {
    let driven = median(spans.iter().filter_map(|span| span.driven).collect())?;
    if !(60.0 / SAME_UNIT..=60.0 * SAME_UNIT).contains(&driven) {
        return None;
    }
    let unit = speed.and_then(Speed::length_per_hour).unwrap_or(Length::Mile);
    Some((
        unit,
        "as free-flow times and speeds show: what the speed counts an hour".to_owned(),
    ))
}

/// The unit by the size of the lengths alone.
fn by_size(spans: &[Span], speed: Option<Speed>, report: &mut ImportReport) -> (Length, String) {
    let lengths = spans
        .iter()
        .map(|span| span.length)
        .filter(|length| *length > 0.0);
    let Some(median) = median(lengths.collect()) else {
        return (Length::Mile, "as no link has a length".to_owned());
    };
    if median > LONGEST_MEDIAN {
        let text = format!(
            "neither config.csv nor coordinates give its unit: a median of {median} is taken for metres"
        );
        report.say(NoteKind::Warning, "link.csv: length", text);
        return (Length::Metre, format!("by their size: the median is {median}"));
    }
    let unit = speed.and_then(Speed::length_per_hour).unwrap_or(Length::Mile);
    let text = "as is usual where nothing says: what the speed counts an hour";
    (unit, text.to_owned())
}

/// Distance of two points in degrees along a great circle.
pub(super) fn distance_m((x1, y1): (f64, f64), (x2, y2): (f64, f64)) -> f64 {
    let half = |degrees: f64| 0.5 * degrees.to_radians();
    let (sin_y, sin_x) = (libm::sin(half(y2 - y1)), libm::sin(half(x2 - x1)));
    let along = libm::cos(y1.to_radians()) * libm::cos(y2.to_radians());
    let chord = sin_y * sin_y + along * sin_x * sin_x;
    2.0 * EARTH_RADIUS_M * libm::asin(libm::sqrt(chord.min(1.0)))
}
