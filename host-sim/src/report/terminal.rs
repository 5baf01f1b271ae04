//! Policies in their colours, where a terminal shows colours and nobody has asked for none.

use super::chart::policy_colours;
use std::io::IsTerminal as _;

/// Whether standard output is to have colours: a terminal, unless `NO_COLOR` is set (no-color.org) or it is a dumb one.
pub fn has_colours() -> bool {
    wants_colours(std::io::stdout().is_terminal(), |name| std::env::var(name).ok())
}

fn wants_colours(is_terminal: bool, variable: impl Fn(&str) -> Option<String>) -> bool {
    let is_unset = |name| variable(name).is_none_or(|value| value.is_empty());
    is_terminal && is_unset("NO_COLOR") && variable("TERM").is_none_or(|terminal| terminal != "dumb")
}

/// A table's text with the names of policies at the beginnings of its lines in their colours.
pub fn coloured(text: &str) -> String {
    let line = |line: &str| {
        let name = line.split(' ').next().unwrap_or_default();
        let found = policy_colours::of(name).filter(|_| line[name.len()..].starts_with("  "));
        found.map_or_else(
            || line.to_owned(),
            |colour| format!("{}{}", colour.on_terminal(name), &line[name.len()..]),
        )
    };
    let lines: Vec<String> = text.split('\n').map(line).collect();
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_policies_are_coloured_and_nothing_else_is() {
        let text = "policy  mean age\nactor       4.01\naloha      13.16\nactor and clock are alike.\n";
        let coloured = coloured(text);
        assert_eq!(
            coloured,
            "policy  mean age\n\u{1b}[38;2;0;114;178mactor\u{1b}[0m       4.01\n\u{1b}[38;2;196;85;0maloha\u{1b}[0m      13.16\n\
             actor and clock are alike.\n"
        );
    }

    #[test]
    fn colours_can_be_refused() {
        let with = |variables: &'static [(&str, &str)]| {
            move |name: &str| {
                variables
                    .iter()
                    .find(|(known, _)| *known == name)
                    .map(|(_, value)| (*value).to_owned())
            }
        };
        assert!(wants_colours(true, with(&[("TERM", "xterm"), ("NO_COLOR", "")])));
        assert!(!wants_colours(true, with(&[("NO_COLOR", "1")])));
        assert!(!wants_colours(true, with(&[("TERM", "dumb")])));
        assert!(!wants_colours(false, with(&[("TERM", "xterm")])));
    }
}
