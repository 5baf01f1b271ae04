//! A grid file: options of a command, and a scenario where it takes one, in which any value may be a list.

use super::Settings;
use super::axis::{Axis, GRID, Kind, MOST_POINTS, POLICY, SEED, VEHICLES, text};
use super::commands::{COMMANDS, Command, Task};
use super::store::checksum;
use crate::mobility::live;
use crate::scenario::Preset;
use assignment::formats;
use kit::choice::Choice as _;
use kit::error::{Error, Result};
use kit::files::Text;
use kit::keys::nearest;
use kit::layers::parse;
use serde_json::json;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// The key that says which command points are.
const COMMAND: &str = "command";

/// The key of the axes that move together.
const ZIP: &str = "zip";

/// All combinations of the values of its axes.
#[derive(Clone, Debug)]
pub struct Grid {
    path: PathBuf,
    command: &'static Command,
    axes: Vec<Axis>,
    /// Axes, by index, that move together; the last group changes fastest from point to point.
    groups: Vec<Vec<usize>>,
    points: usize,
}

/// One combination.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Its number in the grid, from 0.
    pub index: usize,
    /// By axis: which value.
    values: Vec<usize>,
}

impl Point {
    /// Which of an axis's values this point has.
    pub fn value_index(&self, axis: usize) -> usize {
        self.values[axis]
    }
}

impl Grid {
    /// Reads a grid file. `seeds`, if given, replace its seeds.
    ///
    /// # Errors
    /// Names the file and the line or key: an unknown key (with the nearest one), an empty axis, a value of another type,
    /// lists that cannot be zipped, or more than [`MOST_POINTS`] points.
    pub fn read(path: &Path, seeds: Option<&[u64]>) -> Result<Self> {
        let Text { name: place, text } = Text::read(path)?;
        let mut found = parse(&place, &text)?;
        let command = command(&place, found.remove(COMMAND))?;
        let zip = found.remove(ZIP);
        let known = command.known_keys()?;
        let mut values = Table::new();
        flatten(&known, "", found, &mut values);
        if let Some(seeds) = seeds {
            if !command.takes_seeds() {
                let expected = format!("none: `{}` draws nothing at random", command.name);
                return Err(Error::input(
                    "--seeds",
                    format!("{} seeds", seeds.len()),
                    expected,
                ));
            }
            let list = seeds.iter().map(|&seed| Value::Integer(seed.cast_signed()));
            let _replaced = values.insert(SEED.to_owned(), Value::Array(list.collect()));
        }
        if let Some(value) = values.remove("cell.vehicles")
            && values.insert(VEHICLES.to_owned(), value).is_some()
        {
            let found = "both vehicles and cell.vehicles";
            return Err(Error::input(
                format!("{place}: key vehicles"),
                found,
                "one of them",
            ));
        }
        for (key, default) in defaults(command) {
            if !values.contains_key(key) {
                let _none = values.insert(key.to_owned(), default);
            }
        }
        if let Some(key) = values
            .keys()
            .find(|key| known.iter().all(|(name, _)| name != *key))
        {
            let names = known.iter().map(|(name, _)| name.as_str());
            let nearest = nearest(key, names.chain([COMMAND, ZIP]));
            let expected = format!("a key of {}, such as {nearest}", command.whose_keys());
            return Err(Error::input(
                format!("{place}: key {key}"),
                "an unknown key",
                expected,
            ));
        }
        let mut axes = Vec::new();
        for (key, kind) in known {
            if let Some(value) = values.remove(&key) {
                axes.push(Axis::new(&format!("{place}: key {key}"), &key, kind, value)?);
            }
        }
        let groups = groups(&format!("{place}: key zip"), &axes, zip)?;
        let points = groups.iter().try_fold(1_usize, |points, group| {
            points.checked_mul(axes[group[0]].values.len())
        });
        let points = match points {
            Some(points) if points <= MOST_POINTS => points,
            more => {
                let found = more.map_or("more points than can be counted".to_owned(), |n| {
                    format!("{n} points")
                });
                return Err(Error::input(place, found, format!("at most {MOST_POINTS}")));
            }
        };
        Ok(Self {
            path: path.to_owned(),
            command,
            axes,
            groups,
            points,
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What its points are.
    pub const fn command(&self) -> &'static Command {
        self.command
    }

    /// How many points.
    pub const fn points(&self) -> usize {
        self.points
    }

    /// The axes, in the order in which points count them. An axis of one value is a fixed setting.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// Whether two axes move together, as an axis does with itself.
    pub fn together(&self, one: usize, other: usize) -> bool {
        self.groups
            .iter()
            .any(|group| group.contains(&one) && group.contains(&other))
    }

    /// The point of this index, below [`Grid::points`].
    pub fn point(&self, index: usize) -> Point {
        let mut values = vec![0; self.axes.len()];
        let mut rest = index;
        for group in self.groups.iter().rev() {
            let length = self.axes[group[0]].values.len();
            for &axis in group {
                values[axis] = rest % length;
            }
            rest /= length;
        }
        Point { index, values }
    }

    /// The value of an axis, by its index, at a point.
    pub fn value(&self, point: &Point, axis: usize) -> &Value {
        &self.axes[axis].values[point.values[axis]]
    }

    /// Reads and checks a point.
    ///
    /// # Errors
    /// What does not fit, and the point.
    pub fn task(&self, point: &Point) -> Result<Task> {
        let task = (self.command.prepare)(&Settings::new(self, point));
        task.map_err(|error| error.within(self.place(point)))
    }

    /// The file or network that a value of a kind names, if it names one.
    pub fn file(&self, kind: Kind, value: &str) -> Option<PathBuf> {
        let (none, file) = match kind {
            Kind::File(none) => (none, value),
            Kind::Network(none) => (Some(none), value),
            Kind::Mobility => (Some(GRID), live::file_of(value)),
            Kind::Integer | Kind::Number | Kind::Flag | Kind::Text => return None,
        };
        let folder = self.path.parent().unwrap_or(Path::new(""));
        (none != Some(value)).then(|| folder.join(file))
    }

    /// The point for people: file, number and what changes from point to point.
    fn place(&self, point: &Point) -> String {
        let changing = self
            .axes
            .iter()
            .enumerate()
            .filter(|(_, axis)| axis.values.len() > 1);
        let values: Vec<String> = changing
            .map(|(index, axis)| format!("{}={}", axis.key, text(self.value(point, index))))
            .collect();
        format!(
            "{}: point {} ({})",
            self.path.display(),
            point.index,
            values.join(", ")
        )
    }

    /// What the results depend on, as hexadecimal digits: the command, every value, the presets, the contents of all files,
    /// the built-in table, and the program's version. Not the order of lines in the grid's file.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn fingerprint(&self) -> Result<String> {
        let mut inputs = Vec::new();
        for axis in &self.axes {
            for value in &axis.values {
                let Some(path) = self.file(axis.kind, &text(value)) else {
                    continue;
                };
                let files = match axis.kind {
                    Kind::Network(_) => formats::files(&path)?,
                    _ => vec![path],
                };
                for path in files {
                    let bytes = std::fs::read(&path).map_err(|source| Error::file(&path, source))?;
                    inputs.push(checksum(&bytes));
                }
            }
        }
        let axes: Vec<_> = self.axes.iter().map(|axis| (&axis.key, &axis.values)).collect();
        let mut object = json!({
            "version": env!("CARGO_PKG_VERSION"),
            "results": super::outcome::VERSION,
            "presets": Preset::ALL.iter().map(|preset| checksum(preset.values().to_string().as_bytes())).collect::<Vec<_>>(),
            "built_in_table": checksum(firmware::tables::DISTILLED),
            "inputs": inputs,
            "axes": axes,
            "zip": self.groups,
        });
        // A grid that names none has the fingerprint that it had before there were others.
        if self.command.name != COMMANDS[0].name {
            object[COMMAND] = json!(self.command.name);
        }
        Ok(checksum(object.to_string().as_bytes()))
    }
}

/// The command that a grid names.
fn command(place: &str, found: Option<Value>) -> Result<&'static Command> {
    let key = format!("{place}: key {COMMAND}");
    match found {
        None => Ok(COMMANDS[0]),
        Some(Value::String(name)) => <&'static Command>::of_name(&key, &name),
        Some(other) => Err(Error::input(key, other, "the name of one command")),
    }
}

