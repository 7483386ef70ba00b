//! A splat by its moments: mass, mean, covariance, mean colour.

use glam::{DMat3, DQuat, DVec3};

use crate::scene::{Gaussians, SH_GROUP_FLOATS, principal};

/// Floats of a splat's spherical harmonics.
pub(super) const SH: usize = 48;
/// Largest opacity of a merged splat.
pub(super) const MOST_OPACITY: f64 = 0.999;
/// Least opacity of a merged splat: smaller ones have no logit in f32.
const LEAST_OPACITY: f64 = 1e-6;
/// Least ratio of the shortest axis to the longest one. Shorter axes are lost in the rounding of f64.
const THINNEST: f64 = 1e-6;

/// A symmetric matrix: xx, xy, xz, yy, yz, zz.
pub(super) type Symmetric = [f64; 6];

/// A splat, or the union of several: moments of a union are sums over its splats.
#[derive(Clone, Debug)]
pub(super) struct Blob {
    /// Opacity times projected area.
    pub(super) mass: f64,
    pub(super) mean: DVec3,
    pub(super) covariance: Symmetric,
    /// Mean squared distance from the mean over which mass was moved.
    pub(super) spread: f64,
    /// What merging has cost so far.
    pub(super) cost: f64,
    /// Mean spherical harmonics, weighted by mass.
    pub(super) sh: [f32; SH],
}

/// Projected area of an ellipsoid, in the mean over all directions, relative to a disc of half axes 1 and 1: the root
/// of the covariance's second invariant. That is exact for discs, 13 % too small for balls and 10 % for rods.
pub(super) fn area(c: &Symmetric) -> f64 {
    let [xx, xy, xz, yy, yz, zz] = *c;
    (xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz).max(0.0).sqrt().max(f64::MIN_POSITIVE)
}

/// The covariance of a splat of this mass. Where the mass is more than the shape has room for, the shape is widened: a
/// splat cannot be more than opaque, and cut mass would leave holes.
pub(super) fn with_room(covariance: Symmetric, mass: f64) -> Symmetric {
    let wider = (mass / (MOST_OPACITY * area(&covariance))).max(1.0);
    if wider.is_finite() { covariance.map(|v| v * wider) } else { covariance }
}

/// Three numbers of a splat.
fn three(plane: &[f32], i: usize) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|k| f64::from(plane[3 * i + k])))
}

/// The covariance of a splat of a model.
pub(super) fn covariance(g: &Gaussians, i: usize) -> Symmetric {
    let [w, x, y, z] = std::array::from_fn(|k| f64::from(g.quats[4 * i + k]));
    let turn = DQuat::from_xyzw(x, y, z, w);
    let turn = if turn.length_squared() > 1e-24 { turn.normalize() } else { DQuat::IDENTITY };
    let axes = DMat3::from_quat(turn) * DMat3::from_diagonal(three(&g.scales, i).exp());
    let c = axes * axes.transpose();
    [c.x_axis.x, c.x_axis.y, c.x_axis.z, c.y_axis.y, c.y_axis.z, c.z_axis.z]
}

impl Blob {
    /// A splat of a model.
    pub(super) fn of(g: &Gaussians, i: usize) -> Self {
        let covariance = covariance(g, i);
        let opacity = 1.0 / (1.0 + (-f64::from(g.opacities[i])).exp());
        let sh = std::array::from_fn(|k| g.sh[k / SH_GROUP_FLOATS][SH_GROUP_FLOATS * i + k % SH_GROUP_FLOATS]);
        Self { mass: opacity * area(&covariance), mean: three(&g.means, i), covariance, spread: 0.0, cost: 0.0, sh }
    }

    /// The opacity with which a splat of this shape has the mass.
    pub(super) fn opacity(&self) -> f64 {
        (self.mass / area(&self.covariance)).clamp(LEAST_OPACITY, MOST_OPACITY)
    }

    /// Shares of two masses.
    pub(super) fn shares(&self, other: &Self) -> [f64; 2] {
        let sum = self.mass + other.mass;
        if sum > 0.0 { [self.mass / sum, other.mass / sum] } else { [0.5; 2] }
    }

    /// The covariance of both: the mean of the covariances and the covariance of the means.
    pub(super) fn joined(&self, other: &Self) -> Symmetric {
        let [p, q] = self.shares(other);
        let d = other.mean - self.mean;
        let between = [d.x * d.x, d.x * d.y, d.x * d.z, d.y * d.y, d.y * d.z, d.z * d.z];
        std::array::from_fn(|k| p * self.covariance[k] + q * other.covariance[k] + p * q * between[k])
    }

    /// Both as one.
    pub(super) fn merged(&self, other: &Self, cost: f64) -> Self {
        let [p, q] = self.shares(other);
        Self {
            mass: self.mass + other.mass,
            mean: p * self.mean + q * other.mean,
            covariance: self.joined(other),
            spread: p * self.spread + q * other.spread + p * q * self.mean.distance_squared(other.mean),
            cost,
            sh: std::array::from_fn(|k| (p * f64::from(self.sh[k]) + q * f64::from(other.sh[k])) as f32),
        }
    }

    /// Writes the splat into a row.
    pub(super) fn store(&self, g: &mut Gaussians, i: usize) {
        let covariance = with_room(self.covariance, self.mass);
        let [xx, xy, xz, yy, yz, zz] = covariance;
        let (values, axes) = principal(DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]));
        let longest = values.iter().fold(f64::MIN_POSITIVE, |most, v| most.max(*v));
        let least = longest * THINNEST * THINNEST;
        let [x, y, z] = [axes.x_axis, axes.y_axis, axes.z_axis];
        let turn = DQuat::from_mat3(&DMat3::from_cols(x, y, if axes.determinant() < 0.0 { -z } else { z }));
        let turn = turn.normalize();
        let opacity = (self.mass / area(&covariance)).clamp(LEAST_OPACITY, MOST_OPACITY);
        g.means[3 * i..3 * i + 3].copy_from_slice(&self.mean.as_vec3().to_array());
        g.scales[3 * i..3 * i + 3].copy_from_slice(&values.map(|value| (0.5 * value.max(least).ln()) as f32));
        g.quats[4 * i..4 * i + 4].copy_from_slice(&[turn.w, turn.x, turn.y, turn.z].map(|v| v as f32));
        g.opacities[i] = (opacity / (1.0 - opacity)).ln() as f32;
        for (k, value) in self.sh.iter().enumerate() {
            g.sh[k / SH_GROUP_FLOATS][SH_GROUP_FLOATS * i + k % SH_GROUP_FLOATS] = *value;
        }
    }
}
