//! `psrgs-vk demo`: a made-up aerial scene of known geometry, trained.

use std::path::PathBuf;

use super::console::Console;

/// Make a small aerial scene of known geometry, train on it and leave a report
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk demo --out demo-out                       about five minutes on two CPU cores
  psrgs-vk demo --out world --images 80 --max-side 640 --no-train")]
pub(crate) struct Args {
    /// Folder for the scene; the trained model goes to DIR/trained
    #[arg(long, value_name = "DIR", default_value = "demo-out")]
    pub(crate) out: PathBuf,
    /// Photographs
    #[arg(long, value_name = "N", default_value_t = 40)]
    pub(crate) images: u32,
    /// Longer side of a photograph in pixels
    #[arg(long, value_name = "PX", default_value_t = 320)]
    pub(crate) max_side: u32,
    /// Side of the square site in metres
    #[arg(long, value_name = "M", default_value_t = 80.0)]
    pub(crate) extent: f64,
    /// Seed of the scene and of training
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub(crate) seed: u64,
    /// Training steps
    #[arg(long, value_name = "N", default_value_t = 1000)]
    pub(crate) iterations: u32,
    /// Only make the scene
    #[arg(long)]
    pub(crate) no_train: bool,
    #[command(flatten)]
    pub(crate) device: psrgs_vk::train::settings::DeviceChoice,
}

pub(crate) fn run(_args: &Args, _console: &Console) -> anyhow::Result<()> {
    anyhow::bail!("the demo is not part of this build")
}
