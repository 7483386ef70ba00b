//! Writes a world as a dataset.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ImageEncoder, ImageError, ImageResult, RgbImage};

use super::{Truth, World, WorldError, WorldParams, WorldView, colmap, lidar};
use crate::format::{FRAME_FILE, atomic, image_out};

/// The file with the parameters.
const PARAMETERS: &str = "world.toml";
/// The folder with the true map.
const TRUTH: &str = "truth";
/// The file with the laser scan.
pub const LIDAR_FILE: &str = "lidar.las";
/// The file with the ground control points.
const CONTROL_POINTS: &str = "gcp_list.txt";

/// A stage of the generation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Rays are traced; counted in photographs.
    Photographs,
    /// Sparse points are triangulated.
    Points,
    /// Off-path views, the laser scan and the surface; counted in parts.
    Truth,
}

/// The progress of the generation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// The stage.
    pub stage: Stage,
    /// Parts done.
    pub done: u32,
    /// Total number of parts.
    pub total: u32,
}

/// Counts of what was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Summary {
    /// Photographs.
    pub images: u32,
    /// Width of each in pixels.
    pub width: u32,
    /// Height of each in pixels.
    pub height: u32,
    /// Sparse points.
    pub points: usize,
    /// Observations of sparse points over all photographs.
    pub observations: usize,
    /// Solids of the world.
    pub solids: usize,
    /// Off-path views.
    pub offpath: usize,
    /// Points of the laser scan.
    pub lidar: usize,
    /// Triangles of the surface.
    pub triangles: usize,
    /// Ground control points.
    pub control_points: usize,
    /// The reference system of the control points.
    pub system: String,
}

/// Generates a world and writes its dataset to `dir`:
///
/// - `images/NAME.jpg` (or PNG), the photographs with positions in EXIF, and `sparse/0/`, cameras and points as COLMAP
///   reconstructs them;
/// - `gcp_list.txt`, ground control points in OpenDroneMap's format, and `frame.json`, the true place on a map;
/// - for the pixels of the undistorted images `depth/NAME.exr` (channel Z, depth along the optical axis in metres at
///   pixel centres, 0 for sky), `normal/NAME.exr` (N.X, N.Y, N.Z in the camera frame, towards the camera) and
///   `clean/NAME.png`, without noise and with the nominal exposure;
/// - `offpath/`: `images/`, `sparse/0/` (without points), `depth/` and `normal/` of views from other positions,
///   without noise;
/// - `truth/`: `dsm.tif`, `dtm.tif`, `orthophoto.tif` and `classes.tif`, the true map of the site;
/// - `lidar.las`, `lidar.ply` and `surface.ply`;
/// - `world.toml` with every parameter.
///
/// Where `dir` has a `world.toml` already, the files of the earlier world are removed first; files of other names stay.
pub fn generate(params: &WorldParams, dir: &Path, progress: &mut dyn FnMut(Progress)) -> Result<Summary, WorldError> {
    let world = World::new(params)?;
    // An earlier world's files would count as part of this world. Files of other origin stay.
    let file = dir.join(PARAMETERS);
    let again = has_world(dir)?;
    let tree = Tree::create(dir, true, again)?;
    let text = toml::to_string_pretty(params)?;
    atomic::write(&file, |out| out.write_all(text.as_bytes()))?;
    let views = world.views();
    let mut spots = Vec::with_capacity(views.len());
    for (k, view) in (0..).zip(views) {
        progress(Progress { stage: Stage::Photographs, done: k, total: views.len() as u32 });
        let shot = world.shot(view, k);
        let file = tree.images.join(&view.name);
        let position = world.geotag(k, view.camera.center());
        let position = position.map_err(|source| WorldError::Geotag { path: file.clone(), source })?;
        write_photograph(&file, &shot.photograph, params.effects.jpeg_quality, position)?;
        write_png(&dir.join("clean").join(view.file("png")), &shot.clean)?;
        tree.write_truth(view, &shot.truth)?;
        spots.push(world.spots(&shot.photograph));
    }
    progress(Progress { stage: Stage::Points, done: 0, total: 1 });
    let points = world.tie_points(views, &spots);
    let lens = world.lens().map(|lens| (lens, params.distortion));
    if let Some(first) = views.first() {
        atomic::write(&tree.sparse.join("cameras.bin"), |out| colmap::write_camera(out, &first.camera, lens))?;
    }
    atomic::write(&tree.sparse.join("images.bin"), |out| colmap::write_images(out, views, &points))?;
    atomic::write(&tree.sparse.join("points3D.bin"), |out| colmap::write_points(out, views.len(), &points))?;
    let control_points = world.control_points();
    let text = world.control_file(&control_points)?;
    atomic::write(&dir.join(CONTROL_POINTS), |out| out.write_all(text.as_bytes()))?;
    world.frame_file()?.write(&dir.join(FRAME_FILE))?;
    progress(Progress { stage: Stage::Points, done: 1, total: 1 });

    let total = world.offpath().len() as u32 + 3;
    let mut done = 0;
    let mut step = |progress: &mut dyn FnMut(Progress)| {
        progress(Progress { stage: Stage::Truth, done, total });
        done += 1;
    };
    if !world.offpath().is_empty() {
        write_offpath(&world, &dir.join("offpath"), again, &mut || step(progress))?;
    }
    step(progress);
    let truth = dir.join(TRUTH);
    fs::create_dir_all(&truth).map_err(|source| WorldError::Write { path: truth.clone(), source })?;
    world.write_map(&truth)?;
    step(progress);
    let echoes = world.lidar();
    let file = dir.join(LIDAR_FILE);
    let bytes = lidar::las(&echoes).map_err(|e| WorldError::Las { path: file.clone(), source: Box::new(e) })?;
    atomic::write(&file, |out| out.write_all(&bytes))?;
    atomic::write(&dir.join("lidar.ply"), |out| lidar::write_ply(&echoes, out))?;
    step(progress);
    let mesh = world.mesh();
    mesh.write(&dir.join("surface.ply"))?;
    step(progress);

    let (width, height) = world.lens().map_or(params.size(), |lens| (lens.size[0], lens.size[1]));
    Ok(Summary {
        images: views.len() as u32,
        width,
        height,
        points: points.len(),
        observations: points.iter().map(|p| p.track.len()).sum(),
        solids: world.solids().len(),
        offpath: world.offpath().len(),
        lidar: echoes.len(),
        triangles: mesh.triangles.len(),
        control_points: control_points.len(),
        system: world.georeference()?.system().map(ToString::to_string).unwrap_or_default(),
    })
}

