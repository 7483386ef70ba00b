//! A model file in the coordinates of a dataset's scene, rendered from its cameras.

use clap::builder::PossibleValuesParser;
use psrgs_vk::raster::ShStorage;
use std::path::Path;

use psrgs_vk::format::{FrameFile, ply, splats};
use psrgs_vk::map::SurfaceModel;
use psrgs_vk::numbers::counted;
use psrgs_vk::pass::camera::Projection;
use psrgs_vk::raster::{DepthProbe, Look, NamedVariants, Picture, Planes, RenderView, Shown, Variants, Viewer};
use psrgs_vk::scene::{Camera, Frame, Gaussians, Similarity};
use psrgs_vk::train::settings::BlendingVariants;
use psrgs_vk::vk::{self, Buffer, Gpu};

use super::colour::Colour;
use super::console::Console;
use super::exit::Failure;
use super::model_frame::{FrameArgs, ModelFrame};
use super::run_folder::MODEL;

/// The content of a model file.
pub(crate) struct ModelFile {
    model: ply::Model,
    /// The coordinates of the model.
    pub(crate) frame: ModelFrame,
    /// Size of the file in bytes.
    pub(crate) bytes: u64,
    /// Whether the model is rendered with the anti-aliasing factor.
    pub(crate) antialias: bool,
}

/// Splats of a model by the stage of their origin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum SplatSet {
    /// Splats that existed at the end of the low-frequency stage.
    Low,
    /// Splats added later.
    High,
    /// All.
    Full,
}

impl ModelFile {
    /// The model with only the splats of a set. `file` is the model's file, for messages.
    pub(crate) fn of_set(mut self, set: SplatSet, file: &Path) -> Result<Self, Failure> {
        let all = self.splats() as u32;
        let rows = match (set, self.model.constrained) {
            (SplatSet::Full, _) => return Ok(self),
            (SplatSet::Low, Some(first)) => 0..all.min(first as u32),
            (SplatSet::High, Some(first)) => all.min(first as u32)..all,
            (_, None) => {
                return Err(Failure::Input(format!(
                    "{}: --part: the file has no line 'comment psrgs-vk constrained N', so its splats are not told \
                     apart by stage; train by psrgs or psrgs-paper, which have such stages, or leave --part out",
                    file.display()
                )));
            }
        };
        self.model.gaussians = self.model.gaussians.rows(&rows.collect::<Vec<_>>());
        Ok(self)
    }

    /// Reads a model. Its coordinates are those that `frame` names, else the dataset's. Editors drop the comments of a
    /// file, and the shift of the coordinates with them: then `frame.json` beside the model has the shift. `antialias`
    /// is the user's choice; `None` takes that of the file.
    pub(crate) fn read(
        file: &Path,
        antialias: bool,
        frame: &FrameArgs,
        strict: bool,
        console: &Console,
    ) -> anyhow::Result<Self> {
        if file.is_dir() {
            let instead = file.join(MODEL);
            let remedy =
                if instead.is_file() { format!("; its model is {}", instead.display()) } else { String::new() };
            return Err(Failure::Input(format!("{}: a folder, and a model is a file{remedy}", file.display())).into());
        }
        let given = frame.read()?;
        // A frame that is given is that of the coordinates in the file.
        let (mut model, by) = match &given {
            Some(_) => (splats::read(file, strict)?, None),
            None => {
                let splats::Placed { model, by } = splats::read_placed(file, strict)?;
                (model, by)
            }
        };
        model.left_out.iter().for_each(|left_out| console.warn(left_out));
        let mut known_from = match (&by, model.version.is_some()) {
            (Some(_), _) => "by the .frame.json beside it",
            (None, true) => "written by psrgs-vk",
            (None, false) => "assumed; else give --frame",
        };
        if given.is_none()
            && by.is_none()
            && model.version.is_none()
            && model.shift == [0.0; 3]
            && let Some(beside) = FrameFile::beside(file)?
        {
            known_from = "frame.json beside it";
            model.shift = beside.shift;
        }
        let frame = match given {
            Some((to_dataset, file)) => ModelFrame::Other { to_dataset, file: file.to_owned() },
            None => ModelFrame::Dataset { offset: model.shift, known_from },
        };
        let bytes = std::fs::metadata(file).map(|m| m.len()).unwrap_or(0);
        let antialias = antialias || model.antialias.unwrap_or(false);
        console.say(format_args!(
            "{}: {}, spherical harmonics of degree {}; coordinates: {frame}",
            file.display(),
            counted(model.gaussians.len(), "splat"),
            model.sh_degree
        ));
        Ok(Self { model, frame, bytes, antialias })
    }

    /// The model, in the coordinates of its file less its shift.
    pub(crate) fn model(&self) -> &ply::Model {
        &self.model
    }

    /// Another model in the same coordinates.
    pub(crate) fn with_model(&self, model: ply::Model) -> Self {
        Self { model, frame: self.frame.clone(), bytes: self.bytes, antialias: self.antialias }
    }

    /// Number of splats.
    pub(crate) fn splats(&self) -> usize {
        self.model.gaussians.len()
    }

    /// Number of splats of the low-frequency stage, if the file tells; these splats come first.
    pub(crate) fn constrained(&self) -> Option<usize> {
        self.model.constrained
    }

    /// Uploads the model in the coordinates of a dataset's scene.
    pub(crate) fn upload(
        &self,
        gpu: &Gpu,
        forms: &BlendingVariants,
        drawing: &DrawingArgs,
        frame: &Frame,
        background: &Colour,
    ) -> Result<Drawn, vk::Error> {
        let SurfaceModel { viewer, planes, splats, projection, .. } = self.surface(gpu, forms, drawing, frame)?;
        Ok(Drawn { viewer, planes, splats, projection, background: background.rgb, seen: false })
    }

