//! Accuracy of stereo's depths and normals against the truth.

use glam::DVec3;

use super::homography::Homography;
use super::{Prior, StereoView};

/// Largest relative difference of depths between pixels of one surface, and between a point's depth and the depth of
/// the surface that a view sees there.
const SAME_SURFACE: f64 = 0.02;
/// Largest angle in degrees between the true normals around a pixel and its own for the pixel to count as lying on a
/// plane.
const ON_A_PLANE: f64 = 1.0;
/// Pixels to each side whose normals are compared.
const PLANE_REACH: i64 = 2;

/// True depths and normals of a view, at any size of the photograph's aspect ratio.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewTruth {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Depth along the camera's axis in the views' coordinates; not positive where no depth is known.
    pub depth: Vec<f64>,
    /// Unit normals in the camera frame; may be empty.
    pub normals: Vec<[f32; 3]>,
}

/// Errors collected over views.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Accuracy {
    depth: Vec<f64>,
    degrees: Vec<f64>,
    pixels: usize,
    seen: usize,
    seen_valid: usize,
}

impl ViewTruth {
    /// Depth at a pixel of a photograph of another size: interpolated between the nearest pixels of the truth where
    /// they are of one surface, else the nearest pixel's depth.
    fn at(&self, x: u32, y: u32, width: u32, height: u32) -> f64 {
        let place = |v: u32, to: u32, from: u32| (f64::from(v) + 0.5) * f64::from(from) / f64::from(to);
        let (u, v) = (place(x, width, self.width), place(y, height, self.height));
        let depth = |x: f64, y: f64| {
            let (x, y) = (x.clamp(0.0, f64::from(self.width - 1)), y.clamp(0.0, f64::from(self.height - 1)));
            self.depth.get(y as usize * self.width as usize + x as usize).copied().unwrap_or(0.0)
        };
        let (left, top) = ((u - 0.5).floor(), (v - 0.5).floor());
        let (fx, fy) = (u - 0.5 - left, v - 0.5 - top);
        let four = [depth(left, top), depth(left + 1.0, top), depth(left, top + 1.0), depth(left + 1.0, top + 1.0)];
        let (low, high) = four.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), z| (l.min(*z), h.max(*z)));
        if !(low > 0.0 && high < low * (1.0 + SAME_SURFACE)) {
            return depth(u.floor(), v.floor());
        }
        let mix = |a: f64, b: f64, f: f64| a + (b - a) * f;
        1.0 / mix(mix(1.0 / four[0], 1.0 / four[1], fx), mix(1.0 / four[2], 1.0 / four[3], fx), fy)
    }

    /// The true normal at a pixel of a photograph of another size, where the pixel lies on a plane.
    fn normal_of_plane(&self, x: u32, y: u32, width: u32, height: u32) -> Option<DVec3> {
        let place = |v: u32, to: u32, from: u32| ((f64::from(v) + 0.5) * f64::from(from) / f64::from(to)) as i64;
        let (u, v) = (place(x, width, self.width), place(y, height, self.height));
        let normal = |x: i64, y: i64| {
            let inside = (0..i64::from(self.width)).contains(&x) && (0..i64::from(self.height)).contains(&y);
            let of = self.normals.get(usize::try_from(y * i64::from(self.width) + x).ok()?)?;
            inside.then(|| DVec3::from_array(of.map(f64::from))).filter(|n| n.length() > 0.5)
        };
        let here = normal(u, v)?;
        let (reach, least) = (PLANE_REACH, ON_A_PLANE.to_radians().cos());
        let near = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)));
        let same = |(dx, dy): (i64, i64)| normal(u + dx, v + dy).is_none_or(|n| n.dot(here) >= least);
        near.into_iter().all(same).then_some(here)
    }
}

