//! A synthetic aerial world of known geometry: hills, roads, buildings with fine texture, plants; seen from a nadir flight
//! and from oblique views around it; written as a COLMAP dataset with ground-truth depth.
//!
//! World coordinates are metres, x east, y north, z up. Everything follows from [`WorldParams`], seed included.

mod colmap;
mod error;
mod flight;
mod geometry;
mod light;
mod output;
mod params;
mod photograph;
mod random;
mod site;
mod surface;
mod tie_points;

pub use error::WorldError;
pub use flight::View;
pub use geometry::{Bounds, Face, Hit, Ray, Shape, Solid, Surface, Terrain};
pub use output::{Progress, Stage, Summary, generate};
pub use params::{Effects, WorldParams};
pub use tie_points::TiePoint;

use glam::{DVec3, Vec3};

use geometry::Bvh;
use light::Light;
use site::Site;
use surface::{GroundMap, Sample};

/// Offset of shadow rays from the surface, metres.
const SKIN: f64 = 1e-4;

/// The geometry, its appearance, and the cameras that look at it.
pub struct World {
    params: WorldParams,
    terrain: Terrain,
    solids: Vec<Solid>,
    bvh: Bvh,
    ground: GroundMap,
    light: Light,
    views: Vec<View>,
}

impl World {
    /// Builds a world; nothing is rendered yet.
    pub fn new(params: &WorldParams) -> Result<Self, WorldError> {
        params.validate()?;
        let site = Site::new(params);
        let views = flight::plan(params, |x, y| site.terrain.height(x, y));
        Ok(Self {
            params: params.clone(),
            bvh: Bvh::new(&site.solids),
            terrain: site.terrain,
            solids: site.solids,
            ground: site.ground,
            light: Light::new(params.sun, params.effects.reflections),
            views,
        })
    }

    /// What it was made from.
    pub fn params(&self) -> &WorldParams {
        &self.params
    }

    /// The ground.
    pub fn terrain(&self) -> &Terrain {
        &self.terrain
    }

    /// Everything that stands on it.
    pub fn solids(&self) -> &[Solid] {
        &self.solids
    }

    /// Photographs to be taken, in the order of their names.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// The first surface that a ray meets.
    pub fn trace(&self, ray: &Ray) -> Option<Hit> {
        let ground = self.terrain.enter(ray, 0.0, f64::INFINITY);
        let solid = self.bvh.enter(&self.solids, ray, 0.0, ground.unwrap_or(f64::INFINITY), false);
        match (solid, ground) {
            (Some((t, index, face)), _) => Some(Hit {
                t,
                normal: self.solids[index as usize].normal(ray.at(t), face),
                surface: Surface::Solid { index, face },
            }),
            (None, Some(t)) => {
                let p = ray.at(t);
                Some(Hit { t, normal: self.terrain.normal(p.x, p.y), surface: Surface::Terrain })
            }
            (None, None) => None,
        }
    }

    /// Whether anything stands between a point and the sun.
    fn is_shadowed(&self, point: DVec3, normal: DVec3) -> bool {
        let ray = Ray { origin: point + normal * SKIN, direction: self.light.sun };
        self.bvh.enter(&self.solids, &ray, 0.0, f64::INFINITY, true).is_some()
            || self.terrain.enter(&ray, 0.0, f64::INFINITY).is_some()
    }

    fn appearance(&self, point: DVec3, hit: &Hit) -> Sample {
        match hit.surface {
            Surface::Terrain => {
                let (albedo, openness) = self.ground.sample(point.truncate());
                Sample { openness, ..Sample::matte(albedo, self.terrain.smooth_normal(point.x, point.y)) }
            }
            Surface::Solid { index, face } => {
                let solid = &self.solids[index as usize];
                let local = solid.to_local(point - solid.origin);
                solid.finish(face).sample(point, local, hit.normal, solid.to_local(hit.normal))
            }
        }
    }

    /// Radiance from a hit towards the ray's origin.
    fn shade(&self, ray: &Ray, hit: &Hit) -> Vec3 {
        let point = ray.at(hit.t);
        let sample = self.appearance(point, hit);
        let faces_sun = hit.normal.dot(self.light.sun) > 0.0;
        let lit = faces_sun && !(self.params.effects.shadows && self.is_shadowed(point, hit.normal));
        self.light.shade(&sample, ray.direction, lit)
    }
}
