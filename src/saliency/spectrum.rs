//! The spectrum of an image, and saliency maps from it.

use std::f64::consts::{PI, TAU};

use rustfft::num_complex::Complex64;

use super::blur::{at, gaussian};
use super::features::{Features, radial};
use super::fft::{Fft2, quick_length};
use super::{Border, Error, Map, Plane, Settings};

/// An image whose standard deviation is below this share of its largest value counts as one colour: its variation is
/// rounding.
const FLAT: f64 = 1e-6;

/// What all maps of an image share, whatever sigma is.
///
/// The spectral residual is the logarithm of the amplitudes minus its average over neighbouring frequencies (Hou and
/// Zhang 2007). Here a Gaussian of standard deviation sigma weights the average, over a periodic spectrum, as a sampled
/// image has. In the transform of the spectrum (the cepstrum) the average is a product with exp(-2 pi^2 s^2 d^2), where
/// d is the distance in pixels and s = sigma/256 is in cycles per pixel: exact for every sigma, 0 included, and smooth
/// in sigma. Sigma therefore counts frequency bins of an image of 256 pixels, whatever the image's size, and is the
/// same number of cycles per pixel along both axes.
pub struct Spectrum {
    image: (usize, usize),
    padded: (usize, usize),
    origin: (usize, usize),
    fft: Fft2,
    /// F / (|F| + noise): the phase where the amplitude exceeds the noise, and 0 in the bin of the mean.
    phase: Vec<Complex64>,
    /// Transform of the logarithms of the amplitudes; real and even, as the logarithms are.
    cepstrum: Vec<f64>,
    features: Features,
    flat: bool,
    settings: Settings,
}

impl Spectrum {
    /// Transforms an image at its own size.
    pub fn new(image: &Plane, settings: &Settings) -> Result<Self, Error> {
        settings.check()?;
        let size = (image.width() as usize, image.height() as usize);
        let (across, down) = (Side::new(size.0, settings), Side::new(size.1, settings));
        let padded = (across.weights.len(), down.weights.len());
        let fft = Fft2::new(padded.0, padded.1);
        let mut spectrum = Self {
            image: size,
            padded,
            origin: (across.origin, down.origin),
            fft,
            phase: Vec::new(),
            cepstrum: Vec::new(),
            features: Features::default(),
            flat: true,
            settings: settings.clone(),
        };
        if let Some(values) = faded(image, &across, &down) {
            spectrum.analyse(values);
        }
        Ok(spectrum)
    }

    fn analyse(&mut self, mut values: Vec<Complex64>) {
        self.fft.forward(&mut values);
        let bins = values.len();
        // The mean was removed, so the first bin holds rounding only and no statistic counts it.
        let mean = values.iter().skip(1).map(|f| f.norm()).sum::<f64>() / bins as f64;
        if mean.is_nan() || mean <= 0.0 {
            return;
        }
        let noise = self.settings.epsilon * mean;
        // Relative to the mean amplitude, so that brightness and contrast cancel.
        let mut logarithms: Vec<f64> = values.iter().map(|f| ((f.norm() + noise) / mean).ln()).collect();
        logarithms[0] = self.around_the_mean(&logarithms);
        self.phase = values.iter().map(|f| f / (f.norm() + noise)).collect();
        self.phase[0] = Complex64::default();
        self.features = radial(&logarithms, self.padded, self.image);
        let mut cepstrum: Vec<Complex64> = logarithms.iter().map(|l| Complex64::new(*l, 0.0)).collect();
        self.fft.forward(&mut cepstrum);
        self.cepstrum = cepstrum.iter().map(|c| c.re).collect();
        self.flat = false;
    }

    /// The mean of the neighbours of the first bin, which is empty. Without a replacement the average would spread the
    /// hole to other bins.
    fn around_the_mean(&self, logarithms: &[f64]) -> f64 {
        let (w, h) = self.padded;
        let others = [0, 1, h - 1]
            .into_iter()
            .flat_map(|y| [0, 1, w - 1].map(|x| (y % h) * w + x % w))
            .filter(|k| *k != 0)
            .map(|k| logarithms[k]);
        let (sum, count) = others.fold((0.0, 0.0), |(sum, count), l| (sum + l, count + 1.0));
        if count > 0.0 { sum / count } else { 0.0 }
    }

    /// Shape of the amplitudes by frequency.
    pub fn features(&self) -> &Features {
        &self.features
    }

    /// Whether the image is of one colour, and has no map.
    pub fn is_flat(&self) -> bool {
        self.flat
    }

    /// Width and height of the image and of its maps.
    pub fn size(&self) -> (u32, u32) {
        (self.image.0 as u32, self.image.1 as u32)
    }

