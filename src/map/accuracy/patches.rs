//! How far patches of an orthophoto lie from where they belong, to fractions of a cell.

use rayon::prelude::*;
use serde::Serialize;

use super::{Errors, median, plane::solved};

/// Largest shift that is looked for, cells.
const REACH: isize = 6;
/// Least and largest side of a patch, cells.
const SIDES: [usize; 2] = [12, 32];
/// Patches along a picture that is as high as wide, where its size allows.
const ALONG: f64 = 20.0;
/// Most patches that are compared.
const MOST: usize = 4096;
/// Least mean square of the brightness' slope in the direction in which it is least, in steps of 255 per cell.
const TEXTURE: f64 = 4.0;
/// Least share of a patch's cells that both pictures must have.
const COVERED: f64 = 0.7;
/// Rounds of refinement, and the shift in cells below which they end.
const ROUNDS: usize = 40;
const STILL: f64 = 1e-4;
/// Farther than this many cells from the best whole shift, a refinement has lost its way.
const ASTRAY: f64 = 1.5;
/// Weights of the smoothing before pictures are compared: both are smoothed alike.
const SMOOTH: [f64; 5] = [0.0545, 0.2442, 0.4026, 0.2442, 0.0545];

/// Brightness of a picture, row-major; NaN where there is none.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The pixels, 0 to 255.
    pub values: &'a [f32],
}

/// Shifts of patches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Patches {
    /// Side of a patch, cells.
    pub side: usize,
    /// Patches with texture in the reference.
    pub textured: usize,
    /// Of those, the patches that were compared: the map covers them.
    pub count: usize,
    /// Of those, the patches whose shift is known to whole cells alone.
    pub coarse: usize,
    /// Root of the mean square of the length of the shift, metres.
    pub rmse: f64,
    /// Median of the length of the shift, metres.
    pub median_length: f64,
    /// Median shift to the east and to the north, metres.
    pub median: [f64; 2],
    /// Root of the mean square of the shift to the east and to the north, metres.
    pub rmse_axes: [f64; 2],
}

/// Compares a picture with a reference of the same size. Nothing where no patch of the reference has texture.
pub fn patches(reference: &Picture<'_>, map: &Picture<'_>, gsd: f64) -> Option<Patches> {
    let (width, height) = (reference.width, reference.height);
    let side = (((width * height) as f64).sqrt() / ALONG) as usize;
    let side = side.clamp(SIDES[0], SIDES[1]);
    let smoothed = [reference, map].map(smooth);
    let [truth, seen] = [0, 1].map(|k| Picture { width, height, values: &smoothed[k] });
    let corners = corners((width, height), side);
    let found: Vec<Option<Shift>> = corners
        .into_par_iter()
        .filter(|corner| has_texture(&truth, *corner, side))
        .map(|corner| shift(&truth, &seen, corner, side))
        .collect();
    let shifts: Vec<Shift> = found.iter().flatten().copied().collect();
    if found.is_empty() {
        return None;
    }
    let east: Vec<f64> = shifts.iter().map(|s| s.by[0] * gsd).collect();
    let north: Vec<f64> = shifts.iter().map(|s| -s.by[1] * gsd).collect();
    let lengths: Vec<f64> = east.iter().zip(&north).map(|(e, n)| e.hypot(*n)).collect();
    Some(Patches {
        side,
        textured: found.len(),
        count: shifts.len(),
        coarse: shifts.iter().filter(|s| s.coarse).count(),
        rmse: Errors::of(&lengths).rmse,
        median_length: median(lengths),
        rmse_axes: [Errors::of(&east).rmse, Errors::of(&north).rmse],
        median: [median(east), median(north)],
    })
}

/// A patch's shift in cells: the reference's content is found this far to the right and down.
#[derive(Clone, Copy, Debug)]
struct Shift {
    by: [f64; 2],
    coarse: bool,
}

