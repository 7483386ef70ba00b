//! Masks: images beside the photographs that leave pixels out.

use std::path::{Path, PathBuf};

use image::DynamicImage;

use super::Warning;
use super::error::Error;
use super::folder::{exists, holds_pictures, is_photograph};
use super::model::{Model, Shot};
use super::names::stays_inside;
use super::names::{self, Names, Renamed};
use super::picture_file::{header_within, picture, read, whole};
use super::pixels::ChannelValue;
use super::sizing::same_shape;
use crate::host_memory::DecodeLimit;

/// The folder of masks, beside the folder of photographs.
pub(super) const FOLDER: &str = "masks";

/// The colour of a mask that leaves a pixel out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MaskIgnores {
    /// COLMAP's, OpenSfM's and nerfstudio's convention.
    #[default]
    Black,
    /// The opposite convention.
    White,
}

/// Where masks were found, and for how many photographs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Masks {
    /// The folder, or the file that names the masks.
    pub place: PathBuf,
    /// Photographs with a mask.
    pub matched: usize,
    /// All photographs.
    pub of: usize,
}

/// The masks of a model's photographs: those that the model's file names, else those in the folder of masks. There a
/// mask has the photograph's name with `.png` appended (COLMAP, OpenSfM), with `.png` as its extension, or unchanged.
pub(super) fn find(dataset: &Path, folder: Option<&Path>, model: &mut Model) -> Result<Vec<Option<PathBuf>>, Error> {
    let mut warnings = Vec::new();
    let masks = find_all(dataset, folder, model, &mut warnings);
    model.warnings.extend(warnings);
    masks
}

fn find_all(
    dataset: &Path,
    folder: Option<&Path>,
    model: &Model,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Option<PathBuf>>, Error> {
    let mut masks = named(dataset, model, warnings)?;
    let Some(folder) = folder else { return Ok(masks) };
    let without: Vec<usize> = (0..masks.len()).filter(|at| masks[*at].is_none()).collect();
    let forms: Vec<Vec<String>> = without.iter().map(|at| forms(&model.shots[*at])).collect();
    let names: Vec<&str> = without.iter().map(|at| model.shots[*at].name.as_str()).collect();
    let found = Names::look_up(folder, &forms, is_photograph);
    if let Some(renamed) = Renamed::of(names.into_iter().zip(&found)) {
        warnings.push(Warning::OtherNames { what: "masks", of: without.len(), renamed });
    }
    for (at, found) in without.into_iter().zip(found) {
        masks[at] = found.into_file().map(|file| folder.join(file));
    }
    Ok(masks)
}

/// A folder of the dataset whose name suggests masks, but which is not read.
pub(super) fn unread_folder(dataset: &Path) -> Option<String> {
    let entries = std::fs::read_dir(dataset).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.sort();
    let is_like = |name: &str| {
        let name = name.to_lowercase();
        name.starts_with("mask")
            || name.starts_with("segmentation")
            || name.ends_with("_mask")
            || name.ends_with("_masks")
    };
    names.into_iter().find(|name| name != FOLDER && is_like(name) && holds_pictures(&dataset.join(name)))
}

/// The names that a photograph's mask may have.
fn forms(shot: &Shot) -> Vec<String> {
    let of = |name: &str| {
        let replaced = Path::new(name).with_extension("png").to_string_lossy().into_owned();
        [format!("{name}.png"), replaced, name.to_owned()]
    };
    let mut all = of(&shot.name).to_vec();
    all.extend(of(&shot.file).into_iter().filter(|_| shot.file != shot.name));
    all
}

/// The masks inside the dataset that the model's file names.
fn named(dataset: &Path, model: &Model, warnings: &mut Vec<Warning>) -> Result<Vec<Option<PathBuf>>, Error> {
    let mut masks = vec![None; model.shots.len()];
    let asked: Vec<(usize, &str)> =
        model.shots.iter().enumerate().filter_map(|(at, shot)| Some((at, shot.mask.as_deref()?))).collect();
    // Several photographs may share a mask.
    let mut paths: Vec<&str> = asked.iter().map(|(_, path)| *path).collect();
    paths.sort_unstable();
    paths.dedup();
    let forms: Vec<Vec<String>> = paths.iter().map(|path| vec![(*path).to_owned()]).collect();
    let found = Names::look_up(dataset, &forms, is_photograph);
    for (at, path) in &asked {
        let Some(found) = paths.binary_search(path).ok().and_then(|at| found.get(at)) else { continue };
        match found.file() {
            Some(file) => masks[*at] = Some(dataset.join(file)),
            // A folder in place of a mask is reported when it is opened as a file.
            None if stays_inside(path) && exists(&dataset.join(path))? => masks[*at] = Some(dataset.join(path)),
            None => {
                let name = model.shots[*at].name.clone();
                let (file, field) = (model.file.clone(), format!("mask_path of frame '{name}'"));
                let nearest = names::missing(path, found, dataset, is_photograph);
                return Err(Error::NoSuchFile { file, field, path: (*path).to_owned(), nearest });
            }
        }
    }
    if let Some(renamed) = Renamed::of(paths.iter().copied().zip(&found)) {
        warnings.push(Warning::OtherNames { what: "masks", of: paths.len(), renamed });
    }
    Ok(masks)
}

/// Refuses a mask whose aspect ratio is not that of its photograph, or whose decoding takes too much memory. A mask of
/// another size but the same aspect ratio is resized.
pub(super) fn check_size(file: &Path, photograph: (u32, u32), limit: DecodeLimit) -> Result<(), Error> {
    fits(file, header_within(file, limit)?.size, photograph)
}

fn fits(file: &Path, mask: (u32, u32), photograph: (u32, u32)) -> Result<(), Error> {
    if same_shape(mask, photograph) {
        return Ok(());
    }
    let turned = same_shape((mask.1, mask.0), photograph);
    Err(Error::MaskSize { file: file.to_owned(), mask, photograph, turned })
}

/// How a photograph's mask is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaskUse {
    /// Pixels of the mask that leave photograph pixels out.
    pub left_out: u64,
    /// All pixels of the mask.
    pub pixels: u64,
    /// Whether the transparency decides instead of the colour.
    pub by_alpha: bool,
}

