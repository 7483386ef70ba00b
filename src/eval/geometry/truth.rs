//! The ground truth that lies beside a dataset.

use std::path::{Path, PathBuf};

use super::Closest;
use crate::dataset::{self, Dataset, DecodeLimit, LoadOptions, Names, Photograph, Role, Split};
use crate::format;
use crate::format::image_out::{read_depth_within, read_normals_within};
use crate::format::ply::Mesh;
use crate::scene::{Camera, Frame};

/// Ground truth could not be used.
#[derive(Debug, thiserror::Error)]
pub enum GeometryError {
    /// A file of it.
    #[error(transparent)]
    File(#[from] format::Error),
    /// The off-path views.
    #[error(transparent)]
    Offpath(#[from] dataset::Error),
    /// A map is not of its photograph.
    #[error("{}: is {got:?} pixels, which is not the shape of the undistorted photograph, {view:?}", file.display())]
    Shape {
        /// The map.
        file: PathBuf,
        /// Its size.
        got: (u32, u32),
        /// The size that the photograph has in use.
        view: (u32, u32),
    },
}

/// The maps of a view.
#[derive(Clone, Debug)]
pub(super) struct Maps {
    /// The camera in scene coordinates, at the size that is trained at.
    camera: Camera,
    depth: PathBuf,
    normals: Option<PathBuf>,
    limit: DecodeLimit,
}

/// A view that is not of the dataset itself.
#[derive(Clone, Debug)]
pub(super) struct Offpath {
    /// The camera in scene coordinates.
    pub(super) camera: Camera,
    view: dataset::View,
    pub(super) maps: Option<Maps>,
}

impl Offpath {
    pub(super) fn photograph(&self) -> Result<Photograph, GeometryError> {
        Ok(self.view.photograph()?)
    }
}

/// A training photograph as a witness of what can be seen.
#[derive(Clone, Debug)]
pub(super) struct Witness {
    /// The camera in scene coordinates.
    pub(super) camera: Camera,
    /// What is truly there, where that is known.
    pub(super) maps: Option<Maps>,
}

/// Depths and normals of a view, at their own size.
#[derive(Clone, Debug, PartialEq)]
pub struct Known {
    /// The camera in scene coordinates, at the size of the maps.
    pub camera: Camera,
    /// Depth along the camera's axis in the dataset's units; not positive or not finite where none is known.
    pub depth: Vec<f32>,
    /// Unit normals in the camera frame, towards the camera; zero where none is known.
    pub normals: Option<Vec<[f32; 3]>>,
}

impl Known {
    /// The place in scene coordinates that a pixel shows, where its depth is known. `scale`: scene units per unit of
    /// the dataset.
    pub(super) fn point(&self, pixel: usize, scale: f64) -> Option<[f64; 3]> {
        let depth = self.depth.get(pixel).copied().filter(|z| *z > 0.0 && z.is_finite())?;
        let (x, y) = (pixel % self.camera.width as usize, pixel / self.camera.width as usize);
        Some(self.camera.lifted([x as f64 + 0.5, y as f64 + 0.5], f64::from(depth) * scale))
    }

    /// The depths in scene units.
    pub(super) fn scaled(&self, scale: f64) -> Vec<f32> {
        self.depth.iter().map(|z| (f64::from(*z) * scale) as f32).collect()
    }
}

/// The ground truth of a dataset: `depth/NAME.exr` and `normal/NAME.exr` of held-out views, for the pixels of their
/// undistorted pictures, at any size; `offpath/`, a dataset in the same coordinates, with depth too; `surface.ply`.
/// Any part may be absent.
#[derive(Clone, Debug)]
pub struct GeometryTruth {
    pub(super) frame: Frame,
    /// In the dataset's units.
    pub(super) extent: f64,
    pub(super) views: Vec<Maps>,
    pub(super) offpath: Vec<Offpath>,
    pub(super) surface: Option<PathBuf>,
    /// The training photographs.
    pub(super) witnesses: Vec<Witness>,
}

impl GeometryTruth {
    /// Looks for ground truth in the folder of a dataset; `options` are those that it was loaded with.
    pub fn find(dataset: &Dataset, options: &LoadOptions) -> Result<Self, GeometryError> {
        let limit = DecodeLimit::new(options.host_memory);
        let maps = |root: &Path, views: &[&dataset::View]| -> Vec<Option<Maps>> {
            let [depths, normals] = ["depth", "normal"].map(|kind| beside(&root.join(kind), views));
            let cameras = views.iter().map(|view| dataset.frame.camera_to_scene(&view.camera));
            let all = cameras.zip(depths).zip(normals);
            all.map(|((camera, depth), normals)| Some(Maps { camera, depth: depth?, normals, limit })).collect()
        };
        let folder = dataset.path.join("offpath");
        let mut offpath = Vec::new();
        if folder.is_dir() {
            let options = LoadOptions { split: Split::None, format: None, images_folder: None, ..options.clone() };
            let others = Dataset::load(&folder, &options)?;
            let maps = maps(&folder, &others.views.iter().collect::<Vec<_>>());
            offpath.extend(others.views.into_iter().zip(maps).map(|(view, maps)| Offpath {
                camera: dataset.frame.camera_to_scene(&view.camera),
                maps,
                view,
            }));
        }
        let trained: Vec<&dataset::View> = dataset.views_of(Role::Train).map(|(_, view)| view).collect();
        let cameras = trained.iter().map(|view| dataset.frame.camera_to_scene(&view.camera));
        let witnesses = cameras.zip(maps(&dataset.path, &trained)).map(|(camera, maps)| Witness { camera, maps });
        let held_out: Vec<&dataset::View> = dataset.views_of(Role::HeldOut).map(|(_, view)| view).collect();
        Ok(Self {
            frame: dataset.frame,
            extent: dataset.extent,
            views: maps(&dataset.path, &held_out).into_iter().flatten().collect(),
            offpath,
            witnesses: witnesses.collect(),
            surface: Some(dataset.path.join("surface.ply")).filter(|file| file.is_file()),
        })
    }

    /// Whether there is nothing to compare with.
    pub fn is_empty(&self) -> bool {
        self.views.is_empty() && self.offpath.is_empty() && self.surface.is_none()
    }

    /// Reads the surface.
    pub(super) fn surface(&self) -> Result<Option<Closest>, GeometryError> {
        self.surface.as_deref().map(|file| Ok(Closest::new(&Mesh::read(file)?))).transpose()
    }
}

/// A file with the true depths of a view.
pub(in crate::eval) struct DepthFile(PathBuf, DecodeLimit);

impl DepthFile {
    /// Width, height, and depths along the axis of the view's camera in the dataset's units.
    pub(in crate::eval) fn read(&self, camera: &Camera) -> Result<(u32, u32, Vec<f32>), GeometryError> {
        let map = read_depth_within(&self.0, self.1)?;
        at_size(camera, &self.0, (map.width, map.height))?;
        Ok((map.width, map.height, map.values))
    }
}

/// The true depths of some views of a dataset, where it has them.
pub(in crate::eval) fn depth_maps(dataset: &Dataset, views: &[usize]) -> Vec<Option<DepthFile>> {
    let views: Vec<&dataset::View> = views.iter().filter_map(|at| dataset.views.get(*at)).collect();
    let files = beside(&dataset.path.join("depth"), &views);
    files.into_iter().zip(views).map(|(file, view)| Some(DepthFile(file?, view.limit))).collect()
}

/// The map of each view in a folder of them, under the view's name or one that differs a little.
fn beside(folder: &Path, views: &[&dataset::View]) -> Vec<Option<PathBuf>> {
    let name = |view: &&dataset::View| vec![Path::new(&view.name).with_extension("exr").to_string_lossy().into_owned()];
    let names: Vec<Vec<String>> = views.iter().map(name).collect();
    let is_map = |path: &Path| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr"));
    let found = Names::look_up(folder, &names, is_map);
    found.into_iter().map(|found| found.into_file().map(|file| folder.join(file))).collect()
}

impl Maps {
    /// Reads them.
    pub(super) fn read(&self) -> Result<Known, GeometryError> {
        let mut known = self.read_depth()?;
        let size = (known.camera.width, known.camera.height);
        if let Some(file) = &self.normals {
            let read = read_normals_within(file, self.limit)?;
            let got = (read.width, read.height);
            if got != size {
                return Err(GeometryError::Shape { file: file.clone(), got, view: size });
            }
            known.normals = Some(read.values);
        }
        Ok(known)
    }

    /// Reads the depths alone.
    pub(super) fn read_depth(&self) -> Result<Known, GeometryError> {
        let depth = read_depth_within(&self.depth, self.limit)?;
        let camera = at_size(&self.camera, &self.depth, (depth.width, depth.height))?;
        Ok(Known { camera, depth: depth.values, normals: None })
    }

    /// Of depths alone.
    #[cfg(test)]
    pub(super) fn of_depth(camera: Camera, depth: PathBuf, limit: DecodeLimit) -> Self {
        Self { camera, depth, normals: None, limit }
    }
}

/// The camera at the size of a map, which has to have the shape of its picture: sides may be rounded.
fn at_size(camera: &Camera, file: &Path, (width, height): (u32, u32)) -> Result<Camera, GeometryError> {
    let exact = f64::from(width) * f64::from(camera.height) / f64::from(camera.width);
    let slack = 1.0 + f64::from(width) / f64::from(camera.width);
    if (f64::from(height) - exact).abs() > slack {
        let view = (camera.width, camera.height);
        return Err(GeometryError::Shape { file: file.to_owned(), got: (width, height), view });
    }
    Ok(camera.resized(width, height))
}
