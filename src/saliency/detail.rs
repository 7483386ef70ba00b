//! How close splats have to be to show a photograph.

use super::{Border, Error, Plane, blur};

/// Spacings that are tried, in pixels: from 1 up by factors of the square root of two.
const SPACINGS: usize = 8;
/// Standard deviation, in spacings, of the blur that splats of one spacing come to.
const BLUR: f64 = 0.5;
/// Contrast of common texture: the standard deviation of luma, from 0 to 1.
const CONTRAST: f64 = 0.05;
/// Standard deviation, in pixels, of the window for local contrast.
const AROUND: f64 = 4.0;
/// Luma error that nobody sees.
const NOISE: f64 = 0.004;
/// Standard deviation, in spacings, of the window in which what is lost is averaged.
const WINDOW: f64 = 1.0;

/// The widest spacing of splats, in pixels and for each pixel, at which the root mean square of what they lose of the
/// luma stays within `share(pixel)` times the geometric mean of the local contrast and of 0.05: 1 where no
/// spacing does, and the widest, about 11, where all do. Spacings between those that are tried are interpolated by
/// logarithms.
///
/// A share of the contrast alone would follow noise in a clear sky; an error alone would leave faint texture out.
pub fn spacing(luma: &Plane, share: impl Fn(usize) -> f64) -> Result<Plane, Error> {
    let size = (luma.width() as usize, luma.height() as usize);
    let values: Vec<f64> = luma.values().iter().map(|v| f64::from(*v)).collect();
    let steps: Vec<f64> = (0..SPACINGS).map(|k| 2.0_f64.powf(k as f64 / 2.0)).collect();
    let lost = |spacing: &f64| {
        let blurred = blur::gaussian(values.clone(), size, BLUR * spacing, Border::Reflect);
        let squares = values.iter().zip(&blurred).map(|(v, b)| (v - b).powi(2)).collect();
        blur::gaussian(squares, size, WINDOW * spacing, Border::Reflect)
    };
    let lost: Vec<Vec<f64>> = steps.iter().map(lost).collect();
    let means = blur::gaussian(values.clone(), size, AROUND, Border::Reflect);
    let squares = values.iter().zip(&means).map(|(v, mean)| (v - mean).powi(2)).collect();
    let contrasts = blur::gaussian(squares, size, AROUND, Border::Reflect);
    let of = |pixel: usize| {
        let bound = (share(pixel).powi(2) * CONTRAST * contrasts[pixel].sqrt()).max(NOISE * NOISE);
        let Some(first) = lost.iter().position(|lost| lost[pixel] > bound) else { return steps[SPACINGS - 1] };
        if first == 0 {
            return steps[0];
        }
        let (before, after) = (lost[first - 1][pixel].max(f64::MIN_POSITIVE), lost[first][pixel]);
        let share = ((bound / before).ln() / (after / before).ln()).clamp(0.0, 1.0);
        steps[first - 1] * (steps[first] / steps[first - 1]).powf(share)
    };
    Ok(Plane::of(luma.width(), luma.height(), (0..values.len()).map(of)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(value: impl Fn(usize, usize) -> f64) -> Plane {
        Plane::of(64, 64, (0..64 * 64).map(|k| value(k % 64, k / 64)))
    }

    fn middle(plane: &Plane, share: f64) -> f64 {
        f64::from(spacing(plane, |_| share).expect("a plane").values()[32 * 64 + 32])
    }

    #[test]
    fn spacing_follows_the_wavelength() {
        let wave = |length: f64| of(move |x, _| 0.5 + 0.1 * (std::f64::consts::TAU * x as f64 / length).sin());
        let [short, long] = [8.0, 16.0].map(|length| middle(&wave(length), 0.3));
        assert!((long / short - 2.0).abs() < 0.2, "{short} {long}");
        assert!(middle(&wave(8.0), 0.15) < 0.8 * short, "less error asks for more splats");
    }

    #[test]
    fn flat_fields_and_noise_have_the_widest_spacing() {
        assert!(middle(&of(|_, _| 0.5), 0.3) > 11.0);
        assert!(middle(&of(|x, y| 0.5 + 0.002 * f64::from((x * 7 + y * 3) as u32 % 3)), 0.3) > 11.0);
        assert!(middle(&of(|x, y| f64::from((x + y) as u32 % 2)), 0.3) <= 1.0, "a checkerboard needs every pixel");
    }
}
