//! Ground control points as the cameras see them.

use std::collections::HashMap;

use glam::{DMat3, DVec3};

use super::super::{Dataset, Role, View};
use super::control_points::{ControlPoints, Mark};
use crate::geodesy::fit::{self, Fit, NoFit, Pair};
use crate::geodesy::{Georeference, Tangent};
use crate::numbers::fraction;
use crate::scene::Geodetic;

/// A mark further off than this many pixels is wrong, where others agree better.
const WRONG_PIXELS: f64 = 4.0;
/// A mark further off than this many times the middle one is wrong.
const WRONG_TIMES: f64 = 6.0;
/// Rays at a smaller angle than this meet nowhere.
const LEAST_DEGREES: f64 = 0.5;
/// Residual, in sizes of a pixel on the ground, below which no point is called wrong.
const LEAST: f64 = 0.7;

/// The ray of a mark, in dataset coordinates.
struct Ray<'a> {
    origin: DVec3,
    direction: DVec3,
    /// Focal length in pixels.
    focal: f64,
    mark: &'a Mark,
}

impl Ray<'_> {
    /// Distance from the ray in pixels.
    fn pixels(&self, point: DVec3) -> f64 {
        let to = point - self.origin;
        let along = to.dot(self.direction);
        if along <= 0.0 { f64::INFINITY } else { (to - self.direction * along).length() / along * self.focal }
    }
}

/// A point that marks agree on.
struct Point {
    name: String,
    at: DVec3,
    place: [f64; 2],
    height: Option<f64>,
    /// Size of a pixel at the point in dataset units.
    pixel: f64,
}

/// The points that at least two photographs see.
pub(super) struct Triangulated {
    points: Vec<Point>,
    /// What was left out, and why.
    pub(super) notes: Vec<String>,
}

/// Looks for the marks' photographs, and intersects the rays of each point.
pub(super) fn triangulated(dataset: &Dataset, points: &ControlPoints) -> Result<Triangulated, String> {
    let names = Lookup::new(dataset);
    let mut found = Triangulated { points: Vec::new(), notes: Vec::new() };
    let mut without: Vec<&Mark> = Vec::new();
    for (name, marks) in points.by_point() {
        let mut rays = Vec::new();
        for mark in marks {
            match names.view(&mark.photograph) {
                Some(view) => rays.push(ray(view, mark)?),
                None => without.push(mark),
            }
        }
        match intersection(&rays) {
            Ok((at, wrong)) => {
                let pixel = rays.iter().map(|ray| (at - ray.origin).length() / ray.focal).fold(f64::INFINITY, f64::min);
                let first = rays[0].mark;
                found.notes.extend(wrong.into_iter().map(|k| {
                    let off = fraction(rays[k].pixels(at), 1);
                    format!("{name}: the mark in {} is {off} pixels off, and is left out", rays[k].mark.photograph)
                }));
                found.points.push(Point { name, at, place: first.place, height: first.height, pixel });
            }
            Err(problem) => found.notes.push(format!("{name}: {problem}, and is left out")),
        }
    }
    if let Some(first) = without.first() {
        if without.len() == points.marks.len() {
            return Err(format!(
                "line {}: '{}' is no photograph of the dataset, nor are those of the other marks",
                first.line, first.photograph
            ));
        }
        let text = format!("{} marks are in photographs without a pose, such as '{}'", without.len(), first.photograph);
        found.notes.push(text);
    }
    Ok(found)
}

/// Views by the names that files of control points use: in full, else the file's name, else without its ending.
struct Lookup<'a> {
    dataset: &'a Dataset,
    forms: [HashMap<String, Option<usize>>; 3],
}

fn forms(name: &str) -> [String; 3] {
    let lower = name.to_lowercase().replace('\\', "/");
    let file = lower.rsplit('/').next().unwrap_or(&lower).to_owned();
    let stem = file.split('.').next().unwrap_or(&file).to_owned();
    [lower, file, stem]
}

impl<'a> Lookup<'a> {
    fn new(dataset: &'a Dataset) -> Self {
        let mut found: [HashMap<String, Option<usize>>; 3] = Default::default();
        for (k, view) in dataset.views.iter().enumerate().filter(|(_, view)| view.role != Role::Unused) {
            for (form, map) in forms(&view.name).into_iter().zip(&mut found) {
                // A name of two views is none.
                map.entry(form).and_modify(|at| *at = None).or_insert(Some(k));
            }
        }
        Self { dataset, forms: found }
    }

    fn view(&self, name: &str) -> Option<&'a View> {
        let wanted = forms(name);
        let at = self.forms.iter().zip(&wanted).find_map(|(map, form)| map.get(form).copied().flatten())?;
        self.dataset.views.get(at)
    }
}

/// The ray of a mark, through the lens of the photograph.
fn ray<'a>(view: &View, mark: &'a Mark) -> Result<Ray<'a>, String> {
    let (width, height) = view.size_on_disk;
    let [u, v] = mark.pixel.map(|pixel| pixel + 0.5);
    if !(0.0..=f64::from(width)).contains(&u) || !(0.0..=f64::from(height)).contains(&v) {
        return Err(format!(
            "line {}: pixel {} {} lies outside of {}, which has {width}x{height} pixels: mark points in the photographs \
             of the dataset",
            mark.line, mark.pixel[0], mark.pixel[1], view.name
        ));
    }
    let camera = &view.camera;
    let by = [f64::from(camera.width) / f64::from(width), f64::from(camera.height) / f64::from(height)];
    let plain = [(u * by[0] - camera.cx) / camera.fx, (v * by[1] - camera.cy) / camera.fy];
    let bent = match &view.lens {
        Some(lens) => lens
            .ray([u, v])
            .ok_or_else(|| format!("line {}: the lens of {} has no ray at this pixel", mark.line, view.name))?,
        None => plain,
    };
    let r = &camera.rotation;
    let direction: [f64; 3] = std::array::from_fn(|k| r[0][k] * bent[0] + r[1][k] * bent[1] + r[2][k]);
    Ok(Ray {
        origin: DVec3::from_array(camera.center()),
        direction: DVec3::from_array(direction).normalize(),
        focal: camera.fx / by[0],
        mark,
    })
}

