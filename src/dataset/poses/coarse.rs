//! A photograph reduced to a few cells, and how well the colours of points fit it.

use super::super::Pixels;
use super::super::colmap::Point;
use crate::scene::Camera;

/// Cells along the longer side of a photograph. Coarse colours are compared, so that leaves and grass need not agree.
const SIDE: u32 = 64;
/// Points further away than this multiple of their cell's nearest point are hidden.
const HIDDEN: f64 = 1.05;
/// Least number of cells with points for judging a photograph.
const LEAST_CELLS: usize = 100;

/// The colours of a photograph in few cells.
#[derive(Debug, PartialEq)]
pub(in crate::dataset) struct Coarse {
    size: [u32; 2],
    /// Per cell: sums of red, green and blue, and the number of unmasked pixels.
    cells: Vec<[f32; 4]>,
}

impl Coarse {
    /// From the pixels of a photograph at its camera's size; `None` where sizes differ.
    pub(in crate::dataset) fn of(pixels: &Pixels, camera: &Camera) -> Option<Self> {
        Self::with_side(pixels, camera, SIDE)
    }

    /// [`Self::of`] with this many cells along the longer side, or one per pixel for smaller photographs.
    pub(super) fn with_side(pixels: &Pixels, camera: &Camera, side: u32) -> Option<Self> {
        let (width, height) = (camera.width as usize, camera.height as usize);
        if width * height == 0 || width * height != pixels.len() {
            return None;
        }
        let scale = (f64::from(side) / f64::from(camera.width.max(camera.height))).min(1.0);
        let size = [camera.width, camera.height].map(|pixels| ((f64::from(pixels) * scale).round() as u32).max(1));
        let mut cells = vec![[0.0_f32; 4]; size[0] as usize * size[1] as usize];
        let mut add = |pixel: usize, value: [f32; 3], alpha: bool| {
            let (x, y) = (pixel % width * size[0] as usize / width, pixel / width * size[1] as usize / height);
            if let Some(cell) = cells.get_mut(y * size[0] as usize + x).filter(|_| alpha) {
                (0..3).for_each(|k| cell[k] += value[k]);
                cell[3] += 1.0;
            }
        };
        match pixels {
            Pixels::Rgba8(all) => {
                let of = |p: &[u8]| [p[0], p[1], p[2]].map(|v| f32::from(v) / 255.0);
                all.chunks_exact(4).enumerate().for_each(|(i, p)| add(i, of(p), p[3] > 0));
            }
            Pixels::Rgba16(all) => {
                let of = |p: &[u16]| [p[0], p[1], p[2]].map(|v| f32::from(v) / 65535.0);
                all.chunks_exact(4).enumerate().for_each(|(i, p)| add(i, of(p), p[3] > 0));
            }
        }
        Some(Self { size, cells })
    }

    /// Columns and rows.
    pub(super) fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The brightness of each cell; `None` for a cell that is all masked.
    pub(super) fn brightness(&self) -> Vec<Option<f32>> {
        let of = |[r, g, b, count]: &[f32; 4]| (*count > 0.0).then(|| (r + g + b) / (3.0 * count));
        self.cells.iter().map(of).collect()
    }

    /// The correlation of the points' colours with the photograph's, seen from a camera; `None` where too few cells
    /// have points.
    pub(super) fn fit(&self, camera: &Camera, points: &[&Point]) -> Option<f64> {
        let center = camera.center();
        let [width, height] = self.size.map(f64::from);
        let place = |point: &&&Point| {
            let d: [f64; 3] = std::array::from_fn(|k| point.position[k] - center[k]);
            let [x, y, z] = camera.rotation.map(|row| (0..3).map(|k| row[k] * d[k]).sum::<f64>());
            let u = (camera.fx * x / z + camera.cx) / f64::from(camera.width) * width;
            let v = (camera.fy * y / z + camera.cy) / f64::from(camera.height) * height;
            let inside = z > 0.0 && (0.0..width).contains(&u) && (0.0..height).contains(&v);
            inside.then_some((v as usize * self.size[0] as usize + u as usize, z, point.colour))
        };
        let placed: Vec<(usize, f64, [u8; 3])> = points.iter().filter_map(|point| place(&point)).collect();
        let mut nearest = vec![f64::INFINITY; self.cells.len()];
        placed.iter().for_each(|(cell, z, _)| nearest[*cell] = nearest[*cell].min(*z));
        let mut sums = vec![[0.0_f64; 4]; self.cells.len()];
        for (cell, _, colour) in placed.iter().filter(|(cell, z, _)| *z <= HIDDEN * nearest[*cell]) {
            (0..3).for_each(|k| sums[*cell][k] += f64::from(colour[k]) / 255.0);
            sums[*cell][3] += 1.0;
        }
        let both = sums.iter().zip(&self.cells).filter(|(points, cell)| points[3] > 0.0 && cell[3] > 0.0);
        let pairs: Vec<([f64; 3], [f64; 3])> = both
            .map(|(points, cell)| {
                let photograph = std::array::from_fn(|k| f64::from(cell[k] / cell[3]));
                (std::array::from_fn(|k| points[k] / points[3]), photograph)
            })
            .collect();
        (pairs.len() >= LEAST_CELLS).then(|| correlation(&pairs))
    }
}

/// Mean colour of the points in a cell, and of the photograph there.
type ColourPair = ([f64; 3], [f64; 3]);

/// Correlation over all channels, with the mean of each channel subtracted.
fn correlation(pairs: &[ColourPair]) -> f64 {
    let n = pairs.len() as f64;
    let mean = |of: &dyn Fn(&ColourPair) -> f64| pairs.iter().map(of).sum::<f64>() / n;
    let (mut both, mut first, mut second) = (0.0, 0.0, 0.0);
    for k in 0..3 {
        let (a, b) = (mean(&|p| p.0[k]), mean(&|p| p.1[k]));
        both += mean(&|p| (p.0[k] - a) * (p.1[k] - b));
        first += mean(&|p| (p.0[k] - a).powi(2));
        second += mean(&|p| (p.1[k] - b).powi(2));
    }
    both / (first * second).sqrt().max(1e-9)
}
