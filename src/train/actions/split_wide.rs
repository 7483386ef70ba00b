//! Splits splats that are wider than the local wavelength of the photographs, once.

use glam::{DQuat, DVec3};

use super::footprint::Details;
use super::{Change, HostAction};
use crate::raster::{PLANES, gaussians_of, planes_of};
use crate::scene::{Gaussians, rows_of};
use crate::train::Error;
use crate::train::density::logit;
use crate::train::engine::Engine;
use crate::train::input::{Input, View};
use crate::train::message::Message;
use crate::train::schedule::{Event, Kind, Schedule};
use crate::train::settings::Settings;

/// Most children of a splat.
const MOST_CHILDREN: u32 = 4;
/// Children of opacity 0 or 1 have no logit.
const LEAST_OPACITY: f64 = 1e-6;

pub(super) struct SplitWide {
    views: Vec<View>,
    settings: Settings,
}

impl SplitWide {
    pub(super) fn new(input: &Input, settings: &Settings) -> Self {
        let wanted = settings.density.split_wavelength > 0.0;
        Self { views: if wanted { input.train.clone() } else { Vec::new() }, settings: settings.clone() }
    }
}

impl HostAction for SplitWide {
    fn due(&self, schedule: &Schedule, event: Event) -> bool {
        event.kind == Kind::Step && schedule.splits_wide(event.step)
    }

    fn catches_up(&self) -> bool {
        true
    }

    fn run(&mut self, engine: &mut Engine, _: &Schedule, step: u32) -> Result<Option<Change>, Error> {
        let model = engine.model()?;
        let excess = Details::new(&self.views, &self.settings)?.excess(&model)?;
        let mut wide = wide(&excess, self.settings.density.split_wavelength);
        let more = wide.iter().map(|split| split.children() - 1).sum();
        let room = engine.room(more)?;
        // The widest ones come first. One child takes the place of its parent.
        let mut left = room.added;
        wide.retain(|split| {
            let needed = split.children() - 1;
            let fits = needed <= left;
            left = if fits { left - needed } else { 0 };
            fits
        });
        let (mut rows, mut firsts, mut others) = (Vec::new(), Vec::new(), Vec::new());
        for split in &wide {
            let children = split.placed(&model);
            rows.push(split.row);
            firsts.extend(children.first().copied());
            others.extend(children.iter().skip(1).copied());
        }
        engine.replace(&rows, &born(&model, &firsts))?;
        let appended = engine.append(&born(&model, &others))?;
        let message = Message::SplitWide { step, split: rows.len() as u32, splats: appended.splats };
        let capacity = room.capacity.or(appended.capacity);
        Ok(Some(Change { splats: Some(appended.splats), capacity, message: Some(message) }))
    }
}

/// A splat to split, and into how many along each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Split {
    row: u32,
    along: [u32; 3],
}

/// A child of a splat.
#[derive(Clone, Copy, Debug)]
struct Child {
    parent: u32,
    mean: [f32; 3],
    scales: [f32; 3],
    opacity: f32,
}

/// The splats that are more than `factor` times as wide as the local spacing along an axis, the widest first. The axis
/// with the largest excess is divided again and again, up to [`MOST_CHILDREN`].
fn wide(excess: &[[f64; 3]], factor: f64) -> Vec<Split> {
    let mut found = Vec::new();
    for (row, excess) in excess.iter().enumerate() {
        let excess = excess.map(|e| e / factor);
        let mut along = [1; 3];
        loop {
            let left = |k: usize| excess[k] / narrowing(along[k]);
            let widest = (1..3).fold(0, |best, k| if left(k) > left(best) { k } else { best });
            let mut next = along;
            next[widest] += 1;
            if left(widest) > 1.0 && next.iter().product::<u32>() <= MOST_CHILDREN {
                along = next;
            } else {
                break;
            }
        }
        if along != [1; 3] {
            found.push((excess.iter().copied().fold(0.0, f64::max), Split { row: row as u32, along }));
        }
    }
    found.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    found.into_iter().map(|(_, split)| split).collect()
}

