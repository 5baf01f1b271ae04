//! JSON objects against their schemas under `docs/schemas`, strictly: a key that no schema names is an error, and every key that a
//! schema names has to come up in some object.
//!
//! This is the part of JSON Schema that those schemas use; a keyword beyond it is an error.

use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Keywords that say something to readers alone. `unit` is ours: JSON Schema lets other keywords stand.
const ANNOTATIONS: [&str; 6] = ["$schema", "title", "description", "unit", "default", "$defs"];

/// A schema file and the way to a place in it.
type Place = (String, String);

/// The schemas of a folder, and which of their keys have come up.
pub struct Schemas {
    files: BTreeMap<String, Value>,
    seen: BTreeSet<Place>,
}

/// Where the schemas lie.
pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/schemas")
}

impl Schemas {
    /// Reads all of them.
    ///
    /// # Panics
    /// If one is no JSON.
    pub fn read() -> Self {
        let entries = std::fs::read_dir(folder()).unwrap();
        let files = entries.map(|entry| {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            (
                name,
                serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap(),
            )
        });
        Self {
            files: files.collect(),
            seen: BTreeSet::new(),
        }
    }

    /// Their file names.
    pub fn names(&self) -> BTreeSet<&str> {
        self.files.keys().map(String::as_str).collect()
    }

    /// One of them.
    pub fn file(&self, name: &str) -> &Value {
        &self.files[name]
    }

    /// Holds a value against a schema file.
    ///
    /// # Panics
    /// Where it does not fit, with the value's place.
    pub fn check(&mut self, file: &str, value: &Value, what: &str) {
        assert!(self.files.contains_key(file), "{what}: no schema {file}");
        self.walk(&(file.to_owned(), String::new()), value, what);
    }

    fn walk(&mut self, (file, pointer): &Place, value: &Value, at: &str) {
        let schema = self.files[file].pointer(pointer).unwrap().clone();
        let schema = schema.as_object().unwrap();
        let below = |keyword: &str| (file.clone(), format!("{pointer}/{keyword}"));
        if let Some(types) = schema.get("type") {
            let named = |name: &Value| is_of(value, name.as_str().unwrap());
            let fits = types
                .as_array()
                .map_or_else(|| named(types), |any| any.iter().any(named));
            assert!(fits, "{at}: found {value}, expected {types} ({file}{pointer})");
        }
        for (keyword, said) in schema {
            match keyword.as_str() {
                "type" | "additionalProperties" | "patternProperties" => {}
                _ if ANNOTATIONS.contains(&keyword.as_str()) => {}
                "$ref" => {
                    let (other, place) = said
                        .as_str()
                        .unwrap()
                        .split_once('#')
                        .unwrap_or_else(|| (said.as_str().unwrap(), ""));
                    let other = if other.is_empty() { file } else { other };
                    self.walk(&(other.to_owned(), place.to_owned()), value, at);
                }
                "enum" => assert!(
                    said.as_array().unwrap().contains(value),
                    "{at}: {value}, expected {said}"
                ),
                "minimum" => assert!(
                    value.as_f64() >= said.as_f64() || value.is_null(),
                    "{at}: {value}"
                ),
                "maximum" => assert!(value.as_f64() <= said.as_f64(), "{at}: {value}"),
                "minItems" => assert!(
                    items(value).len() as u64 >= said.as_u64().unwrap(),
                    "{at}: {value}"
                ),
                "maxItems" => assert!(
                    items(value).len() as u64 <= said.as_u64().unwrap(),
                    "{at}: {value}"
                ),
                "items" => {
                    for (index, item) in items(value).iter().enumerate() {
                        self.walk(&below("items"), item, &format!("{at}[{index}]"));
                    }
                }
                "required" => {
                    for key in said.as_array().unwrap() {
                        let is_there = value.is_null() || value.get(key.as_str().unwrap()).is_some();
                        assert!(is_there, "{at}: {key} is missing");
                    }
                }
                "properties" => {}
                other => panic!("{file}{pointer}: the keyword {other} is not checked here"),
            }
        }
        for (key, value) in value.as_object().unwrap_or(&Map::new()) {
            let at = format!("{at}.{key}");
            let is_named =
                |keyword: &str, name: &str| schema.get(keyword).is_some_and(|said| said.get(name).is_some());
            let place = if is_named("properties", key) {
                below(&format!("properties/{key}"))
            } else if is_named("patternProperties", "/") && key.contains('/') {
                below("patternProperties/~1")
            } else if schema.get("additionalProperties").is_some_and(Value::is_object) {
                below("additionalProperties")
            } else if schema.contains_key("$ref") {
                continue;
            } else {
                panic!("{at}: a key that no schema describes ({file}{pointer})");
            };
            self.seen.insert(place.clone());
            self.walk(&place, value, &at);
        }
    }

    /// Every key of every schema: its place and what is said of it.
    pub fn keys(&self) -> Vec<(Place, &Value)> {
        let mut found = Vec::new();
        for (file, schema) in &self.files {
            collect(file, String::new(), schema, &mut found);
        }
        found
    }

    /// Keys that no object had.
    pub fn unseen(&self) -> Vec<String> {
        let keys = self.keys().into_iter().map(|(place, _)| place);
        let unseen = keys.filter(|place| !self.seen.contains(place));
        unseen.map(|(file, pointer)| format!("{file}{pointer}")).collect()
    }
}

fn items(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

fn is_of(value: &Value, name: &str) -> bool {
    match name {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        other => panic!("no type of JSON: {other}"),
    }
}

/// All keys below a schema.
fn collect<'s>(file: &str, pointer: String, schema: &'s Value, found: &mut Vec<(Place, &'s Value)>) {
    let named = ["properties", "patternProperties", "$defs"];
    for keyword in named {
        for (key, below) in schema
            .get(keyword)
            .and_then(Value::as_object)
            .into_iter()
            .flatten()
        {
            let place = format!("{pointer}/{keyword}/{}", key.replace('/', "~1"));
            if keyword != "$defs" {
                found.push(((file.to_owned(), place.clone()), below));
            }
            collect(file, place, below, found);
        }
    }
    for keyword in ["items", "additionalProperties"] {
        if let Some(below) = schema.get(keyword).filter(|below| below.is_object()) {
            collect(file, format!("{pointer}/{keyword}"), below, found);
        }
    }
}