/// Upper left corners of patches that do not overlap, thinned out evenly where there are too many.
fn corners((width, height): (usize, usize), side: usize) -> Vec<[usize; 2]> {
    let margin = REACH as usize + 2;
    let room = |size: usize| size.saturating_sub(2 * margin) / side;
    let (columns, rows) = (room(width), room(height));
    let every = (columns * rows).div_ceil(MOST).max(1);
    let all = (0..columns * rows).step_by(every);
    all.map(|k| [margin + side * (k % columns), margin + side * (k / columns)]).collect()
}

/// The picture, smoothed. A pixel without its neighbours has no value.
fn smooth(picture: &Picture<'_>) -> Vec<f32> {
    let (width, height) = (picture.width, picture.height);
    let along = |values: &[f32], stride: usize, size: usize, place: &(dyn Fn(usize) -> usize + Sync)| -> Vec<f32> {
        (0..width * height)
            .into_par_iter()
            .map(|k| {
                if place(k) < 2 || place(k) + 2 >= size {
                    return f32::NAN;
                }
                let sum = (0..5).map(|i| SMOOTH[i] * f64::from(values[k + i * stride - 2 * stride])).sum::<f64>();
                sum as f32
            })
            .collect()
    };
    let rows = along(picture.values, 1, width, &|k| k % width);
    along(&rows, width, height, &|k| k / width)
}

/// Whether brightness changes in every direction.
fn has_texture(truth: &Picture<'_>, corner: [usize; 2], side: usize) -> bool {
    let at = |x: usize, y: usize| f64::from(truth.values[y * truth.width + x]);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for y in corner[1]..corner[1] + side {
        for x in corner[0]..corner[0] + side {
            let (a, b) = (0.5 * (at(x + 1, y) - at(x - 1, y)), 0.5 * (at(x, y + 1) - at(x, y - 1)));
            (xx, xy, yy) = (xx + a * a, xy + a * b, yy + b * b);
        }
    }
    let least = 0.5 * (xx + yy - ((xx - yy) * (xx - yy) + 4.0 * xy * xy).sqrt());
    least / (side * side) as f64 >= TEXTURE
}

/// The shift of a patch; nothing where the map does not cover it.
fn shift(truth: &Picture<'_>, seen: &Picture<'_>, corner: [usize; 2], side: usize) -> Option<Shift> {
    let start = whole_shift(truth, seen, corner, side)?;
    let mut by = start;
    for _ in 0..ROUNDS {
        let Some([dx, dy, ..]) = step(truth, seen, corner, side, by) else { break };
        by = [by[0] + dx.clamp(-0.5, 0.5), by[1] + dy.clamp(-0.5, 0.5)];
        if (by[0] - start[0]).hypot(by[1] - start[1]) > ASTRAY {
            break;
        }
        if dx.hypot(dy) < STILL {
            return Some(Shift { by, coarse: false });
        }
    }
    Some(Shift { by: start, coarse: true })
}

/// The whole shift of greatest correlation.
fn whole_shift(truth: &Picture<'_>, seen: &Picture<'_>, corner: [usize; 2], side: usize) -> Option<[f64; 2]> {
    let at = |picture: &Picture<'_>, x: usize, y: usize| f64::from(picture.values[y * picture.width + x]);
    let mut best: Option<(f64, [f64; 2])> = None;
    for dy in -REACH..=REACH {
        for dx in -REACH..=REACH {
            let (mut n, mut sums, mut squares, mut product) = (0.0, [0.0; 2], [0.0; 2], 0.0);
            for y in corner[1]..corner[1] + side {
                for x in corner[0]..corner[0] + side {
                    let a = at(truth, x, y);
                    let b = at(seen, x.saturating_add_signed(dx), y.saturating_add_signed(dy));
                    if !(a.is_finite() && b.is_finite()) {
                        continue;
                    }
                    n += 1.0;
                    sums = [sums[0] + a, sums[1] + b];
                    squares = [squares[0] + a * a, squares[1] + b * b];
                    product += a * b;
                }
            }
            if n < COVERED * (side * side) as f64 {
                continue;
            }
            let spread = [0, 1].map(|k| squares[k] - sums[k] * sums[k] / n);
            let correlation = (product - sums[0] * sums[1] / n) / (spread[0] * spread[1]).sqrt().max(1e-9);
            // Of equal ones, the shorter shift.
            let rank = correlation - 1e-9 * (dx * dx + dy * dy) as f64;
            if best.is_none_or(|(known, _)| rank > known) {
                best = Some((rank, [dx as f64, dy as f64]));
            }
        }
    }
    best.map(|(_, by)| by)
}