/// How many times narrower than their parent `count` children along an axis are. They stand sqrt(4/3) of their standard
/// deviations apart, as the two children of growth do, and together have the variance of their parent.
fn narrowing(count: u32) -> f64 {
    (1.0 + f64::from(count * count - 1) / 9.0).sqrt()
}

/// Places of `count` children along an axis, in standard deviations of their parent.
fn places(count: u32) -> impl Iterator<Item = f64> + Clone {
    let apart = (4.0_f64 / 3.0).sqrt() / narrowing(count);
    (0..count).map(move |j| (f64::from(j) - 0.5 * f64::from(count - 1)) * apart)
}

impl Split {
    fn children(&self) -> u32 {
        self.along.iter().product()
    }

    /// The children: together they have the mean and covariance of their parent, and its opacity at its centre.
    fn placed(&self, model: &Gaussians) -> Vec<Child> {
        let i = self.row as usize;
        let row = |values: &[f32]| [values[0], values[1], values[2]].map(f64::from);
        let (mean, scales) = (row(&model.means[3 * i..3 * i + 3]), row(&model.scales[3 * i..3 * i + 3]));
        let q = &model.quats[4 * i..4 * i + 4];
        let turn = DQuat::from_xyzw(q[1].into(), q[2].into(), q[3].into(), q[0].into());
        let turn = if turn.length_squared() > 1e-24 { turn.normalize() } else { DQuat::IDENTITY };
        let [a, b, c] = self.along.map(places);
        let offsets: Vec<[f64; 3]> = a
            .flat_map(|x| b.clone().map(move |y| [x, y]))
            .flat_map(|[x, y]| c.clone().map(move |z| [x, y, z]))
            .collect();
        let narrower = self.along.map(narrowing);
        let seen = |offset: &[f64; 3]| (-0.5 * (0..3).map(|k| (offset[k] * narrower[k]).powi(2)).sum::<f64>()).exp();
        let centres: Vec<f64> = offsets.iter().map(seen).collect();
        let opacity = 1.0 / (1.0 + (-f64::from(model.opacities[i])).exp());
        let opacity = logit(shared_opacity(opacity, &centres));
        let child = |offset: &[f64; 3]| {
            let away = turn * DVec3::from_array([0, 1, 2].map(|k| offset[k] * scales[k].exp()));
            Child {
                parent: self.row,
                mean: (DVec3::from_array(mean) + away).to_array().map(|v| v as f32),
                scales: [0, 1, 2].map(|k| (scales[k] - narrower[k].ln()) as f32),
                opacity,
            }
        };
        offsets.iter().map(child).collect()
    }
}

/// The opacity of children that together let as much light through at their parent's centre as the parent does, at most
/// the parent's. `centres` are their falloffs there.
fn shared_opacity(parent: f64, centres: &[f64]) -> f64 {
    let shown = |opacity: f64| 1.0 - centres.iter().map(|g| 1.0 - g * opacity).product::<f64>();
    let (mut low, mut high) = (0.0, parent);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if shown(middle) < parent { low = middle } else { high = middle }
    }
    high.clamp(LEAST_OPACITY, 1.0 - LEAST_OPACITY)
}

