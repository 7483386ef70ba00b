//! Reads SOG files.

use std::f32::consts::SQRT_2;
use std::fs;
use std::io::{Cursor, Read};
use std::path::Path;

use zip::ZipArchive;

use super::super::decoding::{damaged, finished, set_coefficient, splat_count, with_largest};
use super::super::encoding::{logit_of_alpha, rest};
use super::{META, MOST_SIDE, Meta, PALETTE_ROW, Palette};
use crate::format::contain::contained;
use crate::format::ply::Model;
use crate::format::{At, Error, source};
use crate::scene::Gaussians;

/// Most bytes of `meta.json`.
const MOST_META: u64 = 1 << 20;
/// Most entries of a palette: labels have 16 bits.
const MOST_PALETTE: u64 = 1 << 16;
/// Pixels that a picture may have beyond one per splat, and bytes beyond five per pixel.
const SPARE_PIXELS: usize = 1 << 16;
const SPARE_BYTES: u64 = 1 << 16;

/// A model from the bytes of a SOG file. `file` is its name, for messages. A few splats that are not finite are left
/// out; where `strict` is set they are an error.
pub fn decode(file: &Path, bytes: &[u8], strict: bool) -> Result<Model, Error> {
    let wrong = |problem: &dyn std::fmt::Display| damaged(file, "zip archive", At::Byte(0), problem);
    let archive = contained(|| ZipArchive::new(Cursor::new(bytes))).map_err(|e| wrong(&e))?.map_err(|e| wrong(&e))?;
    model(Source { file, place: Place::Archive(archive) }, bytes.len(), strict)
}

/// A model from an unpacked SOG: `file` is its `meta.json`, with the pictures beside it. `strict` is as in [`decode`].
pub fn read_unpacked(file: &Path, strict: bool) -> Result<Model, Error> {
    let folder = match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let files = fs::read_dir(folder).map_err(Error::io(folder, "read"))?.flatten();
    let bytes: u64 = files.filter_map(|file| file.metadata().ok()).map(|file| file.len()).sum();
    model(Source { file, place: Place::Folder(folder) }, usize::try_from(bytes).unwrap_or(usize::MAX), strict)
}

/// The model in files of so many bytes.
fn model(mut source: Source<'_>, bytes: usize, strict: bool) -> Result<Model, Error> {
    let file = source.file;
    let meta = source.meta()?;
    let n = splat_count(file, meta.count, bytes, At::Byte(0))?;
    let mut g = Gaussians::zeros(n);
    let shift = meta.asset.offset.unwrap_or_default();
    if shift.iter().any(|v| !v.is_finite()) {
        return Err(damaged(file, "offset of meta.json", At::Byte(0), "is not finite"));
    }
    source.means(&meta, &mut g)?;
    source.quats(&meta, &mut g)?;
    source.scales(&meta, &mut g)?;
    source.sh0(&meta, &mut g)?;
    let sh_degree = match &meta.sh_rest {
        Some(palette) => source.harmonics(palette, &mut g)?,
        None => 0,
    };
    let model = Model { gaussians: g, sh_degree, shift, antialias: meta.antialias, ..Model::default() };
    finished(file, model, strict)
}

struct Source<'a> {
    file: &'a Path,
    place: Place<'a>,
}

