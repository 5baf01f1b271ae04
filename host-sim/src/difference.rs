//! Two results of one command, side by side: which settings differ, and by how much what came out.
//!
//! Results are the JSON objects that commands print. Policies, cases, delays and classes are found by their names. Where both have the
//! same seed and as many worlds, the difference is taken world by world: what a world's luck does to both cancels out.

use crate::age::AgeSummary;
use kit::error::{Error, Result};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// A command whose results can be compared.
#[derive(Debug)]
struct Kind {
    command: &'static str,
    /// A key that only its objects have.
    mark: &'static str,
    /// Keys that say what was asked for; the rest came out.
    settings: &'static [&'static str],
}

static KINDS: [Kind; 3] = [
    Kind {
        command: "run",
        mark: "bound_age_ms",
        settings: &["scenario", "seed", "slots", "vehicles", "warmup", "worlds"],
    },
    Kind {
        command: "loop",
        mark: "cases",
        settings: &[
            "base_stations",
            "delay_s",
            "metres_per_unit",
            "network",
            "roads",
            "scenario",
            "seed",
            "traffic",
            "worlds",
        ],
    },
    Kind {
        command: "assign",
        mark: "relative_gap",
        settings: &[
            "gap_asked_for",
            "intrazonal_demand",
            "links",
            "pairs",
            "passenger_car_equivalent",
            "total_demand",
            "zones",
        ],
    },
];

/// Lists of things, and the key that names each.
const NAMED: [(&str, &str); 3] = [
    ("policies", "policy"),
    ("delayed", "delay_s"),
    ("classes", "name"),
];

/// What a key of the half width of an interval has more than the key of its number.
const INTERVAL: &str = "_ci95";

/// What a key of the numbers of all worlds has more than the key of their mean.
const BY_WORLD: &str = "world_";

/// A setting that differs.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Its name.
    pub key: String,
    /// Its values; null where it is not set.
    pub values: [Value; 2],
}

/// A number that both results have.
#[derive(Clone, Debug, PartialEq)]
pub struct Measure {
    /// Whose: a policy, a case, a class; empty for the whole.
    pub of: String,
    /// Its key.
    pub key: String,
    /// In each result.
    pub values: [f64; 2],
    /// Half the width of each value's 95 % interval.
    pub half_widths: [Option<f64>; 2],
    /// The same of the difference.
    pub half_width: Option<f64>,
    /// Whether that is of differences world by world.
    pub paired: bool,
}

impl Measure {
    /// The second value less the first.
    pub fn difference(&self) -> f64 {
        self.values[1] - self.values[0]
    }

    /// Whether the interval of the difference leaves out zero.
    pub fn differs(&self) -> Option<bool> {
        self.half_width.map(|half| self.difference().abs() > half)
    }

    /// Whether the intervals of the two overlap.
    pub fn intervals_overlap(&self) -> Option<bool> {
        let [a, b] = self.half_widths;
        Some(self.difference().abs() <= a? + b?)
    }

    /// Whether it has something to show: an interval, or two values.
    pub fn is_quoted(&self) -> bool {
        self.half_width.is_some()
    }
}

/// Two results of one command.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The command.
    pub command: &'static str,
    /// Settings that differ.
    pub settings: Vec<Setting>,
    /// Policies, cases and classes of one result alone.
    pub only: [Vec<String>; 2],
    /// Numbers of both.
    pub measures: Vec<Measure>,
}

/// A result from its file, or from the folder that a command wrote.
///
/// # Errors
/// What is no result, with its place.
pub fn read(path: &Path) -> Result<Value> {
    let file = file_of(path)?;
    let text = fs::read_to_string(&file).map_err(|error| Error::file(&file, error))?;
    serde_json::from_str(&text).map_err(|error| {
        let place = format!("{}:{}", file.display(), error.line());
        Error::input(place, error, "a JSON object, as --json prints")
    })
}

fn file_of(path: &Path) -> Result<PathBuf> {
    if !path.is_dir() {
        return Ok(path.to_owned());
    }
    let names = ["run.json", "loop.json"];
    let found: Vec<PathBuf> = names
        .iter()
        .map(|name| path.join(name))
        .filter(|file| file.exists())
        .collect();
    match found.as_slice() {
        [one] => Ok(one.clone()),
        [] => Err(Error::input(
            path.display(),
            "neither run.json nor loop.json",
            "one of them, or a file",
        )),
        _ => Err(Error::input(
            path.display(),
            "run.json and loop.json",
            "one of them: name the file",
        )),
    }
}

