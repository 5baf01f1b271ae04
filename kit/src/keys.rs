//! Keys of configurations, documented where they are declared: a section is a struct, and each of its fields says what it
//! means, in which range and unit, and where its value comes from.
//!
//! ```
//! kit::keys! {
//!     /// What the cell's radio can do.
//!     pub struct Radio {
//!         /// Full power of a vehicle.
//!         #[key(range = -100.0..=100.0, unit = "dBm", source = "Table I")]
//!         pub max_power_dbm: f64,
//!     }
//! }
//! assert_eq!(Radio::KEYS[0].range(), "-100 to 100 dBm");
//! ```

use crate::choice::Choice;
use crate::error::{Error, Result};
use std::path::PathBuf;
use toml::{Table, Value};

/// A key of a configuration: a single value, or a section of further keys.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Its name in its section.
    pub name: &'static str,
    /// What it means: the doc comment of its field, in full sentences.
    pub meaning: &'static str,
    /// What stands there.
    pub kind: Kind,
    /// Least number, or least of each number in a list.
    pub least: f64,
    /// Largest number, or largest of each number in a list.
    pub most: f64,
    /// Most values of a list.
    pub longest: usize,
    /// Unit of its numbers; empty for plain numbers.
    pub unit: &'static str,
    /// Where its value comes from; empty for a section.
    pub source: &'static str,
}