/// One round of least squares for shift, gain and offset of brightness.
fn step(truth: &Picture<'_>, seen: &Picture<'_>, corner: [usize; 2], side: usize, by: [f64; 2]) -> Option<[f64; 4]> {
    let mut gain = [[0.0; 3]; 2];
    let mut samples = Vec::with_capacity(side * side);
    for y in corner[1]..corner[1] + side {
        for x in corner[0]..corner[0] + side {
            let want = f64::from(truth.values[y * truth.width + x]);
            let Some([value, slope_x, slope_y]) = sampled(seen, [x as f64 + by[0], y as f64 + by[1]]) else { continue };
            if !(want.is_finite() && value.is_finite()) {
                continue;
            }
            samples.push(([slope_x, slope_y, value], want));
            for (row, left) in gain.iter_mut().zip([value, 1.0]) {
                (row[0], row[1], row[2]) = (row[0] + left * value, row[1] + left, row[2] + left * want);
            }
        }
    }
    // First the gain, which the slopes are to be multiplied by.
    let [scale, _] = solved(gain)?;
    let mut normal = [[0.0; 5]; 4];
    for ([slope_x, slope_y, value], want) in samples {
        let row = [scale * slope_x, scale * slope_y, value, 1.0, want];
        for i in 0..4 {
            (0..5).for_each(|j| normal[i][j] += row[i] * row[j]);
        }
    }
    solved(normal)
}

/// Value and slopes at a place between pixels, by cubic curves through four pixels each way.
fn sampled(picture: &Picture<'_>, [x, y]: [f64; 2]) -> Option<[f64; 3]> {
    let (left, top) = (x.floor(), y.floor());
    let inside = left >= 1.0 && top >= 1.0 && left + 2.0 < picture.width as f64 && top + 2.0 < picture.height as f64;
    if !inside {
        return None;
    }
    let ((wx, sx), (wy, sy)) = (cubic(x - left), cubic(y - top));
    let mut out = [0.0; 3];
    for j in 0..4 {
        for i in 0..4 {
            let at = (top as usize + j - 1) * picture.width + left as usize + i - 1;
            let value = f64::from(picture.values[at]);
            out = [out[0] + wx[i] * wy[j] * value, out[1] + sx[i] * wy[j] * value, out[2] + wx[i] * sy[j] * value];
        }
    }
    Some(out)
}

/// Weights of four pixels for the value, and for the slope, at a share of the way from the second to the third
/// (Catmull and Rom 1974).
fn cubic(t: f64) -> ([f64; 4], [f64; 4]) {
    let (t2, t3) = (t * t, t * t * t);
    let value = [
        0.5 * (-t3 + 2.0 * t2 - t),
        0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
        0.5 * (-3.0 * t3 + 4.0 * t2 + t),
        0.5 * (t3 - t2),
    ];
    let slope = [
        0.5 * (-3.0 * t2 + 4.0 * t - 1.0),
        0.5 * (9.0 * t2 - 10.0 * t),
        0.5 * (-9.0 * t2 + 8.0 * t + 1.0),
        0.5 * (3.0 * t2 - 2.0 * t),
    ];
    (value, slope)
}
