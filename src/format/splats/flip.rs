//! Half a turn about x: from axes in which -y is up to axes in which +y is up, and back.

use crate::scene::{Gaussians, SH_GROUP_FLOATS};

/// Signs of the spherical harmonics under the turn, by coefficient: those that are odd in y and z together change.
const SIGNS: [f32; 16] = [1.0, -1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0];

/// The splats with y and z negated. Twice makes the same bits again.
pub(super) fn flipped(g: &Gaussians) -> Gaussians {
    let mut out = g.clone();
    out.means.chunks_exact_mut(3).for_each(|p| p[1..].iter_mut().for_each(|v| *v = -*v));
    out.quats.chunks_exact_mut(4).for_each(|q| q[2..].iter_mut().for_each(|v| *v = -*v));
    for (group, plane) in out.sh.iter_mut().enumerate() {
        for row in plane.chunks_exact_mut(SH_GROUP_FLOATS) {
            row.iter_mut().enumerate().for_each(|(at, v)| *v *= SIGNS[4 * group + at / 3]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Similarity;

    #[test]
    fn the_flip_is_the_rotation_by_half_a_turn_about_x() {
        let mut g = Gaussians::zeros(1);
        g.means = vec![1.0, 2.0, 3.0];
        g.quats = vec![0.5, 0.1, -0.7, 0.4];
        g.sh.iter_mut().flatten().enumerate().for_each(|(k, v)| *v = 0.1 * k as f32 - 2.0);
        let turn =
            Similarity { rotation: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]], ..Similarity::IDENTITY };
        let (ours, turned) = (flipped(&g), turn.gaussians(&g));
        let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(near(&ours.means, &turned.means));
        (0..4).for_each(|k| assert!(near(&ours.sh[k], &turned.sh[k]), "group {k}"));
        // The flip turns the axes of the ellipsoid too, each onto itself or its opposite: the same ellipsoid.
        let [w, x, y, z] = [0, 1, 2, 3].map(|k| turned.quats[k]);
        let same = [x, -w, -z, y];
        assert!(near(&ours.quats, &same) || near(&ours.quats, &same.map(|v| -v)));
        assert_eq!(flipped(&ours), g);
    }
}