/// What may stand at a key.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// A whole number.
    Whole,
    /// A number.
    Number,
    /// True or false.
    Flag,
    /// Text, such as a path.
    Text,
    /// One of these names, each with its meaning.
    Choice(fn() -> Vec<(&'static str, &'static str)>),
    /// Values of one kind, and how many where that is fixed. A list of sections is an array of tables in TOML.
    List(&'static Kind, Option<usize>),
    /// Further keys.
    Section(&'static [Key]),
}

/// A type of values at a key.
pub trait Keyed {
    /// What is written there.
    const KIND: Kind;
}

/// Implements [`Keyed`] for types that are written alike.
macro_rules! keyed {
    ($($kind:ident: $($type:ty)+;)+) => {
        $($(impl Keyed for $type {
            const KIND: Kind = Kind::$kind;
        })+)+
    };
}
keyed! {
    Whole: u32 u64 usize;
    Number: f32 f64;
    Flag: bool;
    Text: String PathBuf;
}

impl<C: Choice> Keyed for C {
    const KIND: Kind = Kind::Choice(|| {
        C::ALL
            .iter()
            .map(|choice| (choice.name(), choice.meaning()))
            .collect()
    });
}

/// A key that a preset may leave out.
impl<T: Keyed> Keyed for Option<T> {
    const KIND: Kind = T::KIND;
}

impl<T: Keyed> Keyed for Vec<T> {
    const KIND: Kind = Kind::List(&T::KIND, None);
}

impl<T: Keyed, const N: usize> Keyed for [T; N] {
    const KIND: Kind = Kind::List(&T::KIND, Some(N));
}

/// Declares sections of a configuration: structs whose fields carry their documentation as [`Key`]s, in the constant `KEYS`.
///
/// A field's doc comment is its meaning; `#[key(...)]` gives `range` (with both ends), `choices` (names with
/// meanings, where the type is another crate's and no [`Choice`]), `longest` (most values of a list), `unit` and `source`, in this
/// order; a key without what its kind needs does not compile. A field that is itself a section has a doc comment alone.
#[macro_export]
macro_rules! keys {
    ($(
        $(#[doc = $about:literal])+
        $visibility:vis struct $section:ident {
            $(
                $(#[doc = $meaning:literal])+
                $(#[key(
                    $(range = $range:expr,)?
                    $(choices = $choices:expr,)?
                    $(longest = $longest:expr,)?
                    $(unit = $unit:literal,)?
                    source = $source:literal
                )])?
                $(#[serde($($serde:tt)*)])?
                $field_visibility:vis $field:ident: $type:ty,
            )+
        }
    )+) => {$(
        $(#[doc = $about])+
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        $visibility struct $section {
            $(
                $(#[doc = $meaning])+
                $(#[doc = concat!(
                    "\n\n",
                    $("Range: `", stringify!($range), "`. ",)?
                    $("Unit: ", $unit, ". ",)?
                    "Source: ", $source, "."
                )])?
                $(#[serde($($serde)*)])?
                $field_visibility $field: $type,
            )+
        }

        impl $section {
            /// Its keys, in the order of the presets.
            pub const KEYS: &'static [$crate::keys::Key] = &[$(
                $crate::keys::Key {
                    $(
                        $(least: *($range).start(), most: *($range).end(),)?
                        $(longest: $longest,)?
                        $(unit: $unit,)?
                        source: $source,
                    )?
                    ..$crate::keys::Key::new(
                        stringify!($field),
                        concat!($($meaning),+),
                        $crate::kind!($type $($(, $choices)?)?),
                    )
                }
                .declared(),
            )+];
        }

        impl $crate::keys::Keyed for $section {
            const KIND: $crate::keys::Kind = $crate::keys::Kind::Section(Self::KEYS);
        }
    )+};
}

/// What is written at a key of this type.
#[doc(hidden)]
#[macro_export]
macro_rules! kind {
    ($type:ty) => {
        <$type as $crate::keys::Keyed>::KIND
    };
    ($type:ty, $choices:expr) => {
        $crate::keys::Kind::Choice(|| $choices.to_vec())
    };
}

impl Key {
    /// A key without range, unit and source.
    pub const fn new(name: &'static str, meaning: &'static str, kind: Kind) -> Self {
        Self {
            name,
            meaning: meaning.trim_ascii(),
            kind,
            least: f64::NEG_INFINITY,
            most: f64::INFINITY,
            longest: usize::MAX,
            unit: "",
            source: "",
        }
    }

    /// The key, if all is said that its kind needs; otherwise its declaration does not compile.
    #[doc(hidden)]
    pub const fn declared(self) -> Self {
        let each = match self.kind {
            Kind::List(each, _) => *each,
            kind => kind,
        };
        let ranged = self.least.is_finite() && self.most.is_finite();
        assert!(
            ranged || !matches!(each, Kind::Whole | Kind::Number),
            "a number needs a range"
        );
        let short = self.longest < usize::MAX || !matches!(self.kind, Kind::List(_, None));
        assert!(short, "a list needs a longest length");
        let sourced = !self.source.is_empty() || matches!(self.kind, Kind::Section(_));
        assert!(sourced, "a key needs a source");
        self
    }

    /// What may stand there, with the unit, such as `0 to 100 dB`.
    pub fn range(&self) -> String {
        let (least, most) = (number(self.least), number(self.most));
        match self.kind {
            Kind::Whole | Kind::Number => format!("{least} to {most} {}", self.unit).trim_end().to_owned(),
            Kind::List(each, length) => {
                let count = length.map_or(format!("at most {}", self.longest), |length| length.to_string());
                match each {
                    Kind::Whole | Kind::Number => {
                        let unit = if self.unit.is_empty() {
                            "numbers"
                        } else {
                            self.unit
                        };
                        format!("{count} {unit} from {least} to {most}")
                    }
                    _ => format!("{count} times {}", each.described()),
                }
            }
            Kind::Choice(choices) => {
                let names: Vec<String> = choices().iter().map(|(name, _)| format!("\"{name}\"")).collect();
                names.join(", ")
            }
            Kind::Flag | Kind::Text | Kind::Section(_) => self.kind.described().to_owned(),
        }
    }

    /// Whether a value of this kind is in the key's range.
    fn admits(&self, kind: Kind, value: &Value) -> bool {
        let within = |number: f64| (self.least..=self.most).contains(&number);
        match (kind, value) {
            (Kind::Whole | Kind::Number, Value::Integer(whole)) => within(*whole as f64),
            (Kind::Number, Value::Float(number)) => within(*number),
            (Kind::Choice(choices), Value::String(found)) => choices().iter().any(|(name, _)| name == found),
            (Kind::List(each, length), Value::Array(values)) => {
                values.len() <= self.longest
                    && length.is_none_or(|length| values.len() == length)
                    && values.iter().all(|value| self.admits(*each, value))
            }
            (Kind::Section(keys), Value::Table(values)) => check(keys, values).is_ok(),
            (Kind::Flag | Kind::Text, value) => kind.fits(value),
            _ => false,
        }
    }
}

impl Kind {
    /// Whether a value is written as this kind is. A whole number is a number too.
    pub fn fits(self, value: &Value) -> bool {
        match self {
            Self::Whole => value.is_integer(),
            Self::Number => value.is_integer() || value.is_float(),
            Self::Flag => value.is_bool(),
            Self::Text | Self::Choice(_) => value.is_str(),
            Self::List(..) => value.is_array(),
            Self::Section(_) => value.is_table(),
        }
    }

    /// What is written there, for errors.
    pub const fn described(self) -> &'static str {
        match self {
            Self::Whole => "a whole number",
            Self::Number => "a number",
            Self::Flag => "true or false",
            Self::Text | Self::Choice(_) => "text",
            Self::List(..) => "a list such as [64, 64]",
            Self::Section(_) => "keys below it",
        }
    }
}

