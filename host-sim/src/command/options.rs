//! Options that sub-commands share.

use crate::policy::{Kind, actor};
use crate::report::table::Table;
use crate::report::terminal::{coloured, has_colours};
use crate::scenario::{Preset, ScenarioSource};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use indicatif::{HumanDuration, ProgressBar, ProgressState, ProgressStyle};
use kit::choice::Choice;
use kit::error::{Error, Result};
use kit::layers::sets;
use std::fmt::Write;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Which scenario.
#[derive(Clone, Debug, clap::Args)]
pub struct ScenarioArguments {
    /// TOML file whose keys replace the preset's
    #[arg(long, value_name = "FILE")]
    pub scenario: Option<PathBuf>,
    /// Scenario to start from
    #[arg(long, value_parser = choice::<Preset>(), default_value = Preset::default().name())]
    pub preset: Preset,
    /// Replace one key, such as radio.max_power_dbm=23 (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

impl ScenarioArguments {
    /// Where the scenario comes from.
    pub fn source(&self) -> ScenarioSource {
        ScenarioSource {
            preset: self.preset,
            file: self.scenario.clone(),
            settings: self.set.clone(),
            ..ScenarioSource::default()
        }
    }

    /// Refuses `--set` of a key for which another option is given.
    ///
    /// # Errors
    /// [`Error::Input`] names both.
    pub fn check_not_set(&self, option: &str, key: &str) -> Result<()> {
        match self.set.iter().find(|setting| sets(setting, key)) {
            None => Ok(()),
            Some(setting) => {
                let found = format!("--set {setting} beside it");
                Err(Error::input(option, found, "one of the two"))
            }
        }
    }
}

/// Refuses a table beside policies of which none uses it. No policy means all.
///
/// # Errors
/// [`Error::Input`] names them.
pub fn check_table_is_used(table: Option<&Path>, policies: &[&'static Kind]) -> Result<()> {
    if table.is_none() || policies.is_empty() || policies.iter().any(|policy| policy.uses_table()) {
        return Ok(());
    }
    let expected = format!("--policy {}, which alone uses a table", actor::KIND.name);
    let names: Vec<_> = policies.iter().map(|policy| policy.name).collect();
    let found = format!("only --policy {} beside it", names.join(", "));
    Err(Error::input("--table", found, expected))
}

/// Reads one of the names of a choice; help lists them with their meanings.
pub fn choice<C: Choice + Send + Sync>() -> impl TypedValueParser<Value = C> {
    let values = C::ALL
        .iter()
        .map(|choice| PossibleValue::new(choice.name()).help(choice.meaning()));
    PossibleValuesParser::new(values).try_map(|name| C::of_name("value", &name))
}

/// Reads a whole number within a range.
pub fn within(range: RangeInclusive<u32>) -> impl TypedValueParser<Value = u32> {
    clap::value_parser!(u32).range(i64::from(*range.start())..=i64::from(*range.end()))
}

/// How tables are shown.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub struct TextArguments {
    /// Show all columns of tables, however wide
    #[arg(long)]
    pub wide: bool,
}

impl TextArguments {
    /// A table's text, with policies in their colours where the terminal shows colours.
    pub fn of(self, table: &Table) -> String {
        let text = if self.wide {
            format!("{table:#}")
        } else {
            table.to_string()
        };
        if has_colours() { coloured(&text) } else { text }
    }
}

/// The command that this process was started with, for reports: whoever types it gets the same results. Left out is what does not
/// change them: threads, and `outputs`, the options that say where results go.
pub fn typed(name: &str, outputs: &[&str]) -> String {
    typed_from(std::env::args().skip(1), name, outputs)
}

fn typed_from(words: impl Iterator<Item = String>, name: &str, outputs: &[&str]) -> String {
    let mut words = words.peekable();
    let _ = words.next_if(|word| word == name);
    let mut command = format!("host-sim {name}");
    while let Some(word) = words.next() {
        let (option, value) = word
            .split_once('=')
            .map_or((word.as_str(), None), |(option, value)| (option, Some(value)));
        if option == "--threads" || outputs.contains(&option) {
            if value.is_none() {
                let _ = words.next();
            }
        } else if option != "--wide" {
            command.push(' ');
            command.push_str(&quoted(&word));
        }
    }
    command
}

/// A word as a shell takes it whole.
fn quoted(word: &str) -> String {
    let is_plain = |character: char| character.is_alphanumeric() || "-_=.,/:@+".contains(character);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

/// A progress bar on stderr, unless output is for scripts.
pub fn progress_bar(steps: u64, template: &str, hidden: bool) -> ProgressBar {
    if hidden {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(steps).with_style(style.with_key("left", left))
}

/// The rest by what is done so far: steps come in bursts, from which a rate of late ones reads anything.
fn left(state: &ProgressState, out: &mut dyn Write) {
    let (done, all) = (state.pos(), state.len().unwrap_or(0));
    let rest = all.saturating_sub(done) as f64 / done as f64;
    let written = match Duration::try_from_secs_f64(state.elapsed().as_secs_f64() * rest) {
        Ok(rest) => write!(out, "{:#}", HumanDuration(rest)),
        Err(_) => out.write_str("?"),
    };
    // A text in memory takes everything.
    let _ = written;
}

/// For work whose length is not known: a message and the time it has taken, on stderr.
pub fn progress_spinner() -> ProgressBar {
    let spinner = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {elapsed}") {
        spinner.set_style(style);
    }
    spinner.enable_steady_tick(Duration::from_millis(200));
    spinner
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_repeats_what_was_typed_but_for_where_results_go() {
        let typed = |line: &str| typed_from(line.split(' ').map(str::to_owned), "run", &["--out"]);
        let command =
            typed("run --policy actor --out run --threads 2 --set mobility.x=[1] --out=b --wide --seed 7");
        assert_eq!(
            command,
            "host-sim run --policy actor --set 'mobility.x=[1]' --seed 7"
        );
        assert_eq!(typed("--vehicles 40"), "host-sim run --vehicles 40");
        assert_eq!(quoted("it's"), r"'it'\''s'");
    }
}