impl Comparison {
    /// Compares two results, each with the place that it comes from.
    ///
    /// # Errors
    /// What is no result, or results of two commands.
    pub fn new(results: [(&str, &Value); 2]) -> Result<Self> {
        let [a, b] = results.map(|(place, value)| kind(place, value));
        let (a, b) = (a?, b?);
        if a.command != b.command {
            let found = format!("a result of `{}`", b.command);
            return Err(Error::input(
                results[1].0,
                found,
                format!("one of `{}`, as the other", a.command),
            ));
        }
        let [first, second] = results.map(|(_, value)| Flat::new(a, value));
        let keys = first.settings.keys().chain(
            second
                .settings
                .keys()
                .filter(|key| !first.settings.contains_key(*key)),
        );
        let settings = keys.map(|key| Setting {
            key: key.clone(),
            values: [&first, &second].map(|flat| flat.settings.get(key).cloned().unwrap_or_default()),
        });
        let only = |own: &Flat, other: &Flat| {
            let names = own.groups.iter().map(|(name, _)| name);
            names
                .filter(|name| other.group(name).is_none())
                .cloned()
                .collect()
        };
        let is_paired = ["seed", "worlds"]
            .iter()
            .all(|key| first.settings.get(*key) == second.settings.get(*key));
        let groups = first
            .groups
            .iter()
            .filter_map(|(name, own)| Some((name, own, second.group(name)?)));
        let measures = groups.flat_map(|(name, own, other)| measures(name, [own, other], is_paired));
        Ok(Self {
            command: a.command,
            settings: settings
                .filter(|setting| setting.values[0] != setting.values[1])
                .collect(),
            only: [only(&first, &second), only(&second, &first)],
            measures: measures.collect(),
        })
    }

    /// The JSON object.
    pub fn to_json(&self) -> Value {
        let setting = |Setting { key, values: [a, b] }: &Setting| json!({ "key": key, "a": a, "b": b });
        let measure = |measure: &Measure| {
            json!({
                "of": measure.of,
                "key": measure.key,
                "a": measure.values[0],
                "b": measure.values[1],
                "difference": measure.difference(),
                "difference_ci95": measure.half_width,
                "paired": measure.paired,
                "intervals_overlap": measure.intervals_overlap(),
                "differs": measure.differs(),
            })
        };
        json!({
            "command": self.command,
            "settings": self.settings.iter().map(setting).collect::<Vec<_>>(),
            "only_a": self.only[0],
            "only_b": self.only[1],
            "measures": self.measures.iter().map(measure).collect::<Vec<_>>(),
        })
    }
}

fn kind(place: &str, result: &Value) -> Result<&'static Kind> {
    let found = KINDS.iter().find(|kind| result.get(kind.mark).is_some());
    found.ok_or_else(|| {
        let commands: Vec<_> = KINDS.iter().map(|kind| format!("`{}`", kind.command)).collect();
        Error::input(
            place,
            "another object",
            format!("a result of {}", commands.join(", ")),
        )
    })
}

/// A result without its nesting.
struct Flat {
    settings: BTreeMap<String, Value>,
    /// Everything else, by whom it is of, in the order of the result. Values are numbers and lists of numbers.
    groups: Vec<(String, BTreeMap<String, Value>)>,
}

impl Flat {
    fn new(kind: &Kind, result: &Value) -> Self {
        let mut flat = Self {
            settings: BTreeMap::new(),
            groups: vec![(String::new(), BTreeMap::new())],
        };
        for (key, value) in result.as_object().into_iter().flatten() {
            let named = NAMED.iter().find(|(list, _)| list == key);
            match (named, value) {
                (Some((_, name)), Value::Array(list)) => {
                    for entry in list {
                        let name = match &entry[*name] {
                            Value::String(name) => name.clone(),
                            number => format!("{number} s late"),
                        };
                        flat.add_group(kind, name, entry);
                    }
                }
                (None, Value::Object(cases)) if key == kind.mark => {
                    cases
                        .iter()
                        .for_each(|(name, case)| flat.add_group(kind, name.clone(), case));
                }
                _ => flat.add(kind, 0, key, value),
            }
        }
        flat
    }

    fn add_group(&mut self, kind: &Kind, name: String, entry: &Value) {
        self.groups.push((name, BTreeMap::new()));
        let index = self.groups.len() - 1;
        for (key, value) in entry.as_object().into_iter().flatten() {
            self.add(kind, index, key, value);
        }
    }

    fn add(&mut self, kind: &Kind, group: usize, key: &str, value: &Value) {
        let is_setting = kind.settings.contains(&key.split('.').next().unwrap_or(key));
        match value {
            // What a mean's vehicles share with no other list: numbers by world.
            Value::Object(inner) => add_all(inner, key, |key, value| self.add(kind, group, &key, value)),
            _ if is_setting && (group == 0 || kind.command == "run") => {
                let _ = self.settings.insert(key.to_owned(), value.clone());
            }
            Value::Number(_) | Value::Array(_) if !is_setting && !is_of_the_machine(key) => {
                let _ = self.groups[group].1.insert(key.to_owned(), value.clone());
            }
            _ => {}
        }
    }

    fn group(&self, name: &str) -> Option<&BTreeMap<String, Value>> {
        let found = self.groups.iter().find(|(known, _)| known == name);
        found.map(|(_, values)| values)
    }
}

fn add_all(inner: &Map<String, Value>, outer: &str, mut add: impl FnMut(String, &Value)) {
    for (key, value) in inner {
        add(format!("{outer}.{key}"), value);
    }
}

