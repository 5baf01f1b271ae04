//! The command line's sub-commands: each has its options and a `run`.

pub mod assign;
pub mod bench;
pub mod carry;
pub mod closed_loop;
#[cfg(feature = "chip")]
pub mod deadline;
pub mod diff;
pub mod explain;
pub mod figures;
#[cfg(feature = "chip")]
pub mod hil;
pub mod merge;
pub mod options;
pub mod refusal;
pub mod run;
pub mod scenario;
pub mod sweep;

use crate::lanes::Vectors;
use clap::error::ErrorKind;
use kit::error::Result;
use kit::output;
use kit::text::WIDTH;
use kit::{remark, say};
use std::process::ExitCode;

/// Reads the command line. Help and version go to stdout as they are; anything wrong, also with the vector unit that
/// the environment asks for, becomes one line on stderr and exit code 2.
///
/// # Errors
/// The exit code to end with.
pub fn parse<P: clap::Parser>() -> std::result::Result<P, ExitCode> {
    let mut command = P::command().max_term_width(WIDTH);
    let matches = command.try_get_matches_from_mut(std::env::args_os());
    let parsed = matches.and_then(|mut matches| P::from_arg_matches_mut(&mut matches));
    let line = parsed.map_err(|error| {
        let error = error.format(&mut command);
        if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) {
            say!("{}", error.to_string().trim_end());
            return finish(Ok(()));
        }
        remark!("{}", refusal::line(&error, &command));
        ExitCode::from(2)
    })?;
    match Vectors::chosen() {
        Ok(_) => Ok(line),
        Err(error) => Err(finish(Err(error))),
    }
}

/// Prints a program's completion script for a shell.
///
/// # Errors
/// None.
pub fn print_completions<P: clap::CommandFactory>(shell: clap_complete::Shell) -> Result<()> {
    let mut command = P::command();
    let name = command.get_name().to_owned();
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command, name, &mut script);
    say!("{}", String::from_utf8_lossy(&script).trim_end());
    Ok(())
}

/// Ends a command: an error, also a standard output that took not everything, becomes one line on stderr and exit code 2.
pub fn finish(outcome: Result<()>) -> ExitCode {
    finish_with(outcome.map(|()| ExitCode::SUCCESS))
}

/// As [`finish`], for a command that ends with a code of its own.
pub fn finish_with(outcome: Result<ExitCode>) -> ExitCode {
    let unsaid = output::failure().map(|kind| format!("standard output: {kind}"));
    let error = match (outcome, unsaid) {
        (Ok(code), None) => return code,
        (Ok(_), Some(unsaid)) => unsaid,
        (Err(error), _) => error.to_string(),
    };
    remark!("error: {error}");
    ExitCode::from(2)
}
