//! Posed photographs: models in several formats, lenses, masks, the split into training and held-out views, and the
//! scene's frame.
//!
//! Loading reads the model and the headers of the photographs. Pixels are decoded on request, by view or by [`Role`],
//! so that held-out photographs stay unread during training.

mod alpha_composite;
mod bounded_parallel;
mod colmap;
mod colourless;
mod diagnostics;
mod error;
mod extent;
mod folder;
mod foreign;
pub mod georeference;
mod hint;
mod jpeg_reduced;
mod jpeg_truncation;
mod json;
pub mod lens;
mod masks;
mod model;
mod names;
mod nerfstudio;
mod numeric_limits;
mod opendronemap;
mod opensfm;
mod part;
mod photograph;
mod picture_file;
mod picture_size;
mod pixel_source;
mod pixels;
mod points_ply;
mod poses;
mod random_points;
mod read;
mod rotation;
mod sizing;
mod split;
mod split_lists;
mod tone;
mod tracks;
mod undecoded;
mod undistort;
mod usable;
mod useless;
mod views;
mod warning;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

pub use colmap::Point;
pub use colourless::{Colourless, NoColours};
pub use diagnostics::Sight;
pub use error::Error;
pub use folder::ImagesFolder;
pub use masks::{MaskIgnores, MaskUse, Masks};
pub use model::Format;
pub use names::{Differences, Renamed};
pub(crate) use names::{NameMatch, Names};
pub use photograph::Photograph;
pub(crate) use pixel_source::cores;
pub use pixel_source::{HostShare, Supply};
pub use pixels::{Depth, Pixels};
pub use poses::{Convention, PoseFault, WrongConvention};
pub(crate) use random_points::in_view;
pub use sizing::{Rounding, Sizing};
pub use split::{Role, Split};
pub use tone::{Samples, Tone, Transfer};
pub use tracks::Tracks;
pub use undecoded::{Decoding, Undecodable, Undecoded};
pub use useless::UselessPoints;
pub use warning::Warning;

use crate::format::{LeftOut, few};
pub use crate::host_memory::DecodeLimit;
use crate::scene::init::{self, InitError};
use crate::scene::{Camera, Coordinates, Frame, Gaussians};
use lens::Lens;
use model::{Model, Shot};
use part::OfWhole;

/// How a dataset is loaded.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadOptions {
    /// Photographs with a longer side are reduced to this many pixels; `None` keeps every size.
    pub max_side: Option<u32>,
    /// Another rule for the size, in place of `max_side`.
    pub sizing: Option<Sizing>,
    /// How sides are rounded.
    pub rounding: Rounding,
    /// The folder of photographs, relative to the dataset; `None` chooses among `images` and `images_N`.
    pub images_folder: Option<PathBuf>,
    /// Which photographs are held out.
    pub split: Split,
    /// The format to read; `None` takes the first one whose files exist.
    pub format: Option<Format>,
    /// The colour of masks that leaves pixels out.
    pub mask_ignores: MaskIgnores,
    /// The colour behind transparent pixels of photographs (red, green, blue from 0 to 1, encoded as in the
    /// photographs). `None` leaves out pixels that are less than half opaque.
    pub behind: Option<[f32; 3]>,
    /// How values of more than 8 bits per channel are interpreted.
    pub tone: Tone,
    /// Limit of the process's memory in bytes. A picture whose decoding would exceed it is refused. `None` allows half
    /// of the free memory.
    pub host_memory: Option<u64>,
    /// Whether a record that cannot be used is an error. Otherwise up to one in ten is left out, with a
    /// [`Warning::LeftOut`].
    pub strict: bool,
    /// Whether photographs are required. Without them sizes are those of the cameras, and only poses can be used.
    pub photographs: bool,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self {
            max_side: Some(1600),
            sizing: None,
            rounding: Rounding::Nearest,
            images_folder: None,
            split: Split::Test,
            format: None,
            mask_ignores: MaskIgnores::Black,
            behind: None,
            tone: Tone::default(),
            host_memory: None,
            strict: false,
            photographs: true,
        }
    }
}

impl LoadOptions {
    fn sizing(&self) -> Sizing {
        self.sizing.unwrap_or(Sizing::MaxSide(self.max_side.unwrap_or(u32::MAX)))
    }
}

