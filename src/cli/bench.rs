//! `psrgs-vk bench`: where the time of a step goes.

use std::path::PathBuf;

use psrgs_vk::train::settings::{DeviceChoice, Photographs};

use super::console::Console;

/// Time each GPU pass over warm training steps
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk bench fox --max-side 640
  psrgs-vk bench fox --max-side 640 --init fox-model/point_cloud.ply --json bench.json
  psrgs-vk bench fox --max-side 160 --steps 5 --validate

Fails (exit code 7) when the results are not live: no pairs, or a loss that does not fall.")]
pub(crate) struct Args {
    /// Dataset
    pub(crate) data: PathBuf,
    /// Start from the splats of this PLY file instead of the dataset's points
    #[arg(long, value_name = "FILE.ply")]
    pub(crate) init: Option<PathBuf>,
    /// Steps before timing begins
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub(crate) warm_up: u32,
    /// Steps that are timed
    #[arg(long, value_name = "N", default_value_t = 30)]
    pub(crate) steps: u32,
    /// Highest degree of the spherical harmonics, all in use from the first step
    #[arg(long, value_name = "D", default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=3))]
    pub(crate) sh_degree: u32,
    /// Use the passes of deterministic training
    #[arg(long)]
    pub(crate) deterministic: bool,
    /// Seed of the order of photographs
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Run under core and synchronization validation; fail on any message, or when the layer is not installed
    #[arg(long)]
    pub(crate) validate: bool,
    /// Write the results as JSON
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) photographs: Photographs,
    #[command(flatten)]
    pub(crate) device: DeviceChoice,
}

pub(crate) fn run(_args: &Args, _console: &Console) -> anyhow::Result<()> {
    anyhow::bail!("benchmarks are not part of this build")
}
