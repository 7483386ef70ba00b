//! Writes a world as a dataset.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;

use super::{World, WorldError, WorldParams, colmap};

/// What is being done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Rays are traced; counted in photographs.
    Photographs,
    /// Sparse points are found.
    Points,
}

/// How far it has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// The stage.
    pub stage: Stage,
    /// Parts done.
    pub done: u32,
    /// Parts in all.
    pub total: u32,
}

/// What was written.
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
}

/// Makes a world and writes it into `dir`: `images/NAME.jpg`, `depth/NAME.exr` (channel Z, depth along the optical axis in
/// metres at pixel centres, 0 for sky), `sparse/0/{cameras,images,points3D}.bin`, and `world.toml` with every parameter.
pub fn generate(params: &WorldParams, dir: &Path, progress: &mut dyn FnMut(Progress)) -> Result<Summary, WorldError> {
    let world = World::new(params)?;
    let (images, depths, sparse) = (dir.join("images"), dir.join("depth"), dir.join("sparse").join("0"));
    for folder in [&images, &depths, &sparse] {
        fs::create_dir_all(folder).map_err(|source| WorldError::Write { path: folder.clone(), source })?;
    }
    let views = world.views();
    let mut spots = Vec::with_capacity(views.len());
    for (k, view) in views.iter().enumerate() {
        progress(Progress { stage: Stage::Photographs, done: k as u32, total: views.len() as u32 });
        let (photograph, depth) = world.photograph(&view.camera, k as u32);
        write_jpeg(&images.join(&view.name), &photograph, params.effects.jpeg_quality)?;
        write_depth(&depths.join(&view.name).with_extension("exr"), photograph.dimensions(), depth)?;
        spots.push(world.spots(&photograph));
    }
    progress(Progress { stage: Stage::Points, done: 0, total: 1 });
    let points = world.tie_points(views, &spots);
    if let Some(first) = views.first() {
        write_with(sparse.join("cameras.bin"), |out| colmap::write_camera(out, &first.camera))?;
    }
    write_with(sparse.join("images.bin"), |out| colmap::write_images(out, views, &points))?;
    write_with(sparse.join("points3D.bin"), |out| colmap::write_points(out, views.len(), &points))?;
    let text = toml::to_string_pretty(params)?;
    write_with(dir.join("world.toml"), |out| out.write_all(text.as_bytes()))?;
    progress(Progress { stage: Stage::Points, done: 1, total: 1 });
    let (width, height) = params.size();
    Ok(Summary {
        images: views.len() as u32,
        width,
        height,
        points: points.len(),
        observations: points.iter().map(|p| p.track.len()).sum(),
        solids: world.solids().len(),
    })
}

fn write_with(path: PathBuf, body: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<(), WorldError> {
    let write = || {
        let mut out = BufWriter::new(File::create(&path)?);
        body(&mut out)?;
        out.flush()
    };
    write().map_err(|source| WorldError::Write { path: path.clone(), source })
}

fn write_jpeg(path: &Path, photograph: &RgbImage, quality: u8) -> Result<(), WorldError> {
    let file = File::create(path).map_err(|source| WorldError::Write { path: path.into(), source })?;
    let mut out = BufWriter::new(file);
    photograph
        .write_with_encoder(JpegEncoder::new_with_quality(&mut out, quality))
        .map_err(|source| WorldError::Photograph { path: path.into(), source })?;
    out.flush().map_err(|source| WorldError::Write { path: path.into(), source })
}

fn write_depth(path: &Path, (width, height): (u32, u32), depth: Vec<f32>) -> Result<(), WorldError> {
    use exr::prelude::{
        AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec, WritableImage,
    };
    let channels = AnyChannels::sort(SmallVec::from_vec(vec![AnyChannel::new("Z", FlatSamples::F32(depth))]));
    let size = (width as usize, height as usize);
    let layer = Layer::new(size, LayerAttributes::named("depth"), Encoding::FAST_LOSSLESS, channels);
    Image::from_layer(layer).write().to_file(path).map_err(|source| WorldError::Depth { path: path.into(), source })
}
