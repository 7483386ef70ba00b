//! Corners of a photograph with their surroundings, for matching with other photographs.

use super::super::Pixels;
use super::coarse::Coarse;
use crate::scene::Camera;

/// Cells along the longer side of a photograph.
const SIDE: u32 = 320;
/// Most corners.
const MOST: usize = 300;
/// Cells on each side of a corner in the compared square.
const REACH: usize = 3;
/// Values of the square.
const VALUES: usize = (2 * REACH + 1) * (2 * REACH + 1);
/// Cells on each side of a corner over which its strength is summed.
const SUMMED: usize = 2;
/// Least distance between two corners in cells.
const APART: usize = 3;
/// Least correlation of matching corners ...
const ALIKE: f32 = 0.8;
/// ... and its least lead over the correlation of either corner with any other corner.
const UNLIKE: f32 = 0.1;

/// A photograph's corners.
pub(super) struct Sketch {
    size: [u32; 2],
    camera_size: [u32; 2],
    /// Column and row.
    corners: Vec<[usize; 2]>,
    /// The brightness around each corner, with mean 0 and norm 1.
    patches: Vec<[f32; VALUES]>,
}

impl Sketch {
    /// `None` where the pixels do not have the camera's size.
    pub(super) fn of(pixels: &Pixels, camera: &Camera) -> Option<Self> {
        let cells = Coarse::with_side(pixels, camera, SIDE)?;
        let size = cells.size();
        let brightness = cells.brightness();
        let [width, height] = size.map(|side| side as usize);
        let stands_out = stands_out(&brightness, [width, height]);
        let mut corners = peaks(&stands_out, [width, height]);
        // The most prominent corners first, equal ones in row order.
        let prominence = |[x, y]: &[usize; 2]| stands_out[y * width + x];
        corners.sort_by(|a, b| prominence(b).total_cmp(&prominence(a)));
        corners.truncate(MOST);
        let (mut kept, mut patches) = (Vec::new(), Vec::new());
        for corner in corners {
            if let Some(patch) = patch(&brightness, width, corner) {
                kept.push(corner);
                patches.push(patch);
            }
        }
        Some(Self { size, camera_size: [camera.width, camera.height], corners: kept, patches })
    }

    /// Pixels per cell.
    pub(super) fn cell(&self) -> f64 {
        f64::from(self.camera_size[0]) / f64::from(self.size[0])
    }

    /// Pixel positions of matching corners in both photographs.
    pub(super) fn matches(&self, other: &Self) -> Vec<[[f64; 2]; 2]> {
        let mut here = vec![Best::default(); self.patches.len()];
        let mut there = vec![Best::default(); other.patches.len()];
        for (i, a) in self.patches.iter().enumerate() {
            for (j, b) in other.patches.iter().enumerate() {
                let alike: f32 = a.iter().zip(b).map(|(x, y)| x * y).sum();
                here[i].add(j, alike);
                there[j].add(i, alike);
            }
        }
        let matched = |(i, best): (usize, &Best)| {
            let back = there.get(best.at)?;
            let clear = best.alike - best.second.max(back.second) >= UNLIKE;
            (back.at == i && best.alike >= ALIKE && clear).then(|| [self.pixel(i), other.pixel(best.at)])
        };
        here.iter().enumerate().filter_map(matched).collect()
    }

    fn pixel(&self, corner: usize) -> [f64; 2] {
        let [x, y] = self.corners[corner];
        let along = |at: usize, k: usize| (at as f64 + 0.5) * f64::from(self.camera_size[k]) / f64::from(self.size[k]);
        [along(x, 0), along(y, 1)]
    }
}

/// The most similar corner of another photograph.
#[derive(Clone, Copy, Default)]
struct Best {
    at: usize,
    alike: f32,
    second: f32,
}

impl Best {
    fn add(&mut self, at: usize, alike: f32) {
        if alike > self.alike {
            *self = Self { at, alike, second: self.alike };
        } else if alike > self.second {
            self.second = alike;
        }
    }
}

/// Corner strength of each cell: the smaller eigenvalue of the structure tensor; 0 at the border and beside masked
/// cells.
fn stands_out(brightness: &[Option<f32>], [width, height]: [usize; 2]) -> Vec<f32> {
    let at = |x: usize, y: usize| brightness[y * width + x];
    let slope = |x: usize, y: usize| {
        let inside = x > 0 && y > 0 && x + 1 < width && y + 1 < height;
        let of = || Some([at(x + 1, y)? - at(x - 1, y)?, at(x, y + 1)? - at(x, y - 1)?]);
        if inside { of() } else { None }
    };
    let slopes: Vec<Option<[f32; 2]>> = (0..width * height).map(|i| slope(i % width, i / width)).collect();
    let products = |slope: &Option<[f32; 2]>| slope.map(|[x, y]| [x * x, x * y, y * y]);
    let products: Vec<Option<[f32; 3]>> = slopes.iter().map(products).collect();
    let rows = summed(&products, 1, |i| i % width >= SUMMED && i % width + SUMMED < width);
    let sums = summed(&rows, width, |i| i / width >= SUMMED && i / width + SUMMED < height);
    let least = |sums: &Option<[f32; 3]>| {
        let [xx, xy, yy] = sums.unwrap_or_default();
        // The smaller eigenvalue.
        0.5 * (xx + yy) - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt()
    };
    sums.iter().map(least).collect()
}

/// Sums over neighbours at a stride; `None` where a neighbour has none.
fn summed(of: &[Option<[f32; 3]>], stride: usize, inside: impl Fn(usize) -> bool) -> Vec<Option<[f32; 3]>> {
    let sum = |i: usize| {
        let mut all = [0.0; 3];
        for k in 0..=2 * SUMMED {
            let one = of[i + k * stride - SUMMED * stride]?;
            (0..3).for_each(|c| all[c] += one[c]);
        }
        Some(all)
    };
    (0..of.len()).map(|i| if inside(i) { sum(i) } else { None }).collect()
}

/// Cells with a larger corner strength than all their neighbours.
fn peaks(stands_out: &[f32], [width, height]: [usize; 2]) -> Vec<[usize; 2]> {
    let margin = APART.max(REACH);
    let mut out = Vec::new();
    for y in margin..height.saturating_sub(margin) {
        for x in margin..width.saturating_sub(margin) {
            let own = stands_out[y * width + x];
            let row = |dy: usize| (y + dy - APART) * width + x - APART;
            let highest = || {
                (0..=2 * APART).all(|dy| stands_out[row(dy)..=row(dy) + 2 * APART].iter().all(|other| *other <= own))
            };
            if own > 0.0 && highest() {
                out.push([x, y]);
            }
        }
    }
    out
}

/// The brightness around a corner; `None` beside masked cells, and for uniform brightness.
fn patch(brightness: &[Option<f32>], width: usize, [x, y]: [usize; 2]) -> Option<[f32; VALUES]> {
    let mut values = [0.0; VALUES];
    for (i, value) in values.iter_mut().enumerate() {
        let side = 2 * REACH + 1;
        *value = brightness[(y + i / side - REACH) * width + x + i % side - REACH]?;
    }
    let mean = values.iter().sum::<f32>() / VALUES as f32;
    values.iter_mut().for_each(|value| *value -= mean);
    let length = values.iter().map(|value| value * value).sum::<f32>().sqrt();
    values.iter_mut().for_each(|value| *value /= length.max(1e-6));
    (length > 1e-6).then_some(values)
}
