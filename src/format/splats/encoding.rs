//! What the formats share: refusals of models that cannot be written, and steps of opacity.

use super::super::ply::inconsistent;
use crate::scene::{Gaussians, SH_GROUP_FLOATS};

/// Largest logit of an opacity that is read: the sigmoid of 16 is 1 in f32, and no gradient moves an infinite logit.
pub(in crate::format) const MAX_LOGIT: f32 = 16.0;

/// Why a model cannot be written in a format.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EncodeError {
    /// A value of a splat is not a finite number.
    #[error("{field} of splat {splat} is {value}: leave this splat out")]
    NotFinite {
        /// Index of the splat.
        splat: usize,
        /// The value's name.
        field: &'static str,
        /// The value.
        value: f32,
    },
    /// The planes of the model have different numbers of splats.
    #[error("{0}")]
    Inconsistent(String),
    /// The format has no room for the number of splats.
    #[error("{splats} splats are more than {most}, the most of this format: keep fewer splats")]
    TooMany {
        /// Number of splats.
        splats: usize,
        /// Most splats of the format.
        most: usize,
    },
    /// A coordinate is outside the range of the format.
    #[error("{field} of splat {splat} is {value}, the format ends at {most}: move the model nearer to the origin")]
    OutOfRange {
        /// Index of the splat.
        splat: usize,
        /// The value's name.
        field: &'static str,
        /// The value.
        value: f32,
        /// Largest value.
        most: f32,
    },
    /// An encoder of another library failed.
    #[error("the encoder failed: {0}")]
    Encoder(String),
}

/// Refuses planes of different lengths, and the first value that is not finite.
pub(in crate::format) fn check(g: &Gaussians) -> Result<(), EncodeError> {
    if let Some(problem) = inconsistent(g) {
        return Err(EncodeError::Inconsistent(problem));
    }
    let planes =
        [("position", &g.means, 3), ("rotation", &g.quats, 4), ("scale", &g.scales, 3), ("opacity", &g.opacities, 1)];
    let sh = g.sh.iter().map(|plane| ("spherical harmonics", plane, SH_GROUP_FLOATS));
    let all = planes.into_iter().chain(sh);
    let bad = all.filter_map(|(field, plane, row)| {
        let at = plane.iter().position(|v| !v.is_finite())?;
        Some(EncodeError::NotFinite { splat: at / row, field, value: plane[at] })
    });
    let splat = |e: &EncodeError| if let EncodeError::NotFinite { splat, .. } = e { *splat } else { 0 };
    bad.min_by_key(splat).map_or(Ok(()), Err)
}

/// The byte nearest to `value`.
pub(in crate::format) fn byte(value: f64) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

/// An opacity as a byte: 255 is opaque.
pub(in crate::format) fn alpha_byte(logit: f32) -> u8 {
    byte(255.0 / (1.0 + (-f64::from(logit)).exp()))
}

/// The logit of an opacity given as a byte.
pub(in crate::format) fn logit_of_alpha(alpha: u8) -> f32 {
    let opacity = f64::from(alpha) / 255.0;
    ((opacity / (1.0 - opacity)).ln() as f32).clamp(-MAX_LOGIT, MAX_LOGIT)
}

/// The unit quaternion (w, x, y, z) of a splat; the identity where the quaternion is too short to have a direction.
pub(in crate::format) fn unit_quat(g: &Gaussians, i: usize) -> [f64; 4] {
    let q: [f64; 4] = std::array::from_fn(|k| f64::from(g.quats[4 * i + k]));
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    if length < 1e-12 { [1.0, 0.0, 0.0, 0.0] } else { q.map(|v| v / length) }
}

/// Index of the component of the largest magnitude, and the quaternion of the same rotation in which it is positive.
pub(in crate::format) fn largest_first(q: [f64; 4]) -> (usize, [f64; 4]) {
    let largest = (1..4).fold(0, |best, k| if q[k].abs() > q[best].abs() { k } else { best });
    (largest, if q[largest] < 0.0 { q.map(|v| -v) } else { q })
}

/// Coefficient `k` (from 0, the constant one) of a channel of splat `i`.
pub(in crate::format) fn coefficient(g: &Gaussians, i: usize, k: usize, channel: usize) -> f32 {
    g.sh[k / 4][SH_GROUP_FLOATS * i + 3 * (k % 4) + channel]
}

/// Number of spherical harmonics beyond the constant one that a file of this degree has per channel.
pub(in crate::format) fn rest(degree: u32) -> usize {
    super::super::ply::REST_BY_DEGREE[degree.min(3) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_that_is_not_finite_is_named_with_its_splat() {
        let mut g = Gaussians::zeros(3);
        assert_eq!(check(&g), Ok(()));
        g.sh[1][12] = f32::INFINITY;
        g.scales[6] = f32::NAN;
        let error = check(&g).expect_err("refused").to_string();
        assert!(error.contains("spherical harmonics of splat 1 is inf"), "{error}");
        g.means.pop();
        assert!(matches!(check(&g), Err(EncodeError::Inconsistent(_))));
    }

    #[test]
    fn an_opacity_comes_back_within_half_a_step() {
        for logit in [-40.0, -6.0, -1.0, 0.0, 0.3, 5.0, 40.0] {
            let back = logit_of_alpha(alpha_byte(logit));
            let opacity = |l: f32| 1.0 / (1.0 + (-f64::from(l)).exp());
            assert!((opacity(back) - opacity(logit)).abs() <= 0.5001 / 255.0, "{logit} became {back}");
            assert!(back.abs() <= MAX_LOGIT);
        }
    }
}
