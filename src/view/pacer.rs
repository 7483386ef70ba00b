//! How often pictures may be drawn, and how large, for a share of device time.

use std::time::{Duration, Instant};

/// Pictures are not reduced below this many pixels on the longer side.
const LEAST_SIDE: u32 = 160;

/// Most pixels of a picture where memory has room.
const MOST_PIXELS: u32 = 2560 * 1600;

/// Seconds of unused share that are kept for a burst of pictures.
const BURST: f64 = 1.0;

/// Steps of size to a side twice as long.
const STEPS_TO_DOUBLE: u32 = 4;

/// Weight of a new measurement.
const NEW: f64 = 0.3;

/// Keeps the share of device time of viewing. The rate of pictures gives way first, then, while somebody moves, the
/// size.
#[derive(Clone, Debug)]
pub struct Pacer {
    share: f64,
    /// Most pixels of a picture.
    most: u32,
    /// Pictures a second while somebody moves, as long as the size allows.
    rate: f64,
    /// Seconds of device time that may be spent. Negative after an expensive picture.
    credit: f64,
    at: Instant,
    /// Seconds of a picture by step of size, from [`LEAST_SIDE`] on.
    costs: Vec<Option<f64>>,
}

impl Pacer {
    /// A pacer for a share of device time (1: all of it) and pictures a second while somebody moves.
    pub fn new(share: f64, rate: f64, now: Instant) -> Self {
        Self { share, most: MOST_PIXELS, rate, credit: share * BURST, at: now, costs: Vec::new() }
    }

    /// With at most this many pixels in a picture, because memory has no more room.
    #[must_use]
    pub fn within(self, most: u32) -> Self {
        Self { most, ..self }
    }

    /// How long to wait before the next picture may be drawn; zero: none.
    pub fn wait(&mut self, now: Instant) -> Duration {
        let since = now.saturating_duration_since(self.at).as_secs_f64();
        self.at = now;
        self.credit = (self.credit + self.share * since).min(self.share * BURST);
        Duration::from_secs_f64((-self.credit / self.share).clamp(0.0, 60.0))
    }

    /// The size to draw for a wanted size. `moving` asks for many pictures rather than large ones.
    pub fn size(&self, wanted: (u32, u32), moving: bool) -> (u32, u32) {
        let pixels = f64::from(wanted.0) * f64::from(wanted.1);
        let share = (f64::from(self.most) / pixels.max(1.0)).sqrt().min(1.0);
        let (width, height) = (within(wanted.0, share), within(wanted.1, share));
        let longest = width.max(height).max(1);
        if !moving || longest <= LEAST_SIDE {
            return (width.max(1), height.max(1));
        }
        let budget = self.share / self.rate;
        let largest = step_of(longest);
        let step = (0..=largest).take_while(|step| *step == 0 || self.expected(*step) <= budget).last().unwrap_or(0);
        let side = if step == largest { longest } else { side_of(step) };
        let scaled = |v: u32| (u64::from(v) * u64::from(side) / u64::from(longest)).max(1) as u32;
        (scaled(width), scaled(height))
    }

    /// Tells what a picture took.
    pub fn drew(&mut self, (width, height): (u32, u32), seconds: f64) {
        self.credit -= seconds;
        let step = step_of(width.max(height));
        if self.costs.len() <= step {
            self.costs.resize(step + 1, None);
        }
        let before = self.costs[step].unwrap_or(seconds);
        self.costs[step] = Some(before + NEW * (seconds - before));
    }

    /// Tells that viewing took time of the device beside the pictures.
    pub fn also_took(&mut self, seconds: f64) {
        self.credit -= seconds;
    }

    /// Expected seconds of a picture: in proportion to the pixels of the next smaller size that was drawn.
    fn expected(&self, step: usize) -> f64 {
        let known = (0..=step).rev().find_map(|s| self.costs.get(s).copied().flatten().map(|cost| (s, cost)));
        let Some((from, cost)) = known else { return f64::INFINITY };
        cost * 4_f64.powf((step - from) as f64 / f64::from(STEPS_TO_DOUBLE))
    }
}

fn within(side: u32, share: f64) -> u32 {
    ((f64::from(side) * share) as u32).max(1)
}

/// Step of size of a longer side.
fn step_of(side: u32) -> usize {
    let doublings = (f64::from(side.max(LEAST_SIDE)) / f64::from(LEAST_SIDE)).log2();
    (doublings * f64::from(STEPS_TO_DOUBLE)).floor() as usize
}

fn side_of(step: usize) -> u32 {
    (f64::from(LEAST_SIDE) * 2_f64.powf(step as f64 / f64::from(STEPS_TO_DOUBLE))).ceil() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws as fast as allowed for some seconds, with `cost` seconds a pixel. Returns (pictures, seconds of drawing,
    /// last size).
    fn draws(pacer: &mut Pacer, from: Instant, seconds: f64, cost: f64, moving: bool) -> (u32, f64, (u32, u32)) {
        let (mut now, mut count, mut spent, mut last) = (from, 0, 0.0, (0, 0));
        while now < from + Duration::from_secs_f64(seconds) {
            let wait = pacer.wait(now);
            if !wait.is_zero() {
                now += wait;
                continue;
            }
            last = pacer.size((640, 480), moving);
            let took = cost * f64::from(last.0 * last.1);
            (count, spent) = (count + 1, spent + took);
            now += Duration::from_secs_f64(took);
            pacer.drew(last, took);
        }
        (count, spent, last)
    }

    #[test]
    fn viewing_keeps_to_its_share_and_size_gives_way_last() {
        let start = Instant::now();
        // A picture of 640x480 takes half a second, one of 160x120 a thirtieth.
        for moving in [false, true] {
            let mut pacer = Pacer::new(0.13, 5.0, start);
            let (count, spent, size) = draws(&mut pacer, start, 60.0, 0.5 / (640.0 * 480.0), moving);
            assert!(spent <= 0.13 * 60.0 + 0.13 + 0.5, "{spent} s");
            assert!(spent >= 0.11 * 60.0, "{spent} s");
            if moving {
                assert!(size.0 < 200 && size.0 >= 160 && count > 4 * 60, "{size:?}, {count}");
            } else {
                assert_eq!(size, (640, 480));
            }
        }
        // Fast enough at the full size.
        let mut pacer = Pacer::new(0.13, 5.0, start);
        assert_eq!(draws(&mut pacer, start, 10.0, 0.02 / (640.0 * 480.0), true).2, (640, 480));
    }

    #[test]
    fn the_first_picture_comes_at_once() {
        let start = Instant::now();
        let mut pacer = Pacer::new(0.13, 5.0, start);
        assert!(pacer.wait(start).is_zero());
        assert_eq!(pacer.size((100, 40), true), (100, 40));
        assert_eq!(pacer.size((4000, 4000), false).0, 2023);
        assert_eq!(pacer.clone().within(100).size((40, 40), false), (10, 10));
        assert_eq!(pacer.size((320, 160), true), (160, 80));
        pacer.drew((320, 160), 2.0);
        let wait = pacer.wait(start).as_secs_f64();
        assert!((wait - (2.0 - 0.13) / 0.13).abs() < 1e-6, "{wait}");
        pacer.also_took(0.5);
        let wait = pacer.wait(start).as_secs_f64();
        assert!((wait - (2.5 - 0.13) / 0.13).abs() < 1e-6, "{wait}");
    }
}
