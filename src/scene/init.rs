//! The first Gaussians of a training, from points.

use std::num::NonZero;
use std::ops::Range;

use glam::{Quat, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::{Frame, Gaussians, SH_GROUP_FLOATS};

/// The constant Y_0 of the spherical harmonics, as the 3DGS reference rounds it.
pub const SH_C0: f64 = 0.282_094_791_773_878_14;
/// Opacity of every first Gaussian.
pub const FIRST_OPACITY: f64 = 0.1;
/// Smallest mean squared distance to neighbours, in squared scene units: the value of the 3DGS reference, which applies
/// it in dataset units. The two units agree for the reference's own scenes, whose extents are about 5. The value
/// matters only for points that coincide.
pub const MIN_SQUARED_DISTANCE: f64 = 1e-7;
/// Standard deviation of a point without neighbours, in scene units: a hundredth of the extent.
pub const LONELY_SCALE: f64 = Frame::EXTENT / 100.0;

const NEIGHBOURS: usize = 3;

/// Points that cannot become the first Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InitError {
    /// No points.
    #[error(
        "the model has no points to start from: triangulate them (COLMAP's point_triangulator writes points3D), \
         or give a model (PLY) as `init`"
    )]
    NoPoints,
    /// More points than 32-bit ids can number.
    #[error("{0} points are more than 32-bit ids can number: thin the points out")]
    TooManyPoints(usize),
}

/// One isotropic Gaussian per point, `points` being (position in dataset coordinates, 8-bit colour): the constant
/// spherical harmonic shows the colour, the opacity is 0.1, and the standard deviation is the root of the mean of the
/// squared distances to the three nearest other points (3DGS reference), or to as many as there are.
pub fn from_points(points: &[([f64; 3], [u8; 3])], frame: &Frame) -> Result<Gaussians, InitError> {
    if points.is_empty() {
        return Err(InitError::NoPoints);
    }
    if u32::try_from(points.len()).is_err() {
        return Err(InitError::TooManyPoints(points.len()));
    }
    let positions: Vec<[f64; 3]> = points.iter().map(|(p, _)| frame.to_scene(*p)).collect();
    let mut out = Gaussians::zeros(points.len());
    make_opaque(&mut out, 0, FIRST_OPACITY);
    out.quats.chunks_exact_mut(4).for_each(|q| q[0] = 1.0);
    paint(&mut out, &points.iter().map(|(_, colour)| *colour).collect::<Vec<_>>());
    for (i, position) in positions.iter().enumerate() {
        out.means[3 * i..3 * i + 3].copy_from_slice(&position.map(|v| v as f32));
    }
    for (scale, ln) in out.scales.chunks_exact_mut(3).zip(log_scales(&positions)) {
        scale.fill(ln as f32);
    }
    Ok(out)
}

/// Gives the first Gaussians the 8-bit `colours`, one per Gaussian.
pub fn paint(gaussians: &mut Gaussians, colours: &[[u8; 3]]) {
    for (sh, colour) in gaussians.sh[0].chunks_exact_mut(SH_GROUP_FLOATS).zip(colours) {
        for (coefficient, channel) in sh.iter_mut().zip(colour) {
            *coefficient = ((f64::from(*channel) / 255.0 - 0.5) / SH_C0) as f32;
        }
    }
}

/// Flattens the Gaussians from `first` on onto surfaces with the given unit normals (scene frame, either sign, one per
/// Gaussian): the third axis points along the normal, and its standard deviation is multiplied by `thickness`.
pub fn lay_flat(gaussians: &mut Gaussians, first: usize, normals: &[[f32; 3]], thickness: f64) {
    let quats = gaussians.quats.chunks_exact_mut(4).skip(first);
    let scales = gaussians.scales.chunks_exact_mut(3).skip(first);
    for ((quat, scale), &[x, y, z]) in quats.zip(scales).zip(normals) {
        // Half way from the third axis to the normal, whose sign makes the angle between them at most a right angle.
        let sign = if z < 0.0 { -1.0 } else { 1.0 };
        let half = [1.0 + z * sign, -y * sign, x * sign];
        let length = half.iter().map(|h| h * h).sum::<f32>().sqrt();
        quat.copy_from_slice(&[half[0] / length, half[1] / length, half[2] / length, 0.0]);
        scale[2] += thickness.ln() as f32;
    }
}

/// Makes flat Gaussians from `first` on long in a direction: each is turned about its third axis until the first axis
/// has the unit direction given for it (scene frame, across the third axis), and the second is `ratio` times as wide as
/// the first. The product of both widths stays.
pub fn stretch(gaussians: &mut Gaussians, first: usize, along: &[([f32; 3], f64)]) {
    let quats = gaussians.quats.chunks_exact_mut(4).skip(first);
    let scales = gaussians.scales.chunks_exact_mut(3).skip(first);
    for ((quat, scale), (direction, ratio)) in quats.zip(scales).zip(along) {
        let now = Quat::from_xyzw(quat[1], quat[2], quat[3], quat[0]);
        let direction = Vec3::from_array(*direction);
        let angle = direction.dot(now * Vec3::Y).atan2(direction.dot(now * Vec3::X));
        let turned = (now * Quat::from_rotation_z(angle)).normalize();
        quat.copy_from_slice(&[turned.w, turned.x, turned.y, turned.z]);
        let half = (0.5 * ratio.ln()) as f32;
        scale[0] -= half;
        scale[1] += half;
    }
}