/// Times of a wall clock say nothing of what was computed.
fn is_of_the_machine(key: &str) -> bool {
    key.starts_with("seconds") || key.ends_with("_per_second")
}

/// The numbers that both of a pair have.
fn measures<'m>(
    of: &'m str,
    groups: [&'m BTreeMap<String, Value>; 2],
    is_paired: bool,
) -> impl Iterator<Item = Measure> + 'm {
    let [own, other] = groups;
    own.iter().filter_map(move |(key, value)| {
        if key.contains(INTERVAL) {
            return None;
        }
        let values = [value.as_f64()?, other.get(key)?.as_f64()?];
        let half_widths = groups.map(|group| interval_of(group, key));
        let worlds = groups.map(|group| by_world(group, key));
        let (half_width, paired) = match worlds {
            [Some(first), Some(second)] if is_paired && first.len() == second.len() => {
                let differences: Vec<f64> = second.iter().zip(&first).map(|(b, a)| b - a).collect();
                (AgeSummary::mean_and_interval(&differences).1, true)
            }
            _ => {
                let [a, b] = half_widths;
                (a.zip(b).map(|(a, b)| libm::hypot(a, b)), false)
            }
        };
        Some(Measure {
            of: of.to_owned(),
            key: key.clone(),
            values,
            half_widths,
            half_width,
            paired: paired && half_width.is_some(),
        })
    })
}

/// Half the width of a number's interval.
fn interval_of(group: &BTreeMap<String, Value>, key: &str) -> Option<f64> {
    let intervals = group.iter().filter(|(name, _)| name.contains(INTERVAL));
    intervals
        .filter(|(name, _)| name.replace(INTERVAL, "") == key)
        .find_map(|(_, value)| value.as_f64())
}

/// A number's values in all worlds.
fn by_world(group: &BTreeMap<String, Value>, key: &str) -> Option<Vec<f64>> {
    let list = group.get(&format!("{BY_WORLD}{key}"))?.as_array()?;
    list.iter().map(Value::as_f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(seed: u64, worlds: [f64; 3], half: f64) -> Value {
        json!({
            "bound_age_ms": 3.85,
            "seed": seed,
            "scenario": { "cell": { "vehicles": 20 + seed } },
            "policies": [{
                "policy": "actor",
                "worlds": 3,
                "slots": 10,
                "slots_per_second": 1e6 * seed as f64,
                "mean_age_ms": worlds.iter().sum::<f64>() / 3.0,
                "mean_age_ci95_ms": half,
                "world_mean_age_ms": worlds,
                "traffic": { "informed_mean_trip_time_s": 70.0 },
            }],
        })
    }

    fn compare(a: &Value, b: &Value) -> Comparison {
        Comparison::new([("a", a), ("b", b)]).unwrap()
    }

    fn measure<'c>(comparison: &'c Comparison, key: &str) -> &'c Measure {
        comparison
            .measures
            .iter()
            .find(|measure| measure.key == key)
            .unwrap()
    }

    #[test]
    fn the_same_worlds_are_compared_one_by_one_and_others_by_their_intervals() {
        // Worlds differ by far more than the two results do.
        let (a, b) = (run(1, [2.0, 5.0, 8.0], 7.45), run(1, [2.2, 5.1, 8.3], 7.5));
        let paired = compare(&a, &b);
        assert!(paired.settings.is_empty(), "{:?}", paired.settings);
        let age = measure(&paired, "mean_age_ms");
        assert!(age.paired && (age.difference() - 0.2).abs() < 1e-12);
        // Deviations 0, -0.1 and 0.1: 4.303 times 0.1 over the root of 3.
        assert!((age.half_width.unwrap() - 0.2484).abs() < 1e-3, "{age:?}");
        assert_eq!(
            (age.intervals_overlap(), age.differs()),
            (Some(true), Some(false))
        );
        assert!(
            paired
                .measures
                .iter()
                .all(|measure| !measure.key.contains("second"))
        );

        let c = run(2, [12.0, 12.1, 12.2], 0.25);
        let apart = compare(&a, &c);
        let age = measure(&apart, "mean_age_ms");
        assert!(!age.paired && (age.half_width.unwrap() - libm::hypot(7.45, 0.25)).abs() < 1e-12);
        assert_eq!(
            (age.intervals_overlap(), age.differs()),
            (Some(true), Some(false))
        );
        let keys: Vec<&str> = apart
            .settings
            .iter()
            .map(|setting| setting.key.as_str())
            .collect();
        assert_eq!(keys, ["scenario.cell.vehicles", "seed"]);
        assert_eq!(
            measure(&apart, "traffic.informed_mean_trip_time_s").half_width,
            None
        );
    }

    #[test]
    fn results_of_two_commands_are_refused() {
        let refusal = Comparison::new([
            ("a.json", &run(1, [1.0; 3], 0.1)),
            ("b.json", &json!({ "relative_gap": 0.0 })),
        ]);
        let text = refusal.unwrap_err().to_string();
        assert_eq!(
            text,
            "b.json: found a result of `assign`, expected one of `run`, as the other"
        );
    }
}