/// Where rays meet, and the rays that do not. With three rays or more, the two that most others agree with decide.
fn intersection(rays: &[Ray<'_>]) -> Result<(DVec3, Vec<usize>), String> {
    if rays.len() < 2 {
        return Err(format!("has {} of the two marks that a point needs", rays.len()));
    }
    let all: Vec<&Ray<'_>> = rays.iter().collect();
    let mut best: Option<(f64, DVec3)> = None;
    for i in 0..rays.len() {
        for j in 0..i {
            let angle = rays[i].direction.cross(rays[j].direction).length().asin().to_degrees();
            let Some(at) = meet(&[&rays[i], &rays[j]]).filter(|_| angle >= LEAST_DEGREES) else { continue };
            let mut off: Vec<f64> = rays.iter().map(|ray| ray.pixels(at)).collect();
            off.sort_by(f64::total_cmp);
            // With three rays the largest decides; with more, the middle.
            let middle = off[if rays.len() == 3 { 2 } else { rays.len() / 2 }];
            if best.is_none_or(|(least, _)| middle < least) {
                best = Some((middle, at));
            }
        }
    }
    let Some((middle, at)) = best else {
        return Err("is seen from one side only, so that its depth is open".to_owned());
    };
    let most = (WRONG_TIMES * middle).max(WRONG_PIXELS);
    let wrong: Vec<usize> = (0..rays.len()).filter(|k| rays[*k].pixels(at) > most).collect();
    let kept: Vec<&Ray<'_>> = all.iter().enumerate().filter(|(k, _)| !wrong.contains(k)).map(|(_, ray)| *ray).collect();
    let at = meet(&kept).filter(|_| kept.len() >= 2).ok_or("has marks that agree nowhere")?;
    Ok((at, wrong))
}

/// The point nearest to rays in pixels.
fn meet(rays: &[&Ray<'_>]) -> Option<DVec3> {
    // About the first origin, so that large coordinates keep their digits.
    let zero = rays.first()?.origin;
    let mut at: Option<DVec3> = None;
    for _ in 0..4 {
        let (mut m, mut b) = (DMat3::ZERO, DVec3::ZERO);
        for ray in rays {
            let d = ray.direction;
            let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
            let weight = at.map_or(1.0, |at| ray.focal.powi(2) / (at - ray.origin).length_squared().max(1e-12));
            m += across * weight;
            b += across * (ray.origin - zero) * weight;
        }
        let size = m.determinant();
        if size.abs() < 1e-12 * m.x_axis.x.abs().max(m.y_axis.y.abs()).max(1e-300).powi(3) {
            return None;
        }
        at = Some(m.inverse() * b + zero);
    }
    at.filter(|at| at.is_finite())
}

impl Triangulated {
    /// The names of the points.
    pub(super) fn names(&self) -> Vec<String> {
        self.points.iter().map(|point| point.name.clone()).collect()
    }

    /// The plane amid the control points, and the fit to it: of the dataset's points, or of where its grid puts them.
    pub(super) fn fitted(&self, points: &ControlPoints, grid: Option<&Georeference>) -> Result<(Tangent, Fit), NoFit> {
        let known: Vec<f64> = self.points.iter().filter_map(|point| point.height).collect();
        let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
        let place = |point: &Point| {
            let [x, y] = point.place;
            points.system.to_geodetic([x, y, point.height.unwrap_or(mean)])
        };
        let places: Vec<Geodetic> = self.points.iter().map(place).collect();
        let tangent = Tangent::amid(&places).ok_or(NoFit::TooFew(0))?;
        let source = |point: &Point| {
            let at = point.at.to_array();
            grid.and_then(|grid| grid.to_geodetic(at)).map_or(at, |place| tangent.from_geodetic(place))
        };
        let sources: Vec<[f64; 3]> = self.points.iter().map(source).collect();
        let targets: Vec<[f64; 3]> = places.iter().map(|place| tangent.from_geodetic(*place)).collect();
        let mut pixels: Vec<f64> = self.points.iter().map(|point| point.pixel).collect();
        pixels.sort_by(f64::total_cmp);
        let pixel = pixels.get(pixels.len() / 2).copied().unwrap_or(1.0) * ratio(&sources, &targets);
        let pair = |k: usize| {
            let vertical = if self.points[k].height.is_some() { pixel } else { f64::INFINITY };
            Pair { point: sources[k], place: targets[k], deviation: [pixel, pixel, vertical] }
        };
        let pairs: Vec<Pair> = (0..self.points.len()).map(pair).collect();
        fit::fit(&pairs, LEAST).map(|fit| (tangent, fit))
    }
}

/// Metres per unit of the dataset: the middle ratio of distances.
fn ratio(sources: &[[f64; 3]], targets: &[[f64; 3]]) -> f64 {
    let apart =
        |points: &[[f64; 3]], i: usize, j: usize| DVec3::from_array(points[i]).distance(DVec3::from_array(points[j]));
    let pairs = (0..sources.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    let mut ratios: Vec<f64> = pairs.map(|(i, j)| apart(targets, i, j) / apart(sources, i, j)).collect();
    ratios.retain(|ratio| ratio.is_finite() && *ratio > 0.0);
    ratios.sort_by(f64::total_cmp);
    ratios.get(ratios.len() / 2).copied().unwrap_or(1.0)
}
