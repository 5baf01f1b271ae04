//! The command line of the simulator.

use clap::{Parser, Subcommand};
use host_sim::command;
use std::process::ExitCode;

/// Age-of-information scheduling for connected vehicles: the cell around the firmware
#[derive(Debug, Parser)]
#[command(version, args_conflicts_with_subcommands = true)]
struct CommandLine {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    run: command::run::RunArguments,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Ages of all policies on the same worlds, and what they do to travel times (the default)
    Run(command::run::RunArguments),
    /// The closed loop from slot to street: vehicles report incidents, the base station plans routes on what it heard
    Loop(command::closed_loop::LoopArguments),
    /// User equilibrium or system optimum of a road network
    Assign(Box<command::assign::AssignArguments>),
    /// How many vehicles a sub-channel carries at a mean age of at most 10, 100 and 1,000 ms, by policy
    Carry(command::carry::CarryArguments),
    /// The paper's path-planning figures with their data
    Figures(command::figures::FigureArguments),
    /// A grid of scenarios, policies and seeds, whole or one shard of it
    Sweep(command::sweep::SweepArguments),
    /// The results of all shards as one table
    Merge(command::merge::MergeArguments),
    /// Two results of one command side by side: settings that differ, and by how much what came out
    Diff(command::diff::DiffArguments),
    #[cfg(feature = "chip")]
    /// Images in QEMU as vehicles of the cell
    Hil(command::hil::HilArguments),
    #[cfg(feature = "chip")]
    /// What a slot costs on the chip: instructions in QEMU, modelled cycles, memories
    Deadline(command::deadline::DeadlineArguments),
    /// How many slots a second the simulator makes on this machine
    Bench(command::bench::BenchArguments),
    /// Write a scenario with every key, unit, range and source, and its JSON schema
    Init(command::scenario::InitArguments),
    /// What a scenario's keys mean
    Explain(command::explain::ExplainArguments),
    /// The JSON schema of scenario files
    Schema,
    /// Completions for a shell, such as `source <(host-sim completions bash)`
    Completions {
        /// Which shell
        shell: clap_complete::Shell,
    },
}

fn main() -> ExitCode {
    let line: CommandLine = match command::parse() {
        Ok(line) => line,
        Err(code) => return code,
    };
    let outcome = match line.command {
        None => command::run::run(&line.run),
        Some(Command::Run(arguments)) => command::run::run(&arguments),
        Some(Command::Loop(arguments)) => command::closed_loop::run(&arguments),
        Some(Command::Assign(arguments)) => return command::finish_with(command::assign::run(&arguments)),
        Some(Command::Carry(arguments)) => command::carry::run(&arguments),
        Some(Command::Figures(arguments)) => command::figures::run(&arguments),
        Some(Command::Sweep(arguments)) => command::sweep::run(&arguments),
        Some(Command::Merge(arguments)) => command::merge::run(&arguments),
        Some(Command::Diff(arguments)) => command::diff::run(&arguments),
        #[cfg(feature = "chip")]
        Some(Command::Hil(arguments)) => command::hil::run(&arguments),
        #[cfg(feature = "chip")]
        Some(Command::Deadline(arguments)) => command::deadline::run(&arguments),
        Some(Command::Bench(arguments)) => command::bench::run(&arguments),
        Some(Command::Init(arguments)) => command::scenario::init(&arguments),
        Some(Command::Explain(arguments)) => command::scenario::explain(&arguments),
        Some(Command::Schema) => command::scenario::print_schema(),
        Some(Command::Completions { shell }) => command::print_completions::<CommandLine>(shell),
    };
    command::finish(outcome)
}
