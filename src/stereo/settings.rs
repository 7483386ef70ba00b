//! Settings of stereo, and their cost.

use super::Error;
use crate::pass::stereo::{ARMS, MOST_CHECKS, MOST_SOURCES};

/// Settings of stereo. The defaults suit photographs of any kind, at a size where stereo takes a small part of the time
/// of a training.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Photographs are reduced until their longer side has at most this many pixels.
    pub max_side: u32,
    /// Number of views that a view is matched with, at most 4.
    pub sources: u32,
    /// Number of sources that count for a hypothesis: those that match best, so that an occlusion in some sources does
    /// no harm.
    pub best: u32,
    /// Sweeps over all pixels.
    pub iterations: u32,
    /// Further sweeps for views that start at random.
    pub random_iterations: u32,
    /// Taps along a side of the window: 3, 4, 5 or 6.
    pub taps: u32,
    /// Pixels between taps.
    pub step: u32,
    /// Random hypotheses that a pixel tries at the start, beside its initial hypothesis.
    pub first_draws: u32,
    /// Further random hypotheses for views that start at random.
    pub random_draws: u32,
    /// Random changes that a pixel tries in a sweep.
    pub draws: u32,
    /// Largest random change in the first sweep, in pixels of parallax; halved in each further sweep.
    pub amplitude: f32,
    /// Standard deviation of the window's weight over distance, in units of [`Settings::reach`].
    pub sigma_distance: f32,
    /// Standard deviation of the window's weight over difference of luma (0 to 1).
    pub sigma_luma: f32,
    /// Largest angle in degrees between a surface's normal and the viewing ray.
    pub most_slanted: f32,
    /// Smallest NCC of a hypothesis that is kept. The default is low because sensor noise lowers the correlation on
    /// bare ground; the agreement of views decides whether a depth is right.
    pub least_ncc: f32,
    /// Largest reprojection distance in pixels after mapping a pixel to a source and back.
    pub agree_pixels: f32,
    /// Largest relative difference between depths that agree.
    pub agree_depth: f32,
    /// Number of views that a view's depths are checked against, sources included, at most 8.
    pub checks: u32,
    /// Number of checked views that must agree; one is enough where at most two are checked.
    pub agree_sources: u32,
    /// Rounds after the first: hypotheses that views agree on spread to other pixels, and all views are checked again.
    pub rounds: u32,
    /// Seed of random draws.
    pub seed: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            max_side: 160,
            sources: 4,
            best: 2,
            iterations: 1,
            random_iterations: 3,
            taps: 5,
            step: 1,
            first_draws: 2,
            random_draws: 6,
            draws: 3,
            amplitude: 1.0,
            sigma_distance: 1.0,
            sigma_luma: 0.2,
            most_slanted: 80.0,
            least_ncc: 0.3,
            agree_pixels: 2.0,
            agree_depth: 0.01,
            checks: 8,
            agree_sources: 2,
            rounds: 1,
            seed: 0,
        }
    }
}

