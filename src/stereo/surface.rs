//! How much surface the views show.

use rayon::prelude::*;

use super::continued::middle;
use super::extend::{others, pixel_at};
use super::{Prior, View};

/// One pixel in so many, both across and down, stands for all.
const STEP: usize = 8;
/// Depths that differ by more than this share are of different surfaces.
const SAME_SURFACE: f64 = 0.1;

/// The surfaces of which depths are known, in pictures: so many pictures of the same sizes as the views' would show all of it once, were each
/// place seen as often as the views see it. Views that look at the same count as one, however many they are.
pub fn surface(views: &[View], priors: &[Prior]) -> f64 {
    (0..views.len()).into_par_iter().map(|i| share(views, priors, i)).sum()
}

/// The view's part of it: each place counts the less, the more views see it.
fn share(views: &[View], priors: &[Prior], i: usize) -> f64 {
    let Some(prior) = priors.get(i) else { return 0.0 };
    let others = others(views, i);
    let (width, height) = (prior.width as usize, prior.height as usize);
    let along = |side: usize| (STEP.min(side) / 2..side).step_by(STEP);
    let places = along(height).flat_map(|y| along(width).map(move |x| y * width + x));
    let (mut seen, mut all) = (0.0, 0);
    for pixel in places {
        all += 1;
        let Some(depth) = prior.depth.get(pixel).map(|d| f64::from(*d)).filter(|d| *d > 0.0) else { continue };
        let (u, v) = middle(prior.width, pixel);
        let sees = |(j, link): &&(usize, super::links::Link)| {
            let Some(place) = pixel_at(link, [u, v], 1.0 / depth, &views[*j].camera) else { return false };
            let there = priors.get(*j).and_then(|p| p.depth.get(place)).map_or(0.0, |d| f64::from(*d));
            let here = link.applied(u, v, 1.0 / depth).z * depth;
            there <= 0.0 || (there / here - 1.0).abs() < SAME_SURFACE
        };
        seen += 1.0 / (1 + others.iter().filter(sees).count()) as f64;
    }
    seen / f64::from(all.max(1))
}
