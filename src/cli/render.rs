//! `psrgs-vk render`: renders of a model from the cameras of a dataset.

use std::path::PathBuf;

use psrgs_vk::dataset::{Dataset, LoadOptions, Role};
use psrgs_vk::numbers::counted;
use psrgs_vk::scene::Camera;

use super::console::Console;
use super::exit::Failure;
use super::look_args::{LookArgs, StrictArgs};
use super::model_file::SplatSet;
use super::pictures::Pictures;
use super::{output_guard, progress};

/// Render a model from the cameras of a dataset
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk render fox-model/point_cloud.ply --cameras fox --out pictures
  psrgs-vk render fox-model/point_cloud.ply --cameras fox --views test --depth --out pictures
  psrgs-vk render fox-model/point_cloud.ply --cameras fox --part low --out low")]
pub(crate) struct Args {
    /// Model: PLY, compressed PLY, SPZ, SOG, .splat or GLB
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
    /// Which splats: those that were there at the end of the low-frequency stage (low),
    /// those that came after (high), or all (full)
    #[arg(long, value_enum, default_value_t = SplatSet::Full)]
    pub(crate) part: SplatSet,
    #[command(flatten)]
    pub(crate) files: StrictArgs,
    #[command(flatten)]
    pub(crate) look: LookArgs,
}

/// Which cameras of a dataset are rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Views {
    All,
    Train,
    Test,
}

impl Views {
    fn take(self, role: Role) -> bool {
        match self {
            Self::All => true,
            Self::Train => role == Role::Train,
            Self::Test => role == Role::HeldOut,
        }
    }
}

pub(crate) fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let model = args.look.read(&args.model, args.files.strict, console)?;
    let model = model.of_set(args.part, &args.model)?;
    let (max_side, strict) = (Some(args.max_side), args.files.strict);
    let options = LoadOptions { max_side, strict, photographs: false, ..LoadOptions::default() };
    let dataset = Dataset::load(&args.cameras, &options)?;
    dataset.warnings.iter().filter(|warning| warning.is_of_files()).for_each(|warning| console.warn(warning));
    output_guard::check(&args.out, &dataset)?;
    let wanted: Vec<(&str, Camera)> = dataset
        .views
        .iter()
        .enumerate()
        .filter(|(_, view)| args.views.take(view.role))
        .filter_map(|(i, view)| Some((view.name.as_str(), dataset.scene_camera(i)?)))
        .collect();
    if wanted.is_empty() {
        let text = format!("{}: too few cameras to hold any out; leave --views out", args.cameras.display());
        return Err(Failure::Input(text).into());
    }
    let pictures = Pictures::new(&args.out, wanted.iter().map(|(name, _)| *name), dataset.frame.scale)?;
    let gpu = args.look.scene.open(console)?;
    let mut drawn = args.look.upload(&gpu, &model, &dataset.frame)?;
    let bar = progress::counter(console, wanted.len(), "pictures");
    for (i, (_, camera)) in wanted.iter().enumerate() {
        pictures.write(i, &drawn.picture(camera, args.depth)?)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    drawn.warn_if_unseen(&args.model, &args.cameras, console);
    console.say(format_args!("{} in {}", counted(wanted.len(), "picture"), args.out.display()));
    Ok(())
}
