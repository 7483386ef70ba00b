//! A synthetic aerial world of known geometry: hills, roads, buildings, plants, thin wires, water and bare fields. The
//! world is photographed from a nadir flight and from oblique views around it, scanned by a laser scanner, and written
//! as a COLMAP dataset with its ground truth.
//!
//! The camera of a [`WorldView`] is that of the undistorted image. Photographs may be taken through a lens with
//! distortion, whose undistorted image is exactly that of the view's camera. All ground truth is for the pixels of
//! undistorted images.
//!
//! World coordinates are metres, x east, y north, z up. [`WorldParams`], seed included, determine everything.

mod colmap;
mod effects;
mod error;
mod flight;
mod from_above;
mod geometry;
mod lidar;
mod light;
mod mesh;
mod noise;
mod optics;
mod output;
mod params;
mod photograph;
mod site;
mod surface;
mod survey;
mod tie_points;
mod true_map;

pub use effects::{Effect, Effects};
pub use error::WorldError;
pub use flight::WorldView;
pub use from_above::FromAbove;
pub use geometry::{Bounds, Face, Hit, Ray, Shape, Solid, Surface, Terrain};
pub use lidar::{Class, LidarPoint};
pub use output::{LIDAR_FILE, Progress, Stage, Summary, generate};
pub use params::{CameraKind, LidarParams, WorldParams};
pub use photograph::{RenderedView, Truth};
pub use survey::SurveyParams;
pub use tie_points::TiePoint;

use glam::{DVec3, Vec3};

use crate::dataset::lens::Lens;
use crate::scene::Camera;
use geometry::Bvh;
use light::Light;
use optics::Optics;
use site::Site;
use surface::{Appearance, GroundMap};

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
    optics: Option<Optics>,
    views: Vec<WorldView>,
    exposures: Vec<f64>,
    offpath: Vec<WorldView>,
}

impl World {
    /// Builds a world; nothing is rendered yet.
    pub fn new(params: &WorldParams) -> Result<Self, WorldError> {
        params.validate()?;
        let site = Site::new(params);
        let views = flight::plan(params, |x, y| site.terrain.height(x, y));
        let mut world = Self {
            params: params.clone(),
            bvh: Bvh::new(&site.solids),
            terrain: site.terrain,
            solids: site.solids,
            ground: site.ground,
            light: Light::new(params.sun, params.effects.reflections),
            optics: views.first().map(|v| Optics::new(params, &v.camera)).transpose()?.flatten(),
            views,
            exposures: flight::exposures(params),
            offpath: Vec::new(),
        };
        let mut views = std::mem::take(&mut world.views);
        for (view, number) in views.iter_mut().zip(0..) {
            let camera = &view.camera;
            let middle = pixel_ray(camera, 0.5 * f64::from(camera.width), 0.5 * f64::from(camera.height));
            let distance = world.trace(&middle).map_or(params.altitude * params.extent, |hit| hit.t);
            view.reconstructed = flight::reconstructed(params, camera, number, distance);
        }
        world.views = views;
        world.offpath = flight::plan_offpath(params, |x, y| world.terrain.height(x, y), |camera| world.nearest(camera));
        Ok(world)
    }

    /// The smallest depth on a grid of rays of a camera.
    fn nearest(&self, camera: &Camera) -> f64 {
        const SIDE: u32 = 12;
        let at = |k: u32, size: u32| f64::from(size) * (f64::from(k) + 0.5) / f64::from(SIDE);
        (0..SIDE * SIDE)
            .filter_map(|k| self.trace(&pixel_ray(camera, at(k % SIDE, camera.width), at(k / SIDE, camera.height))))
            .map(|hit| hit.t)
            .fold(f64::INFINITY, f64::min)
    }

    /// The parameters given to [`Self::new`].
    pub fn params(&self) -> &WorldParams {
        &self.params
    }

    /// The ground.
    pub fn terrain(&self) -> &Terrain {
        &self.terrain
    }

    /// All solids that stand on the ground.
    pub fn solids(&self) -> &[Solid] {
        &self.solids
    }

    /// The views of the photographs, in the order of their names.
    pub fn views(&self) -> &[WorldView] {
        &self.views
    }

    /// The lens of the photographs; `None` without distortion.
    pub fn lens(&self) -> Option<&Lens> {
        self.optics.as_ref().map(|o| &o.lens)
    }

    /// The gain of a photograph's exposure; 1 where no photograph has the number.
    pub fn exposure(&self, number: u32) -> f64 {
        self.exposures.get(number as usize).copied().unwrap_or(1.0)
    }

    /// Views from positions without a photograph, in the order of their names.
    pub fn offpath(&self) -> &[WorldView] {
        &self.offpath
    }

    /// The first surface that a ray hits.
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

    fn appearance(&self, point: DVec3, hit: &Hit) -> Appearance {
        match hit.surface {
            Surface::Terrain => self.ground.sample(point.truncate(), self.terrain.smooth_normal(point.x, point.y)),
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

/// The ray through a point of the image (pixels); its parameter is the depth.
pub(crate) fn pixel_ray(camera: &Camera, x: f64, y: f64) -> Ray {
    let (u, v) = ((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy);
    let r = &camera.rotation;
    let direction = std::array::from_fn(|k| r[0][k] * u + r[1][k] * v + r[2][k]);
    Ray { origin: DVec3::from_array(camera.center()), direction: DVec3::from_array(direction) }
}
