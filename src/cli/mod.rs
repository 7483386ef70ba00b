//! The command line: one file per subcommand, and the parts that commands share.

mod asked;
mod bench;
mod blocks;
mod check;
mod colour;
mod compare;
mod compiling;
mod completions;
mod console;
mod demo;
mod demo_world;
mod device;
mod driver_hint;
mod eval;
mod exit;
mod export;
mod exposure_args;
mod finished;
mod geo_args;
mod held_out;
mod info;
mod interrupt;
mod live_page;
mod lod;
mod look_args;
mod lpips;
mod map;
mod map_accuracy;
mod map_frame;
mod model_file;
mod model_frame;
mod model_page;
mod options;
mod output_guard;
mod outputs;
mod passes;
mod pictures;
mod plain;
mod points;
mod presets;
mod progress;
mod render;
mod resize_args;
mod run_folder;
mod saliency;
mod settings_mismatch;
mod stages;
mod stereo;
mod train;
mod view;
mod weights;

use std::process::ExitCode;
use std::time::Instant;

use clap::{ArgAction, ArgMatches, CommandFactory, FromArgMatches, Parser, Subcommand};

use console::{Console, Level};
use interrupt::Interrupt;

const EXAMPLES: &str = "\
Examples:
  psrgs-vk train fox --out fox-model          train on fox/images with the cameras of fox/sparse/0
  psrgs-vk train fox --out quick --max-side 640 --iterations 2000
  psrgs-vk train --resume fox-model           go on after an interruption
  psrgs-vk eval fox-model/point_cloud.ply fox score a model on the held-out photographs
  psrgs-vk export fox-model/point_cloud.ply --out fox.sog
  psrgs-vk demo --out demo-out                a made-up aerial scene, trained, with a report to look at
  psrgs-vk info                               devices, and what was picked on the one in use";

/// Train Gaussian splats from posed photographs on any Vulkan 1.3 device.
#[derive(Parser)]
#[command(name = "psrgs-vk", version, about, after_help = EXAMPLES, max_term_width = 110, arg_required_else_help = true)]
#[command(subcommand_required = true, disable_help_subcommand = true)]
struct Cli {
    /// Say only what went wrong
    #[arg(short, long, global = true, conflicts_with = "verbose", display_order = 900)]
    quiet: bool,
    /// Say more
    #[arg(short, long, global = true, action = ArgAction::Count, display_order = 901)]
    verbose: u8,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Train(Box<train::Args>),
    View(view::Args),
    Render(render::Args),
    Map(Box<map::Args>),
    Eval(eval::Args),
    Export(Box<export::Args>),
    Lod(lod::Args),
    Points(Box<points::Args>),
    Demo(demo::Args),
    Bench(bench::Args),
    Blocks(blocks::Args),
    Check(Box<check::Args>),
    Compare(compare::Args),
    Saliency(saliency::Args),
    Stereo(stereo::Args),
    Info(info::Args),
    Passes(passes::Args),
    Options(options::Args),
    Weights(weights::Args),
    Completions(completions::Args),
}

/// The command with all its options. Settings of the library begin as those of the 3DGS reference. A training without a
/// named method takes the better one.
fn program() -> clap::Command {
    let better = |c: clap::Command| c.mut_arg("method", |arg| arg.default_value(train::METHOD.name()));
    Cli::command()
        .mut_subcommand("train", better)
        .mut_subcommand("blocks", |blocks| blocks.mut_subcommand("plan", better))
}

/// Runs the command. Returns its exit code and prints an error to standard error.
pub(crate) fn main() -> ExitCode {
    let started = Instant::now();
    let matches = match program().try_get_matches() {
        Ok(matches) => matches,
        Err(error) => wrong_arguments(&error),
    };
    let cli = match Cli::from_arg_matches(&matches) {
        Ok(cli) => cli,
        Err(error) => wrong_arguments(&error),
    };
    let level = match (cli.quiet, cli.verbose) {
        (true, _) => Level::Quiet,
        (false, 0) => Level::Normal,
        (false, _) => Level::Verbose,
    };
    let console = Console::new(level);
    let outcome = run(&cli.command, &matches, &console, started);
    match outcome.and_then(|()| silent(&console)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if console::is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            console::error(exit::message(&error), &exit::remedies(&error));
            ExitCode::from(exit::code(&error))
        }
    }
}

/// Ends the program over its arguments. They may contain file names that a shell expanded.
fn wrong_arguments(error: &clap::Error) -> ! {
    if let Some(clap::error::ContextValue::String(name)) = error.get(clap::error::ContextKind::InvalidArg)
        && error.kind() == clap::error::ErrorKind::UnknownArgument
        && let Some(remedy) = asked::no_option(name, has_set())
    {
        console::error(&remedy, &[]);
        std::process::exit(error.exit_code())
    }
    let text = error.render().to_string();
    if error.use_stderr() && plain::plain(&text) != text {
        console::error(text.trim_end().trim_start_matches("error: "), &[]);
        std::process::exit(error.exit_code())
    }
    error.exit()
}

/// Whether the command on the command line has `--set`.
fn has_set() -> bool {
    let word = std::env::args_os().skip(1).find(|word| !word.to_string_lossy().starts_with('-'));
    word.is_some_and(|word| word == "train" || word == "bench" || word == "blocks")
}

/// Fails where the validation layer was on and has reported anything until all devices were closed.
fn silent(console: &Console) -> anyhow::Result<()> {
    let messages = console.messages_of_devices();
    match messages.first() {
        None => Ok(()),
        Some(first) => {
            Err(exit::Failure::Check(format!("{} validation messages, the first: {first}", messages.len())).into())
        }
    }
}

fn run(command: &Command, matches: &ArgMatches, console: &Console, started: Instant) -> anyhow::Result<()> {
    let own = matches.subcommand().map_or(matches, |(_, of)| of);
    let interrupt = &Interrupt::listen()?;
    match command {
        Command::Train(args) => train::run(args, own, interrupt, console, started),
        Command::View(args) => view::run(args, interrupt, console),
        Command::Render(args) => render::run(args, console),
        Command::Map(args) => map::run(args, console),
        Command::Eval(args) => eval::run(args, console, started),
        Command::Export(args) => export::run(args, console),
        Command::Lod(args) => lod::run(args, console),
        Command::Points(args) => points::run(args, console),
        Command::Demo(args) => demo::run(args, interrupt, console, started),
        Command::Bench(args) => bench::run(args, console),
        Command::Blocks(args) => blocks::run(args, own, interrupt, console, started),
        Command::Check(args) => check::run(args, own, console),
        Command::Compare(args) => compare::run(args, interrupt, console),
        Command::Saliency(args) => saliency::run(args, console),
        Command::Stereo(args) => stereo::run(args, console, started),
        Command::Info(args) => info::run(args, console),
        Command::Passes(args) => passes::run(args),
        Command::Options(options::Args {}) => options::run(program()),
        Command::Weights(args) => weights::run(args, console),
        Command::Completions(args) => completions::run(args, &mut program()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_do_not_contradict_each_other() {
        program().debug_assert();
    }
}
