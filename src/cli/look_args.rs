//! The options of the commands that draw a model file.

use std::path::Path;

use psrgs_vk::scene::Frame;
use psrgs_vk::train::settings::{BlendingVariants, DeviceChoice};
use psrgs_vk::vk::Gpu;

use super::colour::Colour;
use super::console::Console;
use super::device;
use super::model_file::{DrawingArgs, Drawn, ModelFile};
use super::model_frame::FrameArgs;

/// Where a model lies, what is behind it, and what draws it.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct SceneArgs {
    /// Colour behind the splats: black, white, #rrggbb, or R,G,B with numbers from 0 to 1
    #[arg(long, value_name = "COLOUR", default_value = "black")]
    pub(crate) background: Colour,
    #[command(flatten)]
    pub(crate) frame: FrameArgs,
    #[command(flatten)]
    pub(crate) device: DeviceChoice,
    #[command(flatten)]
    pub(crate) blending: BlendingVariants,
}

/// How a model looks.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct LookArgs {
    /// Draw as a model trained with --antialias [default: what the model file says]
    #[arg(long)]
    pub(crate) antialias: bool,
    #[command(flatten)]
    pub(crate) scene: SceneArgs,
    #[command(flatten)]
    pub(crate) drawing: DrawingArgs,
}

/// What becomes of damaged files.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct StrictArgs {
    /// Refuse a file with a record that cannot be used; otherwise up to a tenth of them are left out, with a warning
    #[arg(long)]
    pub(crate) strict: bool,
}

impl SceneArgs {
    /// Opens the device.
    pub(crate) fn open(&self, console: &Console) -> anyhow::Result<Gpu> {
        device::open(&self.device, false, console)
    }

    /// Uploads a model in the coordinates of a dataset's scene.
    pub(crate) fn upload(
        &self,
        (gpu, model): (&Gpu, &ModelFile),
        drawing: &DrawingArgs,
        frame: &Frame,
    ) -> anyhow::Result<Drawn> {
        Ok(model.upload(gpu, &self.blending, drawing, frame, &self.background)?)
    }
}

impl LookArgs {
    /// Reads a model.
    pub(crate) fn read(&self, model: &Path, strict: bool, console: &Console) -> anyhow::Result<ModelFile> {
        ModelFile::read(model, self.antialias, &self.scene.frame, strict, console)
    }

    /// Uploads a model in the coordinates of a dataset's scene.
    pub(crate) fn upload(&self, gpu: &Gpu, model: &ModelFile, frame: &Frame) -> anyhow::Result<Drawn> {
        self.scene.upload((gpu, model), &self.drawing, frame)
    }
}
