//! Similarities between the coordinates of a dataset and of another trainer, and their effect on splats.

use std::fs;

use psrgs_vk::format::{ply, read_transform};
use psrgs_vk::scene::{Frame, Gaussians, NoSimilarity, Similarity};

use super::splats;

/// Rotation by Rodrigues' formula about an axis.
fn rotation(axis: [f64; 3], angle: f64) -> [[f64; 3]; 3] {
    let length = axis.iter().map(|v| v * v).sum::<f64>().sqrt();
    let [x, y, z] = axis.map(|v| v / length);
    let (s, c) = angle.sin_cos();
    let k = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let square: f64 = (0..3).map(|m| k[i][m] * k[m][j]).sum();
            f64::from(u8::from(i == j)) + s * k[i][j] + (1.0 - c) * square
        })
    })
}

fn turned(r: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| (0..3).map(|j| r[i][j] * v[j]).sum())
}

fn some() -> [Similarity; 4] {
    let with = |axis, angle, scale, translation| Similarity { rotation: rotation(axis, angle), scale, translation };
    [
        Similarity::IDENTITY,
        with([0.3, -0.5, 0.9], 1.1, 0.37, [3.0, -8.0, 0.5]),
        with([1.0, 0.0, 0.0], std::f64::consts::PI, 1.0, [0.0; 3]),
        with([-0.7, 0.1, -0.2], 3.1, 12.5, [-40.0, 1.0, 9.0]),
    ]
}

/// Real spherical harmonics from the associated Legendre functions with the Condon-Shortley phase, the definition
/// behind the polynomials that renderers use.
fn harmonic(l: i32, m: i32, [x, y, z]: [f64; 3]) -> f64 {
    let order = m.unsigned_abs() as i32;
    let sine = (1.0 - z * z).max(0.0).sqrt();
    // P_m^m, then upwards in the degree.
    let mut below = (0..order).fold(1.0, |p, k| -p * f64::from(2 * k + 1) * sine);
    let mut here = if l == order { below } else { z * f64::from(2 * order + 1) * below };
    for n in order + 2..=l {
        let next = (f64::from(2 * n - 1) * z * here - f64::from(n + order - 1) * below) / f64::from(n - order);
        (below, here) = (here, next);
    }
    let factorials = (l - order + 1..=l + order).map(f64::from).product::<f64>();
    let norm = (f64::from(2 * l + 1) / (4.0 * std::f64::consts::PI * factorials)).sqrt();
    let angle = f64::from(order) * y.atan2(x);
    norm * here
        * match m {
            0 => 1.0,
            1.. => std::f64::consts::SQRT_2 * angle.cos(),
            _ => std::f64::consts::SQRT_2 * angle.sin(),
        }
}

/// The value of a splat's harmonics from `from` up to `to` coefficients in a direction.
fn value(g: &Gaussians, i: usize, c: usize, coefficients: std::ops::Range<usize>, d: [f64; 3]) -> f64 {
    let mut sum = 0.0;
    let mut k = 0;
    for l in 0..4 {
        for m in -l..=l {
            if coefficients.contains(&k) {
                sum += f64::from(g.sh[k / 4][12 * i + 3 * (k % 4) + c]) * harmonic(l, m, d);
            }
            k += 1;
        }
    }
    sum
}

