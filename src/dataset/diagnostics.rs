//! The views of the cameras of a dataset: whether the dataset will train well, before it is trained.

use rayon::prelude::*;

use super::{Dataset, Samples, Warning, random_points};
use crate::numbers::counted;

/// Pairs of views are compared by at most this many points.
const COMPARED: usize = 20_000;
/// A view with fewer points than this hardly takes part in the reconstruction.
const FEW_POINTS: usize = 20;
/// Views are named up to this many.
const NAMED: usize = 5;

/// What one view has in view, hidden by something or not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// Reconstructed points inside the picture.
    pub points: usize,
    /// The share of them that the view with the most of them has in view too; `None` without points or other views.
    pub overlap: Option<f64>,
}

impl Dataset {
    /// What each view has in view, in the order of the views.
    pub fn sights(&self) -> Vec<Sight> {
        let step = self.points.len().div_ceil(COMPARED).max(1);
        let seen: Vec<(usize, Vec<u64>)> = self
            .views
            .par_iter()
            .map(|view| {
                let mut compared = vec![0_u64; self.points.len().div_ceil(64 * step)];
                let mut points = 0;
                for (i, point) in self.points.iter().enumerate() {
                    if random_points::in_view(&view.camera, point.position) {
                        points += 1;
                        if i % step == 0 {
                            compared[i / step / 64] |= 1 << (i / step % 64);
                        }
                    }
                }
                (points, compared)
            })
            .collect();
        let sight = |(i, (points, mine)): (usize, &(usize, Vec<u64>))| {
            let own: u32 = mine.iter().map(|word| word.count_ones()).sum();
            let shared = |other: &[u64]| mine.iter().zip(other).map(|(a, b)| (a & b).count_ones()).sum::<u32>();
            let most = seen.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, (_, other))| shared(other)).max();
            let overlap = most.filter(|_| own > 0).map(|most| f64::from(most) / f64::from(own));
            Sight { points: *points, overlap }
        };
        seen.par_iter().enumerate().map(sight).collect()
    }

    /// What is wrong with the dataset, `sights` being those of its views: its warnings,
    /// and views that see no points or hardly any.
    pub fn problems(&self, sights: &[Sight]) -> Vec<String> {
        let mut problems: Vec<String> = self.warnings.iter().map(ToString::to_string).collect();
        // What photographs see of points that are of no use says nothing of their poses.
        problems.extend(self.useless.as_ref().map(ToString::to_string));
        if self.begins_at_random() {
            return problems;
        }
        // Of a wrong pose everything is said.
        let told = |name: &str| {
            self.warnings.iter().any(|w| matches!(w, Warning::PoseWrong { name: wrong, .. } if wrong == name))
        };
        let named = |wanted: &dyn Fn(usize) -> bool| -> Vec<&str> {
            let views = self.views.iter().zip(sights).filter(|(view, s)| wanted(s.points) && !told(&view.name));
            views.map(|(view, _)| view.name.as_str()).collect()
        };
        for (names, what) in [
            (named(&|n| n == 0), "without any point in view: the poses are wrong, or nothing was reconstructed there"),
            (named(&|n| n > 0 && n < FEW_POINTS), "with fewer than 20 points in view"),
        ] {
            if !names.is_empty() {
                let more = if names.len() > NAMED { ", ..." } else { "" };
                let shown = names[..names.len().min(NAMED)].join(", ");
                problems.push(format!("{} {what}: {shown}{more}", counted(names.len(), "view")));
            }
        }
        problems
    }

    /// How many photographs have more than 8 bits per channel, and what is done with them:
    /// a line for each kind of file.
    pub fn deep_photographs(&self) -> Vec<String> {
        let of = |samples: Samples| {
            let mut views = self.views.iter().filter(|view| view.samples == samples);
            let first = views.next()?;
            Some(format!("{}: {}", counted(1 + views.count(), "photograph"), first.tone.of(samples)))
        };
        [Samples::Bits16, Samples::Float].into_iter().filter_map(of).collect()
    }
}