/// One posed photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Name in the model, reduced to the part that stays inside a folder.
    pub name: String,
    /// The photograph; empty when the dataset was loaded without.
    pub path: PathBuf,
    /// The camera in dataset coordinates, at the size of training and evaluation.
    pub camera: Camera,
    /// The lens at the photograph's size on disk, where the photograph has to be undistorted.
    pub lens: Option<Lens>,
    /// The dataset's name of the camera model.
    pub model: String,
    /// The mask, which leaves pixels of the photograph out.
    pub mask: Option<PathBuf>,
    /// The colour of the mask that leaves pixels out.
    pub mask_ignores: MaskIgnores,
    /// The colour behind transparent pixels; `None` leaves them out.
    pub behind: Option<[f32; 3]>,
    /// Width and height of the file.
    pub size_on_disk: (u32, u32),
    /// Whether the file is a JPEG file, which can be decoded at a fraction of its size.
    pub jpeg: bool,
    /// The kind of values in the file.
    pub samples: Samples,
    /// How the values are interpreted.
    pub tone: Tone,
    /// The memory that decoding the photograph or its mask may take.
    pub limit: DecodeLimit,
    /// The use of the view.
    pub role: Role,
    /// Whether the pose was checked against the photograph's observations of points.
    pub pose_checked: bool,
}

impl View {
    /// Decodes the photograph at the camera's size.
    pub fn photograph(&self) -> Result<Photograph, Error> {
        photograph::decode(self)
    }

    /// The exposure that the camera noted in the file: time by sensitivity over the square of the f-number, of which
    /// the latter are 1 where they are not noted. `None` without a time.
    pub fn noted_exposure(&self) -> Option<f64> {
        picture_file::noted_exposure(&self.path)
    }
}

/// A loaded dataset.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// The dataset's folder.
    pub path: PathBuf,
    /// Its format.
    pub format: Format,
    /// The files that cameras and points were read from.
    pub files: Vec<PathBuf>,
    /// The folder of photographs; `None` when loaded without photographs.
    pub images: Option<ImagesFolder>,
    /// The masks, if any.
    pub masks: Option<Masks>,
    /// Where on Earth the dataset's coordinates lie, if the dataset says so.
    pub coordinates: Option<Coordinates>,
    /// All views, sorted bytewise by their names in the model.
    pub views: Vec<View>,
    /// The reconstructed points in dataset coordinates, by ascending id.
    pub points: Vec<Point>,
    /// Why a training ignores most or all points; `None` where it uses them.
    pub useless: Option<UselessPoints>,
    /// Why the colours of the points cannot be used; `None` where they can.
    pub colourless: Option<Colourless>,
    /// The views that observe each point, if the format says so.
    pub tracks: Tracks,
    /// The similarity to the scene's coordinates.
    pub frame: Frame,
    /// 1.1 x the largest distance of a training camera from their mean, in dataset units;
    /// [`Frame::EXTENT`] in the scene.
    pub extent: f64,
    /// Whether an undecodable photograph is an error: see [`LoadOptions::strict`].
    pub strict: bool,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

impl Dataset {
    /// Loads the model in a folder, and finds its photographs and masks.
    pub fn load(path: &Path, options: &LoadOptions) -> Result<Self, Error> {
        Self::load_of(path, options, None)
    }

    /// Loads all photographs, or those of a part.
    fn load_of(path: &Path, options: &LoadOptions, part: Option<&OfWhole>) -> Result<Self, Error> {
        sizing::check(options.sizing())?;
        let mut model = Model::read(path, options.format, options.strict)?;
        usable::names(&mut model, options.strict)?;
        if model.points.is_empty() {
            model.warnings.push(Warning::NoPoints { file: model.points_file.clone() });
        }
        let colourless = colourless(&mut model);
        model.warnings.extend(colourless.clone().map(Warning::PointsWithoutColours));
        // The split counts all photographs: a missing one does not change the roles of the others.
        let planned = split::planned(options.split, &model.shots);
        if let Some(part) = part {
            let kept: Vec<bool> = model.shots.iter().map(|shot| part.role(&shot.name).is_some()).collect();
            model.keep_shots(&kept);
        }
        let images = match options.photographs {
            true => Some(find_photographs(path, options, &mut model, part.is_none())?),
            false => None,
        };

        let masks_folder = Some(path.join(masks::FOLDER)).filter(|folder| images.is_some() && folder.is_dir());
        let masks = match &images {
            Some(_) => masks::find(path, masks_folder.as_deref(), &mut model)?,
            None => vec![None; model.shots.len()],
        };
        let roles = match part {
            Some(part) => model.shots.iter().map(|shot| part.role(&shot.name).unwrap_or(Role::Unused)).collect(),
            None => roles(&planned, &model.shots, &mut model.warnings),
        };
        let views = views::of_shots(&model, images.as_ref(), options, roles, masks);
        let mut views = usable::views(&mut model, views, options.strict)?;
        let masks = count_masks(&mut model, masks_folder, &views);
        if masks.is_none() && images.is_some() && !path.join(masks::FOLDER).is_dir() {
            model.warnings.extend(masks::unread_folder(path).map(|folder| Warning::UnreadMasks { folder }));
        }

        let (frame, extent) = place(&mut model, &mut views, options.strict, part)?;
        let useless = useless_points(&model, &views, colourless.is_some());
        Ok(Self {
            path: path.to_owned(),
            format: model.format,
            files: model.files,
            images,
            masks,
            coordinates: model.coordinates,
            views,
            points: model.points,
            useless,
            colourless,
            tracks: model.tracks,
            frame,
            extent,
            strict: options.strict,
            warnings: model.warnings,
        })
    }