/// Multiplies the standard deviations of the Gaussians in `range` by a positive number.
pub fn widen(gaussians: &mut Gaussians, range: Range<usize>, times: f64) {
    let scales = gaussians.scales.iter_mut().take(3 * range.end).skip(3 * range.start);
    scales.for_each(|s| *s += times.ln() as f32);
}

/// Gives the Gaussians from `first` on an opacity between 0 and 1.
pub fn make_opaque(gaussians: &mut Gaussians, first: usize, opacity: f64) {
    let logit = (opacity / (1.0 - opacity)).ln() as f32;
    gaussians.opacities.iter_mut().skip(first).for_each(|o| *o = logit);
}

fn log_scales(positions: &[[f64; 3]]) -> Vec<f64> {
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(positions);
    let wanted = NonZero::new(NEIGHBOURS + 1).unwrap_or(NonZero::<usize>::MIN);
    let one = |(i, position): (usize, &[f64; 3])| {
        // The point itself is among the nearest unless more than three others coincide with it, and then the first
        // three found are as good as any.
        let squared: Vec<f64> = tree
            .nearest_n::<SquaredEuclidean>(position, wanted)
            .iter()
            .filter(|found| found.item != i as u64)
            .take(NEIGHBOURS)
            .map(|found| found.distance)
            .collect();
        if squared.is_empty() {
            return LONELY_SCALE.ln();
        }
        let mean = squared.iter().sum::<f64>() / squared.len() as f64;
        mean.max(MIN_SQUARED_DISTANCE).sqrt().ln()
    };
    positions.par_iter().enumerate().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random_points(n: usize) -> Vec<([f64; 3], [u8; 3])> {
        let mut state = 1_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / f64::from(1 << 24)
        };
        (0..n).map(|_| ([next(), next() * 4.0, next() * 0.1], [(next() * 255.0) as u8, 0, 255])).collect()
    }

    /// Standard deviation of point `i` from the sorted distances to all others.
    fn brute_force(points: &[([f64; 3], [u8; 3])], frame: &Frame, i: usize) -> f64 {
        let here = frame.to_scene(points[i].0);
        let mut squared: Vec<f64> = (0..points.len())
            .filter(|j| *j != i)
            .map(|j| frame.to_scene(points[j].0).iter().zip(here).map(|(a, b)| (a - b) * (a - b)).sum())
            .collect();
        squared.sort_by(f64::total_cmp);
        squared.truncate(3);
        (squared.iter().sum::<f64>() / squared.len() as f64).max(1e-7).sqrt()
    }

    #[test]
    fn scales_are_those_of_three_neighbours_by_brute_force() {
        let frame = Frame { offset: [0.5, 2.0, 0.0], scale: 1.75 };
        for n in [2, 3, 4, 5, 33, 1000] {
            let points = random_points(n);
            let out = from_points(&points, &frame).expect("points");
            assert_eq!(out.len(), n);
            for i in 0..n {
                let want = brute_force(&points, &frame, i);
                for scale in &out.scales[3 * i..3 * i + 3] {
                    assert!((f64::from(*scale).exp() / want - 1.0).abs() < 1e-6, "{n} points, point {i}");
                }
            }
        }
    }

    #[test]
    fn colour_opacity_and_rotation_are_the_reference_s() {
        let frame = Frame { offset: [1.0, 2.0, 3.0], scale: 0.5 };
        let points = [([1.0, 2.0, 3.0], [255, 0, 128]), ([3.0, 2.0, 3.0], [1, 2, 3])];
        let out = from_points(&points, &frame).expect("points");
        assert_eq!(out.means, [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
        let shown: Vec<f64> = out.sh[0][..3].iter().map(|f| 0.5 + SH_C0 * f64::from(*f)).collect();
        for (got, want) in shown.iter().zip([1.0, 0.0, 128.0 / 255.0]) {
            assert!((got - want).abs() < 1e-7);
        }
        assert!(out.sh[0][3..12].iter().chain(&out.sh[1]).chain(&out.sh[2]).chain(&out.sh[3]).all(|f| *f == 0.0));
        assert!((f64::from(out.opacities[0]) + 2.197_224_577_336_219).abs() < 1e-6);
        assert_eq!(out.quats[..4], [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(out.scales[0], 0.0, "the only neighbour is at distance 1");
    }

    #[test]
    fn flat_ones_lie_across_their_normals() {
        let frame = Frame::IDENTITY;
        let mut out = from_points(&random_points(8), &frame).expect("points");
        let round = out.clone();
        let third = 1.0 / 3.0_f32.sqrt();
        let normals = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [third, -third, -third]];
        lay_flat(&mut out, 3, &normals, 0.25);
        assert_eq!((&out.quats[..12], &out.scales[..9]), (&round.quats[..12], &round.scales[..9]));
        for (k, normal) in normals.iter().enumerate() {
            let q = &out.quats[4 * (3 + k)..][..4];
            let turned = Quat::from_xyzw(q[1], q[2], q[3], q[0]) * Vec3::Z;
            let along = turned.dot(Vec3::from_array(*normal)).abs();
            assert!((along - 1.0).abs() < 1e-6, "{normal:?}: {turned}");
            let (now, before) = (&out.scales[3 * (3 + k)..][..3], &round.scales[3 * (3 + k)..][..3]);
            assert_eq!(now[..2], before[..2]);
            assert!((now[2] - before[2] - 0.25_f32.ln()).abs() < 1e-6);
        }
    }

    #[test]
    fn stretched_ones_are_long_in_their_direction() {
        let mut out = from_points(&random_points(4), &Frame::IDENTITY).expect("points");
        let third = 1.0 / 3.0_f32.sqrt();
        let normals = [[0.0, 0.0, -1.0], [third, -third, -third], [0.0, 1.0, 0.0]];
        lay_flat(&mut out, 1, &normals, 0.25);
        let flat = out.clone();
        let half = 0.5_f32.sqrt();
        let along = [([0.6, -0.8, 0.0], 0.5), ([half, half, 0.0], 1.0 / 3.0), ([-1.0, 0.0, 0.0], 1.0)];
        stretch(&mut out, 1, &along);
        assert_eq!((&out.quats[..4], &out.scales[..3]), (&flat.quats[..4], &flat.scales[..3]));
        for (k, ((direction, ratio), normal)) in along.iter().zip(normals).enumerate() {
            let q = &out.quats[4 * (1 + k)..][..4];
            let turned = Quat::from_xyzw(q[1], q[2], q[3], q[0]);
            assert!((turned * Vec3::X).dot(Vec3::from_array(*direction)) > 1.0 - 1e-5, "{k}: {turned}");
            assert!((turned * Vec3::Z).dot(Vec3::from_array(normal)).abs() > 1.0 - 1e-5, "{k}: {turned}");
            let (now, before) = (&out.scales[3 * (1 + k)..][..3], &flat.scales[3 * (1 + k)..][..3]);
            assert!((now[0] + now[1] - before[0] - before[1]).abs() < 1e-5 && now[2] == before[2]);
            assert!((f64::from(now[1] - now[0]).exp() - ratio).abs() < 1e-5);
        }
    }

    #[test]
    fn only_those_from_the_first_on_are_made_opaque_and_narrower() {
        let mut out = from_points(&random_points(8), &Frame::IDENTITY).expect("points");
        let before = out.clone();
        make_opaque(&mut out, 3, 0.75);
        widen(&mut out, 3..7, 0.5);
        assert_eq!((&out.scales[..9], &out.scales[21..]), (&before.scales[..9], &before.scales[21..]));
        let narrower = |(now, then): (&f32, &f32)| (now - then - 0.5_f32.ln()).abs() < 1e-6;
        assert!(out.scales[9..21].iter().zip(&before.scales[9..21]).all(narrower));
        let opacity = |logit: f32| 1.0 / (1.0 + (-f64::from(logit)).exp());
        let all: Vec<f64> = out.opacities.iter().map(|o| opacity(*o)).collect();
        assert!(all[..3].iter().all(|o| (o - FIRST_OPACITY).abs() < 1e-7), "{all:?}");
        assert!(all[3..].iter().all(|o| (o - 0.75).abs() < 1e-7), "{all:?}");
    }

    #[test]
    fn coinciding_points_have_the_floor() {
        let mut points = vec![([0.0; 3], [0; 3]); 50];
        points.extend(vec![([1.0, 0.0, 0.0], [0; 3]); 2]);
        let out = from_points(&points, &Frame::IDENTITY).expect("points");
        let floor = (0.5 * 1e-7_f64.ln()) as f32;
        assert!(out.scales[..150].iter().all(|s| *s == floor));
        // Of two that coincide: distances 0, 1 and 1.
        assert!((f64::from(out.scales[150]) - 0.5 * (2.0_f64 / 3.0).ln()).abs() < 1e-6);
    }

    #[test]
    fn one_point_has_a_size_and_none_is_an_error() {
        let one = from_points(&[([7.0; 3], [9; 3])], &Frame::IDENTITY).expect("a point");
        assert_eq!(one.scales, [0.05_f64.ln() as f32; 3]);
        let error = from_points(&[], &Frame::IDENTITY).expect_err("nothing");
        assert_eq!(error, InitError::NoPoints);
        assert!(error.to_string().contains("`init`"));
    }
}
