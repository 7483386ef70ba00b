//! Moves dead splats onto live ones, and adds splats up to the limit (3DGS-MCMC, Kheradmand et al. 2024).

use super::{Change, HostAction};
use crate::raster::{MEANS, OPACITIES, SCALES};
use crate::train::Error;
use crate::train::engine::Engine;
use crate::train::message::Message;
use crate::train::schedule::{Event, Kind, Schedule, Stream, draw};
use crate::train::settings::Settings;

/// Most splats that share the place of one, as published.
const MOST_COPIES: u32 = 51;
/// Highest opacity after a relocation, and highest opacity that is shared.
const MOST_OPAQUE: f64 = 1.0 - f32::EPSILON as f64;

/// Dead splats take the places, shapes and colours of live ones that are drawn in proportion to their opacity; then the
/// set grows in the same way. Splats at one place share its opacity, so that the render stays the same.
pub(super) struct Relocate {
    seed: u64,
    /// Splats of this opacity or less are dead; no relocation leaves less.
    least: f64,
}

impl Relocate {
    pub(super) fn new(settings: &Settings) -> Self {
        Self { seed: settings.run.seed, least: settings.density.prune_opacity }
    }
}

impl HostAction for Relocate {
    fn due(&self, schedule: &Schedule, event: Event) -> bool {
        event.kind == Kind::Step && schedule.relocates(event.step).is_some()
    }

    fn catches_up(&self) -> bool {
        true
    }

    fn run(&mut self, engine: &mut Engine, schedule: &Schedule, step: u32) -> Result<Option<Change>, Error> {
        let (Some(growth), before) = (schedule.relocates(step), engine.splats()?) else { return Ok(None) };
        let wanted = ((1.0 + growth) * f64::from(before)) as u32;
        let room = engine.room(wanted.saturating_sub(before))?;
        let mut splats = Relocation::new(
            &engine.rows(MEANS, before)?,
            engine.rows(SCALES, before)?,
            engine.rows(OPACITIES, before)?,
            self.least,
        );
        let relocated = splats.revive(|row| draw(self.seed, Stream::Relocations, u64::from(step), u64::from(row)));
        let added = splats.grow(room.added, |row| draw(self.seed, Stream::Growth, u64::from(step), u64::from(row)));
        if relocated + added > 0 {
            engine.relocate(&splats)?;
        }
        let now = before + added;
        let message = Some(Message::Relocated { step, relocated, added, splats: now });
        Ok(Some(Change { splats: Some(now), capacity: room.capacity, message }))
    }
}

/// The set of splats in the course of a relocation.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::train) struct Relocation {
    /// The row before the relocation that each row is a copy of. A row that is a copy of another row is a new splat.
    pub(in crate::train) rows: Vec<u32>,
    /// Whether the row shares a place, so that its moments are those of no splat.
    pub(in crate::train) shares: Vec<bool>,
    /// Log scales of every row.
    pub(in crate::train) scales: Vec<f32>,
    /// Logits of the opacities of every row.
    pub(in crate::train) opacities: Vec<f32>,
    /// Whether the row before the relocation can be shown.
    sound: Vec<bool>,
    least: f64,
}

impl Relocation {
    fn new(means: &[f32], scales: Vec<f32>, opacities: Vec<f32>, least: f64) -> Self {
        let finite = |row: &[f32]| row.iter().all(|v| v.is_finite());
        let shapes = means.chunks_exact(3).zip(scales.chunks_exact(3));
        let sound =
            shapes.zip(&opacities).map(|((mean, scale), logit)| finite(mean) && finite(scale) && logit.is_finite());
        let sound = sound.collect();
        let count = opacities.len() as u32;
        Self { rows: (0..count).collect(), shares: vec![false; opacities.len()], scales, opacities, sound, least }
    }

    /// Opacity of a row; 0 if it cannot be shown.
    fn opacity(&self, row: usize) -> f64 {
        match self.sound.get(self.rows[row] as usize) {
            Some(true) => 1.0 / (1.0 + (-f64::from(self.opacities[row])).exp()),
            _ => 0.0,
        }
    }

