//! Progress of a training run: a bar on a terminal, plain lines elsewhere.

use std::time::{Duration, Instant};

use indicatif::{HumanBytes, HumanCount, HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::console::Console;
use super::plain::plain;
use psrgs_vk::numbers::{counted, fraction};

/// Steps before the estimate of the whole run is printed.
const ESTIMATE_AFTER: u32 = 50;
/// Without a terminal: longest time between two lines.
const QUIET_AT_MOST: Duration = Duration::from_secs(30);
/// Steps over which the speed is measured.
const WINDOW: u32 = 50;

/// Progress messages of a run.
pub(crate) struct Progress {
    console: Console,
    bar: ProgressBar,
    first: u32,
    total: u32,
    score: Option<f64>,
    /// Step and time of the latest entries, oldest first. The speed is that from the first to the last.
    recent: std::collections::VecDeque<(u32, f64)>,
    line_at: Instant,
    estimated: bool,
    /// Last step of the low-frequency stage; 0 without stages.
    low_until: u32,
}

impl Progress {
    /// A run with `done` of its `total` steps done.
    pub(crate) fn new(console: &Console, done: u32, total: u32) -> Self {
        let target = if console.draws() { ProgressDrawTarget::stderr_with_hz(5) } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(u64::from(total)), target);
        let style = ProgressStyle::with_template("{bar:24} {pos}/{len}  {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_position(u64::from(done));
        Self {
            console: console.clone(),
            bar,
            first: done,
            total,
            score: None,
            recent: std::collections::VecDeque::new(),
            line_at: Instant::now(),
            estimated: false,
            low_until: 0,
        }
    }

    /// Tells the stage of each step; `low_until` is the last step of low frequencies, or 0 without stages.
    pub(crate) fn with_stages(self, low_until: u32) -> Self {
        Self { low_until, ..self }
    }

    /// Reports a finished step; `seconds` counts from the start of training.
    pub(crate) fn step(&mut self, step: u32, loss: f32, splats: u32, seconds: f64) {
        self.recent.push_back((step, seconds));
        while self.recent.len() > WINDOW as usize + 1 {
            self.recent.pop_front();
        }
        let status = self.status(step, loss, splats);
        self.bar.set_position(u64::from(step));
        self.bar.set_message(plain(&status).into_owned());
        let due = step == self.first + 1
            || step == self.total
            || step.is_multiple_of((self.total / 20).max(1))
            || self.line_at.elapsed() >= QUIET_AT_MOST;
        if due && !self.console.draws() {
            self.line_at = Instant::now();
            self.console.say(format_args!("step {step}/{}  {status}", self.total));
        }
    }

    /// Whether [`Progress::estimate`] is due: enough steps are done, and the estimate was not printed yet.
    pub(crate) fn wants_estimate(&self, step: u32) -> bool {
        !self.estimated && step >= self.first + ESTIMATE_AFTER && step < self.total
    }

    /// Prints the time of the whole run at the speed so far, and the device memory in use.
    pub(crate) fn estimate(&mut self, step: u32, seconds: f64, device_bytes: u64, grows: bool) {
        self.estimated = true;
        let Some(rate) = self.rate() else { return };
        let total = seconds + f64::from(self.total.saturating_sub(step)) / rate;
        let more = if grows { "; both grow with the number of splats" } else { "" };
        self.say(format!(
            "about {} for all {} steps at this speed, {} of device memory in use{more}",
            duration(total),
            HumanCount(u64::from(self.total)),
            HumanBytes(device_bytes),
        ));
    }

    /// Reports the scores of held-out photographs.
    pub(crate) fn evaluated(&mut self, step: u32, psnr: f64, ssim: f64, splats: u32) {
        self.score = Some(psnr);
        let splats = counted(splats, "splat");
        self.say(format!("step {step}: held-out PSNR {psnr:.2} dB, SSIM {}, {splats}", fraction(ssim, 4)));
    }

    /// Prints a line above the bar.
    pub(crate) fn say(&self, text: impl std::fmt::Display) {
        self.bar.suspend(|| self.console.say(text));
    }

    /// Prints a line above the bar at the verbose level.
    pub(crate) fn detail(&self, text: impl std::fmt::Display) {
        self.bar.suspend(|| self.console.detail(text));
    }

    /// Prints a warning above the bar.
    pub(crate) fn warn(&self, text: impl std::fmt::Display) {
        self.bar.suspend(|| self.console.warn(text));
    }

    /// Removes the bar.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }

    /// Steps per second over the latest steps.
    fn rate(&self) -> Option<f64> {
        let ((s0, t0), (s1, t1)) = (self.recent.front()?, self.recent.back()?);
        (s1 > s0 && t1 > t0).then(|| f64::from(s1 - s0) / (t1 - t0))
    }

    fn status(&self, step: u32, loss: f32, splats: u32) -> String {
        let mut text = format!("loss {loss:.4}  {}", counted(splats, "splat"));
        if self.low_until > 0 {
            text += if step <= self.low_until { "  low frequencies" } else { "  high frequencies" };
        }
        if let Some(rate) = self.rate() {
            let left = f64::from(self.total.saturating_sub(step)) / rate;
            text += &format!("  {}  {} left", speed(rate), duration(left));
        }
        if let Some(psnr) = self.score {
            text += &format!("  {psnr:.2} dB held out");
        }
        text
    }
}

/// A counting bar, where there is a terminal to draw it on.
pub(crate) fn counter(console: &Console, total: usize, what: &str) -> ProgressBar {
    let target = if console.draws() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let style = ProgressStyle::with_template("{bar:24} {pos}/{len} {msg}");
    ProgressBar::with_draw_target(Some(total as u64), target)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        .with_message(plain(what).into_owned())
}

/// A speed in steps per second, or in seconds per step for slow steps.
fn speed(rate: f64) -> String {
    if rate >= 1.0 { format!("{rate:.1} it/s") } else { format!("{:.1} s/it", 1.0 / rate) }
}

/// Seconds as text.
pub(crate) fn duration(seconds: f64) -> String {
    HumanDuration(Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::console::Level;

    #[test]
    fn the_speed_is_that_of_the_latest_steps() {
        let mut progress = Progress::new(&Console::new(Level::Quiet), 0, 1000);
        // Ten steps of 10 s, then a hundred of 0.5 s.
        (1..=10).for_each(|i| progress.step(i, 0.1, 5, f64::from(i) * 10.0));
        (1..=100).for_each(|i| progress.step(10 + i, 0.1, 5, 100.0 + f64::from(i) * 0.5));
        assert!((progress.rate().unwrap() - 2.0).abs() < 1e-9);
        assert_eq!(progress.status(110, 0.1, 12_345), "loss 0.1000  12,345 splats  2.0 it/s  7 minutes left");
        let staged = progress.with_stages(110);
        assert!(staged.status(110, 0.1, 5).starts_with("loss 0.1000  5 splats  low frequencies  2.0 it/s"));
        assert!(staged.status(111, 0.1, 5).starts_with("loss 0.1000  5 splats  high frequencies  2.0 it/s"));
    }

    #[test]
    fn the_estimate_is_told_once_and_not_at_the_end() {
        let mut progress = Progress::new(&Console::new(Level::Quiet), 100, 200);
        assert!(!progress.wants_estimate(149) && progress.wants_estimate(150) && !progress.wants_estimate(200));
        progress.step(149, 0.1, 5, 1.0);
        progress.step(150, 0.1, 5, 2.0);
        progress.estimate(150, 2.0, 1 << 20, true);
        assert!(!progress.wants_estimate(151));
    }
}
