//! Made-up images.

use psrgs_vk::saliency::Plane;
use psrgs_vk::scene::random::Random;

/// An image of a function of (x, y), rounded to 1/256 so that halving and adding quarters is exact.
pub fn drawn(width: u32, height: u32, mut f: impl FnMut(f64, f64) -> f64) -> Plane {
    let mut values = Vec::new();
    for y in 0..height {
        for x in 0..width {
            values.push(((256.0 * f(f64::from(x), f64::from(y)).clamp(0.0, 1.0)).round() / 256.0) as f32);
        }
    }
    Plane::new(width, height, values).expect("an image")
}

/// Waves of random direction and phase, with amplitudes that fall with the frequency as in photographs. All waves are
/// periodic over the image.
pub fn waves(width: u32, height: u32, seed: u64) -> Plane {
    let mut random = Random::new(seed);
    let (w, h) = (f64::from(width), f64::from(height));
    let waves: Vec<[f64; 4]> = (0..40)
        .map(|_| {
            let side = |n: f64, roll: f64| ((roll - 0.5) * n * 0.8).round();
            let (u, v) = (side(w, random.unit()), side(h, random.unit()));
            let f = (u / w).hypot(v / h).max(1.0 / w.min(h));
            [u / w, v / h, random.unit() * std::f64::consts::TAU, 0.006 / f]
        })
        .collect();
    drawn(width, height, |x, y| {
        0.5 + waves.iter().map(|[u, v, p, a]| a * (std::f64::consts::TAU * (u * x + v * y) + p).cos()).sum::<f64>()
    })
}

/// Soft light and shade with a square of noise, whose upper left corner is `at`.
pub fn patch(width: u32, height: u32, at: (f64, f64), side: f64, seed: u64) -> Plane {
    let mut random = Random::new(seed);
    drawn(width, height, |x, y| {
        let inside = (at.0..at.0 + side).contains(&x) && (at.1..at.1 + side).contains(&y);
        let noise = random.unit() - 0.5;
        0.5 + 0.2 * (0.03 * x).sin() * (0.02 * y).cos() + if inside { 0.3 * noise } else { 0.01 * noise }
    })
}

/// Index of the pixel (x, y).
pub fn index(plane: &Plane, x: u32, y: u32) -> usize {
    (y * plane.width() + x) as usize
}

/// The largest absolute difference.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}