impl Accuracy {
    /// Compares the priors of views with the truth, where the truth is known.
    pub fn of(views: &[StereoView], priors: &[Prior], truths: &[Option<ViewTruth>]) -> Self {
        let mut out = Self::default();
        let maps: Vec<Option<Vec<f64>>> = views
            .iter()
            .zip(truths)
            .map(|(view, truth)| {
                let (w, h) = (view.camera.width, view.camera.height);
                truth.as_ref().map(|t| (0..w * h).map(|p| t.at(p % w, p / w, w, h)).collect())
            })
            .collect();
        for (i, view) in views.iter().enumerate() {
            let (Some(truth), Some(map), false) = (&truths[i], &maps[i], view.sources.is_empty()) else { continue };
            let (w, h) = (view.camera.width, view.camera.height);
            let links: Vec<(usize, Homography)> =
                view.sources.iter().map(|s| (*s, Homography::new(&view.camera, &views[*s].camera))).collect();
            for pixel in 0..w * h {
                let (x, y) = (pixel % w, pixel / w);
                let (want, got) = (map[pixel as usize], f64::from(priors[i].depth[pixel as usize]));
                if !(want > 0.0 && want.is_finite()) {
                    continue;
                }
                let sees = |(s, link): &&(usize, Homography)| {
                    let (camera, map) = (&views[*s].camera, &maps[*s]);
                    let h = link.applied(f64::from(x) + 0.5, f64::from(y) + 0.5, 1.0 / want);
                    let (u, v) = (h.x / h.z, h.y / h.z);
                    let inside = h.z > 0.0
                        && (0.0..f64::from(camera.width)).contains(&u)
                        && (0.0..f64::from(camera.height)).contains(&v);
                    let at = v as usize * camera.width as usize + u as usize;
                    let there = map.as_ref().and_then(|m| m.get(at)).copied();
                    inside && there.is_none_or(|z| (z / (h.z * want) - 1.0).abs() < SAME_SURFACE)
                };
                let seen = links.iter().filter(sees).count() >= 2.min(links.len());
                out.pixels += 1;
                out.seen += usize::from(seen);
                out.seen_valid += usize::from(seen && got > 0.0);
                if got > 0.0 {
                    out.depth.push((got / want - 1.0).abs());
                    let normal = DVec3::from_array(priors[i].normals[pixel as usize].map(f64::from));
                    let plane = truth.normal_of_plane(x, y, w, h);
                    out.degrees.extend(plane.map(|n| n.dot(normal).clamp(-1.0, 1.0).acos().to_degrees()));
                }
            }
        }
        out
    }

    /// Compares the priors with points that views see: for each view, positions in pixels and depths.
    pub fn of_points(priors: &[Prior], points: &[Vec<[f64; 3]>]) -> Self {
        let mut out = Self::default();
        for (prior, points) in priors.iter().zip(points) {
            for [u, v, z] in points {
                let at = *v as usize * prior.width as usize + *u as usize;
                let Some(got) = prior.depth.get(at).map(|d| f64::from(*d)) else { continue };
                out.pixels += 1;
                if got > 0.0 {
                    out.depth.push((got / z - 1.0).abs());
                }
            }
        }
        out
    }

    /// Whether nothing was compared.
    pub fn is_empty(&self) -> bool {
        self.pixels == 0
    }

    /// Median relative error of the depths; `None` without depths.
    pub fn median_error(&self) -> Option<f64> {
        median(&self.depth)
    }

    /// Share of the depths whose relative error is at most `share`.
    pub fn within(&self, share: f64) -> Option<f64> {
        let good = self.depth.iter().filter(|e| **e <= share).count();
        (!self.depth.is_empty()).then(|| good as f64 / self.depth.len() as f64)
    }

    /// Share of the compared pixels that have a depth.
    pub fn valid(&self) -> Option<f64> {
        (self.pixels > 0).then(|| self.depth.len() as f64 / self.pixels as f64)
    }

    /// As [`Self::valid`], among the pixels whose surface at least two sources see, or one where the view has only one.
    pub fn valid_where_seen(&self) -> Option<f64> {
        (self.seen > 0).then(|| self.seen_valid as f64 / self.seen as f64)
    }

    /// Median angle between normals on planes, degrees.
    pub fn median_degrees(&self) -> Option<f64> {
        median(&self.degrees)
    }
}

fn median(values: &[f64]) -> Option<f64> {
    let mut values = values.to_vec();
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
