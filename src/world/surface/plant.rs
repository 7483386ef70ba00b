//! Appearance of foliage.

use glam::{DVec2, DVec3, Vec3};

use super::Appearance;
use crate::world::noise::{noise2, noise3, smoothstep};

/// Leaves: patches of a few decimetres with rough normals; darker deep in the crown (`depth_share` 0 at the centre, 1
/// at its edge) and underneath.
pub(super) fn leaves(point: DVec3, normal: DVec3, colour: Vec3, seed: u32, depth_share: f64) -> Appearance {
    let fine = noise3(point * 5.5, seed);
    let coarse = noise3(point * 1.7, seed ^ 0x77);
    let bump = DVec3::new(
        noise2(DVec2::new(point.x * 4.0 + point.z, point.y * 4.0), seed ^ 1) - 0.5,
        noise2(DVec2::new(point.y * 4.0, point.z * 4.0 + point.x), seed ^ 2) - 0.5,
        noise2(DVec2::new(point.z * 4.0 + point.y, point.x * 4.0), seed ^ 3) - 0.5,
    );
    let shade = 0.45 + 0.75 * fine + 0.3 * (coarse - 0.5);
    let sunny = Vec3::new(1.25, 1.1, 0.7);
    let albedo = colour * shade as f32 * Vec3::ONE.lerp(sunny, coarse as f32);
    let openness = (0.35 + 0.65 * smoothstep(0.35, 1.0, depth_share)) * (0.7 + 0.3 * smoothstep(-0.8, 0.5, normal.z));
    Appearance {
        albedo,
        normal: (normal + 1.1 * bump).normalize(),
        openness: openness as f32,
        gloss: 0.0,
        plain: false,
    }
}
