//! Writes SOG files.

use std::f64::consts::SQRT_2;
use std::io::{Cursor, Write};

use rayon::prelude::*;
use zip::write::SimpleFileOptions;

use super::super::encoding::{alpha_byte, byte, check, coefficient, largest_first, rest, unit_quat};
use super::super::{EncodeError, codebook, palette};
use super::{Asset, Coded, Files, META, MOST_SIDE, Means, Meta, PALETTE_ROW, Palette, picture_size};
use crate::format::ply::Model;
use crate::scene::Gaussians;

/// Splats for each entry of the palette of harmonics, and entries that a palette has at least and at most.
const SPLATS_PER_ENTRY: usize = 8;
const SMALL_PALETTE: usize = 1024;
const LARGE_PALETTE: usize = 65_536;
/// Steps of a position between the least and the largest one.
const STEPS: f64 = 65_535.0;

/// The bytes of a SOG file with the splats of a model.
///
/// Coordinates are those of the model, in its axes: viewers take -y as up. `sh_degree` is the degree of spherical
/// harmonics in the file, at most that of the model. Splats are reordered, rotations get unit length.
pub fn encode(model: &Model, sh_degree: u32) -> Result<Vec<u8>, EncodeError> {
    // Before the order changes: errors name splats by their place in the model.
    check(&model.gaussians)?;
    let (meta, pictures) = parts(model, &model.gaussians.in_morton_order(), sh_degree)?;
    archive(&meta, pictures)
}

/// Names and content of the files of an unpacked SOG with the splats of a model, in their order.
pub fn files(model: &Model, sh_degree: u32) -> Result<Vec<(String, Vec<u8>)>, EncodeError> {
    check(&model.gaussians)?;
    let (meta, pictures) = parts(model, &model.gaussians, sh_degree)?;
    let meta = serde_json::to_vec(&meta).map_err(|e| EncodeError::Encoder(e.to_string()))?;
    let named = pictures.into_iter().map(|(name, bytes)| (format!("{name}.webp"), bytes));
    Ok(named.chain([(META.to_owned(), meta)]).collect())
}

/// Names and bytes of pictures.
type Pictures = Vec<(&'static str, Vec<u8>)>;

/// The content of `meta.json`, and the pictures, of splats of a model.
fn parts(model: &Model, g: &Gaussians, sh_degree: u32) -> Result<(Meta, Pictures), EncodeError> {
    let size = picture_size(g.len());
    if size.0.max(size.1) > MOST_SIDE {
        return Err(EncodeError::TooMany { splats: g.len(), most: MOST_SIDE * MOST_SIDE });
    }
    let degree = sh_degree.min(model.sh_degree).min(3);
    let ((means, quats), ((scales, sh0), harmonics)) = rayon::join(
        || rayon::join(|| means_pictures(g, size), || quats_picture(g, size)),
        || {
            let small = || rayon::join(|| scales_picture(g, size), || sh0_picture(g, size));
            rayon::join(small, || (degree > 0).then(|| harmonics_pictures(g, degree, size)).transpose())
        },
    );
    let ((mins, maxs, low, high), (scales_codebook, scales), (sh0_codebook, sh0)) = (means?, scales?, sh0?);
    let (sh_rest, sh_pictures) = match harmonics? {
        Some((palette, centroids, labels)) => {
            (Some(palette), vec![("shN_centroids", centroids), ("shN_labels", labels)])
        }
        None => (None, Vec::new()),
    };
    let files = |name: &str| Files { files: [format!("{name}.webp")] };
    let meta = Meta {
        version: 2,
        asset: Asset {
            generator: Some(concat!("psrgs-vk ", env!("CARGO_PKG_VERSION")).to_owned()),
            offset: (model.shift != [0.0; 3]).then_some(model.shift),
        },
        count: g.len() as u64,
        antialias: model.antialias,
        means: Means { mins, maxs, pictures: Files { files: ["means_l.webp".to_owned(), "means_u.webp".to_owned()] } },
        scales: Coded { codebook: scales_codebook, pictures: files("scales") },
        quats: files("quats"),
        sh0: Coded { codebook: sh0_codebook, pictures: files("sh0") },
        sh_rest,
    };
    let mut pictures = vec![("means_l", low), ("means_u", high), ("quats", quats?), ("scales", scales), ("sh0", sh0)];
    pictures.extend(sh_pictures);
    Ok((meta, pictures))
}

/// The zip archive. WebP does not get smaller, so nothing is compressed again.
fn archive(meta: &Meta, pictures: Pictures) -> Result<Vec<u8>, EncodeError> {
    let failed = |e: &dyn std::fmt::Display| EncodeError::Encoder(e.to_string());
    let meta = serde_json::to_vec(meta).map_err(|e| failed(&e))?;
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Stored)
        // The same model gives the same bytes at any time.
        .last_modified_time(zip::DateTime::default());
    let named = pictures.into_iter().map(|(name, bytes)| (format!("{name}.webp"), bytes));
    for (name, bytes) in named.chain([(META.to_owned(), meta)]) {
        zip.start_file(name, options).map_err(|e| failed(&e))?;
        zip.write_all(&bytes).map_err(|e| failed(&e))?;
    }
    Ok(zip.finish().map_err(|e| failed(&e))?.into_inner())
}

/// A lossless picture of one pixel per splat; pixels after the last splat are zero.
fn picture(
    splats: usize,
    (width, height): (usize, usize),
    pixel: impl Fn(usize) -> [u8; 4] + Sync,
) -> Result<Vec<u8>, EncodeError> {
    let mut pixels = vec![0; 4 * width * height];
    pixels.par_chunks_exact_mut(4).enumerate().take(splats).for_each(|(i, out)| out.copy_from_slice(&pixel(i)));
    webp(&pixels, (width, height))
}