/// Where the files of a SOG are.
enum Place<'a> {
    Archive(ZipArchive<Cursor<&'a [u8]>>),
    Folder(&'a Path),
}

/// Red, green, blue and alpha of a picture's pixels.
struct Pixels {
    rgba: Vec<u8>,
    width: usize,
}

impl Pixels {
    fn pixel(&self, i: usize) -> &[u8] {
        &self.rgba[4 * i..4 * i + 4]
    }
}

impl Source<'_> {
    fn wrong(&self, field: &str, problem: impl std::fmt::Display) -> Error {
        damaged(self.file, field, At::Byte(0), problem)
    }

    /// The bytes of a file of the SOG, at most `most`.
    fn entry(&mut self, name: &str, most: u64) -> Result<Vec<u8>, Error> {
        let file = self.file;
        let mut bytes = Vec::new();
        match &mut self.place {
            Place::Archive(archive) => {
                let read = contained(|| {
                    let entry = archive.by_name(name).map_err(|e| e.to_string())?;
                    entry.take(most + 1).read_to_end(&mut bytes).map_err(|e| e.to_string())
                });
                read.and_then(|read| read).map_err(|e| damaged(file, name, At::Byte(0), e))?;
            }
            Place::Folder(folder) => {
                // No name leads out of the folder.
                if Path::new(name).file_name() != Some(name.as_ref()) {
                    let problem = format_args!("'{name}' is not the name of a file beside it");
                    return Err(damaged(file, "files", At::Byte(0), problem));
                }
                let beside = folder.join(name);
                let (opened, _) = source::open(&beside)?;
                opened.take(most + 1).read_to_end(&mut bytes).map_err(Error::io(&beside, "read"))?;
            }
        }
        if bytes.len() as u64 > most {
            return Err(damaged(file, name, At::Byte(0), format_args!("has more than {most} bytes")));
        }
        Ok(bytes)
    }

    fn meta(&mut self) -> Result<Meta, Error> {
        let bytes = self.entry(META, MOST_META)?;
        let failed = |e: serde_json::Error| damaged(self.file, "meta.json", At::Line(e.line().max(1) as u64), e);
        let version: serde_json::Value = serde_json::from_slice(&bytes).map_err(failed)?;
        if version.get("version").and_then(serde_json::Value::as_u64) != Some(2) {
            let problem = "is not 2: convert the file to version 2 or to PLY, with splat-transform for one";
            return Err(Error::malformed(self.file, "version of meta.json", At::Byte(0), problem));
        }
        serde_json::from_slice(&bytes).map_err(failed)
    }

    /// A picture of at least `pixels` pixels.
    fn picture(&mut self, name: &str, pixels: usize) -> Result<Pixels, Error> {
        let bytes = self.entry(name, 5 * pixels as u64 + SPARE_BYTES)?;
        let decoded = contained(|| unpacked(&bytes, pixels)).and_then(|decoded| decoded);
        decoded.map_err(|problem| self.wrong(name, problem))
    }

    fn codebook(&self, name: &str, codebook: &[f32]) -> Result<[f32; 256], Error> {
        let problem = || format!("the codebook has {} numbers in place of 256", codebook.len());
        codebook.try_into().map_err(|_| self.wrong(name, problem()))
    }

    fn means(&mut self, meta: &Meta, g: &mut Gaussians) -> Result<(), Error> {
        let n = g.len();
        let [low, high] = &meta.means.pictures.files;
        let (low, high) = (self.picture(low, n)?, self.picture(high, n)?);
        let (mins, maxs) = (meta.means.mins, meta.means.maxs);
        for (i, p) in g.means.chunks_exact_mut(3).enumerate() {
            for k in 0..3 {
                let step = u16::from_le_bytes([low.pixel(i)[k], high.pixel(i)[k]]);
                let log = mins[k] + (maxs[k] - mins[k]) * f64::from(step) / f64::from(u16::MAX);
                p[k] = log.abs().exp_m1().copysign(log) as f32;
            }
        }
        Ok(())
    }

    fn quats(&mut self, meta: &Meta, g: &mut Gaussians) -> Result<(), Error> {
        let picture = self.picture(&meta.quats.files[0], g.len())?;
        for (i, q) in g.quats.chunks_exact_mut(4).enumerate() {
            let pixel = picture.pixel(i);
            let smaller = [0, 1, 2].map(|k| (f32::from(pixel[k]) / 255.0 * 2.0 - 1.0) / SQRT_2);
            let turned = pixel[3].checked_sub(252).map(|largest| with_largest(usize::from(largest), smaller));
            // Other values stand for no rotation.
            q.copy_from_slice(&turned.unwrap_or([1.0, 0.0, 0.0, 0.0]));
        }
        Ok(())
    }

    fn scales(&mut self, meta: &Meta, g: &mut Gaussians) -> Result<(), Error> {
        let codebook = self.codebook("scales of meta.json", &meta.scales.codebook)?;
        let picture = self.picture(&meta.scales.pictures.files[0], g.len())?;
        for (i, s) in g.scales.chunks_exact_mut(3).enumerate() {
            s.iter_mut().zip(picture.pixel(i)).for_each(|(s, index)| *s = codebook[usize::from(*index)]);
        }
        Ok(())
    }

    fn sh0(&mut self, meta: &Meta, g: &mut Gaussians) -> Result<(), Error> {
        let codebook = self.codebook("sh0 of meta.json", &meta.sh0.codebook)?;
        let picture = self.picture(&meta.sh0.pictures.files[0], g.len())?;
        for i in 0..g.len() {
            let pixel = picture.pixel(i);
            (0..3).for_each(|c| set_coefficient(g, i, 0, c, codebook[usize::from(pixel[c])]));
            g.opacities[i] = logit_of_alpha(pixel[3]);
        }
        Ok(())
    }

    /// Spherical harmonics beyond the constant one; the result is their degree.
    fn harmonics(&mut self, palette: &Palette, g: &mut Gaussians) -> Result<u32, Error> {
        let field = "shN of meta.json";
        if !(1..=3).contains(&palette.bands) || palette.count > MOST_PALETTE {
            let problem = format!("{} bands and {} entries are too many", palette.bands, palette.count);
            return Err(self.wrong(field, problem));
        }
        let (coefficients, entries) = (rest(palette.bands), palette.count as usize);
        let codebook = self.codebook(field, &palette.codebook)?;
        let [centroids, labels] = &palette.pictures.files;
        let centroids_name = centroids.clone();
        let centroids = self.picture(&centroids_name, coefficients * entries.next_multiple_of(PALETTE_ROW))?;
        if centroids.width != PALETTE_ROW * coefficients {
            let problem = format!("is {} pixels wide in place of {}", centroids.width, PALETTE_ROW * coefficients);
            return Err(self.wrong(&centroids_name, problem));
        }
        let labels = self.picture(labels, g.len())?;
        for i in 0..g.len() {
            let pixel = labels.pixel(i);
            let entry = usize::from(u16::from_le_bytes([pixel[0], pixel[1]]));
            if entry >= entries {
                return Err(self.wrong(&palette.pictures.files[1], format_args!("entry {entry} is not in the palette")));
            }
            for k in 0..coefficients {
                let pixel = centroids.pixel(entry * coefficients + k);
                (0..3).for_each(|c| set_coefficient(g, i, k + 1, c, codebook[usize::from(pixel[c])]));
            }
        }
        Ok(palette.bands)
    }
}

/// The pixels of a WebP picture that has at least `pixels` pixels and not many more.
fn unpacked(bytes: &[u8], pixels: usize) -> Result<Pixels, String> {
    let mut decoder = image_webp::WebPDecoder::new(Cursor::new(bytes)).map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    let found = width * height;
    if found < pixels || found > 2 * pixels + SPARE_PIXELS || width.max(height) > MOST_SIDE {
        return Err(format!("the picture has {width}x{height} pixels where {pixels} are needed"));
    }
    let channels = if decoder.has_alpha() { 4 } else { 3 };
    let mut data = vec![0; channels * found];
    decoder.read_image(&mut data).map_err(|e| e.to_string())?;
    let rgba = match channels {
        4 => data,
        _ => data.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect(),
    };
    Ok(Pixels { rgba, width })
}
