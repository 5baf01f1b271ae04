//! The command line of the trainer.

use clap::{Parser, Subcommand};
use std::process::ExitCode;
use trainer::command;

/// Learns actor networks, evaluates them on held-out worlds and exports firmware tables
#[derive(Debug, Parser)]
#[command(version)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Updates per second of the paper's algorithm at the paper's sizes
    Bench(command::bench::BenchArguments),
    /// Distil the ring clock into a small int8 network
    Distil(command::distil::DistilArguments),
    /// Run a learning algorithm
    Train(command::train::TrainArguments),
    /// What a key of a configuration means, its range, unit and source; or all keys
    Explain(command::explain::ExplainArguments),
    /// Train and evaluate the cases of a plan, and write one table
    Study(command::study::StudyArguments),
    /// Ages of a table, or of a training run, on held-out worlds
    Eval(command::eval::EvalArguments),
    /// Whether a table beats other policies: differences on the same worlds, with their intervals
    Compare(command::compare::CompareArguments),
    /// Write a table into the firmware's sources, or prove that the shipped one is reproducible
    Export(command::export::ExportArguments),
    /// The same network as a table for another C_min
    Adapt(command::adapt::AdaptArguments),
    /// Make a key for signing tables, or print a key's public half
    Key(command::key::KeyArguments),
    /// Sign a table, as a package that units take over the air
    Sign(command::sign::SignArguments),
    /// Completions for a shell, such as `source <(trainer completions bash)`
    Completions {
        /// Which shell
        shell: clap_complete::Shell,
    },
}

fn main() -> ExitCode {
    let line: CommandLine = match host_sim::command::parse() {
        Ok(line) => line,
        Err(code) => return code,
    };
    let outcome = match line.command {
        Command::Bench(arguments) => command::bench::run(&arguments),
        Command::Distil(arguments) => command::distil::run(&arguments),
        Command::Train(arguments) => command::train::run(&arguments),
        Command::Explain(arguments) => command::explain::run(&arguments),
        Command::Study(arguments) => command::study::run(&arguments),
        Command::Eval(arguments) => command::eval::run(&arguments),
        Command::Compare(arguments) => command::compare::run(&arguments),
        Command::Export(arguments) => command::export::run(&arguments),
        Command::Adapt(arguments) => command::adapt::run(&arguments),
        Command::Key(arguments) => command::key::run(&arguments),
        Command::Sign(arguments) => command::sign::run(&arguments),
        Command::Completions { shell } => host_sim::command::print_completions::<CommandLine>(shell),
    };
    host_sim::command::finish(outcome)
}
