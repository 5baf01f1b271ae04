//! What the keys of a configuration mean, for `host-sim explain` and `trainer explain`.

use kit::error::{Error, Result};
use kit::keys::{Key, Kind, listed, nearest, value};
use kit::say;
use kit::text::wrapped;
use serde_json::{Value, json};

/// Options of `explain`.
#[derive(Clone, Debug, clap::Args)]
pub struct ExplainArguments {
    /// A key such as radio.max_power_dbm, or a section; none lists all keys
    #[arg(value_name = "KEY")]
    pub key: Option<String>,
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
}

/// Says what a key, a section or every key means. A key's default is its value in the first of the presets that has it.
///
/// # Errors
/// An unknown key.
pub fn explain(
    keys: &[Key],
    presets: &[(&'static str, toml::Table)],
    arguments: &ExplainArguments,
) -> Result<()> {
    let wanted = arguments.key.as_deref().unwrap_or_default();
    let all = listed(keys);
    let is_wanted = |name: &str| {
        let rest = name.strip_prefix(wanted);
        rest.is_some_and(|rest| wanted.is_empty() || rest.is_empty() || rest.starts_with('.'))
    };
    let explained: Vec<_> = all.iter().filter(|(name, _)| is_wanted(name)).collect();
    if explained.is_empty() {
        let nearest = nearest(wanted, all.iter().map(|(name, _)| name.as_str()));
        return Err(Error::input(
            "explain",
            wanted,
            format!("{nearest}, or another key"),
        ));
    }
    let default = |name: &str| presets.iter().find_map(|(_, values)| value(values, name));
    if arguments.json {
        let object = |(name, key): &&(String, Key)| to_json(name, key, default(name));
        say!(
            "{}",
            json!({ "keys": explained.iter().map(object).collect::<Vec<_>>() })
        );
        return Ok(());
    }
    if let [(name, key)] = explained[..] {
        say!("{}", page(name, key, presets));
        return Ok(());
    }
    for (name, key) in explained {
        let default = default(name).map_or(String::new(), ToString::to_string);
        let lines = [
            format!("{name} = {default}"),
            format!(
                "    {} Range: {}. Source: {}",
                key.meaning,
                key.range(),
                key.source
            ),
        ];
        say!("{}", lines.map(|line| wrapped(&line, "    ")).join("\n"));
    }
    Ok(())
}

/// All that is known of one key.
fn page(name: &str, key: &Key, presets: &[(&'static str, toml::Table)]) -> String {
    let mut values = presets
        .iter()
        .filter_map(|(preset, values)| Some((preset, value(values, name)?)));
    let default = values.next().map(|(_, value)| value);
    let mut lines = vec![
        format!("{name} = {}", default.map_or(String::new(), ToString::to_string)),
        format!("  {}", key.meaning),
    ];
    match key.kind {
        Kind::Choice(choices) => {
            let choices = choices();
            lines.extend(
                choices
                    .iter()
                    .map(|(name, meaning)| format!("  \"{name}\": {meaning}")),
            );
        }
        _ => lines.push(format!("  range: {}", key.range())),
    }
    if let Kind::List(Kind::Section(keys), _) = key.kind {
        let line = |key: &Key| format!("  {}: {} Range: {}", key.name, key.meaning, key.range());
        lines.extend(keys.iter().map(line));
    }
    lines.push(format!("  source: {}", key.source));
    for (preset, value) in values.filter(|(_, value)| Some(*value) != default) {
        lines.push(format!("  in preset {preset}: {value}"));
    }
    let wrapped: Vec<String> = lines.iter().map(|line| wrapped(line, "    ")).collect();
    wrapped.join("\n")
}

fn to_json(name: &str, key: &Key, default: Option<&toml::Value>) -> Value {
    let mut object = json!({
        "key": name,
        "unit": key.unit,
        "default": default,
        "meaning": key.meaning,
        "source": key.source,
    });
    bounds(key, &mut object);
    object
}

/// Adds what a value must be like, in the words of JSON schemas.
pub(super) fn bounds(key: &Key, object: &mut Value) {
    let add = |object: &mut Value, kind: Kind| match kind {
        Kind::Whole => {
            object["type"] = json!("integer");
            (object["minimum"], object["maximum"]) = (json!(key.least as i64), json!(key.most as i64));
        }
        Kind::Number => {
            object["type"] = json!("number");
            (object["minimum"], object["maximum"]) = (json!(key.least), json!(key.most));
        }
        Kind::Flag => object["type"] = json!("boolean"),
        Kind::Text => object["type"] = json!("string"),
        Kind::Choice(choices) => object["enum"] = choices().iter().map(|(name, _)| *name).collect(),
        Kind::List(..) => object["type"] = json!("array"),
        Kind::Section(_) => object["type"] = json!("object"),
    };
    add(object, key.kind);
    if let Kind::List(each, length) = key.kind {
        let mut items = json!({});
        add(&mut items, *each);
        object["items"] = items;
        object["minItems"] = json!(length.unwrap_or(0));
        object["maxItems"] = json!(length.unwrap_or(key.longest));
    }
}
