//! `host-sim diff`: two results of one command, side by side.

use crate::difference::{Comparison, Measure, read};
use crate::report::table::{Column, Table};
use kit::error::Result;
use kit::say;
use kit::text::wrapped;
use std::path::PathBuf;

/// Digits with which numbers are shown (chosen: enough to see a difference of a thousandth).
const DIGITS: i32 = 5;

/// Options of `diff`.
#[derive(Clone, Debug, clap::Args)]
pub struct DiffArguments {
    /// A result: run.json, loop.json, what `assign --json` printed, or the folder of a run or a loop
    #[arg(value_name = "A")]
    pub first: PathBuf,
    /// Another of the same command
    #[arg(value_name = "B")]
    pub second: PathBuf,
    /// Show every number of both, also those without an interval and those that are equal
    #[arg(long)]
    pub all: bool,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub json: bool,
}

/// Compares and reports.
///
/// # Errors
/// What is no result, or results of two commands.
pub fn run(arguments: &DiffArguments) -> Result<()> {
    let names = [&arguments.first, &arguments.second].map(|path| path.display().to_string());
    let (first, second) = (read(&arguments.first)?, read(&arguments.second)?);
    let comparison = Comparison::new([(&names[0], &first), (&names[1], &second)])?;
    if arguments.json {
        say!("{}", comparison.to_json());
        return Ok(());
    }
    say!("A: {}\nB: {}\n", names[0], names[1]);
    say!("{}", settings(&comparison));
    for (names, whose) in comparison.only.iter().zip(["A", "B"]) {
        if !names.is_empty() {
            say!(
                "{}",
                wrapped(&format!("In {whose} alone: {}.", names.join(", ")), "    ")
            );
        }
    }
    say!("\n{}", table(&comparison, arguments.all)?.to_string().trim_end());
    Ok(())
}

fn settings(comparison: &Comparison) -> String {
    if comparison.settings.is_empty() {
        return "Settings: all the same.".to_owned();
    }
    let lines = comparison.settings.iter().map(|setting| {
        let [a, b] = &setting.values;
        // The scenario's keys are known without its name.
        let key = setting.key.trim_start_matches("scenario.");
        wrapped(&format!("  {key}: {a} in A, {b} in B"), "      ")
    });
    let lines: Vec<String> = lines.collect();
    format!("Settings that differ:\n{}", lines.join("\n"))
}

fn table(comparison: &Comparison, all: bool) -> Result<Table> {
    let has_intervals = comparison.measures.iter().any(Measure::is_quoted);
    let is_shown =
        |measure: &&Measure| all || measure.is_quoted() || (!has_intervals && measure.difference() != 0.0);
    let shown: Vec<&Measure> = comparison.measures.iter().filter(is_shown).collect();
    let text = |name, of: fn(&Measure) -> Option<String>| {
        Column::text(name, shown.iter().map(|measure| of(measure)))
    };
    let mut columns = vec![
        text("of", |measure| Some(measure.of.clone())),
        text("number", |measure| Some(measure.key.clone())),
        text("A", |measure| Some(digits(measure.values[0], measure))),
        text("B", |measure| Some(digits(measure.values[1], measure))),
        text("B less A", |measure| Some(digits(measure.difference(), measure))),
    ];
    if has_intervals {
        columns.push(text("+-95 %", |measure| {
            measure.half_width.map(|half| digits(half, measure))
        }));
        columns.push(text("", |measure| {
            measure
                .differs()
                .map(|differs| if differs { "*" } else { "" }.to_owned())
        }));
    }
    let mut table = Table::new(columns)?.titled(&format!("Two results of `{}`", comparison.command));
    let left_out = comparison.measures.iter().filter(|measure| !is_shown(measure));
    let left_out = left_out.filter(|measure| measure.difference() != 0.0).count();
    if has_intervals {
        table.note("*: the interval of the difference leaves out zero. Without: these worlds cannot tell the two apart.");
        let paired = comparison
            .measures
            .iter()
            .filter(|measure| measure.paired)
            .count();
        table.note(if paired > 0 {
            "World by world where the results have each world's number, since seed and worlds are the same; elsewhere as if independent, \
             which is wider than need be."
        } else {
            "The two count as independent: seed or number of worlds differ, or there is one world."
        });
    }
    if shown.is_empty() {
        table.note("No number differs.");
    }
    if left_out > 0 {
        table.note(&format!(
            "{left_out} more numbers differ, without an interval; --all shows them."
        ));
    }
    Ok(table)
}

/// A number with as many decimals as give the larger of a pair [`DIGITS`] digits; counts have none.
fn digits(value: f64, Measure { values: [a, b], .. }: &Measure) -> String {
    let size = a.abs().max(b.abs());
    if value == 0.0 || (a.fract() == 0.0 && b.fract() == 0.0) {
        return format!("{value}");
    }
    let before = libm::floor(libm::log10(size)) as i32 + 1;
    if !(-3..=9).contains(&before) {
        return format!("{value:.3e}");
    }
    let decimals = (DIGITS - before).max(0);
    if value.abs() < 0.5 * libm::pow(0.1, f64::from(decimals)) {
        return format!("{value:.1e}");
    }
    format!("{value:.*}", decimals as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_has_the_digits_of_what_it_is_of() {
        let shown = |a, b| {
            let measure = Measure {
                of: String::new(),
                key: String::new(),
                values: [a, b],
                half_widths: [None; 2],
                half_width: None,
                paired: false,
            };
            [a, b, b - a].map(|value| digits(value, &measure))
        };
        assert_eq!(shown(3.920_81, 3.925_63), ["3.9208", "3.9256", "0.0048"]);
        assert_eq!(shown(7_480_225.3, 7_480_000.0), ["7480225", "7480000", "-225"]);
        assert_eq!(shown(1e-11, 0.0), ["1.000e-11", "0", "-1.000e-11"]);
        assert_eq!(shown(4.3249e-4, 7e-10), ["0.00043249", "7.0e-10", "-0.00043249"]);
        assert_eq!(shown(4.0, 8.0), ["4", "8", "4"]);
    }
}
