//! Twin of `glsl/include/stereo_window.glsl`: bilateral NCC of windows, tap by tap.

use super::Sweep;
use crate::pass::stereo::LINK_ROWS;
use crate::twin::Real;

/// Variance below which a window has too little texture.
const LEAST_VARIANCE: f64 = 4e-6;

/// A window of the reference.
pub struct Window<R> {
    /// Offset of each tap from the pixel.
    pub offsets: Vec<[i32; 2]>,
    /// Weights that sum to 1.
    pub weights: Vec<R>,
    /// Weights times deviations in units of their root mean square.
    pub pattern: Vec<R>,
    /// Weighted mean.
    pub pivot: R,
    /// Weighted variance.
    pub variance: R,
}

impl<R: Real> Window<R> {
    /// Whether the window has enough texture to compare.
    pub fn textured(&self) -> bool {
        self.variance >= R::of(LEAST_VARIANCE)
    }

    /// The window of a pixel.
    pub fn load(sweep: &Sweep<'_, R>, x: i32, y: i32) -> Self {
        let push = sweep.push;
        let (width, height) = (push.width as i32, push.height as i32);
        let reach = ((sweep.side - 1) * sweep.step / 2) as i32;
        let value = |x: i32, y: i32| sweep.blocks[(y * width + x) as usize][0];
        let centre = value(x, y);
        let offsets: Vec<[i32; 2]> = (0..sweep.side * sweep.side)
            .map(|t| [t % sweep.side, t / sweep.side].map(|k| (k * sweep.step) as i32 - reach))
            .collect();
        let mut window =
            Self { offsets, weights: Vec::new(), pattern: Vec::new(), pivot: R::zero(), variance: R::zero() };
        let (mut sum, mut first, mut second) = (R::zero(), R::zero(), R::zero());
        for &[dx, dy] in &window.offsets {
            let inside = (0..width).contains(&(x + dx)) && (0..height).contains(&(y + dy));
            let difference = value((x + dx).clamp(0, width - 1), (y + dy).clamp(0, height - 1)) - centre;
            let squared = R::of(f64::from(dx * dx + dy * dy));
            let exponent =
                squared * R::of(push.by_distance.into()) + difference * difference * R::of(push.by_luma.into());
            let weight = if inside { (-exponent).exp() } else { R::zero() };
            window.weights.push(weight);
            window.pattern.push(difference);
            sum += weight;
            first += weight * difference;
            second += weight * difference * difference;
        }
        let mean = first / sum;
        window.variance = second / sum - mean * mean;
        window.pivot = centre + mean;
        let scale = R::one() / window.variance.max(R::of(LEAST_VARIANCE)).sqrt();
        for (weight, pattern) in window.weights.iter_mut().zip(&mut window.pattern) {
            *weight /= sum;
            *pattern = *weight * (*pattern - mean) * scale;
        }
        window
    }

    /// 1 + NCC with one source; `None` where the source does not see the window's centre.
    pub fn source_score(&self, sweep: &Sweep<'_, R>, source: usize, hypothesis: [R; 3], middle: [R; 2]) -> Option<R> {
        let links = &sweep.links[LINK_ROWS * source..][..LINK_ROWS];
        let stride = sweep.push.stride as usize;
        let picture = &sweep.blocks[(source + 1) * stride..];
        let homogeneous = |dx: R, dy: R| -> [R; 3] {
            let d = hypothesis[0] + hypothesis[1] * dx + hypothesis[2] * dy;
            let at = [middle[0] + dx, middle[1] + dy, R::one(), d];
            std::array::from_fn(|row| (0..4).map(|k| links[row][k] * at[k]).fold(R::zero(), |a, b| a + b))
        };
        let [width, height] = [links[3][0], links[3][1]];
        let centre = homogeneous(R::zero(), R::zero());
        let at = [centre[0] / centre[2], centre[1] / centre[2]];
        let inside = |v: R, side: R| v >= R::zero() && v <= side;
        let seen = centre[2] > R::zero() && inside(at[0], width) && inside(at[1], height);
        let (mut shared, mut sum, mut squares) = (R::zero(), R::zero(), R::zero());
        for ((&[dx, dy], &weight), &pattern) in self.offsets.iter().zip(&self.weights).zip(&self.pattern) {
            let h = homogeneous(R::of(dx.into()), R::of(dy.into()));
            let z = h[2].max(R::of(1e-12));
            let value = sample(picture, [width, height], [h[0] / z, h[1] / z]) - self.pivot;
            shared += pattern * value;
            sum += weight * value;
            squares += weight * value * value;
        }
        let least = R::of(LEAST_VARIANCE);
        let variance = squares - sum * sum;
        let score = (R::one() + shared / variance.max(least).sqrt()).max(R::zero()).min(R::of(2.0));
        seen.then_some(if variance < least { R::zero() } else { score })
    }

    /// Mean of the best scores among the sources that see the window's centre.
    pub fn score(&self, sweep: &Sweep<'_, R>, hypothesis: [R; 3], middle: [R; 2]) -> R {
        let mut scores: Vec<R> = (0..sweep.push.sources as usize)
            .filter_map(|source| self.source_score(sweep, source, hypothesis, middle))
            .collect();
        scores.sort_by(|a, b| b.partial_cmp(a).unwrap_or(std::cmp::Ordering::Equal));
        scores.truncate(sweep.push.best as usize);
        scores.iter().fold(R::zero(), |a, b| a + *b) / R::of(scores.len().max(1) as f64)
    }
}

/// Bilinear sample of an image stored as blocks of 2x2 pixels. `at` is in pixels, with pixel centres at half-integers.
pub fn sample<R: Real>(picture: &[[R; 4]], [width, height]: [R; 2], at: [R; 2]) -> R {
    let half = R::of(0.5);
    let within = |v: R, side: R| (v - half).max(R::zero()).min(side - R::one());
    let (u, v) = (within(at[0], width), within(at[1], height));
    let (fx, fy) = (u - u.floor(), v - v.floor());
    let row = v.floor().f64() as usize * width.f64() as usize + u.floor().f64() as usize;
    let b = picture[row];
    let mix = |a: R, b: R, f: R| a + (b - a) * f;
    mix(mix(b[0], b[1], fx), mix(b[2], b[3], fx), fy)
}
