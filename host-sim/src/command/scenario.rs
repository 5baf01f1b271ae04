//! `host-sim init`, `explain` and `schema`: what a scenario may say, for people and for their editors.

use crate::report::text_table::{Column, TextTable};
use crate::scenario::{KEYS, Key, Preset, nearest_key, section_meaning};
use kit::error::{Error, Result};
use kit::files::write_set;
use kit::say;
use serde_json::{Value, json};
use std::ffi::OsStr;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Options of `init`.
#[derive(Clone, Debug, clap::Args)]
pub struct InitArguments {
    /// File to write; its JSON schema comes beside it. An existing file is left alone
    #[arg(value_name = "FILE", default_value = "scenario.toml")]
    pub file: PathBuf,
    /// Scenario to start from
    #[arg(long, value_enum, default_value_t)]
    pub preset: Preset,
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
}

/// Options of `explain`.
#[derive(Clone, Debug, clap::Args)]
pub struct ExplainArguments {
    /// A key, such as radio.max_power_dbm, or a section; none lists all keys
    #[arg(value_name = "KEY")]
    pub key: Option<String>,
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
}

/// Writes a scenario that says everything about each of its keys, and its schema.
///
/// # Errors
/// If a file is there already, or cannot be written.
pub fn init(arguments: &InitArguments) -> Result<()> {
    let schema_path = write_scenario(&arguments.file, arguments.preset)?;
    if arguments.json {
        say!("{}", json!({ "files": [arguments.file, schema_path] }));
    } else {
        say!(
            "Written: {} with every key, unit, range and source, and {} for editors that know JSON schemas.",
            arguments.file.display(),
            schema_path.display()
        );
    }
    Ok(())
}

/// Writes both files; the schema's path.
fn write_scenario(path: &Path, preset: Preset) -> Result<PathBuf> {
    let Some(name) = path.file_name() else {
        return Err(Error::input(path.display(), "no file name", "a file to write"));
    };
    let schema_path = path.with_extension("schema.json");
    if let Some(there) = [path, &schema_path].into_iter().find(|path| path.exists()) {
        return Err(Error::input(
            there.display(),
            "a file",
            "none, which `init` would overwrite",
        ));
    }
    let text = |name: &OsStr| name.to_string_lossy().into_owned();
    let schema_name = text(schema_path.file_name().unwrap_or(name));
    let files = [
        (text(name), commented(preset, &schema_name)),
        (schema_name, format!("{:#}\n", schema())),
    ];
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    write_set(folder.unwrap_or(Path::new(".")), &files)?;
    Ok(schema_path)
}

/// Says what a key, a section or every key means.
///
/// # Errors
/// An unknown key.
pub fn explain(arguments: &ExplainArguments) -> Result<()> {
    let wanted = arguments.key.as_deref().unwrap_or_default();
    let in_section = |key: &&Key| wanted.is_empty() || key.name == wanted || key.parts().0 == wanted;
    let keys: Vec<&Key> = KEYS.iter().filter(in_section).collect();
    if keys.is_empty() {
        return Err(Error::input(
            "explain",
            wanted,
            format!("{}, or another key", nearest_key(wanted)),
        ));
    }
    if arguments.json {
        say!(
            "{}",
            json!({ "keys": keys.iter().map(|key| to_json(key)).collect::<Vec<_>>() })
        );
        return Ok(());
    }
    if let [key] = keys[..] {
        let (meaning, source) = key.meaning_and_source();
        say!(
            "{} = {}\n  {meaning}\n  range: {}\n  source: {source}",
            key.name,
            value(key, Preset::Paper),
            key.range()
        );
        return Ok(());
    }
    let mut table = TextTable::new(
        "",
        [
            Column::text("key"),
            Column::text("default"),
            Column::text("range"),
            Column::text("meaning"),
            Column::text("source"),
        ],
    );
    for key in keys {
        let (meaning, source) = key.meaning_and_source();
        table.row([
            key.name.into(),
            value(key, Preset::Paper).into(),
            key.range().into(),
            meaning.into(),
            source.into(),
        ]);
    }
    say!("{}", table.to_string().trim_end());
    Ok(())
}

/// Prints the schema.
///
/// # Errors
/// None.
pub fn print_schema() -> Result<()> {
    say!("{:#}", schema());
    Ok(())
}

/// A key's value in a preset, as TOML.
fn value(key: &Key, preset: Preset) -> String {
    key.value(&preset.values())
        .map_or(String::new(), ToString::to_string)
}

fn to_json(key: &Key) -> Value {
    let (meaning, source) = key.meaning_and_source();
    let mut object = json!({
        "key": key.name,
        "unit": key.unit,
        "default": number(key, Preset::Paper),
        "meaning": meaning,
        "source": source,
    });
    object["minimum"] = bound(key, key.least);
    object["maximum"] = bound(key, key.most);
    object
}

/// A bound as a whole number where the key takes only those.
fn bound(key: &Key, value: f64) -> Value {
    if key.is_whole() {
        json!(value as i64)
    } else {
        json!(value)
    }
}

fn number(key: &Key, preset: Preset) -> Value {
    let values = preset.values();
    match key.value(&values) {
        Some(toml::Value::Integer(whole)) => json!(whole),
        Some(toml::Value::Float(float)) => json!(float),
        _ => Value::Null,
    }
}

/// The scenario of a preset as TOML, with unit, range, meaning and source of each key.
fn commented(preset: Preset, schema_name: &str) -> String {
    let mut text = format!(
        "#:schema ./{schema_name}\n# Behind each value: its unit and range; what it means; where it comes from.\n"
    );
    let mut section = "";
    for key in KEYS {
        let (head, name) = key.parts();
        if head != section {
            section = head;
            let _ = writeln!(text, "\n[{section}] # {}", section_meaning(section));
        }
        let (meaning, source) = key.meaning_and_source();
        let setting = format!("{name} = {}", value(key, preset));
        let _ = writeln!(text, "{setting:<40}# {}; {meaning}; {source}", key.range());
    }
    text
}

/// The JSON schema of a scenario file. No key is required: the preset gives what a file leaves out.
fn schema() -> Value {
    let mut sections = serde_json::Map::new();
    for key in KEYS {
        let (section, name) = key.parts();
        let section = sections.entry(section).or_insert_with(|| {
            json!({
                "type": "object",
                "description": section_meaning(section),
                "additionalProperties": false,
                "properties": {},
            })
        });
        let (meaning, source) = key.meaning_and_source();
        section["properties"][name] = json!({
            "type": if key.is_whole() { "integer" } else { "number" },
            "minimum": bound(key, key.least),
            "maximum": bound(key, key.most),
            "default": number(key, Preset::Paper),
            "description": format!("{meaning} ({}; {source})", key.range()),
        });
    }
    json!({
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Freshlane scenario",
        "type": "object",
        "additionalProperties": false,
        "properties": sections,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::ScenarioSource;

    #[test]
    fn a_written_scenario_reads_as_its_preset() {
        for preset in [Preset::Paper, Preset::Companion] {
            let folder = tempfile::tempdir().unwrap();
            let file = folder.path().join("mine.toml");
            write_scenario(&file, preset).unwrap();
            let read = ScenarioSource {
                file: Some(file.clone()),
                ..ScenarioSource::default()
            }
            .read()
            .unwrap();
            let expected = ScenarioSource {
                preset,
                ..ScenarioSource::default()
            }
            .read()
            .unwrap();
            assert_eq!(read, expected);
            let refusal = write_scenario(&file, preset).unwrap_err().to_string();
            assert!(refusal.contains("would overwrite"), "{refusal}");
        }
    }
}