/// A decoded mask.
pub(super) struct Mask {
    width: u32,
    height: u32,
    /// For each pixel, whether it is left out.
    left_out: Vec<bool>,
    by_alpha: bool,
}

impl Mask {
    /// Reads a mask.
    pub(super) fn read(file: &Path, ignores: MaskIgnores, limit: DecodeLimit) -> Result<Self, Error> {
        let bytes = read(file)?;
        Ok(Self::of(&picture(file, &whole(file, &bytes, limit)?, limit)?, ignores))
    }

    /// White pixels are those above half of the mask's brightest value, because masks of 0 and 1 are as common as masks
    /// of 0 and 255. Where the brightness carries no information, the opacity takes its place.
    fn of(image: &DynamicImage, ignores: MaskIgnores) -> Self {
        let luma = luma(image);
        let alpha = alpha(image).filter(|alpha| says_more(alpha, &luma));
        let values = alpha.as_ref().unwrap_or(&luma);
        let half = values.iter().max().map_or(0, |brightest| brightest / 2);
        let left_out = values.iter().map(|value| (*value > half) == (ignores == MaskIgnores::White)).collect();
        Self { width: image.width(), height: image.height(), left_out, by_alpha: alpha.is_some() }
    }

    /// Checks that the mask has the shape of the photograph.
    pub(super) fn for_photograph(self, file: &Path, photograph: (u32, u32)) -> Result<Self, Error> {
        fits(file, (self.width, self.height), photograph)?;
        Ok(self)
    }

    /// Counts of the mask's pixels.
    pub(super) fn used(&self) -> MaskUse {
        let left_out = self.left_out.iter().filter(|left_out| **left_out).count() as u64;
        MaskUse { left_out, pixels: self.left_out.len() as u64, by_alpha: self.by_alpha }
    }

    /// Makes left-out pixels of a photograph (RGBA) transparent.
    pub(super) fn apply<T: ChannelValue>(&self, rgba: &mut [T], (width, height): (u32, u32)) {
        let nearest = |at: u32, size: u32, of: u32| {
            // The mask pixel that contains the centre of the photograph's pixel.
            let at = (2 * u64::from(at) + 1) * u64::from(of) / (2 * u64::from(size));
            (at as u32).min(of - 1) as usize
        };
        for (k, pixel) in rgba.chunks_exact_mut(4).enumerate() {
            let (x, y) = (k as u32 % width, k as u32 / width);
            let at = nearest(y, height, self.height) * self.width as usize + nearest(x, width, self.width);
            if self.left_out[at] {
                pixel[3] = T::default();
            }
        }
    }
}

/// The brightness of each pixel with all its bits: 16-bit masks may hold 0 and 1 too.
fn luma(image: &DynamicImage) -> Vec<u16> {
    match image.color().bytes_per_pixel() / image.color().channel_count().max(1) {
        1 => image.to_luma8().into_raw().into_iter().map(u16::from).collect(),
        2 => image.to_luma16().into_raw(),
        _ => {
            let values = image.to_luma32f().into_raw();
            let brightest = values.iter().copied().filter(|v| v.is_finite()).fold(f32::MIN_POSITIVE, f32::max);
            let white = f32::from(u16::MAX);
            values.into_iter().map(|v| (v / brightest * white).round().clamp(0.0, white) as u16).collect()
        }
    }
}

