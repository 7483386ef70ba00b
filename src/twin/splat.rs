//! One splat's parameters and one camera, in any precision, for the projection's twins.

use half::f16;

use super::{Real, TwinCall};
use crate::pass::camera::{ANTIALIAS, BLACK_LEARNS, CameraPush, Projection, REFERENCE_CLAMP, limits};
use crate::scene::{Camera, Gaussians, SH_GROUP_FLOATS, SH_GROUPS};

/// Parameters of one splat: 3 + 4 + 3 + 1 + 48 = 59 numbers.
pub const PARAMETERS: usize = 59;

/// The 59 parameters of one splat.
#[derive(Clone, Debug, PartialEq)]
pub struct Splat<R> {
    /// Centre, scene units.
    pub mean: [R; 3],
    /// Rotation, w first, of any length.
    pub quat: [R; 4],
    /// Natural logarithms of the standard deviations.
    pub log_scale: [R; 3],
    /// Logit of the opacity.
    pub logit: R,
    /// Spherical harmonics: 16 coefficients of (r, g, b).
    pub sh: [[R; 3]; 16],
}

impl<R: Real> Splat<R> {
    /// The parameters in the order of the planes: mean 3, quat 4, log scale 3, logit 1, SH 48 (coefficient-major).
    pub fn to_array(&self) -> [R; PARAMETERS] {
        let mut out = [R::zero(); PARAMETERS];
        out[..3].copy_from_slice(&self.mean);
        out[3..7].copy_from_slice(&self.quat);
        out[7..10].copy_from_slice(&self.log_scale);
        out[10] = self.logit;
        out[11..].copy_from_slice(self.sh.as_flattened());
        out
    }

    /// The inverse of [`Splat::to_array`].
    pub fn from_array(values: &[R; PARAMETERS]) -> Self {
        let at = |i: usize| values[i];
        Self {
            mean: std::array::from_fn(at),
            quat: std::array::from_fn(|k| at(3 + k)),
            log_scale: std::array::from_fn(|k| at(7 + k)),
            logit: at(10),
            sh: std::array::from_fn(|j| std::array::from_fn(|c| at(11 + 3 * j + c))),
        }
    }

    /// Splat `i` of a model.
    pub fn of(model: &Gaussians, i: usize) -> Self {
        let r = R::of_single;
        Self {
            mean: std::array::from_fn(|k| r(model.means[3 * i + k])),
            quat: std::array::from_fn(|k| r(model.quats[4 * i + k])),
            log_scale: std::array::from_fn(|k| r(model.scales[3 * i + k])),
            logit: r(model.opacities[i]),
            sh: std::array::from_fn(|j| {
                std::array::from_fn(|c| r(model.sh[j / 4][SH_GROUP_FLOATS * i + 3 * (j % 4) + c]))
            }),
        }
    }

    /// Every splat of a model.
    pub fn all(model: &Gaussians) -> Vec<Self> {
        (0..model.len()).map(|i| Self::of(model, i)).collect()
    }

    /// Stores the values as splat `i` of a model (or of its gradients), rounded to f32.
    pub fn store(&self, model: &mut Gaussians, i: usize) {
        let f = |x: &R| x.single();
        for k in 0..3 {
            model.means[3 * i + k] = f(&self.mean[k]);
            model.scales[3 * i + k] = f(&self.log_scale[k]);
        }
        for k in 0..4 {
            model.quats[4 * i + k] = f(&self.quat[k]);
        }
        model.opacities[i] = f(&self.logit);
        for (j, rgb) in self.sh.iter().enumerate() {
            let at = SH_GROUP_FLOATS * i + 3 * (j % 4);
            for (c, value) in rgb.iter().enumerate() {
                model.sh[j / 4][at + c] = f(value);
            }
        }
    }
}

/// A camera with the settings of the projection.
#[derive(Clone, Debug)]
pub struct TwinCamera<R> {
    /// Rotation from the scene to the camera frame, row-major.
    pub rotation: [[R; 3]; 3],
    /// Translation from the scene to the camera frame.
    pub translation: [R; 3],
    /// Camera centre in the scene.
    pub center: [R; 3],
    /// Depth of the near plane.
    pub near: R,
    /// Focal lengths in pixels.
    pub focal: [R; 2],
    /// Principal point in pixels.
    pub principal: [R; 2],
    /// See [`crate::pass::camera::clamp_limits`].
    pub limits: [R; 4],
    /// Image size in pixels.
    pub size: [u32; 2],
    /// Highest degree of spherical harmonics in use.
    pub sh_degree: u32,
    /// Whether opacities carry the anti-aliasing factor.
    pub antialias: bool,
    /// See [`Projection::reference_clamp`].
    pub reference_clamp: bool,
    /// See [`Projection::black_learns`].
    pub black_learns: bool,
    /// See [`Projection::orthographic`].
    pub orthographic: bool,
}

