//! Twin of `glsl/include/tile.glsl`: which tiles hold a pixel centre where a splat is not skipped.
//!
//! The same operations in the same order, so that with `f32` the lists are those of a device with IEEE division and
//! root. The margins and their reasons are described in the shader.

use super::Real;
use std::ops::Range;

const LEVEL_MARGIN: f64 = 1.0 / 16_384.0;
const SHRINK: f64 = 1.0 - 1.0 / 131_072.0;
const END_MARGIN: f64 = 1.0 / 1_048_576.0;
const FAR: f64 = 1.0e9;
const UNBOUNDED: f64 = 1.0e18;

/// The alpha below which a splat does not count at a pixel (Kerbl et al. 2023).
pub const ALPHA_MIN: f32 = 1.0 / 255.0;

/// Sizes of an image and of its tiles, in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileGrid {
    /// Image width and height.
    pub image: [u32; 2],
    /// Tile width and height: powers of two.
    pub tile: [u32; 2],
    /// The alpha below which a splat is skipped at a pixel.
    pub alpha_min: f32,
}

impl TileGrid {
    /// A grid that skips splats below an alpha of 1/255.
    pub fn new(image: [u32; 2], tile: [u32; 2]) -> Self {
        Self { image, tile, alpha_min: ALPHA_MIN }
    }

    /// Columns and rows of tiles.
    pub fn counts(&self) -> [u32; 2] {
        [self.image[0].div_ceil(self.tile[0]), self.image[1].div_ceil(self.tile[1])]
    }
}

/// Values that all tile rows of one splat share.
#[derive(Clone, Debug)]
pub struct TileEllipse<T> {
    mean: [T; 2],
    inv_a: T,
    b: T,
    a_t: T,
    det: T,
    extent_y: T,
    top_y: T,
    /// Rows of tiles that may be touched.
    pub rows: Range<u32>,
}

/// ln x for normal x > 0, by the shader's series.
fn ln<T: Real>(x: T) -> T {
    let digits = if size_of::<T>() == 4 { 23 } else { 52 };
    let (mantissa, exponent, _) = x.integer_decode();
    let mut m = T::of(mantissa as f64 / (1u64 << digits) as f64);
    let mut e = T::of(f64::from(exponent) + f64::from(digits));
    if m > T::of(f64::from(std::f32::consts::SQRT_2)) {
        m *= T::of(0.5);
        e += T::one();
    }
    let inv = T::one() / (m + T::one());
    let s = (m - T::one()) * inv;
    let z = s * s;
    let series = T::one() + z * (T::of(1.0 / 3.0) + z * (T::of(0.2) + z * (T::of(1.0 / 7.0) + z * T::of(1.0 / 9.0))));
    e * T::of(std::f64::consts::LN_2) + (s + s) * series
}

fn clamp<T: Real>(x: T, low: T, high: T) -> T {
    x.max(low).min(high)
}

/// Pixels of an axis whose centres lie in [low, high], as a range of tiles.
fn span<T: Real>(low: T, high: T, pixels: u32, tile: u32) -> Range<u32> {
    let half = T::of(0.5);
    let size = T::of(f64::from(pixels));
    let first = clamp((low - half).ceil(), T::zero(), size);
    let last = clamp((high - half).floor(), -T::one(), size - T::one());
    if first <= last { (first.f64() as u32 / tile)..(last.f64() as u32 / tile + 1) } else { 0..0 }
}

