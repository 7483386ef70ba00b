//! Surfaces that stereo found, continued to where no view looks.

use glam::DVec3;
use rayon::prelude::*;

use super::continued::Continued;
use super::extend::{others, pixel_at};
use super::fuse::in_space;
use super::{FusedPoint, Prior, View};

/// Pixels between points.
const STEP: usize = 12;
/// Surfaces that vary by more than this share of their distance say nothing of what is beside them.
const ROUGHEST: f64 = 0.1;
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

/// Points on the views' surfaces, continued past the edges of the pictures by up to `share` of their longer sides, where no view looks and these
/// surfaces vary little: far apart, in the colours of the nearest edge. No photograph says what is there; but something is, and without them nothing is shown.
pub fn skirt(views: &[View], priors: &[Prior], share: f64) -> Vec<SkirtPoint> {
    let found: Vec<Vec<SkirtPoint>> =
        (0..views.len()).into_par_iter().map(|i| around(views, priors, i, share)).collect();
    let mut points: Vec<SkirtPoint> = Vec::new();
    for one in found.into_iter().flatten() {
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

fn around(views: &[View], priors: &[Prior], i: usize, share: f64) -> Vec<SkirtPoint> {
    let (Some(view), Some(prior)) = (views.get(i), priors.get(i)) else { return Vec::new() };
    let (Some(continued), true) = (Continued::new(view, prior), view.colours.len() == view.pixels()) else {
        return Vec::new();
    };
    let others = others(views, i);
    let camera = &view.camera;
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let rings = (share * width.max(height) / STEP as f64).round() as i64;
    let along = |side: u32| {
        let inside = side.div_ceil(STEP as u32) as i64;
        (-rings..inside + rings).map(|k| (k as f64 + 0.5) * STEP as f64)
    };
    let beside = |u: f64, v: f64| u < 0.0 || v < 0.0 || u >= width || v >= height;
    let one = |(u, v): (f64, f64)| {
        let (q, rough) = continued.inverse_depth(u, v);
        if rough > ROUGHEST || others.iter().any(|(j, link)| pixel_at(link, [u, v], q, &views[*j].camera).is_some()) {
            return None;
        }
        let (position, normal) = in_space(camera, [u, v], 1.0 / q, continued.normal(u, v, q));
        let (position, normal) = (position.to_array(), normal.as_vec3().to_array());
        let spacing = STEP as f64 / (q * 0.5 * (camera.fx + camera.fy));
        Some(SkirtPoint { point: FusedPoint { position, normal, color: edge_colour(view, u, v), pixels: 0 }, spacing })
    };
    let nodes = along(camera.height).flat_map(|v| along(camera.width).map(move |u| (u, v)));
    nodes.filter(|&(u, v)| beside(u, v)).filter_map(one).collect()
}

/// The mean colour about the pixel that is nearest to a place beside the picture, over a square that is the wider the farther that is.
fn edge_colour(view: &View, u: f64, v: f64) -> [u8; 3] {
    let (width, height) = (view.camera.width as usize, view.camera.height as usize);
    let nearest = |at: f64, side: usize| at.clamp(0.0, side.saturating_sub(1) as f64) as usize;
    let (x, y) = (nearest(u, width), nearest(v, height));
    let reach = (u - x as f64).abs().max((v - y as f64).abs()).max(STEP as f64) as usize / 2;
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