impl Settings {
    /// Fails where a value is out of its range.
    pub fn check(&self) -> Result<(), Error> {
        let wrong = |name, value: String, allowed| Err(Error::Setting { name, value, allowed });
        let positive = |v: f32| v.is_finite() && v > 0.0;
        if self.max_side < 16 {
            return wrong("max_side", self.max_side.to_string(), "16 or more");
        }
        if !(1..=MOST_SOURCES as u32).contains(&self.sources) {
            return wrong("sources", self.sources.to_string(), "from 1 to 4");
        }
        if !(1..=MOST_SOURCES as u32).contains(&self.best) {
            return wrong("best", self.best.to_string(), "from 1 to 4");
        }
        if !(self.sources..=MOST_CHECKS as u32).contains(&self.checks) {
            return wrong("checks", self.checks.to_string(), "from the number of `sources` to 8");
        }
        if !(1..=self.checks).contains(&self.agree_sources) {
            let value = self.agree_sources.to_string();
            return wrong("agree_sources (`agree`)", value, "from 1 to the number of checked views (`checks`)");
        }
        for (name, value) in [
            ("iterations", self.iterations),
            ("random_iterations", self.random_iterations),
            ("first_draws", self.first_draws),
            ("random_draws", self.random_draws),
            ("draws", self.draws),
            ("rounds", self.rounds),
        ] {
            if value > 64 {
                return wrong(name, value.to_string(), "at most 64");
            }
        }
        if !(3..=6).contains(&self.taps) {
            return wrong("taps (`window`)", self.taps.to_string(), "3, 4, 5 or 6");
        }
        if !(1..=8).contains(&self.step) {
            return wrong("step", self.step.to_string(), "from 1 to 8");
        }
        if self.taps.is_multiple_of(2) && !self.step.is_multiple_of(2) {
            return wrong("step", self.step.to_string(), "even where `taps` is even");
        }
        for (name, value) in [
            ("amplitude", self.amplitude),
            ("sigma_distance", self.sigma_distance),
            ("sigma_luma", self.sigma_luma),
            ("agree_pixels", self.agree_pixels),
            ("agree_depth", self.agree_depth),
        ] {
            if !positive(value) {
                return wrong(name, value.to_string(), "above 0");
            }
        }
        if !(self.most_slanted > 0.0 && self.most_slanted < 90.0) {
            return wrong("most_slanted", self.most_slanted.to_string(), "between 0 and 90 degrees");
        }
        if !(-1.0..=1.0).contains(&self.least_ncc) {
            return wrong("least_ncc (`least-ncc`)", self.least_ncc.to_string(), "from -1 to 1");
        }
        Ok(())
    }

    /// Pixels from the centre of a window to its outermost taps.
    pub fn reach(&self) -> u32 {
        (self.taps - 1) * self.step / 2
    }

    /// Samples of sources that a pixel takes in a view that does not start at random.
    pub fn samples_per_pixel(&self, sources: u32) -> u64 {
        let sweep = ARMS + self.draws;
        let hypotheses = 1 + self.first_draws + self.iterations * sweep + self.rounds * (1 + sweep);
        u64::from(hypotheses) * u64::from(sources.min(self.sources)) * u64::from(self.taps * self.taps)
    }

    /// Width and height that a photograph of the given size is reduced to.
    pub fn size(&self, width: u32, height: u32) -> (u32, u32) {
        let longer = width.max(height);
        if longer <= self.max_side {
            return (width, height);
        }
        let side = |v: u32| (u64::from(v) * u64::from(self.max_side)).div_ceil(u64::from(longer)).max(1) as u32;
        (side(width), side(height))
    }
}

/// Limit of the cost of stereo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Budget {
    /// Samples of sources over all views: see [`Budget::samples`]. On lavapipe a sample takes 3 to 4 ns of one
    /// processor core, and more the fewer taps a window has.
    pub samples: f64,
}

impl Budget {
    /// Samples that `views` photographs of the given size take with the settings.
    pub fn samples(settings: &Settings, views: usize, width: u32, height: u32) -> f64 {
        let (width, height) = settings.size(width, height);
        views as f64 * f64::from(width) * f64::from(height) * settings.samples_per_pixel(settings.sources) as f64
    }

    /// The settings, made cheaper until they fit the budget or cannot be cheaper. The order: image size down to
    /// `least_side`, sweeps down to 1, sources down to 2, no further rounds, image size down to 16 pixels.
    pub fn fitting(self, settings: &Settings, least_side: u32, views: usize, width: u32, height: u32) -> Settings {
        let mut out = settings.clone();
        let over = |s: &Settings| Self::samples(s, views, width, height) > self.samples;
        let reduced = |s: &mut Settings, least: u32| {
            while over(s) && s.max_side > least {
                s.max_side = (s.max_side * 15 / 16).max(least);
            }
        };
        out.max_side = out.max_side.min(width.max(height)).max(16);
        reduced(&mut out, least_side.max(16));
        while over(&out) && out.iterations > 1 {
            out.iterations -= 1;
        }
        while over(&out) && out.sources > 2 {
            out.sources -= 1;
        }
        if over(&out) {
            out.rounds = 0;
        }
        reduced(&mut out, 16);
        out
    }
}
