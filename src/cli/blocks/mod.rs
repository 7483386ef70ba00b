//! `psrgs-vk blocks`: scenes larger than one machine.

mod merge;
mod part_run;
mod plan;
mod run;
mod status;

use std::time::Instant;

use clap::Subcommand;

pub(crate) use part_run::PartRun;

use super::console::Console;
use super::interrupt::Interrupt;

/// Train a scene larger than one machine: in blocks of the ground, each within limits of splats or memory
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk blocks plan flight --out flight-plan --blocks 4
  psrgs-vk blocks plan flight --out flight-plan --max-device-memory 8GiB
  psrgs-vk blocks run flight-plan
  psrgs-vk blocks merge flight-plan")]
#[command(subcommand_required = true, arg_required_else_help = true, disable_help_subcommand = true)]
pub(crate) struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Plan(Box<plan::Args>),
    Run(Box<run::Args>),
    Merge(Box<merge::Args>),
    Status(status::Args),
}

pub(crate) fn run(
    args: &Args,
    matches: &clap::ArgMatches,
    interrupt: &Interrupt,
    console: &Console,
    started: Instant,
) -> anyhow::Result<()> {
    let own = matches.subcommand().map_or(matches, |(_, of)| of);
    match &args.command {
        Command::Plan(args) => plan::run(args, own, console),
        Command::Run(args) => run::run(args, interrupt, console, started),
        Command::Merge(args) => merge::run(args, console, started),
        Command::Status(args) => status::run(args),
    }
}