/// Splats for children, with what they do not have of their own from their parents.
fn born(model: &Gaussians, children: &[Child]) -> Gaussians {
    let parents: Vec<u32> = children.iter().map(|child| child.parent).collect();
    let mut planes =
        planes_of(model).into_iter().zip(PLANES).map(|(p, (_, width))| rows_of(p, width as usize, &parents));
    let planes = std::array::from_fn(|_| planes.next().unwrap_or_default());
    let mut out = gaussians_of(planes, Vec::new());
    out.means = children.iter().flat_map(|child| child.mean).collect();
    out.scales = children.iter().flat_map(|child| child.scales).collect();
    out.opacities = children.iter().map(|child| child.opacity).collect();
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> Gaussians {
        let mut model = Gaussians::zeros(2);
        model.means = vec![9.0, 9.0, 9.0, 1.0, -2.0, 3.0];
        model.quats = vec![1.0, 0.0, 0.0, 0.0, 0.8, 0.4, -1.0, 0.3];
        model.scales = vec![0.0, 0.0, 0.0, 0.7, -0.3, -2.0];
        model.opacities = vec![0.0, 1.2];
        model.sh[0][12..].fill(0.25);
        model
    }

    fn covariance(quat: &[f32], scales: &[f32]) -> glam::DMat3 {
        let turn = DQuat::from_xyzw(quat[1].into(), quat[2].into(), quat[3].into(), quat[0].into()).normalize();
        let turn = glam::DMat3::from_quat(turn);
        let variances = [0, 1, 2].map(|k| (2.0 * f64::from(scales[k])).exp());
        turn * glam::DMat3::from_diagonal(DVec3::from_array(variances)) * turn.transpose()
    }

    #[test]
    fn children_have_the_moments_and_the_opacity_of_their_parent() {
        let model = model();
        let whole = covariance(&model.quats[4..], &model.scales[3..]);
        for along in [[2, 1, 1], [4, 1, 1], [1, 3, 1], [2, 2, 1]] {
            let split = Split { row: 1, along };
            let children = born(&model, &split.placed(&model));
            assert_eq!(children.len() as u32, split.children());
            assert!(children.sh[0].iter().all(|c| *c == 0.25));
            let share = 1.0 / children.len() as f64;
            let mean = |i: usize| DVec3::from_array([0, 1, 2].map(|k| f64::from(children.means[3 * i + k])));
            let parent = DVec3::new(1.0, -2.0, 3.0);
            let (mut first, mut second, mut light) = (DVec3::ZERO, glam::DMat3::ZERO, 1.0);
            for i in 0..children.len() {
                let away = mean(i) - parent;
                let own = covariance(&children.quats[4 * i..4 * i + 4], &children.scales[3 * i..3 * i + 3]);
                first += away * share;
                second += (own + glam::DMat3::from_cols(away * away.x, away * away.y, away * away.z)) * share;
                let falloff = (-0.5 * away.dot(own.inverse() * away)).exp();
                light *= 1.0 - falloff / (1.0 + (-f64::from(children.opacities[i])).exp());
            }
            assert!(first.length() < 1e-6, "{along:?}: {first}");
            let worst = (second - whole).to_cols_array().iter().fold(0.0_f64, |worst, e| worst.max(e.abs()));
            assert!(worst < 1e-5 * whole.to_cols_array()[0], "{along:?}: {worst}");
            let shown = 1.0 / (1.0 + (-1.2_f64).exp());
            assert!((1.0 - light - shown).abs() < 1e-5, "{along:?}: {light}");
        }
        // Two children are those of growth: half a standard deviation away, sqrt(3/4) as long.
        let two = Split { row: 0, along: [2, 1, 1] }.placed(&model);
        assert!((two[1].mean[0] - 9.5).abs() < 1e-6 && (two[0].scales[0] - 0.75_f32.sqrt().ln()).abs() < 1e-6);
        assert!(shared_opacity(1.0, &[0.8, 0.8]) <= 1.0 - LEAST_OPACITY && shared_opacity(0.0, &[1.0]) > 0.0);
    }

    #[test]
    fn the_axis_that_is_too_wide_is_divided_the_widest_splat_first() {
        let excess = [[0.9, 0.2, 0.0], [1.1, 0.3, 0.0], [4.0, 0.5, 0.0], [2.0, 2.0, 0.0], [0.3, 1.3, 0.0]];
        let found = wide(&excess, 1.0);
        let want = [(2, [4, 1, 1]), (3, [2, 2, 1]), (4, [1, 3, 1]), (1, [2, 1, 1])];
        assert_eq!(found, want.map(|(row, along)| Split { row, along }));
        assert_eq!(wide(&excess, 4.0), [], "none is more than four times as wide");
        assert_eq!(wide(&[[f64::NAN; 3], [0.0; 3]], 1.0), []);
    }
}
