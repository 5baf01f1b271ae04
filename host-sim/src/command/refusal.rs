//! What is wrong with a command line, in the words of all other errors.

use clap::error::{ContextKind, ContextValue, ErrorKind};
use kit::error::Error;
use kit::keys::nearest;
use std::error::Error as _;

/// The one line for an error of the parser.
pub fn line(error: &clap::Error, command: &clap::Command) -> String {
    let told = told(error, command).map(|error| format!("error: {error}"));
    told.unwrap_or_else(|| parsers_own(error))
}

/// `None` for a kind that has no place, finding and expectation.
fn told(error: &clap::Error, command: &clap::Command) -> Option<Error> {
    let text = |kind| match error.get(kind)? {
        ContextValue::String(text) => Some(text.clone()),
        ContextValue::Strings(texts) => Some(texts.join(", ")),
        _ => None,
    };
    let option = || text(ContextKind::InvalidArg).map(|option| bare(&option));
    let help = format!("`{} --help` lists them", command.get_name());
    Some(match error.kind() {
        ErrorKind::InvalidValue => {
            let found = text(ContextKind::InvalidValue)?;
            let found = if found.is_empty() {
                "no value".to_owned()
            } else {
                found
            };
            let Some(ContextValue::Strings(choices)) = error.get(ContextKind::ValidValue) else {
                return Some(Error::input(option()?, found, "a value"));
            };
            let wanted = found.to_lowercase();
            let near = nearest(&wanted, choices.iter().map(String::as_str)).to_owned();
            let others = choices.iter().filter(|choice| **choice != near).cloned();
            let all: Vec<String> = std::iter::once(near.clone()).chain(others).collect();
            Error::input(option()?, found, all.join(", "))
        }
        ErrorKind::ValueValidation => {
            let reason = error.source().map(ToString::to_string).unwrap_or_default();
            Error::input(option()?, text(ContextKind::InvalidValue)?, expectation(&reason))
        }
        ErrorKind::UnknownArgument => {
            let suggested = text(ContextKind::SuggestedArg).map(|option| bare(&option));
            let expected = suggested.map_or(format!("an option; {help}"), |near| format!("{near}; {help}"));
            Error::input(option()?, "no option of this name", expected)
        }
        ErrorKind::InvalidSubcommand => {
            let found = text(ContextKind::InvalidSubcommand)?;
            let near = nearest(
                &found.to_lowercase(),
                command.get_subcommands().map(clap::Command::get_name),
            );
            Error::input(&found, "no command of this name", format!("{near}; {help}"))
        }
        ErrorKind::MissingRequiredArgument => {
            Error::input("command line", "too few options", text(ContextKind::InvalidArg)?)
        }
        ErrorKind::ArgumentConflict => {
            let other = text(ContextKind::PriorArg)?;
            let twice = bare(&other) == option()?;
            let found = if twice {
                "it twice".to_owned()
            } else {
                format!("{} beside it", bare(&other))
            };
            Error::input(option()?, found, if twice { "once" } else { "one of them" })
        }
        _ => return None,
    })
}

/// `--worlds <WORLDS>` as people type it.
fn bare(option: &str) -> String {
    option.split_whitespace().next().unwrap_or(option).to_owned()
}

/// What a value should have been, from why it could not be read.
fn expectation(reason: &str) -> String {
    match reason {
        "invalid digit found in string" | "cannot parse integer from empty string" => {
            "a whole number".to_owned()
        }
        "number too large to fit in target type" => "a smaller number".to_owned(),
        "number too small to fit in target type" => "a larger number".to_owned(),
        "invalid float literal" | "cannot parse float from empty string" => "a number".to_owned(),
        _ => match reason.split_once(" is not in ") {
            Some((_, range)) => range.replace("..=", " to "),
            None => reason.to_owned(),
        },
    }
}

/// The parser's text as one line.
fn parsers_own(error: &clap::Error) -> String {
    let text = error.to_string();
    let lines = text
        .lines()
        .map(str::trim)
        .take_while(|line| !line.starts_with("Usage:"));
    let line: Vec<&str> = lines
        .filter(|line| !line.is_empty() && !line.starts_with("For more"))
        .collect();
    line.join(" ")
}
