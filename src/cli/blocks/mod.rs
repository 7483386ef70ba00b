//! `psrgs-vk blocks`: scenes larger than one machine.

mod plan;

use clap::Subcommand;

use super::console::Console;

/// Train a scene larger than one machine: in blocks of the ground, each within limits of splats or memory
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk blocks plan flight --out flight-plan --blocks 4
  psrgs-vk blocks plan flight --out flight-plan --max-device-memory 8GiB")]
#[command(subcommand_required = true, arg_required_else_help = true, disable_help_subcommand = true)]
pub(crate) struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Plan(Box<plan::Args>),
}

pub(crate) fn run(args: &Args, matches: &clap::ArgMatches, console: &Console) -> anyhow::Result<()> {
    let own = matches.subcommand().map_or(matches, |(_, of)| of);
    match &args.command {
        Command::Plan(args) => plan::run(args, own, console),
    }
}
