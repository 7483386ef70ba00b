//! Twins of `glsl/geometry_depth.comp` and `glsl/geometry_grad.comp`, and the loss by its definition.

use super::loss::{counting, unpack};
use super::place::{ByteMask, MapPosition};
use super::{Real, TwinCall, vec3};
use crate::pass::geometry::{PIXELS, Push, parts};

const OPAQUE: f64 = 0.9;
const PRIOR_JUMP: f64 = 0.1;
const NORMAL_LEAST: f64 = 0.1;
/// Luma weights of the channels (Rec. 709).
pub const LUMA: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// The inputs of the geometry loss.
#[derive(Clone, Debug)]
pub struct Scene<'a, R> {
    /// Sizes, weights and shapes.
    pub push: Push,
    /// The kind of edge weight: see [`crate::pass::geometry::GRAD`].
    pub edges: u32,
    /// (r, g, b, T) per pixel.
    pub image: Vec<[R; 4]>,
    /// (sum w z, sum w n) per pixel.
    pub aux: Vec<[R; 4]>,
    /// The photograph.
    pub photo: Vec<[R; 3]>,
    /// Whether each pixel counts: those that are not masked.
    pub counts: Vec<bool>,
    /// The prior, packed by [`crate::pass::geometry::pack_prior`].
    pub prior: &'a [[u32; 2]],
    /// The mask of pixels to leave out, where there is one.
    pub mask: Option<ByteMask<'a>>,
}

/// Brightness of a colour.
pub fn luma<R: Real>(colour: [R; 3]) -> R {
    vec3::dot(colour, LUMA.map(R::of))
}

/// Whether a value is a valid depth.
fn is_depth<R: Real>(x: R) -> bool {
    x >= R::of(1e-10) && x <= R::of(1e10)
}

/// The unit normal of the second word of a prior.
pub fn prior_normal<R: Real>(word: u32) -> Option<[R; 3]> {
    if word & 0xff_ffff == 0 {
        return None;
    }
    let one = R::one();
    let [u, v] = [word & 0xfff, word >> 12 & 0xfff].map(|code| R::of(f64::from(code)) / R::of(2047.0) - one);
    let z = one - u.abs() - v.abs();
    let side = |v: R| if v >= R::zero() { one } else { -one };
    let folded = if z >= R::zero() { [u, v] } else { [(one - v.abs()) * side(u), (one - u.abs()) * side(v)] };
    let normal = [folded[0], folded[1], z];
    Some(vec3::scale(one / vec3::dot(normal, normal).sqrt(), normal))
}