    /// The views with a role, with their positions in [`Dataset::views`].
    pub fn views_of(&self, role: Role) -> impl Iterator<Item = (usize, &View)> {
        self.views.iter().enumerate().filter(move |(_, view)| view.role == role)
    }

    /// A view's camera in scene coordinates.
    pub fn scene_camera(&self, index: usize) -> Option<Camera> {
        self.views.get(index).map(|view| self.frame.camera_to_scene(&view.camera))
    }

    /// The first splats in scene coordinates, one per point, in the order of the points' ids.
    pub fn first_gaussians(&self) -> Result<Gaussians, InitError> {
        let points: Vec<_> = self.points.iter().map(|p| (p.position, p.colour)).collect();
        init::from_points(&points, &self.frame)
    }

    /// The points that a training uses: those that serve photographs.
    pub fn usable_points(&self) -> &[Point] {
        self.useless.as_ref().map_or(&self.points, |useless| &useless.kept)
    }

    /// Whether a training cannot begin at the points: none exist, or they are of little use.
    pub fn begins_at_random(&self) -> bool {
        self.points.is_empty() || self.useless.is_some()
    }

    /// Random grey points in the common view of the training cameras, in dataset coordinates: the start of a training
    /// without points. Empty with fewer than two cameras, or with all cameras at one place.
    pub fn random_points(&self, seed: u64) -> Vec<([f64; 3], [u8; 3])> {
        let cameras: Vec<Camera> = self.views_of(Role::Train).map(|(_, view)| view.camera).collect();
        random_points::in_common_view(&cameras, seed).into_iter().map(|position| (position, [128; 3])).collect()
    }

    /// Decodes the photographs of a role in parallel, in the order of [`Dataset::views_of`]. Reads no others.
    pub fn photographs(&self, role: Role) -> Result<Vec<Photograph>, Error> {
        let views: Vec<&View> = self.views_of(role).map(|(_, view)| view).collect();
        let decoded: Vec<Result<Photograph, Error>> = views.par_iter().map(|view| view.photograph()).collect();
        decoded.into_iter().collect()
    }
}

/// Why the colours of a model's points cannot be used; `None` where they can.
fn colourless(model: &mut Model) -> Option<Colourless> {
    if model.points.is_empty() {
        return None;
    }
    let why = model.colourless.take().or_else(|| NoColours::of_points(&model.points))?;
    Some(Colourless { file: model.points_file.clone().unwrap_or_else(|| model.file.clone()), why })
}