    /// The settings given to [`Self::new`].
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The saliency map for a filter of `sigma` bins of 256, with its derivative. With sigma 0 the map is that of the
    /// phase alone. An image of one colour has a map of zeros.
    pub fn map(&self, sigma: f64) -> Result<Map, Error> {
        Settings::check_sigma(sigma)?;
        let pixels = self.image.0 * self.image.1;
        if self.flat {
            return Ok(Map::new(self.size(), vec![0.0; pixels], vec![0.0; pixels], &self.settings));
        }
        // Real and imaginary parts are the residual and its derivative: both are real, so one transform makes both.
        let mut residual = self.residual_cepstrum(sigma);
        self.fft.inverse(&mut residual);
        let mut picture = residual;
        for (r, phase) in picture.iter_mut().zip(&self.phase) {
            *r = phase * r.re.exp() * Complex64::new(1.0, r.im);
        }
        self.fft.inverse(&mut picture);

        let (mut energy, mut slope) = (Vec::with_capacity(pixels), Vec::with_capacity(pixels));
        for row in picture.chunks_exact(self.padded.0).skip(self.origin.1).take(self.image.1) {
            for z in &row[self.origin.0..][..self.image.0] {
                energy.push(z.re * z.re);
                slope.push(2.0 * z.re * z.im);
            }
        }
        let (width, height) = self.size();
        let blur = self.settings.blur_of(width, height);
        let blurred = |values| gaussian(values, self.image, blur, self.settings.border);
        Ok(Map::new((width, height), blurred(energy), blurred(slope), &self.settings))
    }

    fn residual_cepstrum(&self, sigma: f64) -> Vec<Complex64> {
        let (w, h) = self.padded;
        let s = sigma / 256.0;
        let squares = |n: usize| -> Vec<f64> { (0..n).map(|i| (i.min(n - i) as f64).powi(2)).collect() };
        let across = squares(w);
        let mut result = Vec::with_capacity(w * h);
        for (row, dy) in self.cepstrum.chunks_exact(w).zip(squares(h)) {
            result.extend(row.iter().zip(&across).map(|(c, dx)| {
                let a = TAU * PI * (dx + dy);
                let kept = (-a * s * s).exp();
                // exp(-a s^2) - 1 without cancellation where a s^2 is small.
                Complex64::new(-c * (-a * s * s).exp_m1(), c * kept * 2.0 * a * s / 256.0)
            }));
        }
        result
    }
}

/// One side of the padded image.
struct Side {
    /// Where the image begins.
    origin: usize,
    /// Index of the image's pixel at each position.
    source: Vec<usize>,
    /// 1 in the image, falling to 0 outside.
    weights: Vec<f64>,
}

impl Side {
    fn new(n: usize, settings: &Settings) -> Self {
        if settings.border == Border::Periodic {
            return Self { origin: 0, source: (0..n).collect(), weights: vec![1.0; n] };
        }
        let length = quick_length(n + 2 * (n as f64 * settings.pad).ceil() as usize);
        let origin = (length - n) / 2;
        let weight = |i: usize| {
            let (before, after) = (origin.saturating_sub(i), (i + 1).saturating_sub(origin + n));
            let (outside, width) = if before > 0 { (before, origin) } else { (after, length - n - origin) };
            0.5 + 0.5 * (PI * outside as f64 / (width + 1) as f64).cos()
        };
        let source = (0..length).map(|i| at(i as isize - origin as isize, n, Border::Reflect)).collect();
        Self { origin, source, weights: (0..length).map(weight).collect() }
    }
}

/// The padded image, minus its mean and faded out, so that its sum is 0. `None` for an image of one colour.
fn faded(image: &Plane, across: &Side, down: &Side) -> Option<Vec<Complex64>> {
    let values = image.values();
    let width = image.width() as usize;
    let sum = |of: &dyn Fn(f64) -> f64| -> f64 {
        let mut sum = 0.0;
        for (y, wy) in down.source.iter().zip(&down.weights) {
            let row = &values[y * width..][..width];
            sum += wy * across.source.iter().zip(&across.weights).map(|(x, w)| w * of(f64::from(row[*x]))).sum::<f64>();
        }
        sum
    };
    let total = across.weights.iter().sum::<f64>() * down.weights.iter().sum::<f64>();
    let mean = sum(&|v| v) / total;
    let deviation = (sum(&|v| (v - mean).powi(2)) / total).sqrt();
    let largest = values.iter().fold(0.0, |m: f64, v| m.max(f64::from(v.abs())));
    if deviation.is_nan() || deviation <= FLAT * largest {
        return None;
    }
    let mut result = Vec::with_capacity(across.source.len() * down.source.len());
    for (y, wy) in down.source.iter().zip(&down.weights) {
        let row = &values[y * width..][..width];
        // In units of the deviation: the squares of very dark images stay far from the smallest numbers.
        let one = |(x, w): (&usize, &f64)| Complex64::new(w * wy * (f64::from(row[*x]) - mean) / deviation, 0.0);
        result.extend(across.source.iter().zip(&across.weights).map(one));
    }
    Some(result)
}
