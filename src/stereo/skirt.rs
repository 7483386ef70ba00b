//! Surfaces that stereo found, continued to where no view looks.

use glam::DVec3;
use rayon::prelude::*;

use super::depth_extrapolation::Continued;
use super::extrapolate::{others, pixel_at};
use super::fuse::in_space;
use super::{FusedPoint, Prior, View};

/// Pixels of the views, as stereo has them, between points beside a picture,
/// where a photograph from elsewhere is likely to look.
const NEAR_STEP: f64 = 8.0;
/// How far beside it that is, in pixels.
const NEAR: f64 = 24.0;
/// Pixels between points farther off.
const FAR_STEP: f64 = 16.0;
/// Surfaces that vary by more than this share of their distance say nothing of what is beside them.
const ROUGHEST: f64 = 0.1;
/// Where depths of less than this share of the pixels are known, those that are say little of what is beside the
/// pictures: on bare floors and before far walls, surfaces continued from a few things in the middle come to stand in
/// the air.
const LEAST_KNOWN: f64 = 0.5;
/// Points that are nearer to each other than this share of the distance between neighbours are one.
const SAME_PLACE: f64 = 0.7;

/// A point where no view looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkirtPoint {
    /// Its place, its normal, and the colour of what is nearest to it in a picture.
    pub point: FusedPoint,
    /// Distance to its neighbours, in the views' coordinates.
    pub spacing: f64,
}

/// Points on the views' surfaces, continued past the edges of the pictures by up to `share` of their longer sides,
/// where no view looks and these surfaces vary little: far apart, in the colours of the nearest edge. No photograph
/// says what is there; but something is, and without them nothing is shown. None where depths of less than half of the
/// pixels that are to be matched are known.
pub fn skirt(views: &[View], priors: &[Prior], share: f64) -> Vec<SkirtPoint> {
    if known_share(views, priors) < LEAST_KNOWN {
        return Vec::new();
    }
    let (near, far): (Vec<_>, Vec<_>) =
        (0..views.len()).into_par_iter().map(|i| around(views, priors, i, share)).unzip();
    let mut points: Vec<SkirtPoint> = Vec::new();
    // The near ones of all views first: a far one that comes later gives way to them.
    for one in near.into_iter().chain(far).flatten() {
        let at = DVec3::from_array(one.point.position);
        let same = |other: &SkirtPoint| {
            at.distance(DVec3::from_array(other.point.position)) < SAME_PLACE * one.spacing.max(other.spacing)
        };
        if !points.iter().any(same) {
            points.push(one);
        }
    }
    points
}

/// Share of the pixels that are to be matched that have a depth.
fn known_share(views: &[View], priors: &[Prior]) -> f64 {
    let (mut known, mut wanted) = (0, 0);
    for (view, prior) in views.iter().zip(priors) {
        known += prior.depth.iter().filter(|d| **d > 0.0).count();
        wanted += view.wanted.as_ref().map_or(view.pixels(), |wanted| wanted.iter().filter(|w| **w).count());
    }
    known as f64 / wanted.max(1) as f64
}

/// Those of a view that are near to its picture, and the others.
fn around(views: &[View], priors: &[Prior], i: usize, share: f64) -> (Vec<SkirtPoint>, Vec<SkirtPoint>) {
    let (Some(view), Some(prior)) = (views.get(i), priors.get(i)) else { return Default::default() };
    let (Some(continued), true) = (Continued::new(view, prior), view.colours.len() == view.pixels()) else {
        return Default::default();
    };
    let others = others(views, i);
    let camera = &view.camera;
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let farthest = share * width.max(height);
    // How far beside the picture; negative on it.
    let beside = |u: f64, v: f64| {
        let out = |at: f64, side: f64| (-at).max(at - side);
        out(u, width).max(out(v, height))
    };
    let one = |[u, v]: [f64; 2], step: f64| {
        let (q, rough) = continued.inverse_depth(u, v);
        if rough > ROUGHEST || others.iter().any(|(j, link)| pixel_at(link, [u, v], q, &views[*j].camera).is_some()) {
            return None;
        }
        let (position, normal) = in_space(camera, [u, v], 1.0 / q, continued.normal(u, v, q));
        let (position, normal) = (position.to_array(), normal.as_vec3().to_array());
        let spacing = step / (q * 0.5 * (camera.fx + camera.fy));
        Some(SkirtPoint { point: FusedPoint { position, normal, colour: edge_colour(view, u, v), pixels: 0 }, spacing })
    };
    let grid = |step: f64, from: f64, to: f64| {
        let (right, bottom) = (nodes(width, step, to), nodes(height, step, to));
        let all = bottom.flat_map(move |v| right.clone().map(move |u| [u, v]));
        all.filter(|&[u, v]| (from..to).contains(&beside(u, v))).filter_map(|at| one(at, step)).collect()
    };
    let near = NEAR.min(farthest);
    (grid(NEAR_STEP, 0.0, near), grid(FAR_STEP, near, farthest))
}

/// Places `step` apart along a side and up to `beyond` it on both ends.
fn nodes(side: f64, step: f64, beyond: f64) -> impl Iterator<Item = f64> + Clone {
    let out = (beyond / step).ceil();
    let inside = (side / step).ceil();
    (0..(2.0 * out + inside) as usize).map(move |k| (k as f64 - out + 0.5) * step)
}

/// The mean colour about the pixel that is nearest to a place beside the picture,
/// over a square that is the wider the farther that is.
fn edge_colour(view: &View, u: f64, v: f64) -> [u8; 3] {
    let (width, height) = (view.camera.width as usize, view.camera.height as usize);
    let nearest = |at: f64, side: usize| at.clamp(0.0, side.saturating_sub(1) as f64) as usize;
    let (x, y) = (nearest(u, width), nearest(v, height));
    let reach = (u - x as f64).abs().max((v - y as f64).abs()).max(NEAR_STEP) as usize / 2;
    let mut sum = [0_u32; 3];
    let mut count = 0;
    for row in y.saturating_sub(reach)..(y + reach + 1).min(height) {
        for pixel in row * width + x.saturating_sub(reach)..row * width + (x + reach + 1).min(width) {
            sum.iter_mut().zip(view.colours[pixel]).for_each(|(sum, c)| *sum += u32::from(c));
            count += 1;
        }
    }
    sum.map(|sum| ((sum + count / 2) / count.max(1)) as u8)
}
