//! `psrgs-vk eval`: scores of a model on held-out photographs.

use std::path::PathBuf;

use psrgs_vk::train::settings::{DeviceChoice, Photographs};

use super::console::Console;

/// Score a model on the held-out photographs of a dataset
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk eval fox-model/point_cloud.ply fox
  psrgs-vk eval other-trainer.ply fox --max-side 640 --json scores.json")]
pub(crate) struct Args {
    /// Model, a PLY file in the INRIA layout, of this or another trainer
    pub(crate) model: PathBuf,
    /// Dataset
    pub(crate) data: PathBuf,
    /// Write the scores, for each photograph too, as JSON
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    /// Write the renders as PNG into this folder
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Colour behind the splats
    #[arg(long, value_name = "COLOUR", value_parser = ["black", "white"], default_value = "black")]
    pub(crate) background: String,
    /// Draw as a model trained with --antialias [default: what the model file says]
    #[arg(long)]
    pub(crate) antialias: bool,
    #[command(flatten)]
    pub(crate) photographs: Photographs,
    #[command(flatten)]
    pub(crate) device: DeviceChoice,
}

pub(crate) fn run(_args: &Args, _console: &Console) -> anyhow::Result<()> {
    anyhow::bail!("evaluation is not part of this build")
}
