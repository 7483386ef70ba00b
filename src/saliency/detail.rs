//! How much of a photograph's spectrum a reduced copy of it keeps.

use rustfft::num_complex::Complex64;

use super::Plane;
use super::fft::Fft2;

/// Shares of the amplitude of an image's spectrum (the mean apart) that copies of a half and of a quarter of its size hold: those of
/// the frequencies below a half and a quarter of the image's highest, along both axes. 1 for an image of one colour.
pub fn kept_when_reduced(image: &Plane) -> [f64; 2] {
    let (w, h) = (image.width() as usize, image.height() as usize);
    let mean = image.values().iter().map(|v| f64::from(*v)).sum::<f64>() / image.values().len() as f64;
    // A border that does not continue on the other side would be a detail of its own: it fades out.
    let fade = |k: usize, n: usize| (std::f64::consts::PI * (k as f64 + 0.5) / n as f64).sin().powi(2);
    let value = |k: usize| {
        let faded = (f64::from(image.values()[k]) - mean) * fade(k % w, w) * fade(k / w, h);
        Complex64::new(faded, 0.0)
    };
    let mut spectrum: Vec<Complex64> = (0..w * h).map(value).collect();
    Fft2::new(w, h).forward(&mut spectrum);
    let along = |k: usize, n: usize| k.min(n - k) as f64 / n as f64;
    let mut sums = [0.0; 3];
    for (k, f) in spectrum.iter().enumerate().skip(1) {
        let frequency = along(k % w, w).max(along(k / w, h));
        for (sum, highest) in sums.iter_mut().zip([0.5, 0.25, 0.125]) {
            if frequency <= highest {
                *sum += f.norm();
            }
        }
    }
    let [all, half, quarter] = sums;
    // What rounding leaves of one colour is no spectrum.
    if all > 1e-9 * spectrum.len() as f64 { [half / all, quarter / all] } else { [1.0; 2] }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waves(across: f64) -> Plane {
        let value = |k: usize| (0.5 + 0.3 * (std::f64::consts::TAU * across * (k % 96) as f64).sin()) as f32;
        Plane::new(96, 64, (0..96 * 64).map(value).collect()).unwrap()
    }

    #[test]
    fn slow_waves_are_kept_and_fast_ones_are_not() {
        let [half, quarter] = kept_when_reduced(&waves(0.05));
        assert!(half > 0.97 && quarter > 0.95, "{half}, {quarter}");
        let [half, quarter] = kept_when_reduced(&waves(0.2));
        assert!(half > 0.97 && quarter < 0.1, "{half}, {quarter}");
        let [half, quarter] = kept_when_reduced(&waves(0.4));
        assert!(half < 0.1 && quarter < 0.1, "{half}, {quarter}");
        assert_eq!(kept_when_reduced(&Plane::new(8, 6, vec![0.25; 48]).unwrap()), [1.0; 2]);
        let one = kept_when_reduced(&Plane::new(1, 1, vec![0.25]).unwrap());
        assert_eq!(one, [1.0; 2]);
    }
}
