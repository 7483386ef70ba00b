//! Gaussians as attribute planes.

/// Spherical-harmonic coefficients come in four groups of four coefficients x RGB.
pub const SH_GROUPS: usize = 4;
/// Floats of one splat in one SH group: coefficient-major, colour fastest.
pub const SH_GROUP_FLOATS: usize = 12;

/// Square of the length below which a quaternion counts as the identity, as in the projection.
const SHORTEST_QUAT_SQUARED: f64 = 1e-24;

/// A set of 3D Gaussians, one plane per attribute, in the units in which they are optimised. On the device every plane
/// is a separate buffer: four SH buffers of 48 bytes per splat hold four times more splats within a descriptor's size
/// limit than one SH buffer would.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    /// Centres, 3 per splat, scene units.
    pub means: Vec<f32>,
    /// Rotations, 4 per splat, w first, not necessarily of unit length.
    pub quats: Vec<f32>,
    /// Natural logarithms of the standard deviations along the axes, 3 per splat.
    pub scales: Vec<f32>,
    /// Logits of the opacities, 1 per splat.
    pub opacities: Vec<f32>,
    /// Spherical harmonics up to degree 3: `sh[g][12 i + 3 j + c]` is coefficient 4 g + j of channel c of splat i.
    pub sh: [Vec<f32>; SH_GROUPS],
    /// Persistent identities, ascending in the order of birth. Of two splats at equal depth, the splat with the lower
    /// index is in front.
    pub ids: Vec<u32>,
}

impl Gaussians {
    /// Number of splats.
    pub fn len(&self) -> usize {
        self.opacities.len()
    }

    /// Whether there are no splats.
    pub fn is_empty(&self) -> bool {
        self.opacities.is_empty()
    }

    /// Rows of the splats whose values are all finite; `None` where the values of every splat are finite.
    pub fn finite_rows(&self) -> Option<Vec<u32>> {
        let row_is_finite =
            |plane: &[f32], row: usize, i: usize| plane[row * i..row * (i + 1)].iter().all(|v| v.is_finite());
        let finite = |i: usize| {
            row_is_finite(&self.means, 3, i)
                && row_is_finite(&self.quats, 4, i)
                && row_is_finite(&self.scales, 3, i)
                && row_is_finite(&self.opacities, 1, i)
                && self.sh.iter().all(|plane| row_is_finite(plane, SH_GROUP_FLOATS, i))
        };
        let rows: Vec<u32> = (0..self.len()).filter(|i| finite(*i)).map(|i| i as u32).collect();
        (rows.len() < self.len()).then_some(rows)
    }

    /// Gives every quaternion unit length, for readers of files that do not normalise. A quaternion of unit length up
    /// to rounding keeps its bits; a quaternion too short to have a direction becomes the identity.
    pub fn normalise_quats(&mut self) {
        for quat in self.quats.chunks_exact_mut(4) {
            let squared: f64 = quat.iter().map(|q| f64::from(*q) * f64::from(*q)).sum();
            if (squared - 1.0).abs() <= 4.0 * f64::from(f32::EPSILON) {
                continue;
            }
            if squared < SHORTEST_QUAT_SQUARED {
                quat.copy_from_slice(&[1.0, 0.0, 0.0, 0.0]);
            } else {
                quat.iter_mut().for_each(|q| *q = (f64::from(*q) / squared.sqrt()) as f32);
            }
        }
    }

    /// Adds splats with their identities.
    pub fn append(&mut self, other: &Self) {
        let planes = [
            (&mut self.means, &other.means),
            (&mut self.quats, &other.quats),
            (&mut self.scales, &other.scales),
            (&mut self.opacities, &other.opacities),
        ];
        planes.into_iter().chain(self.sh.iter_mut().zip(&other.sh)).for_each(|(to, from)| to.extend_from_slice(from));
        self.ids.extend_from_slice(&other.ids);
    }

    /// `n` splats with every value zero and ids 0..n.
    pub fn zeros(n: usize) -> Self {
        Self {
            means: vec![0.0; 3 * n],
            quats: vec![0.0; 4 * n],
            scales: vec![0.0; 3 * n],
            opacities: vec![0.0; n],
            sh: std::array::from_fn(|_| vec![0.0; SH_GROUP_FLOATS * n]),
            ids: (0..n as u32).collect(),
        }
    }
}
