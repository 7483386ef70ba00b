//! Poses by how the colours of the points fit the photographs, where nothing says which photograph shows which points.

use rayon::prelude::*;

use super::super::colmap::Point;
use super::super::{Dataset, Error, Pixels, Role, Supply, View};
use super::inverted::{Convention, WrongConvention};
use super::{LEAST_POINTS, PoseFault};
use crate::scene::Camera;

/// Cells along the longer side of a photograph: its coarse colours are compared, so that leaves and grass do not have to agree.
const SIDE: u32 = 64;
/// Points are looked at up to about this many.
const MOST_POINTS: usize = 20_000;
/// Points farther than this many times the nearest of their cell are hidden.
const HIDDEN: f64 = 1.05;
/// A photograph is judged by so many cells with points at least.
const LEAST_CELLS: usize = 100;
/// So many photographs have to be judged at least, ...
const LEAST_PHOTOGRAPHS: usize = 8;
/// ... and the correlation of half of them has to be this: below, the colours of points say nothing.
const TELLING: f64 = 0.5;
/// A pose is wrong below this share of the median ...
const SHARE: f64 = 0.35;
/// ... and so many times as far below the lower quartile as that is below the median.
const SPREADS: f64 = 5.0;
/// As they are read, poses in another convention correlate less than this.
const UNFIT: f64 = 0.2;

/// The colours of a photograph in few cells.
#[derive(Debug, PartialEq)]
pub(in crate::dataset) struct Coarse {
    size: [u32; 2],
    /// Sums of red, green and blue, and of the pixels that count.
    cells: Vec<[f32; 4]>,
}