fn directions() -> Vec<[f64; 3]> {
    let mut out = vec![[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
    for k in 0..60 {
        let z = (f64::from(k) + 0.5) / 30.0 - 1.0;
        let (angle, radius) = (2.4 * f64::from(k), (1.0 - z * z).sqrt());
        out.push([radius * angle.cos(), radius * angle.sin(), z]);
    }
    out
}

#[test]
fn harmonics_of_each_degree_turn_with_the_scene() {
    let g = splats(20);
    for similarity in some() {
        let out = similarity.gaussians(&g);
        assert_eq!(out.ids, g.ids);
        for range in [0..1, 1..4, 4..9, 9..16] {
            let mut largest: f64 = 0.0;
            for i in 0..g.len() {
                for d in directions() {
                    for c in 0..3 {
                        let before = value(&g, i, c, range.clone(), d);
                        let after = value(&out, i, c, range.clone(), turned(&similarity.rotation, d));
                        largest = largest.max((before - after).abs());
                    }
                }
            }
            // Coefficients up to 3 in magnitude, rounded to f32 once: 2^-24 of each,
            // and at most 7 of them with values below 1.5.
            assert!(largest < 7.0 * 3.0 * 1.5 * 0.5_f64.powi(24), "{range:?}: {largest:e}");
        }
    }
}

fn covariance(g: &Gaussians, i: usize) -> [[f64; 3]; 3] {
    let q: Vec<f64> = g.quats[4 * i..4 * i + 4].iter().map(|v| f64::from(*v)).collect();
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    let angle = 2.0 * (q[0] / length).clamp(-1.0, 1.0).acos();
    let axes = rotation([q[1], q[2], q[3]], angle);
    let variances: Vec<f64> = g.scales[3 * i..3 * i + 3].iter().map(|s| (2.0 * f64::from(*s)).exp()).collect();
    std::array::from_fn(|a| std::array::from_fn(|b| (0..3).map(|k| axes[a][k] * axes[b][k] * variances[k]).sum()))
}

#[test]
fn centres_and_covariances_are_mapped() {
    let g = splats(50);
    for similarity in some() {
        let out = similarity.gaussians(&g);
        assert_eq!(out.opacities, g.opacities);
        for i in 0..g.len() {
            let p = std::array::from_fn(|k| f64::from(g.means[3 * i + k]));
            let want = turned(&similarity.rotation, p);
            for k in 0..3 {
                let want = similarity.scale * want[k] + similarity.translation[k];
                assert!((f64::from(out.means[3 * i + k]) - want).abs() < 1e-5 * want.abs().max(1.0));
            }
            let (before, after) = (covariance(&g, i), covariance(&out, i));
            let r = &similarity.rotation;
            let largest = before.iter().flatten().fold(0.0_f64, |m, v| m.max(v.abs())) * similarity.scale.powi(2);
            for a in 0..3 {
                for b in 0..3 {
                    let want: f64 = (0..9).map(|k| r[a][k / 3] * before[k / 3][k % 3] * r[b][k % 3]).sum();
                    let error = (after[a][b] - similarity.scale.powi(2) * want).abs();
                    assert!(error < 2e-6 * largest, "splat {i}: {error:e} of {largest:e}");
                }
            }
        }
    }
}

#[test]
fn similarities_compose_and_are_undone() {
    let p = [1.5, -0.25, 7.0];
    for a in some() {
        for b in some() {
            let (at_once, one_by_one) = (a.then(&b).point(p), b.point(a.point(p)));
            let back = a.then(&b).inverse().point(at_once);
            for k in 0..3 {
                assert!((at_once[k] - one_by_one[k]).abs() < 1e-9 && (back[k] - p[k]).abs() < 1e-9);
            }
        }
    }
    let [_, some, half_turn, _] = some();
    assert!((some.degrees() - 1.1_f64.to_degrees()).abs() < 1e-9);
    assert!((half_turn.degrees() - 180.0).abs() < 1e-9);
}

/// A model far from the origin of its dataset, moved to a frame of its own and back, keeps its place.
#[test]
fn a_model_in_a_frame_of_its_own_comes_back_into_the_scene() {
    let frame = Frame { offset: [500_123.5, 4_600_987.25, 100.0], scale: 0.125 };
    let scene = splats(300);
    let [_, other, _, _] = some();
    // dataset -> model: about the offset, so that f32 can hold the model.
    let to_model = Similarity { translation: [0.0; 3], ..other };
    let to_model = to_model.after_shift(frame.offset.map(|v| -v));
    let gaussians = Similarity::to_scene(&frame).inverse().then(&to_model).gaussians(&scene);
    let model = ply::Model { gaussians, sh_degree: 3, ..ply::Model::default() };
    let back = model.placed_in_scene(&to_model.inverse(), &frame);
    let pairs = back.means.iter().zip(&scene.means).chain(back.scales.iter().zip(&scene.scales));
    for (got, want) in pairs.chain(back.sh[2].iter().zip(&scene.sh[2])) {
        assert!((got - want).abs() < 1e-5, "{got} {want}");
    }
}

#[test]
fn transforms_of_other_trainers_are_read_and_bad_ones_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("transform.json");
    let read = |text: &str| {
        fs::write(&file, text).expect("written");
        read_transform(&file).map_err(|e| e.to_string())
    };
    let turn = Similarity {
        rotation: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        scale: 2.0,
        translation: [1.0, 2.0, 3.0],
    };
    for text in [
        "[[0,-2,0,1],[2,0,0,2],[0,0,2,3],[0,0,0,1]]",
        "[[0,-2,0,1],[2,0,0,2],[0,0,2,3]]",
        // The scale applies after the matrix, also to the translation.
        r#"{"transform": [[0,-1,0,0.5],[1,0,0,1],[0,0,1,1.5]], "scale": 2}"#,
        r#"{"scale": 0.5, "transform": [[0,-4,0,2],[4,0,0,4],[0,0,4,6],[0,0,0,1]], "other": "ignored"}"#,
    ] {
        let got = read(text).expect(text);
        assert!((got.scale - turn.scale).abs() < 1e-12, "{text}");
        for i in 0..3 {
            assert!((got.translation[i] - turn.translation[i]).abs() < 1e-12, "{text}");
            assert!((0..3).all(|j| (got.rotation[i][j] - turn.rotation[i][j]).abs() < 1e-12), "{text}");
        }
    }
    let id = "[1,0,0,0],[0,1,0,0],[0,0,1,0]";
    for (text, words) in [
        ("[[1,0,\n0,x]]".to_owned(), "line 2"),
        ("{}".to_owned(), "3x4 or 4x4"),
        ("[[1,0,0],[0,1,0],[0,0,1]]".to_owned(), "3x4 or 4x4"),
        (format!("[{id},[0,0,0,2]]"), "0 0 0 1"),
        (format!(r#"{{"transform": [{id}], "scale": -1}}"#), "positive"),
        ("[[1,0,0,0],[0,1,0,0],[0,0,-1,0]]".to_owned(), "mirrors"),
        ("[[1,0,0,0],[0,2,0,0],[0,0,1,0]]".to_owned(), "stretches"),
        ("[[1,0.1,0,0],[0,1,0,0],[0,0,1,0]]".to_owned(), "stretches"),
        ("[[0,0,0,0],[0,0,0,0],[0,0,0,0]]".to_owned(), "positive"),
        // The frame.json of a model of this program is no such transform.
        (r#"{"offset":[0,0,0],"scale":1,"shift":[0,0,0]}"#.to_owned(), "'transform'"),
    ] {
        let error = read(&text).expect_err(&text);
        assert!(error.contains("transform.json: transform at line") && error.contains(words), "{text}: {error}");
    }
    assert_eq!(Similarity::from_rows(&[[f64::NAN; 4]; 3]), Err(NoSimilarity::Degenerate));
}