    /// Puts every dead splat in the place of a live one; `draw` gives the random bits of a row. Returns how many.
    fn revive(&mut self, draw: impl Fn(u32) -> u64) -> u32 {
        let opacities: Vec<f64> = (0..self.rows.len()).map(|row| self.opacity(row)).collect();
        let dead: Vec<usize> = (0..self.rows.len()).filter(|&row| opacities[row] <= self.least).collect();
        let weights = opacities.iter().map(|opacity| if *opacity <= self.least { 0.0 } else { *opacity });
        self.place(&dead, weights.collect(), draw)
    }

    /// Adds `more` splats in the places of others; `draw` gives the random bits of a row. Returns how many.
    fn grow(&mut self, more: u32, draw: impl Fn(u32) -> u64) -> u32 {
        let before = self.rows.len();
        let weights: Vec<f64> = (0..before).map(|row| self.opacity(row)).collect();
        if !weights.iter().any(|weight| *weight > 0.0) {
            return 0;
        }
        let after = before + more as usize;
        self.rows.resize(after, 0);
        self.shares.resize(after, false);
        self.opacities.resize(after, 0.0);
        self.scales.resize(3 * after, 0.0);
        self.place(&(before..after).collect::<Vec<_>>(), weights, draw)
    }

    /// Gives each row of `targets` the place of a row that is drawn in proportion to `weights`.
    fn place(&mut self, targets: &[usize], weights: Vec<f64>, draw: impl Fn(u32) -> u64) -> u32 {
        let mut total = 0.0;
        let sums: Vec<f64> = weights
            .iter()
            .map(|weight| {
                total += weight;
                total
            })
            .collect();
        if total <= 0.0 {
            return 0;
        }
        let mut copies = vec![1_u32; weights.len()];
        let sources: Vec<usize> = targets
            .iter()
            .map(|&target| {
                let uniform = (draw(target as u32) >> 12) as f64 / (1_u64 << 52) as f64;
                let source = sums.partition_point(|sum| *sum <= uniform * total);
                copies[source] += 1;
                source
            })
            .collect();
        for (row, &copies) in copies.iter().enumerate().filter(|(_, copies)| **copies > 1) {
            let (opacity, factor) = shared(self.opacity(row), copies);
            let opacity = opacity.clamp(self.least.min(MOST_OPAQUE), MOST_OPAQUE);
            self.opacities[row] = (opacity / (1.0 - opacity)).ln() as f32;
            let scales = &mut self.scales[3 * row..3 * row + 3];
            scales.iter_mut().for_each(|scale| *scale = (f64::from(*scale) + factor.ln()) as f32);
            self.shares[row] = true;
        }
        for (&target, &source) in targets.iter().zip(&sources) {
            self.rows[target] = self.rows[source];
            self.opacities[target] = self.opacities[source];
            self.scales.copy_within(3 * source..3 * source + 3, 3 * target);
            self.shares[target] = true;
        }
        targets.len() as u32
    }
}

/// The opacity that each of `copies` splats at one place needs to be together as opaque as one splat of `opacity`, and
/// the factor of their standard deviations with which the integral along a ray through the middle stays the same.
pub(crate) fn shared(opacity: f64, copies: u32) -> (f64, f64) {
    let (opacity, copies) = (opacity.min(MOST_OPAQUE), copies.clamp(1, MOST_COPIES));
    let each = -((-opacity).ln_1p() / f64::from(copies)).exp_m1();
    let mut sum = 0.0;
    for i in 0..copies {
        let mut term = each;
        for k in 0..=i {
            sum += term / f64::from(k + 1).sqrt();
            term *= -each * f64::from(i - k) / f64::from(k + 1);
        }
    }
    (each, opacity / sum)
}

#[cfg(test)]
mod tests {
    use super::{Relocation, shared};
    use crate::scene::random::hash;

    fn opacity(logit: f32) -> f64 {
        1.0 / (1.0 + (-f64::from(logit)).exp())
    }

    fn logit(opacity: f64) -> f32 {
        (opacity / (1.0 - opacity)).ln() as f32
    }

    /// The integral over x of 1 - prod (1 - alpha exp(-x^2 / 2 s^2)), which the factor keeps, by the trapezoidal rule.
    fn extent(opacity: f64, copies: i32, sigma: f64) -> f64 {
        let step = 1e-3;
        let alpha = |x: f64| 1.0 - (1.0 - opacity * (-0.5 * (x / sigma).powi(2)).exp()).powi(copies);
        (-12_000..=12_000).map(|k| alpha(f64::from(k) * step)).sum::<f64>() * step
    }

