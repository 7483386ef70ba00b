//! PSNR and SSIM of 8-bit pictures, in f64; on request only over the pixels that are not masked.

use rayon::prelude::*;

/// Peak signal-to-noise ratio in dB of two pictures given as bytes: over all values at once, infinite for equal ones.
/// The lengths must agree and not be 0: `None` otherwise.
pub fn psnr(a: &[u8], b: &[u8]) -> Option<f64> {
    if a.len() != b.len() || a.is_empty() {
        return None;
    }
    let squares: u64 = a.iter().zip(b).map(|(&x, &y)| u64::from(x.abs_diff(y)).pow(2)).sum();
    Some(-10.0 * (squares as f64 / a.len() as f64 / (255.0 * 255.0)).log10())
}

/// [`psnr`] of two RGB pictures over the pixels for which `counts` is true: at least one of them.
pub fn psnr_where(a: &[u8], b: &[u8], counts: &[bool]) -> Option<f64> {
    if a.len() != 3 * counts.len() || b.len() != a.len() {
        return None;
    }
    let kept = |p: &[u8]| -> Vec<u8> {
        p.chunks_exact(3).zip(counts).filter(|(_, counts)| **counts).flat_map(|(p, _)| [p[0], p[1], p[2]]).collect()
    };
    psnr(&kept(a), &kept(b))
}

/// [`ssim`] over the windows around the pixels for which `counts` is true,
/// `a` being taken as equal to `b` in the others.
pub fn ssim_where(a: &[u8], b: &[u8], counts: &[bool], width: usize, height: usize) -> Option<f64> {
    if a.len() != 3 * counts.len() || b.len() != a.len() {
        return None;
    }
    let shown: Vec<u8> = a.iter().zip(b).enumerate().map(|(k, (a, b))| if counts[k / 3] { *a } else { *b }).collect();
    mean_ssim(&shown, b, Some(counts), width, height)
}

/// Mean SSIM of two RGB pictures (interleaved bytes): per channel, 11x11 Gaussian window with sigma 1.5, zero padding,
/// C1 = 1e-4, C2 = 9e-4, over all pixels, the border included; the definition that the 3DGS reference trains and
/// reports with. `None` where the sizes do not agree.
pub fn ssim(a: &[u8], b: &[u8], width: usize, height: usize) -> Option<f64> {
    mean_ssim(a, b, None, width, height)
}

