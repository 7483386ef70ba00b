//! Sun, sky and the camera's response.

use glam::{DVec3, Vec3};

use super::surface::Appearance;

/// A sun with parallel rays and a sky that is a vertical gradient.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Light {
    /// Unit vector towards the sun.
    pub(crate) sun: DVec3,
    /// Whether mirror reflections are drawn.
    reflections: bool,
}

const SUN: Vec3 = Vec3::new(2.75, 2.5, 2.15);
const ZENITH: Vec3 = Vec3::new(0.42, 0.62, 1.0);
const HORIZON: Vec3 = Vec3::new(1.0, 1.08, 1.15);
const BOUNCE: Vec3 = Vec3::new(0.3, 0.29, 0.24);

impl Light {
    /// From the sun's azimuth, clockwise from north (+y), and elevation, in degrees.
    pub(crate) fn new([azimuth, elevation]: [f64; 2], reflections: bool) -> Self {
        let (a, e) = (azimuth.to_radians(), elevation.to_radians());
        Self { sun: DVec3::new(a.sin() * e.cos(), a.cos() * e.cos(), e.sin()), reflections }
    }

    /// Radiance of the sky in a direction.
    pub(crate) fn sky(&self, direction: DVec3) -> Vec3 {
        let up = direction.normalize_or(DVec3::Z).z.max(0.0).sqrt() as f32;
        HORIZON.lerp(ZENITH, up)
    }

    /// Radiance that leaves a surface towards the viewer; `view` points from the viewer to the surface.
    pub(crate) fn shade(&self, sample: &Appearance, view: DVec3, lit: bool) -> Vec3 {
        let n = sample.normal;
        let sun = if lit { n.dot(self.sun).max(0.0) as f32 } else { 0.0 };
        let up = (0.5 + 0.5 * n.z) as f32;
        let ambient = (BOUNCE.lerp(ZENITH.lerp(HORIZON, 0.35) * 0.75, up)) * sample.openness;
        let diffuse = sample.albedo * (SUN * sun + ambient);
        if sample.gloss == 0.0 || !self.reflections {
            return diffuse;
        }
        let v = view.normalize_or(DVec3::NEG_Z);
        let cosine = (-v.dot(n)).clamp(0.0, 1.0) as f32;
        // Schlick's approximation of Fresnel's formula.
        let share = sample.gloss + (1.0 - sample.gloss) * (1.0 - cosine).powi(5);
        let mirror = v - n * (2.0 * v.dot(n));
        let seen = if mirror.z > 0.0 { self.sky(mirror) } else { BOUNCE };
        diffuse.lerp(seen, share)
    }
}

/// Converts radiance to 8-bit sRGB values, not yet rounded: a soft shoulder (extended Reinhard curve, Reinhard et al.
/// 2002), then the sRGB transfer curve.
pub(crate) fn develop(radiance: Vec3) -> Vec3 {
    const WHITE: f32 = 2.6;
    let x = radiance.max(Vec3::ZERO) * 1.32;
    let y = (x * (Vec3::ONE + x / (WHITE * WHITE)) / (Vec3::ONE + x)).min(Vec3::ONE);
    let encode = |c: f32| if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
    Vec3::new(encode(y.x), encode(y.y), encode(y.z)) * 255.0
}
