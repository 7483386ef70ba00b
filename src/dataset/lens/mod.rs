//! Lenses: projects rays of the camera frame into a photograph with distortion, and back.
//!
//! The formulas are those of OpenCV and COLMAP in normalised coordinates (x, y) = (X / Z, Y / Z). With r the distance
//! from the axis and s = r^2, a ray lands at (x h, y h) plus the tangential part. Lenses differ in h(s) only.

pub(super) mod names;
mod pinhole;

/// COLMAP's names of the camera models that become a [`Lens`].
pub(crate) const SUPPORTED_MODELS: &str = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, \
                                    SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE and OPENCV_FISHEYE";

/// How a lens bends rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// Brown's model with a rational radial part: h = (1 + n1 s + n2 s^2 + n3 s^3 + n4 s^4) / (1 + d1 s + d2 s^2 + d3
    /// s^3), and tangentially (2 p1 x y + p2 (s + 2 x^2), 2 p2 x y + p1 (s + 2 y^2)).
    Brown {
        /// n1 to n4.
        numerator: [f64; 4],
        /// d1 to d3.
        denominator: [f64; 3],
        /// p1 and p2.
        tangential: [f64; 2],
    },
    /// The equidistant fisheye (Kannala and Brandt 2006, OpenCV): h = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8) / r
    /// with t = atan r the angle from the axis.
    Fisheye {
        /// k1 to k4.
        k: [f64; 4],
    },
}

/// Rays further from the axis are outside every image of a pinhole camera.
const MOST_DEGREES: f64 = 85.0;
/// Steps of the search for the end of a lens's range.
const STEPS: u32 = 2048;

impl Distortion {
    /// Brown's model with a polynomial radial part.
    pub fn brown(k: [f64; 3], tangential: [f64; 2]) -> Self {
        Self::Brown { numerator: [k[0], k[1], k[2], 0.0], denominator: [0.0; 3], tangential }
    }

    /// Whether the lens has no distortion.
    pub fn is_none(&self) -> bool {
        match self {
            Self::Brown { numerator, denominator, tangential } => {
                numerator.iter().chain(denominator).chain(tangential).all(|v| *v == 0.0)
            }
            Self::Fisheye { .. } => false,
        }
    }

    /// h, and its derivative with respect to r divided by r.
    fn radial(&self, s: f64) -> (f64, f64) {
        match self {
            Self::Brown { numerator: [a, b, c, d], denominator: [e, f, g], .. } => {
                let top = 1.0 + s * (a + s * (b + s * (c + s * d)));
                let bottom = 1.0 + s * (e + s * (f + s * g));
                let of_top = a + s * (2.0 * b + s * (3.0 * c + s * 4.0 * d));
                let of_bottom = e + s * (2.0 * f + s * 3.0 * g);
                (top / bottom, 2.0 * (of_top * bottom - top * of_bottom) / (bottom * bottom))
            }
            Self::Fisheye { k: [a, b, c, d] } => {
                if s < 1e-12 {
                    // t / r = 1 - s / 3 + ...
                    return (1.0, 2.0 * (a - 1.0 / 3.0));
                }
                let r = s.sqrt();
                let t = r.atan();
                let q = t * t;
                let bent = t * (1.0 + q * (a + q * (b + q * (c + q * d))));
                let slope = 1.0 + q * (3.0 * a + q * (5.0 * b + q * (7.0 * c + q * 9.0 * d)));
                (bent / r, (slope / (1.0 + s) - bent / r) / s)
            }
        }
    }

    fn tangential(&self) -> [f64; 2] {
        match self {
            Self::Brown { tangential, .. } => *tangential,
            Self::Fisheye { .. } => [0.0; 2],
        }
    }

    /// Whether the distance from the image's centre still grows with the ray's angle from the axis.
    fn grows(&self, angle: f64) -> bool {
        let s = angle.tan().powi(2);
        let (h, slope) = self.radial(s);
        h > 0.0 && h.is_finite() && h + s * slope > 0.0
    }

    /// The distance from the axis up to which the image point moves outwards with the ray. Beyond it the polynomial
    /// turns back and describes nothing that was calibrated.
    fn reach(&self) -> f64 {
        let most = MOST_DEGREES.to_radians();
        let angle = |i: u32| most * f64::from(i) / f64::from(STEPS);
        let Some(end) = (1..=STEPS).find(|i| !self.grows(angle(*i))) else { return most.tan() };
        let (mut inside, mut outside) = (angle(end - 1), angle(end));
        for _ in 0..60 {
            let middle = 0.5 * (inside + outside);
            if self.grows(middle) { inside = middle } else { outside = middle }
        }
        inside.tan()
    }
}

