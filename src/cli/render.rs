//! `psrgs-vk render`: pictures of a model from the cameras of a dataset.

use std::path::PathBuf;

use super::console::Console;

/// Render a model from the cameras of a dataset
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk render fox-model/point_cloud.ply --cameras fox --out pictures
  psrgs-vk render fox-model/point_cloud.ply --cameras fox --views test --depth --out pictures")]
pub(crate) struct Args {
    /// Model, a PLY file in the INRIA layout
    pub(crate) model: PathBuf,
    /// Dataset whose cameras are used; its photographs are not needed
    #[arg(long, value_name = "DATA")]
    pub(crate) cameras: PathBuf,
    /// Folder for the pictures
    #[arg(long, value_name = "DIR", default_value = "renders")]
    pub(crate) out: PathBuf,
    /// Cameras to render: all, train or test (every 8th by sorted name)
    #[arg(long, value_enum, default_value_t = Views::All)]
    pub(crate) views: Views,
    /// Pictures are reduced until their longer side has at most this many pixels
    #[arg(long, value_name = "PX", default_value_t = 1600)]
    pub(crate) max_side: u32,
    /// Also write depth (along the camera's axis) and normals as EXR
    #[arg(long)]
    pub(crate) depth: bool,
    /// Colour behind the splats
    #[arg(long, value_name = "COLOUR", value_parser = ["black", "white"], default_value = "black")]
    pub(crate) background: String,
    /// Draw as a model trained with --antialias [default: what the model file says]
    #[arg(long)]
    pub(crate) antialias: bool,
    #[command(flatten)]
    pub(crate) device: psrgs_vk::train::settings::DeviceChoice,
}

/// Cameras of a dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Views {
    All,
    Train,
    Test,
}

pub(crate) fn run(_args: &Args, _console: &Console) -> anyhow::Result<()> {
    anyhow::bail!("rendering is not part of this build")
}
