//! Twin of `glsl/stereo_sweep.comp`.

use super::Window;
use crate::pass::stereo::{ARMS, FLAG_START, SweepPush};
use crate::twin::{Real, random};

/// Largest slope of random planes against the image plane.
const TILT: f64 = 1.5;

/// The inputs that all pixels of a call share.
pub struct Sweep<'a, R> {
    /// The push constants.
    pub push: &'a SweepPush,
    /// Taps along a side of the window.
    pub side: u32,
    /// Pixels between taps.
    pub step: u32,
    /// Rows of 2x2 pixels, reference first.
    pub blocks: &'a [[R; 4]],
    /// Rows of the sources.
    pub links: &'a [[R; 4]],
}

/// Whether a hypothesis is in the range of depths and faces the camera.
pub fn possible<R: Real>(push: &SweepPush, [d, gx, gy]: [R; 3], middle: [R; 2]) -> bool {
    let of = |v: f32| R::of(v.into());
    let ray = [(middle[0] - of(push.centre_x)) / of(push.focal_x), (middle[1] - of(push.centre_y)) / of(push.focal_y)];
    let (px, py) = (gx * of(push.focal_x), gy * of(push.focal_y));
    let pz = d - px * ray[0] - py * ray[1];
    let squares = (px * px + py * py + pz * pz) * (ray[0] * ray[0] + ray[1] * ray[1] + R::one());
    d >= of(push.least) && d <= of(push.most) && d * d >= of(push.facing) * of(push.facing) * squares
}

/// Random numbers from -1 to 1.
fn spread<R: Real>(bits: [u32; 4]) -> [R; 4] {
    bits.map(|b| R::of(f64::from(b >> 8) / 8_388_608.0 - 1.0))
}

/// The offsets of an arm, in the order of evaluation.
fn places(arm: u32) -> Vec<[i32; 2]> {
    let ahead: [i32; 2] = [[0, -1], [0, 1], [-1, 0], [1, 0]][(arm % 4) as usize];
    if arm >= 4 {
        return (0..11).map(|k| ahead.map(|v| v * (3 + 2 * k))).collect();
    }
    let pair = |out: i32, side: i32| [0, 1].map(|k| ahead[k] * (1 + out) + ahead[1 - k] * out * side);
    std::iter::once(ahead).chain((1..=3).flat_map(|out| [pair(out, -1), pair(out, 1)])).collect()
}

/// The hypothesis of the best neighbour on an arm, extended to the pixel.
fn arm<R: Real>(push: &SweepPush, planes: &[[R; 4]], number: u32, [x, y]: [i32; 2]) -> [R; 3] {
    let (width, height) = (push.width as i32, push.height as i32);
    let mut found = [R::zero(); 4];
    for [dx, dy] in places(number) {
        let (px, py) = (x + dx, y + dy);
        if !(0..width).contains(&px) || !(0..height).contains(&py) {
            continue;
        }
        let plane = planes[(py * width + px) as usize];
        if plane[3] > found[3] {
            let d = plane[0] - plane[1] * R::of(dx.into()) - plane[2] * R::of(dy.into());
            found = [d, plane[1], plane[2], plane[3]];
        }
    }
    [found[0], found[1], found[2]]
}

fn random_plane<R: Real>(push: &SweepPush, draw: [R; 4]) -> [R; 3] {
    let (least, most, half) = (R::of(push.least.into()), R::of(push.most.into()), R::of(0.5));
    let share = half + half * draw[0];
    let d = least * (R::one() - share) + most * share;
    let tilt = |k: usize, focal: f32| d * R::of(TILT) * draw[k] / R::of(focal.into());
    [d, tilt(1, push.focal_x), tilt(2, push.focal_y)]
}

fn changed<R: Real>(push: &SweepPush, held: [R; 3], number: u32, draw: [R; 4]) -> [R; 3] {
    let (amplitude, slope) = (R::of(push.amplitude.into()), R::of(push.slope.into()));
    let d = if number % 3 == 1 { held[0] } else { held[0] + amplitude * draw[0] };
    let along = |k: usize| if number.is_multiple_of(3) { held[k] } else { held[k] + slope * draw[k] };
    [d, along(1), along(2)]
}

/// Hypothesis number `c` of a pixel, where `held` is the best hypothesis so far.
pub fn candidates<R: Real>(push: &SweepPush, planes: &[[R; 4]], pixel: u32, c: u32, held: [R; 3]) -> [R; 3] {
    let draw = spread(random::bits([pixel, c, push.turn, push.seed]));
    let own = planes[pixel as usize];
    let start = push.flags & FLAG_START != 0;
    match (start, c) {
        (true, 0) => [own[0], own[1], own[2]],
        (true, _) => random_plane(push, draw),
        (false, c) if c < ARMS => arm(push, planes, c, [(pixel % push.width) as i32, (pixel / push.width) as i32]),
        (false, c) => changed(push, held, c - ARMS, draw),
    }
}

impl<R: Real> Sweep<'_, R> {
    /// Number of hypotheses that a pixel tries.
    pub fn tries(&self) -> u32 {
        self.push.draws + if self.push.flags & FLAG_START != 0 { 1 } else { ARMS }
    }

    /// The centre of a pixel.
    pub fn middle(&self, pixel: u32) -> [R; 2] {
        [pixel % self.push.width, pixel / self.push.width].map(|v| R::of(f64::from(v) + 0.5))
    }

    /// The window of a pixel.
    pub fn window(&self, pixel: u32) -> Window<R> {
        Window::load(self, (pixel % self.push.width) as i32, (pixel / self.push.width) as i32)
    }

    /// The hypothesis and score of a pixel after the call.
    pub fn pixel(&self, planes: &[[R; 4]], pixel: u32) -> [R; 4] {
        let (window, middle) = (self.window(pixel), self.middle(pixel));
        let mut held = planes[pixel as usize];
        if self.push.flags & FLAG_START != 0 {
            held = [R::zero(); 4];
        }
        for c in 0..self.tries() {
            let tried = candidates(self.push, planes, pixel, c, [held[0], held[1], held[2]]);
            if !window.textured() || !possible(self.push, tried, middle) {
                continue;
            }
            let score = window.score(self, tried, middle);
            if score > held[3] {
                held = [tried[0], tried[1], tried[2], score];
            }
        }
        held
    }
}