/// Values of keys that a grid of a command need not have.
fn defaults(command: &Command) -> Vec<(&'static str, Value)> {
    let mut defaults = Vec::new();
    if !command.policies.is_empty() {
        let names = command
            .policies
            .iter()
            .map(|kind| Value::String(kind.name.to_owned()));
        defaults.push((POLICY, Value::Array(names.collect())));
    }
    if command.takes_seeds() {
        defaults.push((SEED, Value::Integer(1)));
    }
    defaults
}

/// Takes sections apart: `[radio] max_power_dbm = 23` becomes the key `radio.max_power_dbm`.
fn flatten(known: &[(String, Kind)], prefix: &str, table: Table, flat: &mut Table) {
    for (name, value) in table {
        let key = format!("{prefix}{name}");
        // `mobility` is a section and an option of run; only the section is a table.
        let is_section = known
            .iter()
            .any(|(known, _)| known.starts_with(&format!("{key}.")));
        match value {
            Value::Table(section) if is_section => flatten(known, &format!("{key}."), section, flat),
            value => {
                let _none = flat.insert(key, value);
            }
        }
    }
}

/// Axes that move together, from `zip = [["table", "radio.max_power_dbm"]]`; every other axis is a group of its own.
fn groups(place: &str, axes: &[Axis], zip: Option<Value>) -> Result<Vec<Vec<usize>>> {
    let expected = "lists of keys of this grid, such as [[\"vehicles\", \"worlds\"]]";
    let lists: Vec<Vec<String>> = match zip {
        None => Vec::new(),
        Some(value) => {
            let shown = value.to_string();
            value
                .try_into()
                .map_err(|_| Error::input(place, shown, expected))?
        }
    };
    let mut group_of: Vec<usize> = (0..axes.len()).collect();
    let mut zipped = Vec::new();
    for list in &lists {
        let mut members = Vec::new();
        for key in list {
            let key = if key == "cell.vehicles" { VEHICLES } else { key };
            let axis = axes.iter().position(|axis| axis.key == key);
            let axis = axis.ok_or_else(|| Error::input(place, format!("\"{key}\""), expected))?;
            if zipped.contains(&axis) {
                return Err(Error::input(place, format!("{key} twice"), "every key once"));
            }
            zipped.push(axis);
            members.push(axis);
        }
        let Some(first) = members.iter().copied().min() else {
            return Err(Error::input(place, "an empty list", expected));
        };
        for member in members {
            let (one, other) = (&axes[first], &axes[member]);
            if one.values.len() != other.values.len() {
                let found = format!("{} values of {}", other.values.len(), other.key);
                let expected = format!("{}, as {} has", one.values.len(), one.key);
                return Err(Error::input(place, found, expected));
            }
            group_of[member] = first;
        }
    }
    Ok((0..axes.len())
        .map(|first| (0..axes.len()).filter(|&axis| group_of[axis] == first).collect())
        .filter(|group: &Vec<usize>| !group.is_empty())
        .collect())
}
