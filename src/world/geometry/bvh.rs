//! A bounding volume hierarchy over the solids.

use glam::DVec3;

use super::{Bounds, Ray, Solid};

const LEAF: usize = 3;
const BINS: usize = 12;

#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Bounds,
    /// Leaf: its first entry of `order`. Inner node: index of its second child (the first child follows the node).
    first: u32,
    /// Number of solids of a leaf, 0 for inner nodes.
    count: u32,
}

/// A hierarchy built by the binned surface area heuristic (Wald 2007).
#[derive(Clone, Debug, Default)]
pub(crate) struct Bvh {
    nodes: Vec<Node>,
    order: Vec<u32>,
}

impl Bvh {
    pub(crate) fn new(solids: &[Solid]) -> Self {
        let boxes: Vec<Bounds> = solids.iter().map(Solid::bounds).collect();
        let mut order: Vec<u32> = (0..solids.len() as u32).collect();
        let mut nodes = Vec::new();
        if !order.is_empty() {
            build(&boxes, &mut order, 0, &mut nodes);
        }
        Self { nodes, order }
    }

    /// The first solid that the ray enters with `low < t < high`: t, solid, face. With `any`, the first one found,
    /// which need not be the nearest.
    pub(crate) fn enter(&self, solids: &[Solid], ray: &Ray, low: f64, high: f64, any: bool) -> Option<(f64, u32, u32)> {
        let inverse = ray.direction.recip();
        let mut best = None;
        let mut limit = high;
        let mut stack = [0u32; 96];
        let mut depth = usize::from(!self.nodes.is_empty());
        while depth > 0 {
            depth -= 1;
            let at = stack[depth];
            let node = &self.nodes[at as usize];
            if !meets(&node.bounds, ray.origin, inverse, low, limit) {
                continue;
            }
            if node.count == 0 {
                stack[depth] = node.first;
                stack[depth + 1] = at + 1;
                depth += 2;
                continue;
            }
            for &index in &self.order[node.first as usize..(node.first + node.count) as usize] {
                if let Some((t, face)) = solids[index as usize].enter(ray, low, limit) {
                    limit = t;
                    best = Some((t, index, face));
                    if any {
                        return best;
                    }
                }
            }
        }
        best
    }
}

fn meets(b: &Bounds, origin: DVec3, inverse: DVec3, low: f64, high: f64) -> bool {
    let (a, c) = ((b.min - origin) * inverse, (b.max - origin) * inverse);
    let near = a.x.min(c.x).max(a.y.min(c.y)).max(a.z.min(c.z)).max(low);
    let far = a.x.max(c.x).min(a.y.max(c.y)).min(a.z.max(c.z)).min(high);
    near <= far
}

/// Builds the subtree of `order`, whose first entry is number `start` of the whole list. Either side of a split gets at
/// least a sixth of the solids, so that 10^7 solids stay under the 96 entries of the traversal's stack: ln(10^7 / 3) /
/// ln(6 / 5) = 82.
fn build(boxes: &[Bounds], order: &mut [u32], start: u32, nodes: &mut Vec<Node>) {
    let bounds = order.iter().fold(Bounds::EMPTY, |b, &k| b.join(boxes[k as usize]));
    let at = nodes.len();
    nodes.push(Node { bounds, first: start, count: order.len() as u32 });
    if order.len() <= LEAF {
        return;
    }
    let centre = |k: u32| (boxes[k as usize].min + boxes[k as usize].max) * 0.5;
    let middle = order.iter().fold(Bounds::EMPTY, |b, &k| b.join(Bounds { min: centre(k), max: centre(k) }));
    let size = middle.max - middle.min;
    let axis = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let bin = |k: u32| {
        let x = (centre(k)[axis] - middle.min[axis]) / size[axis].max(1e-12);
        ((x * BINS as f64) as usize).min(BINS - 1)
    };
    let mut bins = [(Bounds::EMPTY, 0usize); BINS];
    for &k in order.iter() {
        let b = &mut bins[bin(k)];
        *b = (b.0.join(boxes[k as usize]), b.1 + 1);
    }
    let side = |part: &[(Bounds, usize)]| {
        let (b, n) = part.iter().fold((Bounds::EMPTY, 0), |(b, n), &(c, m)| (b.join(c), n + m));
        (b.half_area() * n as f64, n)
    };
    let best = (1..BINS)
        .filter_map(|s| {
            let ((left, n), (right, m)) = (side(&bins[..s]), side(&bins[s..]));
            (n.min(m) * 6 >= order.len()).then_some((left + right, s))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let split = match best {
        Some((_, s)) => {
            order.sort_by_key(|&k| (bin(k) >= s, k));
            order.partition_point(|&k| bin(k) < s)
        }
        None => {
            order.sort_by(|&a, &b| centre(a)[axis].total_cmp(&centre(b)[axis]).then(a.cmp(&b)));
            order.len() / 2
        }
    };
    let (left, right) = order.split_at_mut(split);
    build(boxes, left, start, nodes);
    nodes[at].first = nodes.len() as u32;
    nodes[at].count = 0;
    build(boxes, right, start + split as u32, nodes);
}
