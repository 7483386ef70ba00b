//! Closed solids: convex polyhedra, ellipsoids, cones.

use glam::DVec3;

use super::Ray;
use crate::world::Class;
use crate::world::surface::Finish;

/// A half-space `normal . p <= offset` of a convex polyhedron, in the solid's frame.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    /// Outward unit normal.
    pub normal: DVec3,
    /// Distance of the plane from the solid's origin.
    pub offset: f64,
    pub(crate) finish: Finish,
}

/// The shape of a solid, in the solid's frame.
#[derive(Clone, Debug)]
pub enum Shape {
    /// The points inside all half-spaces.
    Convex(Box<[Face]>),
    /// Axis-aligned ellipsoid about the origin with these radii.
    Ellipsoid(DVec3),
    /// Cone with its base disc of this radius at z = 0 and its tip at z = height.
    Cone {
        /// Radius of the base.
        radius: f64,
        /// Height of the tip.
        height: f64,
    },
}

/// A shape placed in the world: turned by `yaw` about the vertical, then moved to `origin`.
#[derive(Clone, Debug)]
pub struct Solid {
    /// World position of the solid's origin.
    pub origin: DVec3,
    /// Turn about +z in radians, counter-clockwise from above.
    pub yaw: f64,
    /// The shape.
    pub shape: Shape,
    /// The kind of object that the solid belongs to.
    pub class: Class,
    pub(crate) finish: Finish,
    cos: f64,
    sin: f64,
}

/// An axis-aligned box in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates.
    pub min: DVec3,
    /// Largest coordinates.
    pub max: DVec3,
}

impl Bounds {
    /// The empty box.
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// The smallest box that holds both.
    pub fn join(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Half the surface of the box; 0 when empty.
    pub(crate) fn half_area(self) -> f64 {
        let e = (self.max - self.min).max(DVec3::ZERO);
        e.x * e.y + e.y * e.z + e.z * e.x
    }
}

impl Solid {
    /// Places a shape. `finish` applies to curved shapes; faces of polyhedra have their own finish.
    pub(crate) fn new(origin: DVec3, yaw: f64, shape: Shape, class: Class, finish: Finish) -> Self {
        Self { origin, yaw, shape, class, finish, cos: yaw.cos(), sin: yaw.sin() }
    }

    /// A world direction in the solid's frame.
    pub fn to_local(&self, v: DVec3) -> DVec3 {
        DVec3::new(self.cos * v.x + self.sin * v.y, self.cos * v.y - self.sin * v.x, v.z)
    }

    /// A direction of the solid's frame in the world.
    pub fn to_world(&self, v: DVec3) -> DVec3 {
        DVec3::new(self.cos * v.x - self.sin * v.y, self.cos * v.y + self.sin * v.x, v.z)
    }

    /// The finish of a face.
    pub(crate) fn finish(&self, face: u32) -> &Finish {
        match &self.shape {
            Shape::Convex(faces) => faces.get(face as usize).map_or(&self.finish, |f| &f.finish),
            _ => &self.finish,
        }
    }

    /// Where the ray enters the solid with `low < t < high`: t and the face.
    pub(crate) fn enter(&self, ray: &Ray, low: f64, high: f64) -> Option<(f64, u32)> {
        let o = self.to_local(ray.origin - self.origin);
        let d = self.to_local(ray.direction);
        match &self.shape {
            Shape::Convex(faces) => enter_convex(faces, o, d, low, high),
            Shape::Ellipsoid(radii) => {
                let (o, d) = (o / *radii, d / *radii);
                let (a, b, c) = (d.dot(d), o.dot(d), o.dot(o) - 1.0);
                let disc = b * b - a * c;
                if disc <= 0.0 {
                    return None;
                }
                let t = (-b - disc.sqrt()) / a;
                (t > low && t < high).then_some((t, 0))
            }
            Shape::Cone { radius, height } => enter_cone(*radius, *height, o, d, low, high),
        }
    }

