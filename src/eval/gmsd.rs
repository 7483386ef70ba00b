//! Gradient magnitude similarity deviation (Xue, Zhang, Mou, Bovik 2014), a measure that nothing trains on.

/// Keeps quotients finite in flat places, for luma from 0 to 255.
const C: f64 = 170.0;

/// Of two RGB pictures (interleaved bytes): the standard deviation over pixels of the similarity of their gradient
/// magnitudes (Prewitt) on luma averaged over 2x2 pixels. 0 for equal pictures. Where `counts` is false for one of the
/// four pixels there is nothing. `None` where sizes do not agree or no pixel has a neighbour on every side.
pub fn gmsd(a: &[u8], b: &[u8], counts: Option<&[bool]>, width: usize, height: usize) -> Option<f64> {
    if a.len() != 3 * width * height || b.len() != a.len() || counts.is_some_and(|c| c.len() != width * height) {
        return None;
    }
    let (w, h) = (width / 2, height / 2);
    if w < 3 || h < 3 {
        return None;
    }
    let luma = |p: &[u8]| 0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2]);
    let corners = |k: usize| {
        let first = 2 * (k / w) * width + 2 * (k % w);
        [first, first + 1, first + width, first + width + 1]
    };
    let there: Vec<bool> = (0..w * h).map(|k| counts.is_none_or(|c| corners(k).iter().all(|i| c[*i]))).collect();
    let reduced = |picture: &[u8]| -> Vec<f64> {
        (0..w * h).map(|k| corners(k).iter().map(|i| luma(&picture[3 * i..3 * i + 3])).sum::<f64>() / 4.0).collect()
    };
    let (a, b) = (reduced(a), reduced(b));
    let magnitude = |p: &[f64], x: usize, y: usize| {
        let at = |dx: usize, dy: usize| p[(y + dy - 1) * w + x + dx - 1];
        let across: f64 = (0..3).map(|d| at(2, d) - at(0, d)).sum::<f64>() / 3.0;
        let down: f64 = (0..3).map(|d| at(d, 2) - at(d, 0)).sum::<f64>() / 3.0;
        across.hypot(down)
    };
    let mut values = Vec::new();
    for y in 1..h - 1 {
        for x in 1..w - 1 {
            if (0..9).all(|k| there[(y + k / 3 - 1) * w + x + k % 3 - 1]) {
                let (p, q) = (magnitude(&a, x, y), magnitude(&b, x, y));
                values.push((2.0 * p * q + C) / (p * p + q * q + C));
            }
        }
    }
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (!values.is_empty()).then(|| (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt())
}

#[cfg(test)]
mod tests {
    use super::gmsd;

    fn picture(value: impl Fn(usize, usize) -> u8) -> Vec<u8> {
        (0..16 * 12).flat_map(|k| [value(k % 16, k / 16); 3]).collect()
    }

    #[test]
    fn equal_and_shifted_pictures_have_none_and_flat_ones_a_little() {
        let stripes = picture(|x, y| (40 * (x / 2 % 3) + 11 * (y / 2 % 4)) as u8);
        assert_eq!(gmsd(&stripes, &stripes, None, 16, 12), Some(0.0));
        // A brighter picture has the same gradients.
        let brighter: Vec<u8> = stripes.iter().map(|v| v + 20).collect();
        assert!(gmsd(&stripes, &brighter, None, 16, 12).unwrap() < 1e-12);
        // Half of it without its stripes.
        let half = picture(|x, y| if x < 8 { 60 } else { (40 * (x / 2 % 3) + 11 * (y / 2 % 4)) as u8 });
        assert!(gmsd(&stripes, &half, None, 16, 12).unwrap() > 0.05);
    }

    /// A step edge against a flat picture: two of the six columns inside have gradient 100 (Prewitt), where the
    /// similarity is C / (100^2 + C); the others have 1.
    #[test]
    fn a_step_is_as_by_hand() {
        let step = picture(|x, _| if x < 8 { 0 } else { 100 });
        let low = 170.0 / (100.0_f64.powi(2) + 170.0);
        let share = 2.0_f64 / 6.0;
        let want = (share * (1.0 - share)).sqrt() * (1.0 - low);
        let got = gmsd(&step, &picture(|_, _| 0), None, 16, 12).unwrap();
        assert!((got - want).abs() < 1e-12, "{got} for {want}");
    }

    #[test]
    fn what_does_not_count_is_left_out_and_sizes_are_checked() {
        let step = picture(|x, _| if x < 8 { 0 } else { 100 });
        let counts: Vec<bool> = (0..16 * 12).map(|k| k % 16 < 7).collect();
        assert_eq!(gmsd(&step, &picture(|_, _| 0), Some(&counts), 16, 12), Some(0.0));
        assert_eq!(gmsd(&step, &step, Some(&[false; 16 * 12]), 16, 12), None);
        assert_eq!(gmsd(&step, &step, None, 12, 12), None);
        assert_eq!(gmsd(&[0; 48], &[0; 48], None, 4, 4), None);
    }
}
