//! How much surface the views show.

use rayon::prelude::*;

use super::continued::middle;
use super::extend::{others, pixel_at};
use super::links::Link;
use super::{Prior, View};

/// One pixel in so many, both across and down, stands for all.
const STEP: usize = 8;
/// Depths that differ by more than this share are of different surfaces.
const SAME_SURFACE: f64 = 0.1;

/// The area of the surfaces of which depths are known, in units of a photograph: a place that n views have in their pictures counts 1 / n in
/// each of these. A view has it there unless it knows another depth of that pixel; views of which nothing is known are left out, as are those
/// whose prior is not of their size.
pub fn surface(views: &[View], priors: &[Prior]) -> f64 {
    let known: Vec<bool> = views.iter().zip(priors).map(|(view, prior)| is_known(view, prior)).collect();
    let of = |i: usize| if known[i] { share(views, priors, &known, i) } else { 0.0 };
    // Summed in the order of the views: the same on any number of cores.
    let shares: Vec<f64> = (0..known.len()).into_par_iter().map(of).collect();
    shares.into_iter().sum()
}

fn is_known(view: &View, prior: &Prior) -> bool {
    let size = (view.camera.width, view.camera.height);
    (prior.width, prior.height) == size && prior.depth.len() == view.pixels() && prior.depth.iter().any(|d| *d > 0.0)
}

/// A view's part of it.
fn share(views: &[View], priors: &[Prior], known: &[bool], i: usize) -> f64 {
    let prior = &priors[i];
    let others: Vec<(usize, Link)> =
        others(views, i).into_iter().filter(|(j, _)| known.get(*j) == Some(&true)).collect();
    let (width, height) = (prior.width as usize, prior.height as usize);
    let along = |side: usize| (STEP.min(side) / 2..side).step_by(STEP);
    let places = along(height).flat_map(|y| along(width).map(move |x| y * width + x));
    let (mut seen, mut all) = (0.0, 0);
    for pixel in places {
        all += 1;
        let depth = f64::from(prior.depth[pixel]);
        if depth <= 0.0 {
            continue;
        }
        let (u, v) = middle(prior.width, pixel);
        let sees = |(j, link): &&(usize, Link)| {
            let Some(place) = pixel_at(link, [u, v], 1.0 / depth, &views[*j].camera) else { return false };
            let there = f64::from(priors[*j].depth[place]);
            let here = link.applied(u, v, 1.0 / depth).z * depth;
            there <= 0.0 || (there / here - 1.0).abs() < SAME_SURFACE
        };
        seen += 1.0 / (1 + others.iter().filter(sees).count()) as f64;
    }
    seen / f64::from(all.max(1))
}