/// Chooses the folder of photographs, and finds each photograph there, also under a slightly different name. `whole`
/// says whether other photographs than those of the model have no pose.
fn find_photographs(path: &Path, options: &LoadOptions, model: &mut Model, whole: bool) -> Result<ImagesFolder, Error> {
    let files: Vec<String> = model.shots.iter().map(|s| s.file.clone()).collect();
    let names: Vec<&str> = files.iter().map(String::as_str).collect();
    let longest = model.shots.iter().map(|s| s.lens.size[0].max(s.lens.size[1])).max().unwrap_or(1);
    let wanted = options.sizing().longest(longest);
    let images = match (&model.images, &options.images_folder) {
        (Some(folder), None) => ImagesFolder { path: folder.clone(), reduction: 1, automatic: true },
        (_, asked) => folder::choose(path, asked.as_deref(), longest, wanted, &names)?,
    };
    let is_wanted = folder::may_hold(images.path == path, names.iter().copied());
    let forms: Vec<Vec<String>> = names.iter().map(|name| vec![(*name).to_owned()]).collect();
    let found = Names::look_up(&images.path, &forms, &is_wanted);
    let there: Vec<bool> = found.iter().map(|found| found.file().is_some()).collect();
    let (missing, total) = (there.iter().filter(|there| !**there).count(), names.len());
    if let Some((first, of_first)) = names.iter().zip(&found).find(|(_, found)| found.file().is_none()) {
        if !names::leads_out(first) {
            folder::allowed(&images.path.join(first))?;
        }
        let nearest = names::instead(first, of_first, &found, &images.path, is_wanted);
        let first = (*first).to_owned();
        if options.strict || !few(missing as u64, total as u64) {
            return Err(Error::MissingPhotographs { folder: images.path, count: missing, total, first, nearest });
        }
        let (file, problem) = (images.path.clone(), format!("there is no such file{nearest}"));
        let first = format!("'{first}'");
        let left_out = LeftOut { file, what: "photographs", count: missing, of: total, first, problem };
        model.warnings.push(Warning::LeftOut(left_out));
        model.keep_shots(&there);
    }
    if let Some(renamed) = Renamed::of(names.iter().copied().zip(&found)) {
        model.warnings.push(Warning::OtherNames { what: "photographs", of: total, renamed });
    }
    for (shot, file) in model.shots.iter_mut().zip(found.into_iter().filter_map(NameMatch::into_file)) {
        shot.file = file;
    }
    // A dataset's own folder also holds masks and depth, so extra pictures in it say nothing.
    let unposed = match &model.images {
        Some(_) => 0,
        None if !whole => 0,
        None => folder::count_photographs(&images.path).saturating_sub(model.shots.len()),
    };
    if unposed > 0 {
        model.warnings.push(Warning::PhotographsWithoutPose { photographs: unposed });
    }
    Ok(images)
}

/// Checks the poses, places the scene's frame over the sound ones, and leaves out views and points outside the frame's
/// range. A part has the frame of the whole. Returns the frame and the extent.
fn place(
    model: &mut Model,
    views: &mut Vec<View>,
    strict: bool,
    part: Option<&OfWhole>,
) -> Result<(Frame, f64), Error> {
    let mut judged = poses::Judgement::of(model)?;
    judged.apply(views, &mut model.warnings);
    let (frame, extent, degenerate) = match part {
        // Which cameras are far from all others was judged for the whole.
        Some(of) => (of.frame, of.extent, None),
        None => {
            let centers = poses::without_far(&judged, views, &model.points, &mut model.warnings);
            extent::scene_frame(&centers, &model.points)
        }
    };
    model.warnings.extend(degenerate);
    usable::placed(model, views, &frame, strict)?;
    Ok((frame, extent))
}

/// Why a training ignores the points; `None` where it uses them. Ignores all of them where their colours cannot be used
/// either.
fn useless_points(model: &Model, views: &[View], colourless: bool) -> Option<UselessPoints> {
    let on: Vec<Camera> = views.iter().filter(|view| view.role == Role::Train).map(|view| view.camera).collect();
    let points_file = model.points_file.as_ref().unwrap_or(&model.file);
    let mut useless = useless::judge(points_file.clone(), &on, &model.points)?;
    if colourless {
        useless.kept.clear();
    }
    Some(useless)
}

/// Counts the photographs with masks. Warns where a folder of masks matches no photograph.
fn count_masks(model: &mut Model, folder: Option<PathBuf>, views: &[View]) -> Option<Masks> {
    let (matched, of) = (views.iter().filter(|view| view.mask.is_some()).count(), views.len());
    match folder {
        Some(folder) if matched == 0 => {
            model.warnings.push(Warning::NoMaskMatches { folder });
            None
        }
        Some(place) => Some(Masks { place, matched, of }),
        None => (matched > 0).then(|| Masks { place: model.file.clone(), matched, of }),
    }
}

/// The role of every view. With too few views to train on, nothing is held out.
fn roles(planned: &HashMap<String, Role>, shots: &[Shot], warnings: &mut Vec<Warning>) -> Vec<Role> {
    let role = |shot: &Shot| planned.get(&shot.name).copied().unwrap_or(Role::Train);
    let roles: Vec<Role> = shots.iter().map(role).collect();
    if roles.contains(&Role::Train) {
        return roles;
    }
    warnings.push(Warning::NothingHeldOut { views: shots.len() });
    vec![Role::Train; shots.len()]
}