impl<R: Real> TwinCamera<R> {
    /// The camera for a row of a model: a row that is not `full` has harmonics up to degree 1 only.
    pub fn of_row(&self, full: bool) -> Self
    where
        R: Copy,
    {
        Self { sh_degree: if full { self.sh_degree } else { self.sh_degree.min(1) }, ..*self }
    }

    /// From the push constants, with perspective.
    pub fn of(push: &CameraPush) -> Self {
        let r = |x: f32| R::of(f64::from(x));
        let rows = [push.row0, push.row1, push.row2];
        Self {
            rotation: rows.map(|row| [r(row[0]), r(row[1]), r(row[2])]),
            translation: rows.map(|row| r(row[3])),
            center: std::array::from_fn(|k| r(push.center[k])),
            near: r(push.center[3]),
            focal: [r(push.intrinsics[0]), r(push.intrinsics[1])],
            principal: [r(push.intrinsics[2]), r(push.intrinsics[3])],
            limits: push.limits.map(r),
            size: [push.width, push.height],
            sh_degree: push.sh_degree,
            antialias: push.flags & ANTIALIAS != 0,
            reference_clamp: push.flags & REFERENCE_CLAMP != 0,
            black_learns: push.flags & BLACK_LEARNS != 0,
            orthographic: false,
        }
    }

    /// From a camera, without rounding to f32 on the way.
    pub fn exact(camera: &Camera, projection: &Projection) -> Self {
        Self {
            rotation: camera.rotation.map(|row| row.map(R::of)),
            translation: camera.translation.map(R::of),
            center: camera.center().map(R::of),
            near: R::of(projection.near),
            focal: [R::of(camera.fx), R::of(camera.fy)],
            principal: [R::of(camera.cx), R::of(camera.cy)],
            limits: limits(camera, projection).map(R::of),
            size: [camera.width, camera.height],
            sh_degree: projection.sh_degree,
            antialias: projection.antialias,
            reference_clamp: projection.reference_clamp,
            black_learns: projection.black_learns,
            orthographic: projection.orthographic,
        }
    }
}

/// The first `n` splats of the model in the buffers from `first` on: means, quats, scales, opacities, sh0 to sh3.
pub(super) fn model_of(call: &TwinCall<'_>, first: usize, n: usize) -> Gaussians {
    model_with(call, first, n, |plane| call.get(plane))
}

/// As [`model_of`], with spherical harmonics in half floats.
pub(super) fn model_of_halves(call: &TwinCall<'_>, first: usize, n: usize) -> Gaussians {
    model_with(call, first, n, |plane| call.get::<u16>(plane).into_iter().map(|h| f16::from_bits(h).to_f32()).collect())
}

fn model_with(call: &TwinCall<'_>, first: usize, n: usize, sh: impl Fn(usize) -> Vec<f32>) -> Gaussians {
    let plane = |k: usize, row: usize| {
        let mut values = call.get::<f32>(first + k);
        values.truncate(n * row);
        values
    };
    debug_assert_eq!(SH_GROUPS, 4);
    Gaussians {
        means: plane(0, 3),
        quats: plane(1, 4),
        scales: plane(2, 3),
        opacities: plane(3, 1),
        sh: std::array::from_fn(|g| {
            let mut values = sh(first + 4 + g);
            // Rows that a plane does not have are never read.
            values.resize(n * SH_GROUP_FLOATS, 0.0);
            values
        }),
        ids: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Some packed words are NaNs as floats: the bits of a signalling NaN are 0x7f80_0001 to 0x7fbf_ffff.
    #[test]
    fn words_in_the_places_of_floats_keep_their_bits() {
        let word = |at: usize| f32::from_bits([0x7f80_0001, 0x7fbf_ffff, 0xff9a_3c00, 0x7fff_7fff][at % 4]);
        let plane = |row: usize| (0..2 * row).map(word).collect::<Vec<f32>>();
        let model = Gaussians {
            means: plane(3),
            quats: plane(4),
            scales: plane(3),
            opacities: plane(1),
            sh: std::array::from_fn(|_| plane(SH_GROUP_FLOATS)),
            ids: Vec::new(),
        };
        let mut after = Gaussians::zeros(2);
        for (i, splat) in Splat::<f32>::all(&model).iter().enumerate() {
            Splat::from_array(&splat.to_array()).store(&mut after, i);
        }
        let bits = |m: &Gaussians| {
            let planes = [&m.means, &m.quats, &m.scales, &m.opacities].into_iter().chain(&m.sh);
            planes.map(|plane| plane.iter().map(|v| v.to_bits()).collect()).collect::<Vec<Vec<u32>>>()
        };
        assert_eq!(bits(&after), bits(&model));
    }
}
