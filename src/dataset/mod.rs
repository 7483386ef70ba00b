//! Posed photographs: COLMAP models, images, the split into training and held-out views, the scene's frame.
//!
//! Loading reads the model and the headers of the photographs. Pixels are decoded when they are asked for, by view or by
//! [`Role`], so that held-out photographs stay unread during training.

mod colmap;
mod error;
mod extent;
mod folder;
mod jpeg_end;
mod photograph;
mod sizing;
mod split;
mod warning;

use std::path::{Path, PathBuf};

use rayon::prelude::*;

pub use colmap::Point;
pub use error::Error;
pub use folder::ImagesFolder;
pub use photograph::Photograph;
pub use sizing::{Rounding, Sizing};
pub use split::{Role, Split};
pub use warning::Warning;

use crate::scene::init::{self, InitError};
use crate::scene::{Camera, Frame, Gaussians};
use colmap::{Model, Pose};

/// What to load and how.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadOptions {
    /// Images with a longer side are reduced to this many pixels; `None` keeps every size.
    pub max_side: Option<u32>,
    /// Another rule for the size, in place of `max_side`.
    pub sizing: Option<Sizing>,
    /// How sides are rounded.
    pub rounding: Rounding,
    /// The folder of photographs, relative to the dataset; `None` chooses among `images` and `images_N`.
    pub images_folder: Option<PathBuf>,
    /// Which photographs are held out.
    pub split: Split,
    /// Whether there must be photographs. Without them sizes are those of the cameras, and only poses can be used.
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
    /// Name in the model, also the path inside the folder of photographs.
    pub name: String,
    /// The photograph; empty when the dataset was loaded without.
    pub path: PathBuf,
    /// The camera in dataset coordinates, at the size trained and evaluated at.
    pub camera: Camera,
    /// Width and height of the file.
    pub size_on_disk: (u32, u32),
    /// What the view is used for.
    pub role: Role,
}

impl View {
    /// Decodes the photograph at the camera's size.
    pub fn photograph(&self) -> Result<Photograph, Error> {
        photograph::decode(&self.path, self.size_on_disk, self.camera.width, self.camera.height)
    }
}

/// A loaded dataset.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// The folder it was loaded from.
    pub path: PathBuf,
    /// Where the photographs are; `None` when loaded without.
    pub images: Option<ImagesFolder>,
    /// All views, sorted bytewise by name.
    pub views: Vec<View>,
    /// The reconstructed points in dataset coordinates, by ascending id.
    pub points: Vec<Point>,
    /// The similarity to the scene's coordinates.
    pub frame: Frame,
    /// 1.1 x the largest distance of a training camera from their mean, in dataset units; [`Frame::EXTENT`] in the scene.
    pub extent: f64,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

impl Dataset {
    /// Loads the COLMAP model of a folder and finds its photographs.
    pub fn load(path: &Path, options: &LoadOptions) -> Result<Self, Error> {
        let sizing = options.sizing();
        check_sizing(sizing)?;
        let mut model = Model::read(path)?;
        check_names(&mut model)?;
        let mut warnings = Vec::new();
        if model.points.is_empty() {
            warnings.push(Warning::NoPoints { file: model.files.points.clone() });
        }
        let cameras =
            model.poses.iter().map(|pose| full_size_camera(&model, pose)).collect::<Result<Vec<Camera>, Error>>()?;
        let images = if options.photographs {
            Some(find_photographs(path, options, &model, &cameras, &mut warnings)?)
        } else {
            None
        };

        let roles = roles(options.split, cameras.len(), &mut warnings);
        let views = model
            .poses
            .par_iter()
            .zip(cameras)
            .zip(roles)
            .map(|((pose, camera), role)| {
                let photograph = images.as_ref().map(|folder| folder.path.join(&pose.name));
                let size_on_disk = match &photograph {
                    Some(file) => photograph::size_on_disk(file)?,
                    None => (camera.width, camera.height),
                };
                let path = photograph.unwrap_or_default();
                check_aspect(&path, pose.camera, &camera, size_on_disk)?;
                let (width, height) = sizing.apply(size_on_disk, (camera.width, camera.height), options.rounding);
                check_size(&path, &camera, sizing, size_on_disk, (width, height))?;
                Ok(View { name: pose.name.clone(), path, camera: camera.resized(width, height), size_on_disk, role })
            })
            .collect::<Vec<Result<View, Error>>>();
        // In the order of the names, so that of several problems always the same one is told.
        let views = views.into_iter().collect::<Result<Vec<View>, Error>>()?;

        let centers: Vec<[f64; 3]> =
            views.iter().filter(|v| v.role == Role::Train).map(|v| v.camera.center()).collect();
        let (frame, extent, degenerate) = extent::scene_frame(&centers, &model.points);
        warnings.extend(degenerate);
        Ok(Self { path: path.to_owned(), images, views, points: model.points, frame, extent, warnings })
    }

    /// The views of a role with their positions in [`Dataset::views`].
    pub fn views_of(&self, role: Role) -> impl Iterator<Item = (usize, &View)> {
        self.views.iter().enumerate().filter(move |(_, view)| view.role == role)
    }

    /// A view's camera for points in scene coordinates.
    pub fn scene_camera(&self, index: usize) -> Option<Camera> {
        self.views.get(index).map(|view| self.frame.camera_to_scene(&view.camera))
    }

    /// The first Gaussians in scene coordinates, one per point, in the order of the points' ids.
    pub fn first_gaussians(&self) -> Result<Gaussians, InitError> {
        let points: Vec<_> = self.points.iter().map(|p| (p.position, p.color)).collect();
        init::from_points(&points, &self.frame)
    }