fn mean_ssim(a: &[u8], b: &[u8], counts: Option<&[bool]>, width: usize, height: usize) -> Option<f64> {
    if a.len() != b.len() || a.len() != 3 * width * height || a.is_empty() {
        return None;
    }
    let raw: [f64; 11] = std::array::from_fn(|i| (-(i as f64 - 5.0).powi(2) / 4.5).exp());
    let taps = raw.map(|x| x / raw.iter().sum::<f64>());
    // Moments of one row of the window's column sums: x, y, x^2, y^2, xy.
    let row_of = |i: usize| -> f64 {
        let mut sums = vec![[0.0f64; 5]; 3 * width];
        for (k, &w) in taps.iter().enumerate() {
            let line = (i + k).wrapping_sub(5);
            if line >= height {
                continue;
            }
            let span = 3 * width * line..3 * width * (line + 1);
            for (sum, (&x, &y)) in sums.iter_mut().zip(a[span.clone()].iter().zip(&b[span])) {
                let (x, y) = (f64::from(x) / 255.0, f64::from(y) / 255.0);
                for (s, v) in sum.iter_mut().zip([x, y, x * x, y * y, x * y]) {
                    *s += w * v;
                }
            }
        }
        (0..3 * width)
            .filter(|j| counts.is_none_or(|counts| counts[i * width + j / 3]))
            .map(|j| {
                let mut m = [0.0f64; 5];
                for (k, &w) in taps.iter().enumerate() {
                    if let Some(sum) = (j + 3 * k).checked_sub(15).and_then(|at| sums.get(at)) {
                        m.iter_mut().zip(sum).for_each(|(m, s)| *m += w * s);
                    }
                }
                let [x, y, xx, yy, xy] = m;
                let top = (2.0 * x * y + 1e-4) * (2.0 * (xy - x * y) + 9e-4);
                top / ((x * x + y * y + 1e-4) * (xx - x * x + yy - y * y + 9e-4))
            })
            .sum()
    };
    // Rows are added in order, so that the result does not depend on the number of threads.
    let rows: Vec<f64> = (0..height).into_par_iter().map(row_of).collect();
    let values = counts.map_or(a.len(), |counts| 3 * counts.iter().filter(|c| **c).count());
    (values > 0).then(|| rows.iter().sum::<f64>() / values as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture that exercises contrast, gradients and texture, from a formula so that other programs can make it too.
    fn picture(width: usize, height: usize, phase: usize) -> Vec<u8> {
        (0..3 * width * height)
            .map(|k| {
                let (x, y, c) = (k / 3 % width, k / 3 / width, k % 3);
                ((x * 7 + y * 13 + c * 29 + phase * (x * y % 11)) % 256) as u8
            })
            .collect()
    }

    /// The definition with all 121 taps, one window at a time.
    fn plain(a: &[u8], b: &[u8], width: usize, height: usize) -> f64 {
        let weight = |i: i64, j: i64| (-((i * i + j * j) as f64) / 4.5).exp();
        let total: f64 = (-5..=5).flat_map(|i| (-5..=5).map(move |j| weight(i, j))).sum();
        let mut sum = 0.0;
        for k in 0..a.len() {
            let (x, y, c) = ((k / 3 % width) as i64, (k / 3 / width) as i64, k % 3);
            let at = |p: &[u8], i: i64, j: i64| {
                let inside = y + i >= 0 && x + j >= 0 && y + i < height as i64 && x + j < width as i64;
                if inside { f64::from(p[3 * ((y + i) as usize * width + (x + j) as usize) + c]) / 255.0 } else { 0.0 }
            };
            let mean = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
                let taps = (-5..=5).flat_map(|i| (-5..=5).map(move |j| (i, j)));
                taps.map(|(i, j)| weight(i, j) / total * f(at(a, i, j), at(b, i, j))).sum()
            };
            let (mx, my) = (mean(&|p, _| p), mean(&|_, q| q));
            let (vx, vy) = (mean(&|p, _| (p - mx) * (p - mx)), mean(&|_, q| (q - my) * (q - my)));
            let cov = mean(&|p, q| (p - mx) * (q - my));
            sum += (2.0 * mx * my + 1e-4) / (mx * mx + my * my + 1e-4) * (2.0 * cov + 9e-4) / (vx + vy + 9e-4);
        }
        sum / a.len() as f64
    }

    #[test]
    fn ssim_is_its_definition_on_fixed_pictures() {
        for (width, height) in [(1, 1), (3, 2), (11, 11), (23, 17)] {
            let original = picture(width, height, 0);
            let pictures = [
                original.clone(),
                picture(width, height, 3),
                original.iter().map(|v| v / 2).collect(),
                original.iter().map(|v| 255 - v).collect(),
                vec![0; original.len()],
                vec![255; original.len()],
            ];
            for a in &pictures {
                for b in &pictures {
                    let (got, want) = (ssim(a, b, width, height).unwrap(), plain(a, b, width, height));
                    assert!((got - want).abs() < 1e-9, "{width}x{height}: {got} instead of {want}");
                }
                assert!((ssim(a, a, width, height).unwrap() - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn ssim_of_flat_pictures_is_the_luminance_term() {
        // Summed over a square of side w this is I (w - 10)^2 + E (w - 10) + C with I the value where the window is
        // full, E and C those of edges and corners, where the padding has structure: the second difference in w is 2 I.
        let total = |w: usize| {
            let pixels = 3 * w * w;
            ssim(&vec![51; pixels], &vec![204; pixels], w, w).unwrap() * (w * w) as f64
        };
        let full = (total(21) - 2.0 * total(20) + total(19)) / 2.0;
        let flat = (2.0 * 0.2 * 0.8 + 1e-4) / (0.04 + 0.64 + 1e-4);
        assert!((full - flat).abs() < 1e-9, "{full} instead of {flat}");
    }

    #[test]
    fn masked_pixels_have_no_part_and_the_others_their_full_windows() {
        let (width, height) = (23, 17);
        let (a, b) = (picture(width, height, 0), picture(width, height, 3));
        let all = vec![true; width * height];
        assert_eq!(ssim_where(&a, &b, &all, width, height), ssim(&a, &b, width, height));
        assert_eq!(psnr_where(&a, &b, &all), psnr(&a, &b));
        let counts: Vec<bool> = (0..width * height).map(|k| k % width > 6 && k % 5 != 2).collect();
        let mut other = a.clone();
        other.chunks_exact_mut(3).zip(&counts).filter(|(_, c)| !**c).for_each(|(p, _)| p.fill(99));
        assert_eq!(ssim_where(&other, &b, &counts, width, height), ssim_where(&a, &b, &counts, width, height));
        assert_eq!(psnr_where(&other, &b, &counts), psnr_where(&a, &b, &counts));
        // The definition: SSIM's map of the picture with the masked pixels replaced, averaged where pixels count.
        let mut shown = a.clone();
        let covered = |k: &usize| !counts[*k / 3];
        (0..a.len()).filter(covered).for_each(|k| shown[k] = b[k]);
        let single = |k: usize| {
            let only: Vec<bool> = (0..width * height).map(|i| i == k).collect();
            mean_ssim(&shown, &b, Some(&only), width, height).unwrap()
        };
        let counted: Vec<usize> = (0..width * height).filter(|k| counts[*k]).collect();
        let want = counted.iter().map(|k| single(*k)).sum::<f64>() / counted.len() as f64;
        assert!((ssim_where(&a, &b, &counts, width, height).unwrap() - want).abs() < 1e-12);
        assert_eq!(ssim_where(&a, &b, &vec![false; width * height], width, height), None);
        assert_eq!(psnr_where(&a, &b, &vec![false; width * height]), None);
    }

    #[test]
    fn psnr_by_hand() {
        assert_eq!(psnr(&[1, 2, 3], &[1, 2, 3]), Some(f64::INFINITY));
        assert_eq!(psnr(&[1], &[1, 2]), None);
        assert_eq!(psnr(&[], &[]), None);
        // One value of four off by 51 = a fifth of the range: mean square 1/100.
        assert!((psnr(&[0, 0, 0, 51], &[0; 4]).unwrap() - 20.0).abs() < 1e-12);
        assert!((psnr(&[0; 3], &[255; 3]).unwrap()).abs() < 1e-12);
        assert_eq!(ssim(&[0; 12], &[0; 12], 2, 3), None);
    }
}
