//! Diagnoses a dataset before training: what its cameras have in view.

use rayon::prelude::*;

use super::{Dataset, Samples, Warning, random_points};
use crate::numbers::counted;

/// Most points by which pairs of views are compared.
const COMPARED: usize = 20_000;
/// A view with fewer points hardly takes part in the reconstruction.
const FEW_POINTS: usize = 20;
/// Most views that a message names.
const NAMED: usize = 5;

/// The points in front of a camera and inside its image, hidden or not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// Number of these points.
    pub points: usize,
    /// Largest share of these points that another view has in view too; `None` without points or other views.
    pub overlap: Option<f64>,
}

impl Dataset {
    /// The points in view of each view, in the order of the views.
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

    /// The problems of the dataset: its warnings, and views with no points or hardly any in view. `sights` are those of
    /// its views.
    pub fn problems(&self, sights: &[Sight]) -> Vec<String> {
        let mut problems: Vec<String> = self.warnings.iter().map(ToString::to_string).collect();
        // Where the points are of no use, a view without points says nothing about its pose.
        problems.extend(self.useless.as_ref().map(ToString::to_string));
        if self.begins_at_random() {
            return problems;
        }
        // A view with a wrong pose has its own warning.
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

    /// The number of photographs with more than 8 bits per channel, and how they are treated: a line for each kind of
    /// file.
    pub fn deep_photographs(&self) -> Vec<String> {
        let of = |samples: Samples| {
            let mut views = self.views.iter().filter(|view| view.samples == samples);
            let first = views.next()?;
            Some(format!("{}: {}", counted(1 + views.count(), "photograph"), first.tone.of(samples)))
        };
        [Samples::Bits16, Samples::Float].into_iter().filter_map(of).collect()
    }
}
