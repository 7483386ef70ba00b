//! Surfaces that stereo found, continued to where few views look.

use glam::DVec3;
use rayon::prelude::*;

use super::depth_extrapolation::{Continued, middle};
use super::fuse::in_space;
use super::homography::Homography;
use super::{FusedPoint, Prior, View};
use crate::scene::Camera;

/// Surfaces are continued where what they are continued from varies by at most this share of the depth: a depth that is
/// wrong by a hundredth moves a place by some pixels in the views that look there from elsewhere.
pub(super) const ROUGHEST: f64 = 0.01;

/// A pixel that few views look at.
struct Alone {
    pixel: usize,
    point: FusedPoint,
    /// Other views that look there, and the pixels in which they do.
    shared: Vec<(usize, usize)>,
}

/// Points for the pixels of which stereo knows nothing and that at most `most` views look at, their own included: there
/// nothing can be compared, or hardly. They lie on the view's own surfaces, continued by a plane through all of them
/// and by what the nearest differ from it, where these vary little: a plain can be continued, a town cannot. Places
/// that views share are used once.
pub fn extend(views: &[View], priors: &[Prior], most: usize) -> Vec<FusedPoint> {
    let found: Vec<Vec<Alone>> = (0..views.len()).into_par_iter().map(|i| alone(views, priors, i, most)).collect();
    let mut used: Vec<Vec<bool>> = views.iter().map(|view| vec![false; view.pixels()]).collect();
    let mut points = Vec::new();
    for (i, found) in found.into_iter().enumerate() {
        for Alone { pixel, point, shared } in found {
            if used[i][pixel] {
                continue;
            }
            shared.into_iter().for_each(|(other, there)| used[other][there] = true);
            points.push(point);
        }
    }
    points
}

fn alone(views: &[View], priors: &[Prior], i: usize, most: usize) -> Vec<Alone> {
    let (Some(view), Some(prior)) = (views.get(i), priors.get(i)) else { return Vec::new() };
    let Some(continued) = Continued::new(view, prior) else { return Vec::new() };
    let others = others(views, i);
    let wanted = |pixel: &usize| view.wanted.as_ref().is_none_or(|wanted| wanted.get(*pixel) != Some(&false));
    let one = |pixel: usize| {
        let (u, v) = middle(prior.width, pixel);
        let (q, rough) = continued.inverse_depth(u, v);
        if rough > ROUGHEST {
            return None;
        }
        let sharing = others.iter().filter_map(|(j, link)| Some((*j, pixel_at(link, [u, v], q, &views[*j].camera)?)));
        let shared: Vec<(usize, usize)> = sharing.take(most).collect();
        (shared.len() < most).then(|| {
            let (position, normal) = in_space(&view.camera, [u, v], 1.0 / q, continued.normal(u, v, q));
            let colour = view.colours.get(pixel).copied().unwrap_or([128; 3]);
            let normal = normal.as_vec3().to_array();
            Alone { pixel, point: FusedPoint { position: position.to_array(), normal, colour, pixels: 1 }, shared }
        })
    };
    (0..view.pixels()).filter(|&pixel| prior.depth[pixel] <= 0.0).filter(wanted).filter_map(one).collect()
}

/// How the pixels of a view lead to those of all others, of those first that stand nearest:
/// they are the likeliest to look at the same.
pub(super) fn others(views: &[View], i: usize) -> Vec<(usize, Homography)> {
    let centre = |view: &View| DVec3::from_array(view.camera.center());
    let own = centre(&views[i]);
    let distance = |j: &usize| own.distance_squared(centre(&views[*j]));
    let mut nearest: Vec<usize> = (0..views.len()).filter(|&j| j != i).collect();
    nearest.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    nearest.into_iter().map(|j| (j, Homography::new(&views[i].camera, &views[j].camera))).collect()
}

/// The pixel of another camera in which a place in a picture at an inverse depth lies.
pub(super) fn pixel_at(link: &Homography, [u, v]: [f64; 2], inverse_depth: f64, camera: &Camera) -> Option<usize> {
    let h = link.applied(u, v, inverse_depth);
    let (x, y) = (h.x / h.z, h.y / h.z);
    let inside = h.z > 0.0 && x >= 0.0 && y >= 0.0 && x < f64::from(camera.width) && y < f64::from(camera.height);
    inside.then(|| y as usize * camera.width as usize + x as usize)
}