/// A number as people write it: very small and very large ones by their powers of ten.
fn number(value: f64) -> String {
    match value.abs() {
        0.0 | 1e-3..1e6 => value.to_string(),
        _ => format!("{value:e}"),
    }
}

/// Checks all values against the ranges of their keys, those in lists of sections too. A key without a value passes.
///
/// # Errors
/// The first key that is out of its range as `section.key` or, in a list, `list[0].key`, its value and its range; in a list also
/// one that is unknown.
pub fn check(keys: &[Key], values: &Table) -> Result<()> {
    listed(keys)
        .iter()
        .try_for_each(|(name, key)| match value(values, name) {
            Some(Value::Array(entries))
                if let Kind::List(Kind::Section(keys), _) = key.kind
                    && entries.len() <= key.longest =>
            {
                let mut entries = entries.iter().enumerate();
                entries.try_for_each(|(index, entry)| check_entry(&format!("{name}[{index}]"), keys, entry))
            }
            Some(found) if !key.admits(key.kind, found) => {
                // As people write it: 3 instead of 3.0.
                let found = found
                    .as_float()
                    .map_or_else(|| found.to_string(), |float| float.to_string());
                Err(Error::input(name, found, key.range()))
            }
            _ => Ok(()),
        })
}

/// Checks a section of a list, which errors call by its name there.
fn check_entry(name: &str, keys: &'static [Key], entry: &Value) -> Result<()> {
    let Value::Table(values) = entry else {
        return Err(Error::input(name, entry, Kind::Section(keys).described()));
    };
    if let Some(unknown) = values
        .keys()
        .find(|&value| keys.iter().all(|key| key.name != value))
    {
        let names: Vec<&str> = keys.iter().map(|key| key.name).collect();
        let expected = format!("one of {}", names.join(", "));
        return Err(Error::input(
            format!("{name}.{unknown}"),
            "an unknown key",
            expected,
        ));
    }
    check(keys, values).map_err(|error| match error {
        Error::Input {
            place,
            found,
            expected,
        } => Error::input(format!("{name}.{place}"), found, expected),
        other => other,
    })
}

/// All keys that have values, with their names as `section.key`, in the order of the presets.
pub fn listed(keys: &[Key]) -> Vec<(String, Key)> {
    let below = |key: &Key| match key.kind {
        Kind::Section(keys) => listed(keys)
            .into_iter()
            .map(|(name, inner)| (format!("{}.{name}", key.name), inner))
            .collect(),
        _ => vec![(key.name.to_owned(), *key)],
    };
    keys.iter().flat_map(below).collect()
}

/// The value of `section.key` in a table.
pub fn value<'v>(values: &'v Table, name: &str) -> Option<&'v Value> {
    match name.split_once('.') {
        Some((section, rest)) => value(values.get(section)?.as_table()?, rest),
        None => values.get(name),
    }
}

/// How much of a name is compared with known keys, in bytes (chosen: three times the longest key). Likeness takes as long as the name.
const COMPARED: usize = 200;

/// Which of the known keys is most like a name. One with the wrong section, or with none, is still recognised.
pub fn nearest<'k>(name: &str, known: impl IntoIterator<Item = &'k str>) -> &'k str {
    let name = &name[..name.floor_char_boundary(COMPARED)];
    let last = |key: &str| key.rsplit('.').next().unwrap_or_default().to_owned();
    let likeness = |key: &str| {
        let whole = strsim::jaro_winkler(key, name);
        (whole.max(strsim::jaro_winkler(&last(key), &last(name))), whole)
    };
    let nearest = known.into_iter().max_by(|a, b| {
        let (a, b) = (likeness(a), likeness(b));
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    nearest.unwrap_or_default()
}
