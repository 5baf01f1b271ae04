//! `host-sim init`, `explain` and `schema`: what a scenario may say, for people and for their editors.

use super::explain::{ExplainArguments, bounds};
use super::options::choice;
use crate::scenario::{Preset, Scenario};
use kit::choice::Choice as _;
use kit::error::{Error, Result};
use kit::files::write_set;
use kit::keys::{Key, Kind};
use kit::say;
use serde_json::{Value, json};
use std::ffi::OsStr;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use toml::Table;

/// Options of `init`.
#[derive(Clone, Debug, clap::Args)]
pub struct InitArguments {
    /// File to write; its JSON schema comes beside it. An existing file is left alone
    #[arg(value_name = "FILE", default_value = "scenario.toml")]
    pub file: PathBuf,
    /// Scenario to start from
    #[arg(long, value_parser = choice::<Preset>(), default_value = Preset::default().name())]
    pub preset: Preset,
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

/// Says what a key, a section or every key of a scenario means.
///
/// # Errors
/// An unknown key.
pub fn explain(arguments: &ExplainArguments) -> Result<()> {
    let presets: Vec<_> = Preset::ALL
        .iter()
        .map(|preset| (preset.name(), preset.values()))
        .collect();
    super::explain::explain(Scenario::KEYS, &presets, arguments)
}

/// Prints the schema.
///
/// # Errors
/// None.
pub fn print_schema() -> Result<()> {
    say!("{:#}", schema());
    Ok(())
}

/// The scenario of a preset as TOML, with meaning, range and source of each key.
fn commented(preset: Preset, schema_name: &str) -> String {
    let mut text = format!(
        "#:schema ./{schema_name}\n# Behind each value: what it means; its range and unit; where it comes from.\n"
    );
    write_keys(&mut text, Scenario::KEYS, &preset.values(), "");
    text
}

fn write_keys(text: &mut String, keys: &[Key], values: &Table, section: &str) {
    for key in keys {
        let meaning = key.meaning.trim_end_matches('.');
        match (key.kind, values.get(key.name)) {
            (Kind::Section(keys), Some(toml::Value::Table(values))) => {
                let head = format!("{section}{}", key.name);
                let _ = writeln!(text, "\n[{head}] # {meaning}");
                write_keys(text, keys, values, &format!("{head}."));
            }
            (_, value) => {
                let setting = match value {
                    Some(value) => format!("{} = {value}", key.name),
                    None => format!("# {} =", key.name),
                };
                let _ = writeln!(text, "{setting:<40}# {meaning}; {}; {}", key.range(), key.source);
            }
        }
    }
}

/// The JSON schema of a scenario file. No key is required: the preset gives what a file leaves out.
fn schema() -> Value {
    let mut schema = json!({
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Freshlane scenario",
    });
    describe(&mut schema, Scenario::KEYS, &Preset::Paper.values());
    schema
}

/// Makes a schema that of a section.
fn describe(schema: &mut Value, keys: &[Key], defaults: &Table) {
    schema["type"] = json!("object");
    schema["additionalProperties"] = json!(false);
    for key in keys {
        let property = &mut schema["properties"][key.name];
        match (key.kind, defaults.get(key.name)) {
            (Kind::Section(keys), Some(toml::Value::Table(defaults))) => {
                property["description"] = json!(key.meaning);
                describe(property, keys, defaults);
            }
            (_, default) => {
                property["description"] = json!(format!("{} ({}; {})", key.meaning, key.range(), key.source));
                property["default"] = json!(default);
                bounds(key, property);
            }
        }
    }
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
