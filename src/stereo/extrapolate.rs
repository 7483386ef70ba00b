//! Extrapolation of surfaces to regions that few views see.

use glam::DVec3;
use rayon::prelude::*;

use super::depth_extrapolation::{ExtrapolatedDepths, middle};
use super::fuse::in_space;
use super::homography::Homography;
use super::{FusedPoint, Prior, StereoView};
use crate::scene::Camera;

/// Largest variation of the depths that an extrapolation uses, as a share of the depth: an error of a hundredth in
/// depth moves a point by some pixels in other views.
pub(super) const ROUGHEST: f64 = 0.01;

/// An extrapolated point of a pixel without depth.
struct ExtrapolatedPixel {
    pixel: usize,
    point: FusedPoint,
    /// Other views that see the point, and the pixels that it projects to.
    shared: Vec<(usize, usize)>,
}

/// Points for the pixels without depth that at most `most` views see, the pixel's own view included: stereo can compare
/// little or nothing there. The points lie on the view's own surfaces, extrapolated by a plane fitted to all depths and
/// by the nearest depths' differences from it. Only surfaces that vary little are extrapolated: a plain, not a town.
/// Views that share a point get one point between them.
pub fn extend(views: &[StereoView], priors: &[Prior], most: usize) -> Vec<FusedPoint> {
    let found: Vec<Vec<ExtrapolatedPixel>> =
        (0..views.len()).into_par_iter().map(|i| alone(views, priors, i, most)).collect();
    let mut used: Vec<Vec<bool>> = views.iter().map(|view| vec![false; view.pixels()]).collect();
    let mut points = Vec::new();
    for (i, found) in found.into_iter().enumerate() {
        for ExtrapolatedPixel { pixel, point, shared } in found {
            if used[i][pixel] {
                continue;
            }
            shared.into_iter().for_each(|(other, there)| used[other][there] = true);
            points.push(point);
        }
    }
    points
}

fn alone(views: &[StereoView], priors: &[Prior], i: usize, most: usize) -> Vec<ExtrapolatedPixel> {
    let (Some(view), Some(prior)) = (views.get(i), priors.get(i)) else { return Vec::new() };
    let Some(continued) = ExtrapolatedDepths::new(view, prior) else { return Vec::new() };
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
            let first = (i as u32, pixel as u32);
            let point = FusedPoint { position: position.to_array(), normal, colour, pixels: 1, first };
            ExtrapolatedPixel { pixel, point, shared }
        })
    };
    (0..view.pixels()).filter(|&pixel| prior.depth[pixel] <= 0.0).filter(wanted).filter_map(one).collect()
}

/// Homographies from a view to all others, nearest views first: they most likely see the same surfaces.
pub(super) fn others(views: &[StereoView], i: usize) -> Vec<(usize, Homography)> {
    let centre = |view: &StereoView| DVec3::from_array(view.camera.center());
    let own = centre(&views[i]);
    let distance = |j: &usize| own.distance_squared(centre(&views[*j]));
    let mut nearest: Vec<usize> = (0..views.len()).filter(|&j| j != i).collect();
    nearest.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    nearest.into_iter().map(|j| (j, Homography::new(&views[i].camera, &views[j].camera))).collect()
}

/// The pixel of another camera that sees a position (u, v) of the photograph at an inverse depth; `None` outside its
/// image.
pub(super) fn pixel_at(link: &Homography, [u, v]: [f64; 2], inverse_depth: f64, camera: &Camera) -> Option<usize> {
    let h = link.applied(u, v, inverse_depth);
    let (x, y) = (h.x / h.z, h.y / h.z);
    let inside = h.z > 0.0 && x >= 0.0 && y >= 0.0 && x < f64::from(camera.width) && y < f64::from(camera.height);
    inside.then(|| y as usize * camera.width as usize + x as usize)
}