    /// Decodes the photographs of one role in parallel, in the order of [`Dataset::views_of`]. No other is read.
    pub fn photographs(&self, role: Role) -> Result<Vec<Photograph>, Error> {
        let views: Vec<&View> = self.views_of(role).map(|(_, view)| view).collect();
        let decoded: Vec<Result<Photograph, Error>> = views.par_iter().map(|view| view.photograph()).collect();
        decoded.into_iter().collect()
    }
}

/// Sorts the poses by name and refuses names that cannot be.
fn check_names(model: &mut Model) -> Result<(), Error> {
    let file = &model.files.images;
    if model.poses.is_empty() {
        return Err(Error::NoImages { file: file.clone() });
    }
    model.poses.sort_by(|a, b| a.name.cmp(&b.name));
    if let Some(pair) = model.poses.windows(2).find(|pair| pair[0].name == pair[1].name) {
        return Err(Error::DuplicateName { file: file.clone(), name: pair[0].name.clone() });
    }
    match model.poses.iter().find(|pose| !folder::stays_inside(&pose.name)) {
        Some(pose) => Err(Error::NameOutside { file: file.clone(), name: pose.name.clone() }),
        None => Ok(()),
    }
}

/// The camera of a pose at the size of its calibration.
fn full_size_camera(model: &Model, pose: &Pose) -> Result<Camera, Error> {
    let files = &model.files;
    let intrinsics = model.cameras.get(&pose.camera).ok_or_else(|| {
        let problem = format!("there is no camera {} in {}", pose.camera, files.cameras.display());
        crate::format::Error::malformed(
            &files.images,
            format_args!("camera of image '{}'", pose.name),
            pose.at,
            problem,
        )
    })?;
    let [fx, fy, cx, cy] = intrinsics.pinhole(&files.cameras, pose.camera)?;
    let (width, height) = (intrinsics.width, intrinsics.height);
    Ok(Camera { rotation: pose.rotation, translation: pose.translation, fx, fy, cx, cy, width, height })
}

fn find_photographs(
    path: &Path,
    options: &LoadOptions,
    model: &Model,
    cameras: &[Camera],
    warnings: &mut Vec<Warning>,
) -> Result<ImagesFolder, Error> {
    let names: Vec<&str> = model.poses.iter().map(|p| p.name.as_str()).collect();
    let longest = cameras.iter().map(|c| c.width.max(c.height)).max().unwrap_or(1);
    let wanted = options.sizing().longest(longest);
    let images = folder::choose(path, options.images_folder.as_deref(), longest, wanted, &names)?;
    let missing: Vec<&&str> = names.iter().filter(|name| !images.path.join(name).is_file()).collect();
    if let Some(first) = missing.first() {
        return Err(Error::MissingPhotographs {
            folder: images.path,
            count: missing.len(),
            total: names.len(),
            first: (**first).to_owned(),
        });
    }
    let unposed = folder::count_photographs(&images.path).saturating_sub(names.len());
    if unposed > 0 {
        warnings.push(Warning::PhotographsWithoutPose { photographs: unposed });
    }
    Ok(images)
}

/// The role of every view. With so few views that none would be left to train on, nothing is held out.
fn roles(split: Split, views: usize, warnings: &mut Vec<Warning>) -> Vec<Role> {
    let roles: Vec<Role> = (0..views).map(|i| split.role(i)).collect();
    if roles.contains(&Role::Train) {
        return roles;
    }
    warnings.push(Warning::NothingHeldOut { views });
    vec![Role::Train; views]
}

/// Whether a size has the shape of a camera's, up to a pixel: sides of reduced copies are rounded up or down.
fn has_shape(camera: &Camera, (width, height): (u32, u32)) -> bool {
    let (w, h) = (f64::from(width), f64::from(height));
    let ratio = f64::from(camera.height) / f64::from(camera.width);
    (h - w * ratio).abs() <= 1.0 + ratio
}

/// The file may be a reduced copy.
fn check_aspect(file: &Path, number: u32, camera: &Camera, photograph: (u32, u32)) -> Result<(), Error> {
    if has_shape(camera, photograph) {
        return Ok(());
    }
    let turned = has_shape(camera, (photograph.1, photograph.0));
    Err(Error::AspectRatio {
        file: file.to_owned(),
        photograph,
        camera: number,
        expected: (camera.width, camera.height),
        hint: if turned { "; turned by 90 degrees it would fit: orientation tags of EXIF are not applied" } else { "" },
    })
}

fn check_sizing(sizing: Sizing) -> Result<(), Error> {
    match sizing {
        Sizing::MaxSide(0) => Err(Error::ZeroMaxSide),
        Sizing::Downscale(factor) if !(factor >= 1.0 && factor.is_finite()) => Err(Error::BadSize),
        Sizing::Exact(0, _) | Sizing::Exact(_, 0) => Err(Error::BadSize),
        _ => Ok(()),
    }
}

/// A size asked for must be one that the photograph can be reduced to without being stretched.
fn check_size(
    file: &Path,
    camera: &Camera,
    sizing: Sizing,
    on_disk: (u32, u32),
    wanted: (u32, u32),
) -> Result<(), Error> {
    let shaped = !matches!(sizing, Sizing::Exact(..)) || has_shape(camera, wanted);
    if shaped && wanted.0 <= on_disk.0 && wanted.1 <= on_disk.1 {
        return Ok(());
    }
    Err(Error::SizeDoesNotFit { file: file.to_owned(), photograph: on_disk, wanted })
}