/// The opacity of each pixel; `None` without an alpha channel.
fn alpha(image: &DynamicImage) -> Option<Vec<u16>> {
    Some(match image {
        DynamicImage::ImageLumaA8(picture) => picture.pixels().map(|p| u16::from(p.0[1])).collect(),
        DynamicImage::ImageRgba8(picture) => picture.pixels().map(|p| u16::from(p.0[3])).collect(),
        DynamicImage::ImageLumaA16(picture) => picture.pixels().map(|p| p.0[1]).collect(),
        DynamicImage::ImageRgba16(picture) => picture.pixels().map(|p| p.0[3]).collect(),
        DynamicImage::ImageRgba32F(picture) => {
            let white = f32::from(u16::MAX);
            picture.pixels().map(|p| (p.0[3] * white).round().clamp(0.0, white) as u16).collect()
        }
        _ => return None,
    })
}

/// From this share of opaque pixels that are neither dark nor bright, a mask with transparent parts is a cut-out
/// photograph.
const CUT_OUT: f64 = 0.25;

/// Whether the opacity decides instead of the brightness: it varies, and the brightness is uniform or that of a cut-out
/// photograph.
fn says_more(alpha: &[u16], luma: &[u16]) -> bool {
    let range = |values: &[u16]| (values.iter().min().copied().unwrap_or(0), values.iter().max().copied().unwrap_or(0));
    let ((clear, opaque), (dark, bright)) = (range(alpha), range(luma));
    if clear == opaque {
        return false;
    }
    // Lossy files do not keep a uniform colour exactly.
    if bright - dark <= bright / 16 {
        return true;
    }
    let seen = || alpha.iter().zip(luma).filter(|(a, _)| **a > opaque / 2);
    let between = seen().filter(|(_, l)| **l > bright / 8 && **l < bright - bright / 8).count();
    clear <= opaque / 2 && between as f64 > CUT_OUT * seen().count() as f64
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, ImageBuffer, Luma, Rgba, RgbaImage};

    use super::*;

    fn kept(image: DynamicImage) -> (Vec<bool>, bool) {
        let mask = Mask::of(&image, MaskIgnores::Black);
        (mask.left_out.iter().map(|left_out| !left_out).collect(), mask.by_alpha)
    }

    fn grey(values: &[u8]) -> Vec<bool> {
        let image = GrayImage::from_raw(values.len() as u32, 1, values.to_vec()).unwrap();
        let (black, by_alpha) = kept(image.clone().into());
        let white = Mask::of(&image.into(), MaskIgnores::White).left_out;
        assert_eq!((&white, by_alpha), (&black, false), "the other polarity leaves out what this one keeps");
        black
    }

    #[test]
    fn grey_is_white_from_half_of_the_brightest_value_on() {
        assert_eq!(grey(&[0, 1, 126, 127, 128, 129, 255]), [false, false, false, false, true, true, true]);
        assert_eq!(grey(&[0, 99, 100, 101, 200]), [false, false, false, true, true]);
        assert_eq!(grey(&[0, 1]), [false, true]);
        assert_eq!(grey(&[0, 0]), [false, false]);
        assert_eq!(grey(&[9, 9]), [true, true], "one grey is white");
    }

    #[test]
    fn sixteen_bits_and_floats_keep_their_values() {
        let deep = |values: &[u16]| {
            let image = ImageBuffer::<Luma<u16>, _>::from_raw(values.len() as u32, 1, values.to_vec()).unwrap();
            kept(image.into()).0
        };
        assert_eq!(deep(&[0, 1]), [false, true], "labels");
        assert_eq!(deep(&[0, 32767, 32768, 65535]), [false, false, true, true]);
        let floats =
            ImageBuffer::<image::Rgb<f32>, _>::from_fn(3, 1, |x, _| image::Rgb([[0.0, 1.8, 4.0][x as usize]; 3]));
        assert_eq!(kept(floats.into()).0, [false, false, true]);
    }

    #[test]
    fn opacity_counts_where_the_colour_says_nothing() {
        let rgba =
            |pixels: &[[u8; 4]]| kept(RgbaImage::from_raw(pixels.len() as u32, 1, pixels.concat()).unwrap().into());
        let white = |alpha| [255, 255, 255, alpha];
        assert_eq!(rgba(&[white(0), white(127), white(128), white(255)]), (vec![false, false, true, true], true));
        assert_eq!(rgba(&[[0, 0, 0, 0], [0, 0, 0, 255]]), (vec![false, true], true), "of any colour");
        assert_eq!(rgba(&[[251, 252, 250, 0], white(255)]), (vec![false, true], true), "as lossy files have it");
        // The brightness varies, so transparency does not decide.
        assert_eq!(rgba(&[[0, 0, 0, 255], white(0), white(255)]), (vec![false, true, true], false));
        assert_eq!(rgba(&[white(255), white(255)]), (vec![true, true], false));
        // A cut-out photograph.
        let cut_out = [[90, 120, 60, 255], [140, 110, 90, 255], [0, 0, 0, 0], [250, 240, 250, 255]];
        assert_eq!(rgba(&cut_out), (vec![true, true, false, true], true));
        let deep = ImageBuffer::<Rgba<u16>, _>::from_fn(2, 1, |x, _| Rgba([65535, 65535, 65535, x as u16 * 65535]));
        assert_eq!(kept(deep.into()), (vec![false, true], true));
    }
}
