//! `psrgs-vk info`: devices, limits, and what was picked and why.

use super::console::Console;

/// List Vulkan devices, their limits, and which capabilities were picked and why
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Device to describe: index or part of a name [default: the one that training would use]
    #[arg(long, value_name = "D", env = "PSRGS_DEVICE")]
    pub(crate) device: Option<String>,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
}

pub(crate) fn run(_args: &Args, _console: &Console) -> anyhow::Result<()> {
    anyhow::bail!("device information is not part of this build")
}