impl<R: Real> Scene<'_, R> {
    fn size(&self) -> [usize; 2] {
        [self.push.width as usize, self.push.height as usize]
    }

    fn at(&self, k: usize) -> [usize; 2] {
        [k % self.size()[0], k / self.size()[0]]
    }

    fn number(value: f32) -> R {
        R::of(f64::from(value))
    }

    fn unit(&self) -> R {
        Self::number(self.push.median).max(R::of(1e-6))
    }

    /// |grad I| at a pixel.
    fn edge(&self, k: usize) -> R {
        let ([width, height], [x, y]) = (self.size(), self.at(k));
        let luma = |x: usize, y: usize| luma(self.photo[y * width + x]);
        let across = luma((x + 1).min(width - 1), y) - luma(x.saturating_sub(1), y);
        let down = luma(x, (y + 1).min(height - 1)) - luma(x, y.saturating_sub(1));
        R::of(0.5) * (across * across + down * down).sqrt()
    }

    /// The rendered depth at a pixel; `None` where the pixel is masked or not opaque.
    fn depth(&self, k: usize) -> Option<R> {
        let opacity = R::one() - self.image[k][3];
        let depth = self.aux[k][0] / opacity.max(R::of(1e-3));
        (self.counts[k] && opacity > R::of(OPAQUE) && is_depth(depth)).then_some(depth)
    }

    fn prior_place(&self, k: usize) -> MapPosition<R> {
        MapPosition::of(self.at(k), self.size(), [self.push.prior_width as usize, self.push.prior_height as usize])
    }

    fn prior_at(&self, [x, y]: [usize; 2]) -> (R, u32) {
        let [depth, word] = self.prior[y * self.push.prior_width as usize + x];
        (Self::number(f32::from_bits(depth)), word)
    }

    /// Confidence of the prior at a pixel.
    fn confidence(&self, k: usize) -> R {
        let (_, word) = self.prior_at(self.prior_place(k).nearest);
        R::of(f64::from(word >> 24)) / R::of(255.0)
    }

    /// Depth of a trusted prior at a pixel.
    fn prior_depth(&self, k: usize) -> Option<R> {
        let place = self.prior_place(k);
        let nearest = self.prior_at(place.nearest).0;
        if !is_depth(nearest) || self.confidence(k) <= R::zero() {
            return None;
        }
        let inverse = place.between(|at| {
            let depth = self.prior_at(at).0;
            let same = is_depth(depth) && (depth - nearest).abs() <= R::of(PRIOR_JUMP) * nearest;
            R::one() / if same { depth } else { nearest }
        });
        Some(R::one() / inverse)
    }

    /// Direction and length of the blended normal, and the normal of a trusted prior; `None` where either is missing.
    fn normals(&self, k: usize) -> Option<([R; 3], R, [R; 3])> {
        let [_, x, y, z] = self.aux[k];
        let size = vec3::dot([x, y, z], [x, y, z]).sqrt();
        let wanted = prior_normal(self.prior_at(self.prior_place(k).nearest).1)?;
        let usable = self.aux[k].iter().all(|v| v.is_finite()) && size > R::of(NORMAL_LEAST);
        (usable && self.confidence(k) > R::zero()).then(|| (vec3::scale(R::one() / size, [x, y, z]), size, wanted))
    }

    /// 1 - M.
    fn kept(&self, k: usize) -> R {
        let mask = self.mask.map_or(R::zero(), |mask| mask.at(self.at(k), self.size()));
        if self.counts[k] { R::one() - mask } else { R::zero() }
    }

    fn edge_weight(&self, edge: R, mean: R) -> R {
        let strength = Self::number(self.push.edge);
        match self.edges {
            0 => R::one() + strength * edge / (edge + mean).max(R::of(1e-12)),
            _ => (-strength * edge).exp(),
        }
    }

    /// `geometry_depth`: a row of the map, and the pixel's contribution to the totals.
    pub fn depth_row(&self, k: usize) -> ([R; 4], [R; 4]) {
        let edge = if self.counts[k] { self.edge(k) } else { R::zero() };
        let depth = self.depth(k);
        let wanted = depth.and_then(|_| self.prior_depth(k));
        let normals = depth.and_then(|_| self.normals(k));
        let flag = |set: bool| if set { R::one() } else { R::zero() };
        let row = [depth.map_or(R::zero(), |d| d / self.unit()), edge, self.kept(k), wanted.unwrap_or(R::zero())];
        (row, [flag(depth.is_some()), flag(wanted.is_some()), flag(normals.is_some()), edge])
    }

    /// `geometry_grad`: the pixel's part of the loss, dL/dT and dL/d(auxiliary image).
    pub fn grad_row(&self, map: &[[R; 4]], totals: &[R; 4], k: usize) -> ([R; 4], R, [R; 4]) {
        let (o, two) = (R::zero(), R::of(2.0));
        let mut part = [o; 4];
        if map[k][0] <= o {
            return (part, o, [o; 4]);
        }
        let mean = totals[3] / Self::number(self.push.pixels).max(R::one());
        let each = |weight: f32, k: usize| Self::number(weight) / totals[k].max(R::one());
        let ([width, height], [x, y]) = (self.size(), self.at(k));
        let smooth = each(self.push.smooth_weight, 0);
        let mut of_depth = o;
        for (place, length, stride) in [(x, width, 1), (y, height, width)] {
            let at = |step: isize| {
                let inside = place.checked_add_signed(step).is_some_and(|p| p < length);
                if inside { map[k.wrapping_add_signed(step * stride as isize)] } else { [o; 4] }
            };
            let second = |step: isize| {
                let [a, b, c] = [-1, 0, 1].map(|s| at(step + s)[0]);
                if a > o && b > o && c > o { a - two * b + c } else { o }
            };
            let weighted = |step: isize| {
                let [_, edge, kept, _] = at(step);
                (-Self::number(self.push.edge_stop) * edge).exp() * kept * second(step)
            };
            part[1] += smooth * weighted(0) * second(0);
            of_depth += smooth * two * (weighted(-1) - two * weighted(0) + weighted(1)) / self.unit();
        }
        let depth = map[k][0] * self.unit();
        let trust = self.confidence(k) * map[k][2];
        let wanted = map[k][3];
        if wanted > o {
            let (residual, huber) = ((depth - wanted) / wanted, Self::number(self.push.huber));
            let held = residual.max(-huber).min(huber);
            let weight = each(self.push.depth_weight, 1) * self.edge_weight(map[k][1], mean) * trust;
            part[0] = weight * held * (residual - R::of(0.5) * held);
            of_depth += weight * held / wanted;
        }
        let opacity = R::one() - self.image[k][3];
        let mut of_aux = [of_depth / opacity, o, o, o];
        if let Some((normal, size, wanted)) = self.normals(k).filter(|_| trust > o) {
            let (cosine, l1) = (Self::number(self.push.cosine_weight), Self::number(self.push.l1_weight));
            let weight = each(1.0, 2) * trust;
            let off = vec3::add(normal, vec3::scale(-R::one(), wanted));
            let apart = off.iter().fold(o, |sum, v| sum + v.abs());
            part[2] = weight * (cosine * (R::one() - vec3::dot(normal, wanted)) + l1 * apart);
            let sign = |v: R| if v == o { o } else { v.signum() };
            let g: [R; 3] = std::array::from_fn(|c| weight * (l1 * sign(off[c]) - cosine * wanted[c]));
            let along = vec3::dot(normal, g);
            (0..3).for_each(|c| of_aux[1 + c] = (g[c] - normal[c] * along) / size);
        }
        part[3] = part[0] + part[1] + part[2];
        (part, of_depth * depth / opacity, of_aux)
    }

    /// The weighted depth, smoothness and normal terms by their definitions.
    pub fn value(&self) -> [R; 3] {
        let ([width, height], push, two) = (self.size(), &self.push, R::of(2.0));
        let pixels = width * height;
        let counted = self.counts.iter().filter(|c| **c).count().max(1);
        let edges = (0..pixels).filter(|k| self.counts[*k]).fold(R::zero(), |sum, k| sum + self.edge(k));
        let mean_edge = edges / R::of(counted as f64);
        let depths: Vec<Option<R>> = (0..pixels).map(|k| self.depth(k)).collect();
        let mean = |weight: f32, terms: Vec<R>| {
            let count = R::of(terms.len().max(1) as f64);
            Self::number(weight) * terms.into_iter().fold(R::zero(), |sum, v| sum + v) / count
        };
        let huber = Self::number(push.huber);
        let data = |k: usize| {
            let (depth, wanted) = (depths[k]?, self.prior_depth(k)?);
            let r = ((depth - wanted) / wanted).abs();
            let loss = if r <= huber { r * r / two } else { huber * (r - huber / two) };
            Some(loss * self.edge_weight(self.edge(k), mean_edge) * self.confidence(k) * self.kept(k))
        };
        let smooth = |k: usize| {
            let here = depths[k]?;
            let [x, y] = self.at(k);
            let second = |inside: bool, stride: usize| {
                let sides = inside.then(|| Some(depths[k - stride]? + depths[k + stride]?)).flatten();
                sides.map_or(R::zero(), |sides| ((sides - two * here) / self.unit()).powi(2))
            };
            let sum = second(x > 0 && x + 1 < width, 1) + second(y > 0 && y + 1 < height, width);
            Some(sum * (-Self::number(push.edge_stop) * self.edge(k)).exp() * self.kept(k))
        };
        let normal = |k: usize| {
            let _ = depths[k]?;
            let (normal, _, wanted) = self.normals(k)?;
            let apart = (0..3).fold(R::zero(), |sum, c| sum + (normal[c] - wanted[c]).abs());
            let (cosine, l1) = (Self::number(push.cosine_weight), Self::number(push.l1_weight));
            let loss = cosine * (R::one() - vec3::dot(normal, wanted)) + l1 * apart;
            Some(loss * self.confidence(k) * self.kept(k))
        };
        [
            mean(push.depth_weight, (0..pixels).filter_map(data).collect()),
            mean(push.smooth_weight, (0..pixels).filter_map(smooth).collect()),
            mean(1.0, (0..pixels).filter_map(normal).collect()),
        ]
    }
}

