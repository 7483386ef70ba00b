//! Splats off the surface, a triangle mesh.

use glam::DVec3;
use rayon::prelude::*;

use crate::format::ply::Mesh;
use crate::scene::{Frame, Gaussians};

/// A splat counts as opaque above this opacity.
const OPAQUE: f64 = 0.5;
/// Share of the extent beyond which a splat floats.
const FAR: f64 = 0.01;

/// How far splats are from a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OffSurface {
    /// Median distance of opaque splats, weighted by their mass, in the dataset's units.
    pub distance: Option<f64>,
    /// Share of the mass of all splats that floats.
    pub floaters: Option<f64>,
}

/// Distances of a model's splats (in scene coordinates) from the true surface (in the dataset's).
///
/// The *opaque mass* of a splat is its opacity times the product of its two largest standard deviations: what it covers
/// where it is seen from its flat side. The distance is that of its centre from the nearest point of the surface.
/// `distance` is the median over splats with an opacity above 0.5, weighted by mass; `floaters` is the share of the
/// mass of all splats, also transparent ones, that is further away than 1 % of `extent` (the dataset's extent as
/// [`crate::dataset::Dataset::extent`] has it, in its units). The surface has to cover what the photographs show:
/// splats beyond its border would count too.
pub fn off_surface(model: &Gaussians, frame: &Frame, extent: f64, surface: &Closest) -> OffSurface {
    if surface.is_empty() {
        return OffSurface::default();
    }
    let splat = |i: usize| {
        let row = |plane: &[f32]| [0, 1, 2].map(|k| f64::from(plane[3 * i + k]));
        let opacity = 1.0 / (1.0 + (-f64::from(model.opacities[i])).exp());
        let mut axes = row(&model.scales);
        axes.sort_by(f64::total_cmp);
        let mass = opacity * (axes[1] + axes[2]).exp();
        let distance = surface.distance(frame.to_dataset(row(&model.means)));
        (mass, distance, opacity)
    };
    let splats: Vec<(f64, f64, f64)> =
        (0..model.len()).into_par_iter().map(splat).filter(|(m, d, _)| m.is_finite() && d.is_finite()).collect();
    let total: f64 = splats.iter().map(|(mass, ..)| mass).sum();
    // The sum of no floats is -0, which would be told as such.
    let far: f64 = splats.iter().filter(|(_, d, _)| *d > FAR * extent).map(|(mass, ..)| mass).sum::<f64>().abs();
    let mut opaque: Vec<(f64, f64)> = splats.iter().filter(|s| s.2 > OPAQUE).map(|s| (s.1, s.0)).collect();
    OffSurface { distance: weighted_median(&mut opaque), floaters: (total > 0.0).then(|| far / total) }
}

/// The smallest value such that it and the smaller ones have half of the weight; values with their weights.
fn weighted_median(values: &mut [(f64, f64)]) -> Option<f64> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|v| v.1).sum::<f64>();
    let mut sum = 0.0;
    values
        .iter()
        .find(|v| {
            sum += v.1;
            sum >= half
        })
        .map(|v| v.0)
}

/// Most triangles of a leaf.
const LEAF: usize = 4;

/// A box that holds a range of triangles, or two boxes.
#[derive(Clone, Copy, Debug)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// Leaf: its first triangle. Inner node: its second child (the first one follows the node).
    first: u32,
    /// Triangles of a leaf, 0 for inner nodes.
    count: u32,
}

/// A triangle mesh that answers how far a point is from it, exactly: a hierarchy of boxes, divided at the median of the
/// triangles' middles along the longest side.
#[derive(Clone, Debug, Default)]
pub struct Closest {
    nodes: Vec<Node>,
    triangles: Vec<[DVec3; 3]>,
}

impl Closest {
    /// Prepares a mesh. Triangles with a corner that does not exist are left out.
    pub fn new(mesh: &Mesh) -> Self {
        let corner = |k: u32| mesh.vertices.get(k as usize).map(|v| DVec3::from_array(*v));
        let triangle = |t: &[u32; 3]| Some([corner(t[0])?, corner(t[1])?, corner(t[2])?]);
        let mut out = Self { nodes: Vec::new(), triangles: mesh.triangles.iter().filter_map(triangle).collect() };
        let mut triangles = std::mem::take(&mut out.triangles);
        if !triangles.is_empty() {
            out.build(&mut triangles, 0);
        }
        out.triangles = triangles;
        out
    }

    /// Whether there is no triangle.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Distance of a point from the nearest triangle; infinite without one.
    pub fn distance(&self, p: [f64; 3]) -> f64 {
        let p = DVec3::from_array(p);
        let mut best = f64::INFINITY;
        if let Some(root) = self.nodes.first() {
            self.visit(0, root, p, &mut best);
        }
        best.sqrt()
    }

    /// The subtree of `triangles`, whose first one is number `start` of all.
    fn build(&mut self, triangles: &mut [[DVec3; 3]], start: usize) {
        let corners = || triangles.iter().flatten();
        let low = corners().fold(DVec3::INFINITY, |a, b| a.min(*b));
        let high = corners().fold(DVec3::NEG_INFINITY, |a, b| a.max(*b));
        let at = self.nodes.len();
        self.nodes.push(Node { low, high, first: start as u32, count: triangles.len() as u32 });
        if triangles.len() <= LEAF {
            return;
        }
        let axis = (high - low).max_position();
        let middle = |t: &[DVec3; 3]| t[0][axis] + t[1][axis] + t[2][axis];
        let half = triangles.len() / 2;
        triangles.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
        let (left, right) = triangles.split_at_mut(half);
        self.build(left, start);
        self.nodes[at].first = self.nodes.len() as u32;
        self.nodes[at].count = 0;
        self.build(right, start + half);
    }

    /// Lowers `best`, a squared distance, to what the subtree has.
    fn visit(&self, at: usize, node: &Node, p: DVec3, best: &mut f64) {
        if node.count > 0 {
            let leaf = node.first as usize..(node.first + node.count) as usize;
            for triangle in &self.triangles[leaf] {
                *best = best.min(to_triangle(p, triangle));
            }
            return;
        }
        let children = [at + 1, node.first as usize].map(|k| (k, &self.nodes[k]));
        let mut near = children.map(|(k, child)| (to_box(p, child), k, child));
        if near[1].0 < near[0].0 {
            near.swap(0, 1);
        }
        for (distance, k, child) in near {
            if distance < *best {
                self.visit(k, child, p, best);
            }
        }
    }
}

/// Squared distance from a box.
fn to_box(p: DVec3, node: &Node) -> f64 {
    (p - p.clamp(node.low, node.high)).length_squared()
}

/// Squared distance from a triangle: from its plane where the point is above its inside, else from the nearest edge.
fn to_triangle(p: DVec3, [a, b, c]: &[DVec3; 3]) -> f64 {
    let n = (*b - *a).cross(*c - *a);
    let edges = [(*a, *b), (*b, *c), (*c, *a)];
    let above = n.length_squared() > 0.0 && edges.iter().all(|(u, v)| n.cross(*v - *u).dot(p - *u) >= 0.0);
    if above {
        let height = n.dot(p - *a);
        return height * height / n.length_squared();
    }
    edges.iter().map(|(u, v)| to_segment(p, *u, *v)).fold(f64::INFINITY, f64::min)
}

fn to_segment(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let along = b - a;
    let length = along.length_squared();
    let s = if length > 0.0 { ((p - a).dot(along) / length).clamp(0.0, 1.0) } else { 0.0 };
    (p - (a + along * s)).length_squared()
}
