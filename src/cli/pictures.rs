//! Image files of views: renders, depth and normals, and photographs beside them.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use image::RgbImage;
use psrgs_vk::eval::{DepthMap, ImageScore, ViewPanel};
use psrgs_vk::format::{image_out, names};
use psrgs_vk::raster::Picture;
use psrgs_vk::train::{View, score};

use super::exit::Failure;

/// Bytes of the longest suffix of a file's name, `.photograph.png`.
const LONGEST_ENDING: usize = 15;

/// A folder for images, and the name of each view's files.
pub(crate) struct Pictures {
    folder: PathBuf,
    names: Vec<String>,
    /// Scene units per dataset unit. Depth files are in dataset units.
    scale: f64,
}

impl Pictures {
    /// Creates the folder. Later a view is given by its position in `views`.
    pub(crate) fn new<'a>(
        folder: &Path,
        views: impl Iterator<Item = &'a str>,
        scale: f64,
    ) -> Result<Self, anyhow::Error> {
        fs::create_dir_all(folder).with_context(|| Failure::Output(folder.display().to_string()))?;
        let views: Vec<&str> = views.collect();
        Ok(Self { folder: folder.to_owned(), names: names::flat(&views, LONGEST_ENDING), scale })
    }

    /// Writes `NAME.png`, or `NAME.KIND.png`.
    fn rgb(&self, view: usize, kind: &str, size: (u32, u32), rgb: &[u8]) -> anyhow::Result<()> {
        Ok(image_out::write_png(&self.file(view, kind, "png"), size.0, size.1, rgb)?)
    }

    /// Writes the render, and depth (along the camera's axis, in the dataset's units) and normals where it has them.
    pub(crate) fn write(&self, view: usize, picture: &Picture) -> anyhow::Result<()> {
        self.rgb(view, "", (picture.width, picture.height), &picture.rgb8())?;
        self.geometry(view, picture)?;
        Ok(())
    }

    fn geometry(&self, view: usize, picture: &Picture) -> anyhow::Result<Option<DepthMap>> {
        let (width, height) = (picture.width, picture.height);
        let (Some(depth), Some(normals)) = (picture.depth(), picture.normals()) else { return Ok(None) };
        let values: Vec<f32> = depth.iter().map(|z| (f64::from(*z) / self.scale) as f32).collect();
        image_out::write_depth(&self.file(view, "depth", "exr"), width, height, &values)?;
        image_out::write_normals(&self.file(view, "normal", "exr"), width, height, &normals)?;
        Ok(Some(DepthMap { width, height, values }))
    }

    /// Writes a held-out view's render and photograph, and compares the two.
    pub(crate) fn held_out(&self, at: usize, view: &View, picture: &Picture) -> anyhow::Result<ViewPanel> {
        let size = (picture.width, picture.height);
        let photograph = view.photograph.pixels()?;
        let (rgb, truth) = (picture.rgb8(), photograph.rgb8());
        self.rgb(at, "render", size, &rgb)?;
        self.rgb(at, "photograph", size, &truth)?;
        let depth = self.geometry(at, picture)?;
        let ImageScore { name, psnr, psnr_cc, ssim, lpips_squeeze, gmsd, psnr_high_frequency, .. } =
            score(view, &photograph, &rgb);
        let image = |pixels: Vec<u8>| RgbImage::from_raw(size.0, size.1, pixels).context("picture size");
        Ok(ViewPanel {
            name,
            photograph: image(truth)?,
            render: image(rgb)?,
            depth,
            counting: if photograph.masked() == 0 { Vec::new() } else { photograph.counting() },
            stages: None,
            psnr,
            psnr_cc,
            ssim,
            lpips_squeeze,
            gmsd,
            psnr_high_frequency,
        })
    }

    /// Writes which pixels of a held-out view at least one photograph to train on sees: those are white.
    pub(crate) fn seen(&self, view: usize, size: (u32, u32), seen: &[bool]) -> anyhow::Result<()> {
        let pixels: Vec<u8> = seen.iter().flat_map(|seen| [if *seen { 255 } else { 0 }; 3]).collect();
        self.rgb(view, "seen", size, &pixels)
    }

    /// Path of a view's file: `NAME.KIND.EXTENSION`, or `NAME.EXTENSION` without a kind.
    pub(crate) fn file(&self, view: usize, kind: &str, extension: &str) -> PathBuf {
        let name = self.names.get(view).map_or("view", String::as_str);
        let dot = if kind.is_empty() { "" } else { "." };
        self.folder.join(format!("{name}{dot}{kind}.{extension}"))
    }
}