impl Coarse {
    /// Of a photograph of a camera's size; `None` where the pixels are not as many.
    pub(in crate::dataset) fn of(pixels: &Pixels, camera: &Camera) -> Option<Self> {
        let (width, height) = (camera.width as usize, camera.height as usize);
        if width * height == 0 || width * height != pixels.len() {
            return None;
        }
        let scale = (f64::from(SIDE) / f64::from(camera.width.max(camera.height))).min(1.0);
        let size = [camera.width, camera.height].map(|side| ((f64::from(side) * scale).round() as u32).max(1));
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

    /// The correlation of the points' colours with the photograph's, from a camera; `None` where too little of it has points.
    fn fit(&self, camera: &Camera, points: &[&Point]) -> Option<f64> {
        let center = camera.center();
        let [width, height] = self.size.map(f64::from);
        let place = |point: &&&Point| {
            let d: [f64; 3] = std::array::from_fn(|k| point.position[k] - center[k]);
            let [x, y, z] = camera.rotation.map(|row| (0..3).map(|k| row[k] * d[k]).sum::<f64>());
            let u = (camera.fx * x / z + camera.cx) / f64::from(camera.width) * width;
            let v = (camera.fy * y / z + camera.cy) / f64::from(camera.height) * height;
            let inside = z > 0.0 && (0.0..width).contains(&u) && (0.0..height).contains(&v);
            inside.then_some((v as usize * self.size[0] as usize + u as usize, z, point.color))
        };
        let placed: Vec<(usize, f64, [u8; 3])> = points.iter().filter_map(|point| place(&point)).collect();
        let mut nearest = vec![f64::INFINITY; self.cells.len()];
        placed.iter().for_each(|(cell, z, _)| nearest[*cell] = nearest[*cell].min(*z));
        let mut sums = vec![[0.0_f64; 4]; self.cells.len()];
        for (cell, _, color) in placed.iter().filter(|(cell, z, _)| *z <= HIDDEN * nearest[*cell]) {
            (0..3).for_each(|k| sums[*cell][k] += f64::from(color[k]) / 255.0);
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

/// Mean colour of points in a cell, and that of the photograph there.
type Pair = ([f64; 3], [f64; 3]);

/// Of the channels together, the mean of each taken off.
fn correlation(pairs: &[Pair]) -> f64 {
    let n = pairs.len() as f64;
    let mean = |of: &dyn Fn(&Pair) -> f64| pairs.iter().map(of).sum::<f64>() / n;
    let (mut both, mut first, mut second) = (0.0, 0.0, 0.0);
    for k in 0..3 {
        let (a, b) = (mean(&|p| p.0[k]), mean(&|p| p.1[k]));
        both += mean(&|p| (p.0[k] - a) * (p.1[k] - b));
        first += mean(&|p| (p.0[k] - a).powi(2));
        second += mean(&|p| (p.1[k] - b).powi(2));
    }
    both / (first * second).sqrt().max(1e-9)
}

impl Dataset {
    /// Photographs of a role that the colours of the points do not fit from their poses, though those of nearly all others do: their
    /// positions in the order of [`Dataset::views_of`], which is that of `photographs`, too. Those that the points' tracks say enough of
    /// are not looked at. An error where all would fit with their poses in another convention.
    pub fn poses_against_colours(
        &self,
        role: Role,
        photographs: &[Option<Supply>],
    ) -> Result<Vec<(usize, PoseFault)>, Error> {
        let tracked = self.tracked();
        let of = |(k, ((view, of), photograph)): (usize, ((usize, &'_ View), &'_ Option<Supply>))| {
            let untold = tracked.get(view).is_some_and(|points| *points < LEAST_POINTS);
            let coarse = photograph.as_ref().filter(|_| untold)?.coarse()?;
            Some((k, of.camera, coarse.clone()))
        };
        let judged: Vec<_> = self.views_of(role).zip(photographs).enumerate().filter_map(of).collect();
        if judged.len() < LEAST_PHOTOGRAPHS || self.colourless.is_some() {
            return Ok(Vec::new());
        }
        let step = self.points.len().div_ceil(MOST_POINTS).max(1);
        let points: Vec<&Point> = self.points.iter().step_by(step).collect();
        let fits = |read: &(dyn Fn(&Camera) -> Camera + Sync)| -> Vec<(usize, f64)> {
            let fit = |(k, camera, coarse): &(usize, Camera, std::sync::Arc<Coarse>)| {
                Some((*k, coarse.fit(&read(camera), &points)?))
            };
            judged.par_iter().filter_map(fit).collect()
        };
        let as_read = fits(&|camera| *camera);
        let [lower, middle] = quartiles(&as_read);
        if as_read.len() < LEAST_PHOTOGRAPHS || middle < UNFIT {
            for found in Convention::ALL {
                let otherwise = fits(&|camera| found.camera(self.format, camera));
                if 10 * otherwise.len() >= 8 * judged.len() && quartiles(&otherwise)[1] >= TELLING {
                    let what = WrongConvention { format: self.format, found };
                    return Err(Error::PosesInOtherConvention { file: self.path.clone(), what });
                }
            }
        }
        if as_read.len() < LEAST_PHOTOGRAPHS || middle < TELLING {
            return Ok(Vec::new());
        }
        let bound = (SHARE * middle).min(lower - SPREADS * (middle - lower));
        let wrong = as_read.into_iter().filter(|(_, fit)| *fit < bound);
        Ok(wrong.map(|(k, fit)| (k, PoseFault::Colours { fit, usual: middle })).collect())
    }

    /// Of each view how many points are said to be in its picture.
    fn tracked(&self) -> Vec<usize> {
        let mut out = vec![0; self.views.len()];
        for view in (0..self.points.len()).flat_map(|point| self.tracks.of(point)) {
            if let Some(count) = out.get_mut(*view as usize) {
                *count += 1;
            }
        }
        out
    }
}

/// The lower quartile and the median.
fn quartiles(fits: &[(usize, f64)]) -> [f64; 2] {
    let mut all: Vec<f64> = fits.iter().map(|(_, fit)| *fit).collect();
    all.sort_by(f64::total_cmp);
    [all.len() / 4, all.len() / 2].map(|at| all.get(at).copied().unwrap_or(0.0))
}