/// The part, one per thread, that pixel `k` is added to.
fn part_of(k: usize) -> usize {
    64 * (k / PIXELS as usize) + k % 64
}

fn pixels(call: &TwinCall<'_>, push: &Push) -> usize {
    (push.width * push.height).min(call.groups * PIXELS) as usize
}

fn add(parts: &mut [[f32; 4]], k: usize, row: [f32; 4]) {
    parts[part_of(k)].iter_mut().zip(row).for_each(|(sum, v)| *sum += v);
}

/// The parts of a dispatch, all zero.
fn no_parts(call: &TwinCall<'_>, push: &Push) -> Vec<[f32; 4]> {
    vec![[0.0; 4]; parts(push.width, push.height).min(64 * call.groups) as usize]
}

/// Adapter over raw buffers.
pub fn run_depth(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let (target, bits) = (call.get::<u32>(2), call.constants[1]);
    let prior = call.get::<[u32; 2]>(3);
    let bytes = call.get::<u8>(4);
    let mask = ByteMask { bytes: &bytes, size: [push.mask_width as usize, push.mask_height as usize] };
    let scene = Scene::<f32> {
        push,
        edges: 0,
        image: call.get(0),
        aux: call.get(1),
        photo: unpack(&target, bits),
        counts: counting(&target, bits),
        prior: &prior,
        mask: (call.constants[0] != 0).then_some(mask),
    };
    let (mut map, mut parts) = (call.get::<[f32; 4]>(5), no_parts(call, &push));
    for (k, entry) in map.iter_mut().enumerate().take(pixels(call, &push)) {
        let (row, counted) = scene.depth_row(k);
        *entry = row;
        add(&mut parts, k, counted);
    }
    call.set(5, &map);
    call.set(6, &parts);
}

/// Adapter over raw buffers.
pub fn run_grad(call: &mut TwinCall<'_>) {
    let push: Push = call.push();
    let prior = call.get::<[u32; 2]>(2);
    let scene = Scene::<f32> {
        push,
        edges: call.constants[0],
        image: call.get(0),
        aux: call.get(1),
        photo: Vec::new(),
        counts: Vec::new(),
        prior: &prior,
        mask: None,
    };
    let map = call.get::<[f32; 4]>(3);
    let totals = call.get::<[f32; 4]>(4)[0];
    let (mut of_image, mut of_aux) = (call.get::<[f32; 4]>(5), call.get::<[f32; 4]>(6));
    let mut parts = no_parts(call, &push);
    for k in 0..pixels(call, &push) {
        let (part, of_transmittance, aux) = scene.grad_row(&map, &totals, k);
        of_image[k][3] += of_transmittance;
        of_aux[k] = aux;
        add(&mut parts, k, part);
    }
    call.set(5, &of_image);
    call.set(6, &of_aux);
    call.set(7, &parts);
}
