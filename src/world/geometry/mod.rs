//! Shapes, the terrain, and rays that hit them.

mod bvh;
mod solid;
mod terrain;

pub(crate) use bvh::Bvh;
pub use solid::{Bounds, Face, Shape, Solid};
pub use terrain::Terrain;

use glam::DVec3;

/// A half-line `origin + t direction`, t > 0. The direction need not have unit length: with a direction whose
/// camera-frame z is 1, t is the depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: DVec3,
    /// Where it goes.
    pub direction: DVec3,
}

impl Ray {
    /// The point at t.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }
}

/// The intersection of a ray with a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Ray parameter.
    pub t: f64,
    /// Outward unit normal of the surface in world axes.
    pub normal: DVec3,
    /// The surface.
    pub surface: Surface,
}

/// A surface of the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Surface {
    /// The ground.
    Terrain,
    /// A face of a solid.
    Solid {
        /// Index in the world's list of solids.
        index: u32,
        /// Index of the face (0 for curved shapes).
        face: u32,
    },
}
