//! Models of a given number of splats, made from a real one.

use crate::raster::{MEANS, OPACITIES, PLANES, SCALES, gaussians_of, planes_of};
use crate::scene::Gaussians;
use crate::twin::random;

/// Seed stream of this module, apart from that of density control.
const STREAM: u32 = 0x6265_6e63;

/// Makes `splats` splats that cover about the same area as `from`, for timing at any size.
///
/// Above the size of `from`, its splats are repeated in turn: the first round in place, every later copy moved by a
/// normal deviate of its own standard deviations. Below that size, splats are kept at even intervals. Points lie on
/// surfaces, so standard deviations are multiplied by sqrt(old number / new number). The covered area, and with it the
/// number of blended splats per pixel, stays about the same until splats become smaller than a pixel. Everything else
/// is copied. The result depends on the arguments alone.
pub fn resized(from: &Gaussians, splats: u32, seed: u64) -> Gaussians {
    let (n, m) = (splats as usize, from.len());
    if m == 0 {
        return from.clone();
    }
    let source = |i: usize| if n > m { i % m } else { (i as u64 * m as u64 / n as u64) as usize };
    let mut planes: [Vec<f32>; 8] = Default::default();
    for ((out, plane), (_, row)) in planes.iter_mut().zip(planes_of(from)).zip(PLANES) {
        let row = row as usize;
        *out = (0..n).flat_map(|i| &plane[row * source(i)..row * (source(i) + 1)]).copied().collect();
    }
    let seed = [seed as u32, (seed >> 32) as u32];
    for i in m..n {
        let z = random::normals::<f64>([i as u32, seed[0], seed[1], STREAM]);
        let j = source(i);
        let moved = offset(&from.quats[4 * j..4 * j + 4], &from.scales[3 * j..3 * j + 3], z);
        planes[MEANS][3 * i..3 * i + 3].iter_mut().zip(moved).for_each(|(p, d)| *p += d as f32);
    }
    let smaller = (0.5 * (m as f64 / n.max(1) as f64).ln()) as f32;
    planes[SCALES].iter_mut().for_each(|s| *s += smaller);
    debug_assert_eq!(planes[OPACITIES].len(), n);
    gaussians_of(planes, (0..splats).collect())
}

/// The normal deviate `z` in the splat's axes, scaled by its standard deviations, as an offset in the world.
fn offset(quat: &[f32], log_scales: &[f32], z: [f64; 3]) -> [f64; 3] {
    let q = glam::DQuat::from_xyzw(quat[1].into(), quat[2].into(), quat[3].into(), quat[0].into());
    let along = glam::DVec3::from_array(std::array::from_fn(|k| f64::from(log_scales[k]).exp() * z[k]));
    (if q.length_squared() > 0.0 { q.normalize() * along } else { along }).to_array()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn few() -> Gaussians {
        let mut g = Gaussians::zeros(3);
        for i in 0..3 {
            g.means[3 * i] = 100.0 * i as f32;
            g.quats[4 * i] = 2.0;
            g.scales[3 * i..3 * i + 3].copy_from_slice(&[0.0, -30.0, -30.0]);
            g.opacities[i] = i as f32;
            g.sh[3][12 * i + 11] = i as f32 + 0.5;
        }
        g
    }

    #[test]
    fn copies_lie_within_their_splats_and_cover_the_same_area() {
        let g = resized(&few(), 3000, 7);
        assert_eq!((g.len(), g.ids[2999]), (3000, 2999));
        assert_eq!(g.means[..9], few().means, "the first round stays where it was");
        let (mut mean, mut square) = (0.0, 0.0);
        for i in 3..3000 {
            let j = i % 3;
            assert_eq!((g.opacities[i], g.sh[3][12 * i + 11]), (j as f32, j as f32 + 0.5));
            let moved = f64::from(g.means[3 * i] - 100.0 * j as f32);
            assert!(g.means[3 * i + 1].abs() < 1e-10, "moved along a thin axis");
            (mean, square) = (mean + moved / 2997.0, square + moved * moved / 2997.0);
        }
        // Five standard errors of 2997 standard normals.
        assert!(mean.abs() < 0.092 && (square - 1.0).abs() < 0.13, "mean {mean}, variance {square}");
        assert!((g.scales[0] - 0.5 * 0.001_f32.ln()).abs() < 1e-6);
        assert_eq!(resized(&few(), 3000, 7), g);
        assert_ne!(resized(&few(), 3000, 8), g);
    }

    #[test]
    fn fewer_are_spread_over_all_and_larger() {
        let g = resized(&resized(&few(), 300, 0), 3, 0);
        assert_eq!(g.opacities, [0.0, 1.0, 2.0]);
        assert!(g.scales[0].abs() < 1e-5);
        assert_eq!(resized(&few(), 3, 0), few());
        assert!(resized(&few(), 0, 0).is_empty() && resized(&Gaussians::zeros(0), 5, 0).is_empty());
    }
}