    /// Uploads the model for a map.
    pub(crate) fn surface(
        &self,
        gpu: &Gpu,
        forms: &BlendingVariants,
        drawing: &DrawingArgs,
        frame: &Frame,
    ) -> Result<SurfaceModel, vk::Error> {
        let variants = Variants::choose(gpu, false)
            .with(gpu, NamedVariants { tile: forms.tile_shape, ..NamedVariants::default() });
        let viewer = Viewer::with_variants(gpu, variants);
        let planes = viewer.upload_with(&self.in_scene(frame), drawing.sh())?;
        let projection =
            Projection { sh_degree: self.model.sh_degree, antialias: self.antialias, ..Projection::default() };
        Ok(SurfaceModel { viewer, planes, splats: self.splats() as u32, projection, frame: *frame })
    }

    /// A scene in the dataset's units whose origin is near the splats: f32 is exact there, also far from the dataset's
    /// origin.
    pub(crate) fn frame_of_its_own(&self) -> Frame {
        let offset = match &self.frame {
            ModelFrame::Dataset { .. } => self.model.shift,
            ModelFrame::Other { to_dataset, .. } => to_dataset.point(self.model.shift),
        };
        Frame { offset, scale: 1.0 }
    }

    /// From the dataset's coordinates to those of the model, [`ply::Model::shift`] added.
    pub(crate) fn dataset_to_model(&self) -> Similarity {
        match &self.frame {
            ModelFrame::Dataset { .. } => Similarity::IDENTITY,
            ModelFrame::Other { to_dataset, .. } => to_dataset.inverse(),
        }
    }

    /// A model in the dataset's coordinates less its shift.
    pub(crate) fn in_dataset(&self, model: ply::Model) -> Self {
        let frame = ModelFrame::Dataset { offset: model.shift, known_from: "by the file beside it" };
        Self { model, frame, bytes: self.bytes, antialias: self.antialias }
    }

    /// The splats in the coordinates of a scene.
    pub(crate) fn in_scene(&self, frame: &Frame) -> Gaussians {
        match &self.frame {
            ModelFrame::Dataset { .. } => self.model.in_scene(frame),
            ModelFrame::Other { to_dataset, .. } => self.model.placed_in_scene(to_dataset, frame),
        }
    }
}

/// A model on the device.
pub(crate) struct Drawn {
    viewer: Viewer,
    planes: Planes,
    splats: u32,
    projection: Projection,
    background: [f32; 3],
    /// Whether any render so far shows a splat.
    seen: bool,
}

impl Drawn {
    /// A render from a camera of the scene, with depth and normals where `aux` is set.
    pub(crate) fn picture(&mut self, camera: &Camera, aux: bool) -> Result<Picture, vk::Error> {
        let shot = RenderView { camera: *camera, projection: self.projection, background: self.background };
        let picture = self.viewer.render(&self.planes, self.splats, &shot, aux)?;
        self.seen |= picture.rgbt.chunks_exact(4).any(|pixel| pixel[3] < 1.0);
        Ok(picture)
    }

    /// Draws other splats of the scene from now on.
    pub(crate) fn replace(&mut self, gaussians: &Gaussians, drawing: &DrawingArgs) -> Result<(), vk::Error> {
        self.planes = self.viewer.upload_with(gaussians, drawing.sh())?;
        self.splats = gaussians.len() as u32;
        Ok(())
    }

    /// Draws the model as `look` says; `ids` tell the parts of the model apart.
    pub(crate) fn look(
        &mut self,
        camera: &Camera,
        look: Look,
        ids: Option<(&Buffer, u32)>,
    ) -> Result<Picture, vk::Error> {
        let view = RenderView { camera: *camera, projection: self.projection, background: self.background };
        self.viewer.look(Shown { planes: &self.planes, splats: self.splats, ids }, &view, look)
    }

    /// Depths at the pixels of a camera of the scene, and the weights in front of and behind `known` ones.
    pub(crate) fn probe(&mut self, camera: &Camera, known: Option<&[f32]>) -> Result<DepthProbe, vk::Error> {
        let view = RenderView { camera: *camera, projection: self.projection, background: self.background };
        self.viewer.probe(&self.planes, self.splats, &view, known)
    }

    /// Warns where no render shows a splat: model and cameras do not belong together.
    pub(crate) fn warn_if_unseen(&self, model: &Path, dataset: &Path, console: &Console) {
        if !self.seen {
            console.warn(format_args!(
                "no camera of {} sees a splat of {}: the pictures are empty. Model and dataset must share one \
                 coordinate system: was the model trained on this dataset, neither of them moved since, and does \
                 --frame lead the right way?",
                dataset.display(),
                model.display()
            ));
        }
    }
}

/// Savings of precision for faster renders.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Shortcuts")]
pub(crate) struct DrawingArgs {
    /// Bits in which the numbers of spherical harmonics are stored on the device
    #[arg(long, value_name = "BITS", default_value = "32", value_parser = PossibleValuesParser::new(["16", "32"]))]
    sh_bits: String,
}

impl DrawingArgs {
    /// No savings.
    pub(crate) fn exact() -> Self {
        Self { sh_bits: "32".to_owned() }
    }

    /// How spherical harmonics are stored.
    pub(crate) fn sh(&self) -> ShStorage {
        if self.sh_bits == "16" { ShStorage::Half } else { ShStorage::Full }
    }
}
