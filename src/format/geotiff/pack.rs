//! The samples of a tile: averages for overviews, differences and deflate for the file.

use std::io::{self, Read, Write};

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;

use super::{Kind, NO_DATA, TILE};

const SIDE: usize = TILE as usize;

/// The samples of a tile, row-major, the samples of a pixel beside each other.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// Of [`Kind::Rgba8`] and [`Kind::Gray8`].
    Bytes(Vec<u8>),
    /// Of [`Kind::Float`].
    Floats(Vec<f32>),
}

impl Samples {
    /// A tile without data.
    pub fn empty(kind: Kind) -> Self {
        let samples = SIDE * SIDE * kind.samples();
        match kind {
            Kind::Rgba8 | Kind::Gray8 => Self::Bytes(vec![0; samples]),
            Kind::Float(_) => Self::Floats(vec![NO_DATA; samples]),
        }
    }

    /// Clears what lies beyond `width` and `height` pixels of the tile.
    pub(super) fn blank_beyond(&mut self, kind: Kind, width: u32, height: u32) {
        let (row, kept, rows) = (SIDE * kind.samples(), width as usize * kind.samples(), height as usize);
        let from = |y: usize| if y < rows { kept } else { 0 };
        match self {
            Self::Bytes(values) => {
                values.chunks_exact_mut(row).enumerate().for_each(|(y, row)| row[from(y)..].fill(0));
            }
            Self::Floats(values) => {
                values.chunks_exact_mut(row).enumerate().for_each(|(y, row)| row[from(y)..].fill(NO_DATA));
            }
        }
    }

    /// Half as large: means of up to four pixels that have data.
    pub(super) fn halved(&self, kind: Kind) -> Self {
        match self {
            Self::Bytes(values) => Self::Bytes(halved(values, kind.samples(), mean_of_bytes)),
            Self::Floats(values) => Self::Floats(halved(values, kind.samples(), mean_of_floats)),
        }
    }

    /// Stores a halved tile as a quarter of this one.
    pub(super) fn put_quarter(&mut self, kind: Kind, half: &Self, at: (u32, u32)) {
        match (self, half) {
            (Self::Bytes(whole), Self::Bytes(half)) => put_quarter(whole, half, kind.samples(), at),
            (Self::Floats(whole), Self::Floats(half)) => put_quarter(whole, half, kind.samples(), at),
            _ => debug_assert!(false, "tiles of two kinds"),
        }
    }

    /// The differences of neighbours, deflated: predictor 2 of bytes, 3 of floats.
    pub(super) fn packed(&self, kind: Kind) -> Vec<u8> {
        let stride = kind.samples();
        let mut bytes = match self {
            Self::Bytes(values) => values.clone(),
            Self::Floats(values) => values.chunks_exact(SIDE * stride).flat_map(planes_of).collect(),
        };
        for row in bytes.chunks_exact_mut(SIDE * kind.bytes()) {
            (stride..row.len()).rev().for_each(|k| row[k] = row[k].wrapping_sub(row[k - stride]));
        }
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(4));
        // A vector takes whatever is written.
        let _ = encoder.write_all(&bytes);
        encoder.finish().unwrap_or_default()
    }

    /// The inverse of [`Self::packed`].
    pub(super) fn unpacked(kind: Kind, packed: &[u8]) -> io::Result<Self> {
        let (stride, row_bytes) = (kind.samples(), SIDE * kind.bytes());
        let mut bytes = vec![0; SIDE * row_bytes];
        ZlibDecoder::new(packed).read_exact(&mut bytes)?;
        for row in bytes.chunks_exact_mut(row_bytes) {
            (stride..row.len()).for_each(|k| row[k] = row[k].wrapping_add(row[k - stride]));
        }
        Ok(match kind {
            Kind::Rgba8 | Kind::Gray8 => Self::Bytes(bytes),
            Kind::Float(_) => Self::Floats(bytes.chunks_exact(row_bytes).flat_map(floats_of).collect()),
        })
    }
}

/// The first bytes of all floats of a row, then the second ones, and so on, the highest first.
fn planes_of(row: &[f32]) -> Vec<u8> {
    let mut out = vec![0; 4 * row.len()];
    for (k, value) in row.iter().enumerate() {
        for (plane, byte) in value.to_be_bytes().into_iter().enumerate() {
            out[plane * row.len() + k] = byte;
        }
    }
    out
}

fn floats_of(planes: &[u8]) -> Vec<f32> {
    let count = planes.len() / 4;
    (0..count).map(|k| f32::from_be_bytes(std::array::from_fn(|plane| planes[plane * count + k]))).collect()
}

fn halved<T: Copy + Default>(values: &[T], samples: usize, mean: impl Fn([&[T]; 4], &mut [T])) -> Vec<T> {
    let half = SIDE / 2;
    let mut out = vec![T::default(); half * half * samples];
    let pixel = |x: usize, y: usize| &values[(y * SIDE + x) * samples..][..samples];
    for (k, out) in out.chunks_exact_mut(samples).enumerate() {
        let (x, y) = (2 * (k % half), 2 * (k / half));
        mean([pixel(x, y), pixel(x + 1, y), pixel(x, y + 1), pixel(x + 1, y + 1)], out);
    }
    out
}

/// The mean colour of the pixels whose last sample is not 0: opaque ones, and gray ones with data.
fn mean_of_bytes(pixels: [&[u8]; 4], out: &mut [u8]) {
    let (mut sums, mut count) = ([0u32; 4], 0);
    for pixel in pixels.iter().filter(|pixel| pixel.last().is_some_and(|last| *last > 0)) {
        sums.iter_mut().zip(*pixel).for_each(|(sum, value)| *sum += u32::from(*value));
        count += 1;
    }
    if count > 0 {
        out.iter_mut().zip(sums).for_each(|(out, sum)| *out = ((sum + count / 2) / count) as u8);
    }
}

/// The mean of each band over the pixels that have data in it.
fn mean_of_floats(pixels: [&[f32]; 4], out: &mut [f32]) {
    for (band, out) in out.iter_mut().enumerate() {
        let (mut sum, mut count) = (0.0, 0);
        for value in pixels.iter().map(|pixel| pixel[band]).filter(|value| *value != NO_DATA && value.is_finite()) {
            sum += f64::from(value);
            count += 1;
        }
        *out = if count > 0 { (sum / f64::from(count)) as f32 } else { NO_DATA };
    }
}

fn put_quarter<T: Copy>(whole: &mut [T], half: &[T], samples: usize, (x, y): (u32, u32)) {
    let (row, left, top) = (SIDE / 2 * samples, x as usize * SIDE / 2, y as usize * SIDE / 2);
    for (k, from) in half.chunks_exact(row).enumerate() {
        whole[((top + k) * SIDE + left) * samples..][..row].copy_from_slice(from);
    }
}