/// The folders of a dataset with its ground truth.
struct Tree {
    images: PathBuf,
    sparse: PathBuf,
    depth: PathBuf,
    normal: PathBuf,
}

/// Whether `dir` holds an earlier world. Fails where files of other origin have the names of a world's files.
fn has_world(dir: &Path) -> Result<bool, WorldError> {
    let parameters = dir.join(PARAMETERS);
    let text = fs::read_to_string(&parameters);
    if text.is_ok_and(|text| toml::from_str::<WorldParams>(&text).is_ok()) {
        return Ok(true);
    }
    let written = [
        PARAMETERS,
        "images",
        "sparse",
        "depth",
        "normal",
        "clean",
        "offpath",
        LIDAR_FILE,
        "lidar.ply",
        "surface.ply",
        CONTROL_POINTS,
        FRAME_FILE,
        TRUTH,
    ];
    match written.iter().map(|name| dir.join(name)).find(|path| path.symlink_metadata().is_ok()) {
        Some(path) => Err(WorldError::Taken { path }),
        None => Ok(false),
    }
}

/// Removes the files of a folder that have the names of a world's files.
fn remove_own(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_file() && is_own(&entry.file_name().to_string_lossy()) {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Whether a world writes files of this name, such as `view_0007.jpg`, `off_0001.exr` and the files of the sparse
/// model.
fn is_own(name: &str) -> bool {
    let numbered = |start: &str| {
        let (number, extension) = name.strip_prefix(start)?.split_once('.')?;
        let digits = number.len() >= 4 && number.bytes().all(|b| b.is_ascii_digit());
        (digits && ["jpg", "png", "exr"].contains(&extension)).then_some(())
    };
    let model = ["cameras.bin", "images.bin", "points3D.bin"];
    model.contains(&name) || ["view_", "off_"].into_iter().find_map(numbered).is_some()
}

impl Tree {
    fn create(dir: &Path, clean: bool, empty: bool) -> Result<Self, WorldError> {
        let tree = Self {
            images: dir.join("images"),
            sparse: dir.join("sparse").join("0"),
            depth: dir.join("depth"),
            normal: dir.join("normal"),
        };
        let also = clean.then(|| dir.join("clean"));
        for folder in [&tree.images, &tree.sparse, &tree.depth, &tree.normal].into_iter().chain(&also) {
            let failed = |source| WorldError::Write { path: folder.clone(), source };
            if empty && folder.is_dir() {
                remove_own(folder).map_err(failed)?;
            }
            fs::create_dir_all(folder).map_err(failed)?;
        }
        Ok(tree)
    }

    fn write_truth(&self, view: &WorldView, truth: &Truth) -> Result<(), WorldError> {
        let (width, height) = (view.camera.width, view.camera.height);
        image_out::write_depth(&self.depth.join(view.file("exr")), width, height, &truth.depth)?;
        image_out::write_normals(&self.normal.join(view.file("exr")), width, height, &truth.normals)?;
        Ok(())
    }
}

fn write_offpath(world: &World, dir: &Path, again: bool, step: &mut dyn FnMut()) -> Result<(), WorldError> {
    let tree = Tree::create(dir, false, again)?;
    let views = world.offpath();
    for view in views {
        step();
        let (picture, truth) = world.clean(&view.camera);
        write_png(&tree.images.join(&view.name), &picture)?;
        tree.write_truth(view, &truth)?;
    }
    if let Some(first) = views.first() {
        atomic::write(&tree.sparse.join("cameras.bin"), |out| colmap::write_camera(out, &first.camera, None))?;
    }
    atomic::write(&tree.sparse.join("images.bin"), |out| colmap::write_images(out, views, &[]))?;
    atomic::write(&tree.sparse.join("points3D.bin"), |out| colmap::write_points(out, views.len(), &[]))?;
    Ok(())
}

fn write_png(path: &Path, picture: &RgbImage) -> Result<(), WorldError> {
    Ok(image_out::write_png(path, picture.width(), picture.height(), picture.as_raw())?)
}

fn write_photograph(path: &Path, photograph: &RgbImage, quality: u8, exif: Vec<u8>) -> Result<(), WorldError> {
    let failed = |source| WorldError::Photograph { path: path.into(), source };
    let mut bytes = Vec::new();
    if quality == 0 {
        encoded(PngEncoder::new(&mut bytes), photograph, exif).map_err(failed)?;
    } else {
        encoded(JpegEncoder::new_with_quality(&mut bytes, quality), photograph, exif).map_err(failed)?;
    }
    Ok(atomic::write(path, |out| out.write_all(&bytes))?)
}

fn encoded(mut encoder: impl ImageEncoder, photograph: &RgbImage, exif: Vec<u8>) -> ImageResult<()> {
    encoder.set_exif_metadata(exif).map_err(ImageError::Unsupported)?;
    photograph.write_with_encoder(encoder)
}
