//! Masks: pictures beside the photographs that say which pixels are not to be looked at.

use std::path::{Path, PathBuf};

use image::GrayImage;

use super::error::Error;
use super::photograph;
use super::pixels::Sample;

/// The folder of masks, beside that of the photographs.
pub(super) const FOLDER: &str = "masks";

/// Which colour of a mask means that a pixel is left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MaskIgnores {
    /// COLMAP's, OpenSfM's and nerfstudio's convention.
    #[default]
    Black,
    /// The opposite.
    White,
}

/// Where masks were found, and for how many photographs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Masks {
    /// The folder, or the file that names the masks.
    pub place: PathBuf,
    /// Photographs that have one.
    pub matched: usize,
    /// Photographs.
    pub of: usize,
}

/// The mask of a photograph in a folder of masks: named as the photograph with `.png` behind (COLMAP, OpenSfM), or with `.png` in
/// place of its extension, or just as the photograph.
pub(super) fn beside(folder: &Path, name: &str) -> Option<PathBuf> {
    let appended = folder.join(format!("{name}.png"));
    let replaced = folder.join(Path::new(name).with_extension("png"));
    [appended, replaced, folder.join(name)].into_iter().find(|file| file.is_file())
}

/// Refuses a mask whose shape is not that of its photograph; one of another size but of the same shape is resized.
pub(super) fn check_size(file: &Path, photograph: (u32, u32)) -> Result<(), Error> {
    let mask = photograph::header(file)?.size;
    if photograph::same_shape(mask, photograph) {
        return Ok(());
    }
    Err(Error::MaskSize { file: file.to_owned(), mask, photograph })
}

/// Makes the pixels of a photograph (RGBA) transparent that a mask leaves out. What is brighter than half of the mask's
/// brightest value is white: masks of 0 and 1 are as common as those of 0 and 255.
pub(super) fn apply<T: Sample>(rgba: &mut [T], width: u32, height: u32, mask: &GrayImage, ignores: MaskIgnores) {
    let brightest = mask.pixels().map(|p| p.0[0]).max().unwrap_or(0);
    let nearest = |at: u32, size: u32, of: u32| {
        // The mask's pixel that holds the centre of the photograph's.
        let at = (2 * u64::from(at) + 1) * u64::from(of) / (2 * u64::from(size));
        (at as u32).min(of - 1)
    };
    for (k, pixel) in rgba.chunks_exact_mut(4).enumerate() {
        let (x, y) = (k as u32 % width, k as u32 / width);
        let value = mask.get_pixel(nearest(x, width, mask.width()), nearest(y, height, mask.height())).0[0];
        let white = value > brightest / 2;
        if white == (ignores == MaskIgnores::White) {
            pixel[3] = T::default();
        }
    }
}
