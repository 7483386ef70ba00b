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

/// Standard deviation, in spacings, of the window in which variation is averaged: more than a splat's own place, whose
/// few gradients agree by chance.
const VARIATION_WINDOW: f64 = 2.0;
/// Spacings for which variation is computed: 1, 2, 4 and 8 pixels.
const VARIATION_LEVELS: usize = 4;

/// The widest spacing that [`spacing`] tries, in pixels.
pub const WIDEST_SPACING: f64 = 11.313_708;

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

/// As [`spacing`], where the mask says what may be lost: from `errors[0]` of the contrast at 0 to `errors[1]` at 1,
/// between them by logarithms.
pub fn spacing_by_mask(luma: &Plane, mask: &Plane, errors: [f64; 2]) -> Result<Plane, Error> {
    Error::check("the mask", mask.values().len(), luma.values().len())?;
    let [low, high] = errors.map(f64::ln);
    spacing(luma, |pixel| (low + (high - low) * f64::from(mask.values()[pixel])).exp())
}

/// The structure tensor of luma (the xx, xy and yy parts of the mean product of gradients, per squared pixel) at
/// places, each a pixel and the spacing of splats there: of what such splats show of the luma, over two spacings around.
/// Flat fields and noise have less than [`variation_floor`].
pub fn variation(luma: &Plane, places: &[(usize, f64)]) -> Vec<[f64; 3]> {
    let size = (luma.width() as usize, luma.height() as usize);
    let values: Vec<f64> = luma.values().iter().map(|v| f64::from(*v)).collect();
    let level = |spacing: f64| spacing.log2().round().clamp(0.0, VARIATION_LEVELS as f64 - 1.0) as usize;
    let mut found = vec![[0.0; 3]; places.len()];
    for k in 0..VARIATION_LEVELS {
        let at: Vec<usize> = (0..places.len()).filter(|&i| level(places[i].1) == k).collect();
        if at.is_empty() {
            continue;
        }
        let spacing = f64::from(1_u32 << k);
        let gradients = scharr(&blur::gaussian(values.clone(), size, BLUR * spacing, Border::Reflect), size);
        let parts = [[0, 0], [0, 1], [1, 1]].map(|[a, b]| {
            let products = gradients.iter().map(|gradient| gradient[a] * gradient[b]).collect();
            blur::gaussian(products, size, VARIATION_WINDOW * spacing, Border::Reflect)
        });
        for i in at {
            found[i] = [0, 1, 2].map(|part| parts[part].get(places[i].0).copied().unwrap_or(0.0));
        }
    }
    found
}

/// Variation below which nothing is seen, at a spacing: an invisible difference of luma from one splat to the next.
pub fn variation_floor(spacing: f64) -> f64 {
    (NOISE / spacing).powi(2)
}

/// Derivatives along x and y, with Scharr's weights: equally exact in all directions.
fn scharr(values: &[f64], (width, height): (usize, usize)) -> Vec<[f64; 2]> {
    let at = |x: usize, dx: isize, y: usize, dy: isize| {
        let column = blur::at(x as isize + dx, width, Border::Reflect);
        values[blur::at(y as isize + dy, height, Border::Reflect) * width + column]
    };
    let weights = [(-1, 3.0 / 32.0), (0, 10.0 / 32.0), (1, 3.0 / 32.0)];
    let of = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let along_x = weights.iter().map(|&(d, weight)| weight * (at(x, 1, y, d) - at(x, -1, y, d))).sum();
        let along_y = weights.iter().map(|&(d, weight)| weight * (at(x, d, y, 1) - at(x, d, y, -1))).sum();
        [along_x, along_y]
    };
    (0..values.len()).map(of).collect()
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

    /// A wave in a direction, of a length well above the spacing: variation is a^2 (2 pi / length)^2 / 2 along it.
    #[test]
    fn variation_is_that_of_the_wave_in_its_direction() {
        let (length, amplitude) = (16.0, 0.1);
        for degrees in [0.0_f64, 25.0, 45.0, 90.0, 160.0] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let phase = |x: usize, y: usize| std::f64::consts::TAU * (x as f64 * cos + y as f64 * sin) / length;
            let plane = of(|x, y| 0.5 + amplitude * phase(x, y).sin());
            let middles: Vec<(usize, f64)> = (0..16).map(|k| ((24 + k) * 64 + 24 + k, 2.0)).collect();
            let all = variation(&plane, &middles);
            let [xx, xy, yy] = [0, 1, 2].map(|part| all.iter().map(|found| found[part]).sum::<f64>() / 16.0);
            let along = xx * cos * cos + 2.0 * xy * cos * sin + yy * sin * sin;
            let across = xx * sin * sin - 2.0 * xy * cos * sin + yy * cos * cos;
            // The blur of a splat's spacing, which takes 14 % of the amplitude, and the finite difference lower it.
            let want = (amplitude * std::f64::consts::TAU / length).powi(2) / 2.0;
            assert!((0.6..0.9).contains(&(along / want)), "{degrees}: {along} of {want}");
            assert!(across.abs() < 1e-3 * along, "{degrees}: {across} across, {along} along");
        }
        assert!(variation(&of(|_, _| 0.5), &[(2080, 4.0)])[0].iter().all(|v| v.abs() < 1e-12));
        let faint = variation(&of(|x, y| 0.5 + 0.002 * f64::from((x * 7 + y * 3) as u32 % 3)), &[(2080, 4.0)])[0];
        assert!(faint.iter().all(|v| *v < variation_floor(4.0)), "{faint:?}");
    }

    #[test]
    fn flat_fields_and_noise_have_the_widest_spacing() {
        assert!(middle(&of(|_, _| 0.5), 0.3) >= WIDEST_SPACING);
        assert!(middle(&of(|x, y| 0.5 + 0.002 * f64::from((x * 7 + y * 3) as u32 % 3)), 0.3) > 11.0);
        assert!(middle(&of(|x, y| f64::from((x + y) as u32 % 2)), 0.3) <= 1.0, "a checkerboard needs every pixel");
    }
}
