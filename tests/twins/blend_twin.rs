//! The f64 twin of the blending backward pass against central differences of its forward pass.

use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::blend_backward::{Upstream, backward};
use psrgs_vk::twin::blend_forward::{Blend, Blended, evaluate, forward};

use super::blend_scene::{Scene, widen};

fn loss(out: &Blended<f64>, up: &Upstream<f64>) -> f64 {
    let dot = |a: &[[f64; 4]], b: &[[f64; 4]]| -> f64 {
        a.as_flattened().iter().zip(b.as_flattened()).map(|(x, y)| x * y).sum()
    };
    dot(&out.image, &up.grad_image) + dot(&out.aux, &up.grad_aux)
}

/// Whether every pixel keeps its decisions when the splats move by the steps of the differences.
fn smooth(blend: &Blend<f64>) -> Vec<bool> {
    (0..blend.width * blend.height)
        .map(|pixel| {
            let (x, y) = (pixel % blend.width, pixel / blend.width);
            let mut transmittance = 1.0;
            blend.list(x, y).iter().all(|&splat| {
                let row = &blend.splats[splat as usize];
                let at = evaluate(row, Blend::center(x, y), blend.alpha_min);
                let raw = row[5] * at.falloff;
                transmittance *= 1.0 - at.alpha();
                (raw * 255.0 - 1.0).abs() > 1e-3
                    && (raw / 0.99 - 1.0).abs() > 1e-3
                    && (transmittance / 1e-4 - 1.0).abs() > 1e-2
            })
        })
        .collect()
}

fn upstream(blend: &Blend<f64>, seed: u64) -> Upstream<f64> {
    let mut d = Random::new(seed);
    let keep = smooth(blend);
    let out = forward(blend);
    let mut grads =
        || keep.iter().map(|&k| std::array::from_fn(|_| if k { d.range(-1.0, 1.0) } else { 0.0 })).collect();
    let (grad_image, grad_aux) = (grads(), grads());
    Upstream { image: out.image, last: out.last, grad_image, grad_aux, clamp_gradient_passes: false }
}

fn add(sum: &mut [f64], terms: &[f64]) {
    sum.iter_mut().zip(terms).for_each(|(s, t)| *s += t);
}

/// Gradients per splat from gradients per pair.
fn per_splat(blend: &Blend<f64>, up: &Upstream<f64>) -> (Vec<[f64; 12]>, Vec<[f64; 4]>) {
    let grads = backward(blend, up);
    let mut rows = vec![[0.0; 12]; blend.splats.len()];
    let mut normals = vec![[0.0; 4]; blend.splats.len()];
    for (pair, &splat) in blend.sorted.iter().enumerate() {
        add(&mut rows[splat as usize], &grads.rows[pair]);
        add(&mut normals[splat as usize], &grads.normals[pair]);
    }
    (rows, normals)
}

fn close(what: &str, got: f64, want: f64) {
    assert!((got - want).abs() <= 1e-5 * want.abs().max(0.05), "{what}: {got} instead of {want}");
}

#[test]
fn backward_is_the_derivative_of_forward() {
    let mut touched = 0;
    for (seed, n, most) in [(1, 9, 0.9), (2, 25, 1.3), (3, 60, 0.3)] {
        let scene = Scene::random("random", seed, n, [19, 13], most);
        let mut blend = widen::<f64>(&scene.blend(8, true));
        // Derived from the conic, as below.
        blend.splats.iter_mut().for_each(|row| row[7] = row[4] - row[3] * row[3] / row[2]);
        let up = upstream(&blend, seed + 100);
        let (rows, normals) = per_splat(&blend, &up);
        // Column of the gradient and of the splat's row.
        let columns = [(0, 0), (1, 1), (2, 2), (3, 3), (4, 4), (5, 5), (6, 8), (7, 9), (8, 10), (9, 6)];
        let difference = |change: &dyn Fn(&mut Blend<f64>, f64)| {
            let h = 1e-6;
            let at = |h: f64| {
                let mut moved = blend.clone();
                change(&mut moved, h);
                loss(&forward(&moved), &up)
            };
            (at(h) - at(-h)) / (2.0 * h)
        };
        for splat in 0..n {
            for (column, place) in columns {
                let want = difference(&|b, h| {
                    let row = &mut b.splats[splat];
                    row[place] += h;
                    // The column that is stored beside the conic.
                    if (2..5).contains(&place) {
                        row[7] = row[4] - row[3] * row[3] / row[2];
                    }
                });
                // A moved mean moves the plane of the depths along, which is the projection's to add.
                let slope = [blend.splats[splat][11], blend.normals.as_ref().map_or(0.0, |n| n[splat][3]), 0.0];
                let along = slope[column.min(2)] * rows[splat][9];
                close(&format!("splat {splat} column {column}"), rows[splat][column] - along, want);
                touched += usize::from(want != 0.0);
            }
            for (k, got) in normals[splat].into_iter().take(3).enumerate() {
                let want = difference(&|b, h| {
                    if let Some(normals) = &mut b.normals {
                        normals[splat][k] += h;
                    }
                });
                close(&format!("splat {splat} normal {k}"), got, want);
            }
        }
    }
    assert!(touched > 500, "only {touched} derivatives differ from zero");
}

#[test]
fn absolute_columns_are_sums_over_pixels_of_absolute_values() {
    let scene = Scene::random("random", 5, 20, [17, 9], 0.8);
    let blend = widen::<f64>(&scene.blend(8, false));
    let up = upstream(&blend, 6);
    let (rows, _) = per_splat(&blend, &up);
    let mut want = vec![[0.0; 2]; 20];
    for pixel in 0..17 * 9 {
        let mut one = up.clone();
        for (k, grad) in one.grad_image.iter_mut().enumerate() {
            if k != pixel {
                *grad = [0.0; 4];
            }
        }
        for (sum, row) in want.iter_mut().zip(per_splat(&blend, &one).0) {
            sum[0] += row[0].abs();
            sum[1] += row[1].abs();
        }
    }
    for (row, want) in rows.iter().zip(&want) {
        close("abs x", row[10], want[0]);
        close("abs y", row[11], want[1]);
    }
    assert!(want.iter().any(|w| w[0] > 0.0));
}

#[test]
fn clamped_alpha_has_a_gradient_only_as_in_the_reference() {
    let mut scene = Scene::random("clamped", 1, 1, [1, 1], 1.0);
    scene.splats[0] = [0.5, 0.5, 1.0, 0.0, 1.0, 0.999, 1.0, 0.0, 0.3, 0.6, 0.9, 0.0];
    scene.everywhere = true;
    let blend = widen::<f64>(&scene.blend(8, false));
    let out = forward(&blend);
    let mut up = Upstream {
        image: out.image,
        last: out.last,
        grad_image: vec![[1.0, 1.0, 1.0, 0.0]],
        grad_aux: vec![[0.0; 4]],
        clamp_gradient_passes: false,
    };
    assert_eq!(per_splat(&blend, &up).0[0][5], 0.0);
    up.clamp_gradient_passes = true;
    let background: f64 = blend.background.iter().sum();
    close("opacity", per_splat(&blend, &up).0[0][5], 1.8f32 as f64 - background);
}
