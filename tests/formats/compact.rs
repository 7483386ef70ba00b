//! Compact formats: round trips within the steps of each format, extremes, refusals.

use std::path::Path;

use psrgs_vk::format::ply::Model;
use psrgs_vk::format::splats::sog;
use psrgs_vk::scene::{Gaussians, SH_GROUP_FLOATS};

use super::splats;

/// A model of random splats.
fn model(n: usize, sh_degree: u32) -> Model {
    Model { gaussians: splats(n), sh_degree, antialias: Some(true), ..Model::default() }
}

/// The value of a plane's row farthest from that of the other model, by a distance of values.
fn farthest(a: &[f32], b: &[f32], distance: impl Fn(f64, f64) -> f64) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| distance(f64::from(*a), f64::from(*b))).fold(0.0, f64::max)
}

fn opacity(logit: f64) -> f64 {
    1.0 / (1.0 + (-logit).exp())
}

/// Largest angle between the rotations of two models, in radians.
fn angle(a: &Gaussians, b: &Gaussians) -> f64 {
    let dot = |(a, b): (&[f32], &[f32])| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    let pairs = a.quats.chunks_exact(4).zip(b.quats.chunks_exact(4));
    pairs.map(|pair| 2.0 * dot(pair).abs().min(1.0).acos()).fold(0.0, f64::max)
}

/// The constant coefficients.
fn colours(g: &Gaussians) -> Vec<f32> {
    g.sh[0].chunks_exact(SH_GROUP_FLOATS).flat_map(|row| &row[..3]).copied().collect()
}

#[test]
fn sog_comes_back_within_its_steps() {
    for n in [1, 2, 17, 700] {
        let written = model(n, 0);
        let bytes = sog::encode(&written, 0).expect("written");
        let read = sog::decode(Path::new("a.sog"), &bytes, false).expect("read");
        let (old, new) = (written.gaussians.in_morton_order(), &read.gaussians);
        let log = |v: f64| v.abs().ln_1p().copysign(v);
        let step = 2.0 * 4.0_f64.ln() / 65_535.0;
        assert!(farthest(&old.means, &new.means, |a, b| (log(a) - log(b)).abs()) <= 0.51 * step);
        assert!(farthest(&old.opacities, &new.opacities, |a, b| (opacity(a) - opacity(b)).abs()) <= 0.501 / 255.0);
        // Uniform numbers from -3 to 3 in 256 steps; few numbers are kept exactly.
        let coded = if 3 * n <= 256 { 0.0 } else { 4.0 * 6.0 / 256.0 };
        assert!(farthest(&old.scales, &new.scales, |a, b| (a - b).abs()) <= coded);
        assert!(farthest(&colours(&old), &colours(new), |a, b| (a - b).abs()) <= coded);
        assert!(angle(&old, new) <= 0.02, "{}", angle(&old, new));
        assert_eq!((read.sh_degree, read.antialias, read.shift), (0, Some(true), [0.0; 3]));
        assert_eq!(sog::encode(&written, 0).expect("written"), bytes, "the same model gives the same bytes");
    }
}
