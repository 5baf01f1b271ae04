//! The command line's sub-commands: each has its options and a `run`.

pub mod assign;
pub mod run;