    /// Outward unit normal in world axes at a point of a face.
    pub(crate) fn normal(&self, point: DVec3, face: u32) -> DVec3 {
        let p = self.to_local(point - self.origin);
        let n = match &self.shape {
            Shape::Convex(faces) => faces.get(face as usize).map_or(DVec3::Z, |f| f.normal),
            Shape::Ellipsoid(radii) => (p / (*radii * *radii)).normalize_or(DVec3::Z),
            Shape::Cone { .. } if face == 1 => DVec3::NEG_Z,
            Shape::Cone { radius, height } => {
                let out = DVec3::new(p.x, p.y, 0.0).normalize_or(DVec3::X);
                (out * *height + DVec3::Z * *radius).normalize()
            }
        };
        self.to_world(n)
    }

    /// The box around the solid.
    pub fn bounds(&self) -> Bounds {
        let around = |low: DVec3, high: DVec3| {
            (0..8).map(move |k| {
                DVec3::new(
                    if k & 1 == 0 { low.x } else { high.x },
                    if k & 2 == 0 { low.y } else { high.y },
                    if k & 4 == 0 { low.z } else { high.z },
                )
            })
        };
        let corners: Vec<DVec3> = match &self.shape {
            Shape::Convex(faces) => vertices(faces),
            Shape::Ellipsoid(radii) => around(-*radii, *radii).collect(),
            Shape::Cone { radius, height } => {
                around(DVec3::new(-radius, -radius, 0.0), DVec3::new(*radius, *radius, *height)).collect()
            }
        };
        corners.into_iter().fold(Bounds::EMPTY, |b, c| {
            let p = self.origin + self.to_world(c);
            b.join(Bounds { min: p, max: p })
        })
    }
}

fn enter_convex(faces: &[Face], o: DVec3, d: DVec3, low: f64, high: f64) -> Option<(f64, u32)> {
    let (mut near, mut far, mut face) = (low, high, u32::MAX);
    for (k, f) in faces.iter().enumerate() {
        let distance = f.offset - f.normal.dot(o);
        let speed = f.normal.dot(d);
        if speed < 0.0 {
            let t = distance / speed;
            if t > near {
                near = t;
                face = k as u32;
            }
        } else if speed > 0.0 {
            far = far.min(distance / speed);
        } else if distance < 0.0 {
            return None;
        }
        if near >= far {
            return None;
        }
    }
    (face != u32::MAX).then_some((near, face))
}

fn enter_cone(radius: f64, height: f64, o: DVec3, d: DVec3, low: f64, high: f64) -> Option<(f64, u32)> {
    // x^2 + y^2 = k^2 (height - z)^2 with 0 <= z <= height.
    let k2 = (radius / height) * (radius / height);
    let (oz, dz) = (height - o.z, -d.z);
    let a = d.x * d.x + d.y * d.y - k2 * dz * dz;
    let b = o.x * d.x + o.y * d.y - k2 * oz * dz;
    let c = o.x * o.x + o.y * o.y - k2 * oz * oz;
    let mut best: Option<(f64, u32)> = None;
    let mut offer = |t: f64, face: u32| {
        if t > low && t < best.map_or(high, |(u, _)| u) {
            best = Some((t, face));
        }
    };
    let disc = b * b - a * c;
    if disc > 0.0 && a.abs() > 1e-14 {
        let root = disc.sqrt();
        for t in [(-b - root) / a, (-b + root) / a] {
            let z = o.z + t * d.z;
            // Only entries: the outward normal must face the ray.
            let p = o + d * t;
            let out = DVec3::new(p.x, p.y, k2 * (height - z));
            if (0.0..=height).contains(&z) && out.dot(d) < 0.0 {
                offer(t, 0);
            }
        }
    }
    if d.z > 0.0 {
        let t = -o.z / d.z;
        let p = o + d * t;
        if p.x * p.x + p.y * p.y <= radius * radius {
            offer(t, 1);
        }
    }
    best
}

/// Corners of a convex polyhedron.
fn vertices(faces: &[Face]) -> Vec<DVec3> {
    let mut out = Vec::new();
    for (i, a) in faces.iter().enumerate() {
        for (j, b) in faces.iter().enumerate().skip(i + 1) {
            for c in &faces[j + 1..] {
                let cross = b.normal.cross(c.normal);
                let det = a.normal.dot(cross);
                if det.abs() < 1e-9 {
                    continue;
                }
                let p = (cross * a.offset + c.normal.cross(a.normal) * b.offset + a.normal.cross(b.normal) * c.offset)
                    / det;
                if faces.iter().all(|f| f.normal.dot(p) <= f.offset + 1e-7) {
                    out.push(p);
                }
            }
        }
    }
    out
}