/// Prepares the test for one splat: mean in pixels, conic (A, B, C), opacity with its anti-aliasing factor.
pub fn ellipse<T: Real>(mean: [T; 2], conic: [T; 3], opacity: T, grid: &TileGrid) -> TileEllipse<T> {
    let mut e = TileEllipse {
        mean,
        inv_a: T::zero(),
        b: T::zero(),
        a_t: T::zero(),
        det: T::zero(),
        extent_y: T::zero(),
        top_y: T::zero(),
        rows: 0..0,
    };
    let (tiny, huge, far) = (T::of(1.0e-30), T::of(1.0e15), T::of(FAR));
    let scaled = opacity / T::of(f64::from(grid.alpha_min));
    let sound = conic[0] > tiny
        && conic[0] < huge
        && conic[2] > tiny
        && conic[2] < huge
        && conic[1].abs() < huge
        && mean[0].abs() < far
        && mean[1].abs() < far
        && scaled > T::of(0.5)
        && scaled < T::of(1.0e6);
    if !sound {
        return e;
    }
    let t = T::of(2.0) * ln(scaled) + T::of(LEVEL_MARGIN);
    if t <= T::zero() {
        return e;
    }
    let a = conic[0] * T::of(SHRINK);
    let c = conic[2] * T::of(SHRINK);
    let b = conic[1];
    let det = a * c - b * b;
    let a_t = a * t;
    let unbounded = T::of(UNBOUNDED);
    let mut extent = unbounded;
    let mut top = if b > T::zero() { -unbounded } else { unbounded };
    if det > T::zero() {
        let inv_det = T::one() / det;
        let inv_c = T::one() / c;
        extent = ((a_t * inv_det).sqrt() * T::of(1.0 + END_MARGIN)).min(unbounded);
        let widest = ((c * t) * inv_det).sqrt();
        top = clamp(-(b * inv_c) * widest, -unbounded, unbounded);
    }
    let slack = T::of(END_MARGIN) * (mean[1].abs() + extent);
    let low = (mean[1] - extent) - slack;
    let high = (mean[1] + extent) + slack;
    e.rows = span(low, high, grid.image[1], grid.tile[1]);
    e.inv_a = T::one() / a;
    e.b = b;
    e.a_t = a_t;
    e.det = det;
    e.extent_y = extent;
    e.top_y = top;
    e
}

/// Columns of tiles that the splat touches in a row of tiles.
pub fn row<T: Real>(e: &TileEllipse<T>, row: u32, grid: &TileGrid) -> Range<u32> {
    let half = T::of(0.5);
    let y0 = T::of(f64::from(row * grid.tile[1])) + half;
    let y1 = T::of(f64::from(((row + 1) * grid.tile[1]).min(grid.image[1]))) - half;
    let d0 = (y0 - e.mean[1]).max(-e.extent_y);
    let d1 = (y1 - e.mean[1]).min(e.extent_y);
    if d0 > d1 {
        return 0..0;
    }
    let at = |dy: T| {
        let centre = -(e.b * dy) * e.inv_a;
        let half_width = (e.a_t - e.det * (dy * dy)).max(T::zero()).sqrt() * e.inv_a;
        (centre, half_width, T::of(END_MARGIN) * (e.mean[0].abs() + (centre.abs() + half_width)))
    };
    let (c_right, w_right, slack_right) = at(clamp(e.top_y, d0, d1));
    let (c_left, w_left, slack_left) = at(clamp(-e.top_y, d0, d1));
    let high = (e.mean[0] + (c_right + w_right)) + slack_right;
    let low = (e.mean[0] + (c_left - w_left)) - slack_left;
    span(low, high, grid.image[0], grid.tile[0])
}

/// Tiles that a splat touches.
pub fn count<T: Real>(mean: [T; 2], conic: [T; 3], opacity: T, grid: &TileGrid) -> u32 {
    let e = ellipse(mean, conic, opacity, grid);
    e.rows.clone().map(|y| row(&e, y, grid).len() as u32).sum()
}

/// The tiles a splat touches, as numbers `row * columns + column` in row-major order:
/// the order in which `emit` writes them.
pub fn list<T: Real>(mean: [T; 2], conic: [T; 3], opacity: T, grid: &TileGrid) -> Vec<u32> {
    let e = ellipse(mean, conic, opacity, grid);
    let columns = grid.counts()[0];
    e.rows.clone().flat_map(|y| row(&e, y, grid).map(move |x| y * columns + x)).collect()
}
