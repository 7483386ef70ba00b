//! PSNR after an affine colour fit: what is left of an error when exposure and white balance of the photograph are not
//! counted.

/// PSNR in dB of 8-bit RGB pictures after the render's colours have been mapped to the photograph's by the affine map
/// that fits them best in least squares (one 3x4 matrix for the picture; without rounding or clamping). Never below
/// [`super::psnr`], because the identity is such a map; infinite for equal pictures.
/// `None` where the sizes do not agree or nothing counts.
pub fn psnr_cc(render: &[u8], photograph: &[u8]) -> Option<f64> {
    fitted(render, photograph, |_| true)
}

/// [`psnr_cc`] over the pixels for which `counts` is true.
pub fn psnr_cc_where(render: &[u8], photograph: &[u8], counts: &[bool]) -> Option<f64> {
    if render.len() != 3 * counts.len() {
        return None;
    }
    fitted(render, photograph, |k| counts[k])
}

fn fitted(render: &[u8], photograph: &[u8], counts: impl Fn(usize) -> bool) -> Option<f64> {
    if render.len() != photograph.len() || !render.len().is_multiple_of(3) {
        return None;
    }
    let colour = |p: &[u8]| [0, 1, 2].map(|c| f64::from(p[c]));
    let pixels = || {
        let both = render.chunks_exact(3).zip(photograph.chunks_exact(3)).enumerate();
        // The colour, and what is missing to the photograph's.
        both.filter(|(k, _)| counts(*k)).map(|(_, (x, y))| {
            let (x, y) = (colour(x), colour(y));
            (x, [0, 1, 2].map(|c| y[c] - x[c]))
        })
    };
    let n = pixels().count() as f64;
    if n == 0.0 {
        return None;
    }
    let (mut mean_x, mut mean_r) = ([0.0; 3], [0.0; 3]);
    for (x, r) in pixels() {
        (0..3).for_each(|c| {
            mean_x[c] += x[c] / n;
            mean_r[c] += r[c] / n;
        });
    }
    let (mut of_x, mut of_r) = ([[0.0; 3]; 3], [[0.0; 3]; 3]);
    for (x, r) in pixels() {
        for i in 0..3 {
            let d = x[i] - mean_x[i];
            for j in 0..3 {
                of_x[i][j] += d * (x[j] - mean_x[j]);
                of_r[i][j] += d * (r[j] - mean_r[j]);
            }
        }
    }
    // Colours that do not vary in some direction say nothing of the map there: it stays the identity.
    let ridge = 1e-9 * (n + of_x[0][0] + of_x[1][1] + of_x[2][2]);
    (0..3).for_each(|i| of_x[i][i] += ridge);
    let l = triangle(&of_x);
    // What each channel of the photograph takes of the render's.
    let map: [[f64; 3]; 3] = std::array::from_fn(|j| substitute(&l, of_r.map(|row| row[j])));
    let mut squares = 0.0;
    for (x, r) in pixels() {
        for j in 0..3 {
            let mapped: f64 = (0..3).map(|i| (x[i] - mean_x[i]) * map[j][i]).sum();
            squares += (r[j] - mean_r[j] - mapped).powi(2);
        }
    }
    Some(-10.0 * (squares / (3.0 * n) / (255.0 * 255.0)).log10())
}

/// The lower triangle l with `l l^T = a`, of a symmetric positive definite matrix (Cholesky).
fn triangle(a: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let mut l = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..=i {
            let rest = a[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            l[i][j] = if i == j { rest.max(f64::MIN_POSITIVE).sqrt() } else { rest / l[j][j] };
        }
    }
    l
}

/// Solves `l l^T x = b`.
fn substitute(l: &[[f64; 3]; 3], b: [f64; 3]) -> [f64; 3] {
    let mut x = b;
    for i in 0..3 {
        x[i] = (x[i] - (0..i).map(|k| l[i][k] * x[k]).sum::<f64>()) / l[i][i];
    }
    for i in (0..3).rev() {
        x[i] = (x[i] - (i + 1..3).map(|k| l[k][i] * x[k]).sum::<f64>()) / l[i][i];
    }
    x
}

#[cfg(test)]
mod tests {
    use super::super::{psnr, psnr_where};
    use super::*;

    fn noise(seed: u32, count: usize) -> Vec<u8> {
        let mut state = seed;
        let next = |_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        (0..count).map(next).collect()
    }

    #[test]
    fn an_affine_change_of_colours_is_not_counted() {
        let render: Vec<u8> = noise(1, 3000).iter().map(|v| v / 2).collect();
        // Exact in 8 bits: channels mixed with whole numbers, and moved.
        let map = |p: &[u8]| [p[1] + 20, p[0] / 2 * 2, 127 - p[2]];
        let even: Vec<u8> = render.iter().map(|v| v / 2 * 2).collect();
        let photograph: Vec<u8> = even.chunks_exact(3).flat_map(map).collect();
        assert!(psnr(&even, &photograph).unwrap() < 20.0);
        assert!(psnr_cc(&even, &photograph).unwrap() > 120.0);
    }

    #[test]
    fn the_fit_is_that_of_the_normal_equations() {
        // One channel carries everything: y = x + e with e = (1, -2, 1) at x = (0, 1, 2), to which no line fits any
        // better, beside two channels that are equal. Squares: 6 over 9 values.
        let (render, photograph) = ([10, 5, 5, 11, 5, 5, 12, 5, 5], [11, 5, 5, 9, 5, 5, 13, 5, 5]);
        let want = -10.0 * (6.0_f64 / 9.0 / 65025.0).log10();
        assert!((psnr_cc(&render, &photograph).unwrap() - want).abs() < 1e-6);
        // Moved, it is the same to the fit and not to the plain number.
        let moved = photograph.map(|v| v + 30);
        assert!((psnr_cc(&render, &moved).unwrap() - want).abs() < 1e-6);
        assert!(psnr(&render, &moved).unwrap() < want - 10.0);
    }

    #[test]
    fn a_fit_never_costs() {
        for seed in 0..20 {
            let (render, photograph) = (noise(seed, 300), noise(seed + 1000, 300));
            let grey: Vec<u8> = render.chunks_exact(3).flat_map(|p| [p[0]; 3]).collect();
            let flat = vec![seed as u8; 300];
            for render in [&render, &grey, &flat] {
                let (plain, fitted) = (psnr(render, &photograph).unwrap(), psnr_cc(render, &photograph).unwrap());
                assert!(fitted >= plain - 1e-9, "{fitted} below {plain}");
            }
        }
        assert_eq!(psnr_cc(&[7; 30], &[7; 30]), Some(f64::INFINITY));
    }

    #[test]
    fn masked_pixels_have_no_part_in_the_fit() {
        let (render, photograph) = (noise(5, 300), noise(6, 300));
        let counts: Vec<bool> = (0..100).map(|k| k % 3 != 0).collect();
        let mut other = render.clone();
        other.chunks_exact_mut(3).zip(&counts).filter(|(_, c)| !**c).for_each(|(p, _)| p.fill(255));
        let score = psnr_cc_where(&render, &photograph, &counts).unwrap();
        assert_eq!(psnr_cc_where(&other, &photograph, &counts), Some(score));
        assert!(score >= psnr_where(&render, &photograph, &counts).unwrap());
        assert_eq!(psnr_cc_where(&render, &photograph, &[true; 100]), psnr_cc(&render, &photograph));
        assert_eq!(psnr_cc_where(&render, &photograph, &[false; 100]), None);
        assert_eq!(psnr_cc(&[1, 2, 3], &[1, 2]), None);
    }
}