    /// Against independent numbers: for two copies the sums in closed form, else numerical integrals.
    #[test]
    fn opacity_and_scale_are_shared_as_published() {
        let (each, factor) = shared(0.3, 1);
        assert!((each - 0.3).abs() < 1e-15 && (factor - 1.0).abs() < 1e-14);
        let (each, factor) = shared(0.75, 2);
        // o' = 1 - sqrt(1/4); the sum is o' + (o' - o'^2 / sqrt 2).
        assert!((each - 0.5).abs() < 1e-15);
        assert!((factor - 0.75 / (1.0 - 0.25 / 2.0_f64.sqrt())).abs() < 1e-14);
        for (opacity, copies) in [(0.01, 2), (0.6, 2), (0.99, 2), (0.3, 5), (0.02, 51), (0.9, 51), (0.9999, 51)] {
            let (each, factor) = shared(opacity, copies);
            assert!(((1.0 - each).powi(copies as i32) - (1.0 - opacity)).abs() < 1e-12, "{opacity}, {copies}");
            let (one, all) = (extent(opacity, 1, 1.0), extent(each, copies as i32, factor));
            assert!((one / all - 1.0).abs() < 1e-9, "{opacity}, {copies}: {one} before, {all} after");
        }
        assert_eq!(shared(0.5, 80), shared(0.5, 51), "more are not told apart");
        let (each, factor) = shared(1.0, 51);
        assert!(each < 0.5 && factor.is_finite() && factor > 0.0);
    }

    /// Rows of opacity 0.9, dead, 0.3, no number, exactly at the limit.
    fn five() -> Relocation {
        let opacities = vec![logit(0.9), logit(0.001), logit(0.3), f32::NAN, -20.0];
        let scales = (0..15).map(|k| -0.1 * k as f32).collect();
        Relocation::new(&[0.0; 15], scales, opacities, 0.005)
    }

    #[test]
    fn dead_splats_take_the_places_of_live_ones() {
        let mut splats = five();
        assert_eq!(splats.revive(|row| hash(u64::from(row))), 3);
        for dead in [1, 3, 4] {
            let source = splats.rows[dead] as usize;
            assert!([0, 2].contains(&source), "row {dead} from {source}");
            assert_eq!(splats.opacities[dead], splats.opacities[source]);
            assert_eq!(splats.scales[3 * dead..3 * dead + 3], splats.scales[3 * source..3 * source + 3]);
            assert!(splats.shares[dead] && splats.shares[source]);
        }
        assert!(splats.opacities.iter().all(|o| opacity(*o) > 0.005));
        assert_eq!(splats, {
            let mut again = five();
            again.revive(|row| hash(u64::from(row)));
            again
        });
    }

    #[test]
    fn places_are_drawn_in_proportion_to_opacity_and_no_more() {
        let rows = 3000;
        let mut opacities = vec![logit(0.8), logit(0.2)];
        opacities.resize(2 + rows, logit(0.001));
        let count = opacities.len();
        let mut splats = Relocation::new(&vec![0.0; 3 * count], vec![0.0; 3 * count], opacities, 0.005);
        assert_eq!(splats.revive(|row| hash(u64::from(row))), rows as u32);
        let of_first = splats.rows[2..].iter().filter(|row| **row == 0).count() as f64 / rows as f64;
        // Five standard errors.
        assert!((of_first - 0.8).abs() < 5.0 * (0.16 / rows as f64).sqrt(), "{of_first}");
    }

    #[test]
    fn growth_adds_as_many_as_asked_and_none_to_nothing() {
        let mut splats = five();
        splats.revive(|row| hash(u64::from(row)));
        assert_eq!(splats.grow(2, |row| hash(u64::from(row))), 2);
        assert_eq!((splats.rows.len(), splats.scales.len(), splats.opacities.len()), (7, 21, 7));
        assert!(
            splats.rows.iter().all(|row| [0, 2].contains(row)),
            "places of splats that were live: {:?}",
            splats.rows
        );
        let mut dead = Relocation::new(&[0.0; 3], vec![0.0; 3], vec![f32::NAN], 0.005);
        assert_eq!((dead.revive(hash_row), dead.grow(5, hash_row)), (0, 0));
        assert_eq!(dead.rows, [0]);
    }

    fn hash_row(row: u32) -> u64 {
        hash(u64::from(row))
    }
}