/// A calibrated camera with a lens, for one image size. Pixel coordinates are those of [`crate::scene::Camera`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Focal lengths in pixels.
    pub focal: [f64; 2],
    /// Principal point in pixels.
    pub center: [f64; 2],
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// The distortion of rays.
    pub distortion: Distortion,
    reach: f64,
}

impl Lens {
    /// A lens. Determines once how far from the axis `distortion` holds.
    pub fn new(focal: [f64; 2], center: [f64; 2], size: [u32; 2], distortion: Distortion) -> Self {
        Self { focal, center, size, distortion, reach: distortion.reach() }
    }

    /// The same lens for images of another size.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let by = [f64::from(width) / f64::from(self.size[0]), f64::from(height) / f64::from(self.size[1])];
        let scaled = |v: [f64; 2]| [v[0] * by[0], v[1] * by[1]];
        Self { focal: scaled(self.focal), center: scaled(self.center), size: [width, height], ..*self }
    }

    /// The pixel where the ray through (x, y, 1) lands, and the derivatives of the pixel by x and y, row-major. `None`
    /// outside the range in which the lens maps one to one.
    pub fn project(&self, [x, y]: [f64; 2]) -> Option<([f64; 2], [[f64; 2]; 2])> {
        let ([u, v], [[a, b], [c, d]]) = self.bend([x, y])?;
        let ([fx, fy], [cx, cy]) = (self.focal, self.center);
        Some(([fx * u + cx, fy * v + cy], [[fx * a, fx * b], [fy * c, fy * d]]))
    }

    /// The ray (x, y, 1) that lands at a pixel: the inverse of [`Lens::project`].
    pub fn ray(&self, [u, v]: [f64; 2]) -> Option<[f64; 2]> {
        let bent = [(u - self.center[0]) / self.focal[0], (v - self.center[1]) / self.focal[1]];
        let mut ray = self.straight(bent)?;
        // Starts from the inverse of the radial part. The tangential part is small, so Newton's steps are too.
        for _ in 0..50 {
            let ([x, y], [[a, b], [c, d]]) = self.bend(ray)?;
            let (miss, det) = ([x - bent[0], y - bent[1]], a * d - b * c);
            let step = [(d * miss[0] - b * miss[1]) / det, (a * miss[1] - c * miss[0]) / det];
            ray = [ray[0] - step[0], ray[1] - step[1]];
            if step[0].abs() + step[1].abs() <= 1e-13 * (1.0 + ray[0].abs() + ray[1].abs()) {
                return self.bend(ray).map(|_| ray);
            }
        }
        None
    }

    /// [`Lens::project`] in normalised coordinates.
    fn bend(&self, [x, y]: [f64; 2]) -> Option<([f64; 2], [[f64; 2]; 2])> {
        let s = x * x + y * y;
        if s.is_nan() || s > self.reach * self.reach {
            return None;
        }
        let ((h, slope), [p, q]) = (self.distortion.radial(s), self.distortion.tangential());
        let bent = [x * h + 2.0 * p * x * y + q * (s + 2.0 * x * x), y * h + 2.0 * q * x * y + p * (s + 2.0 * y * y)];
        let mixed = x * y * slope + 2.0 * (p * x + q * y);
        let jacobian = [
            [h + x * x * slope + 2.0 * p * y + 6.0 * q * x, mixed],
            [mixed, h + y * y * slope + 2.0 * q * x + 6.0 * p * y],
        ];
        let turned = jacobian[0][0] * jacobian[1][1] - mixed * mixed <= 0.0;
        (!turned).then_some((bent, jacobian))
    }

    /// The inverse of the radial part, by Newton's method inside a bracket that shrinks with every step.
    fn straight(&self, bent: [f64; 2]) -> Option<[f64; 2]> {
        let wanted = bent[0].hypot(bent[1]);
        if wanted == 0.0 {
            return Some(bent);
        }
        let at = |r: f64| {
            let (h, slope) = self.distortion.radial(r * r);
            (r * h - wanted, h + r * r * slope)
        };
        let (mut low, mut high) = (0.0, self.reach);
        let short = at(high).0;
        if short.is_nan() || short < 0.0 {
            return None;
        }
        let mut r = wanted.min(high);
        for _ in 0..200 {
            let (miss, slope) = at(r);
            if miss > 0.0 {
                high = r
            } else {
                low = r
            }
            let newton = r - miss / slope;
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            if (next - r).abs() <= 1e-15 * (1.0 + r) {
                break;
            }
            r = next;
        }
        Some([bent[0] * r / wanted, bent[1] * r / wanted])
    }
}
