//! Extrapolation of surfaces to regions that no view sees.

use glam::DVec3;
use rayon::prelude::*;

use super::depth_extrapolation::ExtrapolatedDepths;
use super::extrapolate::{others, pixel_at};
use super::fuse::in_space;
use super::{FusedPoint, Prior, StereoView};

/// Distance in pixels, at stereo's size, of points close to a photograph's edge, which other viewpoints are likely to
/// see.
const NEAR_STEP: f64 = 8.0;
/// Largest distance in pixels from the edge that counts as close.
const NEAR: f64 = 24.0;
/// Distance in pixels of points farther from the edge.
const FAR_STEP: f64 = 16.0;
/// Largest variation of the depths that an extrapolation uses, as a share of the depth.
const ROUGHEST: f64 = 0.1;
/// Smallest share of pixels with a known depth for an extrapolation. With fewer, as on bare floors and before far
/// walls, surfaces extrapolated from a few objects in the middle would float in the air.
const LEAST_KNOWN: f64 = 0.5;
/// Points closer together than this share of their spacing count as one.
const SAME_PLACE: f64 = 0.7;

/// A point that no view sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkirtPoint {
    /// Its position, its normal, and the colour of the photograph's nearest edge.
    pub point: FusedPoint,
    /// Distance to its neighbours, in the views' coordinates.
    pub spacing: f64,
}

/// Points on the views' surfaces, extrapolated past the edges of the photographs by up to `share` of their longer
/// sides, where no view looks and the surfaces vary little. The points are far apart and have the colours of the
/// nearest edge. No photograph shows these regions, but without points a render would be empty there. Empty where less
/// than half of the wanted pixels have a depth.
pub fn skirt(views: &[StereoView], priors: &[Prior], share: f64) -> Vec<SkirtPoint> {
    if known_share(views, priors) < LEAST_KNOWN {
        return Vec::new();
    }
    let (near, far): (Vec<_>, Vec<_>) =
        (0..views.len()).into_par_iter().map(|i| around(views, priors, i, share)).unzip();
    let mut points: Vec<SkirtPoint> = Vec::new();
    // The near points of all views come first and take precedence over far points.
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

/// Share of the wanted pixels that have a depth.
fn known_share(views: &[StereoView], priors: &[Prior]) -> f64 {
    let (mut known, mut wanted) = (0, 0);
    for (view, prior) in views.iter().zip(priors) {
        known += prior.depth.iter().filter(|d| **d > 0.0).count();
        wanted += view.wanted.as_ref().map_or(view.pixels(), |wanted| wanted.iter().filter(|w| **w).count());
    }
    known as f64 / wanted.max(1) as f64
}

/// The points of a view near its edges, and the points farther away.
fn around(views: &[StereoView], priors: &[Prior], i: usize, share: f64) -> (Vec<SkirtPoint>, Vec<SkirtPoint>) {
    let (Some(view), Some(prior)) = (views.get(i), priors.get(i)) else { return Default::default() };
    let (Some(continued), true) = (ExtrapolatedDepths::new(view, prior), view.colours.len() == view.pixels()) else {
        return Default::default();
    };
    let others = others(views, i);
    let camera = &view.camera;
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let farthest = share * width.max(height);
    // Distance outside the photograph in pixels; negative inside.
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
        Some(SkirtPoint {
            point: FusedPoint { position, normal, colour: edge_colour(view, u, v), pixels: 0, first: (0, 0) },
            spacing,
        })
    };
    let grid = |step: f64, from: f64, to: f64| {
        let (right, bottom) = (nodes(width, step, to), nodes(height, step, to));
        let all = bottom.flat_map(move |v| right.clone().map(move |u| [u, v]));
        all.filter(|&[u, v]| (from..to).contains(&beside(u, v))).filter_map(|at| one(at, step)).collect()
    };
    let near = NEAR.min(farthest);
    (grid(NEAR_STEP, 0.0, near), grid(FAR_STEP, near, farthest))
}

/// Positions `step` apart along a side, extended by `beyond` at both ends.
fn nodes(side: f64, step: f64, beyond: f64) -> impl Iterator<Item = f64> + Clone {
    let out = (beyond / step).ceil();
    let inside = (side / step).ceil();
    (0..(2.0 * out + inside) as usize).map(move |k| (k as f64 - out + 0.5) * step)
}

/// The mean colour around the pixel nearest to a position outside the photograph, over a square that grows with the
/// distance.
fn edge_colour(view: &StereoView, u: f64, v: f64) -> [u8; 3] {
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
