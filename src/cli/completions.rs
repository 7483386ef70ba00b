//! `psrgs-vk completions SHELL`: completion scripts.

use super::console;

/// Print the completion script of a shell
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk completions bash > ~/.local/share/bash-completion/completions/psrgs-vk
  psrgs-vk completions fish > ~/.config/fish/completions/psrgs-vk.fish")]
pub(crate) struct Args {
    /// Which shell
    shell: clap_complete::Shell,
}

pub(crate) fn run(args: &Args, command: &mut clap::Command) -> anyhow::Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, command, "psrgs-vk", &mut script);
    console::print(&String::from_utf8(script)?)
}
