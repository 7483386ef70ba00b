//! The amount of surface that the views show.

use rayon::prelude::*;

use super::depth_extrapolation::middle;
use super::extrapolate::{others, pixel_at};
use super::homography::Homography;
use super::{Prior, StereoView};
use crate::scene::Camera;

/// Step in pixels, across and down, between the pixels that are counted.
const STEP: usize = 8;
/// Largest number of points that are counted.
const MOST_POINTS: usize = 4096;
/// Relative difference of depths from which surfaces count as different.
const SAME_SURFACE: f64 = 0.1;

/// The area of the surfaces with known depths, in units of one photograph's wanted pixels. A point that n views see
/// counts 1 / n in each. A view sees a point that it contains unless the view has another depth at that pixel. Views
/// without depths are left out, as are views whose prior has another size.
pub fn surface(views: &[StereoView], priors: &[Prior]) -> f64 {
    let known: Vec<bool> = views.iter().zip(priors).map(|(view, prior)| is_known(view, prior)).collect();
    let of = |i: usize| if known[i] { share(views, priors, &known, i) } else { 0.0 };
    // The sum is in the order of the views, and so equal on any number of cores.
    let shares: Vec<f64> = (0..known.len()).into_par_iter().map(of).collect();
    shares.into_iter().sum()
}

fn is_known(view: &StereoView, prior: &Prior) -> bool {
    let size = (view.camera.width, view.camera.height);
    (prior.width, prior.height) == size && prior.depth.len() == view.pixels() && prior.depth.iter().any(|d| *d > 0.0)
}

/// A view's share of the area.
fn share(views: &[StereoView], priors: &[Prior], known: &[bool], i: usize) -> f64 {
    let prior = &priors[i];
    let others: Vec<(usize, Homography)> =
        others(views, i).into_iter().filter(|(j, _)| known.get(*j) == Some(&true)).collect();
    let (width, height) = (prior.width as usize, prior.height as usize);
    let along = |side: usize| (STEP.min(side) / 2..side).step_by(STEP);
    let places = along(height).flat_map(|y| along(width).map(move |x| y * width + x));
    let (mut seen, mut all) = (0.0, 0);
    let counts = |pixel: &usize| views[i].wanted.as_ref().is_none_or(|wanted| wanted.get(*pixel) == Some(&true));
    for pixel in places.filter(counts) {
        all += 1;
        let depth = f64::from(prior.depth[pixel]);
        if depth <= 0.0 {
            continue;
        }
        let (u, v) = middle(prior.width, pixel);
        let sees = |(j, link): &&(usize, Homography)| {
            let Some(place) = pixel_at(link, [u, v], 1.0 / depth, &views[*j].camera) else { return false };
            let there = f64::from(priors[*j].depth[place]);
            let here = link.applied(u, v, 1.0 / depth).z * depth;
            there <= 0.0 || (there / here - 1.0).abs() < SAME_SURFACE
        };
        seen += 1.0 / (1 + others.iter().filter(sees).count()) as f64;
    }
    seen / f64::from(all.max(1))
}

/// An estimate of [`surface`] from points on the surfaces, before any depth is known. A point inside n photographs
/// counts 1 / n in each, as a share of the points inside that photograph. Occlusion is ignored.
pub fn surface_of_points(cameras: &[Camera], points: &[[f64; 3]]) -> f64 {
    let taken: Vec<[f64; 3]> = points.iter().step_by(points.len().div_ceil(MOST_POINTS).max(1)).copied().collect();
    let inside: Vec<Vec<bool>> = cameras.par_iter().map(|c| taken.iter().map(|p| has(c, *p)).collect()).collect();
    let views: Vec<f64> = (0..taken.len()).map(|p| inside.iter().filter(|of| of[p]).count() as f64).collect();
    let share = |of: &Vec<bool>| {
        let counts = of.iter().zip(&views).filter(|(inside, _)| **inside).map(|(_, n)| 1.0 / n);
        counts.clone().sum::<f64>() / (counts.count().max(1) as f64)
    };
    inside.iter().map(share).sum()
}

/// Whether a point is inside a camera's image.
fn has(camera: &Camera, point: [f64; 3]) -> bool {
    let [x, y, z] = [0, 1, 2].map(|k| {
        let row = camera.rotation[k];
        row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + camera.translation[k]
    });
    let (u, v) = (camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy);
    z > 0.0 && (0.0..f64::from(camera.width)).contains(&u) && (0.0..f64::from(camera.height)).contains(&v)
}
