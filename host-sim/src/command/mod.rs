//! The command line's sub-commands: each has its options and a `run`.

pub mod assign;
pub mod figures;
pub mod options;
pub mod run;

use crate::error::Result;
use std::process::ExitCode;

/// Ends a command: an error becomes one line on stderr and exit code 2.
pub fn finish(outcome: Result<()>) -> ExitCode {
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}