/// A lossless WebP picture of four channels.
pub(super) fn webp(pixels: &[u8], (width, height): (usize, usize)) -> Result<Vec<u8>, EncodeError> {
    let encoded = |predict: bool| {
        let mut out = Vec::new();
        let mut encoder = image_webp::WebPEncoder::new(&mut out);
        let mut params = image_webp::EncoderParams::default();
        params.use_predictor_transform = predict;
        encoder.set_params(params);
        encoder
            .encode(pixels, width as u32, height as u32, image_webp::ColorType::Rgba8)
            .map_err(|e| EncodeError::Encoder(e.to_string()))?;
        Ok(out)
    };
    // Codebook indices of neighbours have little in common: prediction helps some pictures only.
    let (predicted, plain) = rayon::join(|| encoded(true), || encoded(false));
    let (predicted, plain) = (predicted?, plain?);
    Ok(if predicted.len() < plain.len() { predicted } else { plain })
}

/// Least and largest positions as logarithms, and the pictures of low and high bytes.
type MeansPictures = ([f64; 3], [f64; 3], Vec<u8>, Vec<u8>);

fn means_pictures(g: &Gaussians, size: (usize, usize)) -> Result<MeansPictures, EncodeError> {
    let log = |v: f32| f64::from(v).abs().ln_1p().copysign(f64::from(v));
    let (mut mins, mut maxs) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in g.means.chunks_exact(3) {
        for k in 0..3 {
            (mins[k], maxs[k]) = (mins[k].min(log(p[k])), maxs[k].max(log(p[k])));
        }
    }
    if g.is_empty() {
        (mins, maxs) = ([0.0; 3], [0.0; 3]);
    }
    let step = |i: usize, k: usize| -> [u8; 2] {
        let range = maxs[k] - mins[k];
        let share = if range > 0.0 { (log(g.means[3 * i + k]) - mins[k]) / range } else { 0.0 };
        ((share * STEPS).round().clamp(0.0, STEPS) as u16).to_le_bytes()
    };
    let bytes = |half: usize| picture(g.len(), size, |i| [step(i, 0)[half], step(i, 1)[half], step(i, 2)[half], 255]);
    let (low, high) = rayon::join(|| bytes(0), || bytes(1));
    Ok((mins, maxs, low?, high?))
}

fn quats_picture(g: &Gaussians, size: (usize, usize)) -> Result<Vec<u8>, EncodeError> {
    picture(g.len(), size, |i| {
        let (largest, q) = largest_first(unit_quat(g, i));
        let mut out = [0, 0, 0, 252 + largest as u8];
        let others = (0..4).filter(|k| *k != largest);
        others.zip(&mut out).for_each(|(k, out)| *out = byte(255.0 * (q[k] * SQRT_2 * 0.5 + 0.5)));
        out
    })
}

fn scales_picture(g: &Gaussians, size: (usize, usize)) -> Result<(Vec<f32>, Vec<u8>), EncodeError> {
    let codebook = codebook::of(g.scales.par_iter().copied());
    let index = |i: usize, k: usize| codebook::nearest(&codebook, g.scales[3 * i + k]);
    let picture = picture(g.len(), size, |i| [index(i, 0), index(i, 1), index(i, 2), 255])?;
    Ok((codebook, picture))
}

fn sh0_picture(g: &Gaussians, size: (usize, usize)) -> Result<(Vec<f32>, Vec<u8>), EncodeError> {
    let colour = |i: usize, c: usize| coefficient(g, i, 0, c);
    let codebook = codebook::of((0..3 * g.len()).into_par_iter().map(|k| colour(k / 3, k % 3)));
    let index = |i: usize, c: usize| codebook::nearest(&codebook, colour(i, c));
    let picture = picture(g.len(), size, |i| [index(i, 0), index(i, 1), index(i, 2), alpha_byte(g.opacities[i])])?;
    Ok((codebook, picture))
}

/// Entry of `meta.json`, palette and labels.
type HarmonicsPictures = (Palette, Vec<u8>, Vec<u8>);

fn harmonics_pictures(g: &Gaussians, degree: u32, size: (usize, usize)) -> Result<HarmonicsPictures, EncodeError> {
    let coefficients = rest(degree);
    let rows: Vec<f32> = (0..g.len())
        .into_par_iter()
        .flat_map_iter(|i| (0..3 * coefficients).map(move |at| coefficient(g, i, 1 + at / 3, at % 3)))
        .collect();
    let most = (g.len() / SPLATS_PER_ENTRY).clamp(SMALL_PALETTE, LARGE_PALETTE);
    let found = palette::of(&rows, 3 * coefficients, most);
    let codebook = codebook::of(found.entries.par_iter().copied());
    let entries = found.entries.len() / (3 * coefficients);
    let centroids_size = (PALETTE_ROW * coefficients, entries.div_ceil(PALETTE_ROW).max(1));
    let centroids = picture(entries * coefficients, centroids_size, |at| {
        let index = |c: usize| codebook::nearest(&codebook, found.entries[3 * at + c]);
        [index(0), index(1), index(2), 255]
    })?;
    let labels = picture(g.len(), size, |i| {
        let [low, high, ..] = found.labels[i].to_le_bytes();
        [low, high, 0, 255]
    })?;
    let files = ["shN_centroids.webp".to_owned(), "shN_labels.webp".to_owned()];
    let palette = Palette { count: entries as u64, bands: degree, codebook, pictures: Files { files } };
    Ok((palette, centroids, labels))
}
