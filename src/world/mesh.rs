//! The surface of a world as triangles.

use glam::{DQuat, DVec3};

use super::World;
use super::geometry::{Face, Shape, Solid, Terrain};
use crate::format::ply::Mesh;

impl World {
    /// The ground and all solids. Faces of polyhedra and of the ground are exact; curved shapes are approximated by
    /// flat pieces within 5 % of the shape's radius.
    pub fn mesh(&self) -> Mesh {
        let mut parts = MeshBuilder::default();
        parts.add_terrain(&self.terrain);
        let sphere = unit_sphere();
        for solid in &self.solids {
            parts.add_solid(solid, &sphere);
        }
        parts.0
    }
}

/// A mesh under construction.
#[derive(Default)]
struct MeshBuilder(Mesh);

impl MeshBuilder {
    /// Adds corners and the triangles between them.
    fn add(&mut self, vertices: impl IntoIterator<Item = DVec3>, triangles: impl IntoIterator<Item = [u32; 3]>) {
        let first = self.0.vertices.len() as u32;
        self.0.vertices.extend(vertices.into_iter().map(|v| v.to_array()));
        self.0.triangles.extend(triangles.into_iter().map(|t| t.map(|k| k + first)));
    }

    fn add_terrain(&mut self, terrain: &Terrain) {
        let side = terrain.corners();
        let vertices = (0..side * side).map(|k| terrain.corner_position(k % side, k / side));
        let cells = (0..(side - 1) * (side - 1)).map(|k| (k % (side - 1), k / (side - 1)));
        let triangles = cells.flat_map(|(i, j)| {
            let at = |i: usize, j: usize| (j * side + i) as u32;
            let (a, b) = (at(i, j), at(i + 1, j + 1));
            [[a, at(i + 1, j), b], [a, b, at(i, j + 1)]]
        });
        self.add(vertices, triangles);
    }

    fn add_solid(&mut self, solid: &Solid, sphere: &Mesh) {
        let place = |v: DVec3| solid.origin + solid.to_world(v);
        match &solid.shape {
            Shape::Convex(faces) => {
                for k in 0..faces.len() {
                    let corners = outline(faces, k);
                    let fan = (2..corners.len() as u32).map(|c| [0, c - 1, c]);
                    self.add(corners.into_iter().map(place), fan);
                }
            }
            Shape::Ellipsoid(radii) => {
                let vertices = sphere.vertices.iter().map(|v| place(DVec3::from_array(*v) * *radii));
                self.add(vertices, sphere.triangles.iter().copied());
            }
            Shape::Cone { radius, height } => {
                const SIDES: u32 = 12;
                // The corners lie as far outside the true circle as the middles of the sides lie inside.
                let r = radius * 2.0 / (1.0 + (std::f64::consts::PI / f64::from(SIDES)).cos());
                let rim = |k: u32| {
                    DQuat::from_rotation_z(std::f64::consts::TAU * f64::from(k) / f64::from(SIDES)) * (DVec3::X * r)
                };
                let vertices = (0..SIDES).map(rim).chain([DVec3::Z * *height, DVec3::ZERO]).map(place);
                let next = |k: u32| (k + 1) % SIDES;
                let triangles =
                    (0..SIDES).flat_map(|k| [[k, next(k), SIDES], [next(k), k, SIDES + 1]]).collect::<Vec<_>>();
                self.add(vertices, triangles);
            }
        }
    }
}

/// The unit sphere as an icosahedron with every triangle divided into four. The corners lie as far outside the sphere
/// as the middles of the triangles lie inside.
fn unit_sphere() -> Mesh {
    let golden = 0.5 * (1.0 + 5.0f64.sqrt());
    let mut corners: Vec<DVec3> = [(0, 1, 2), (1, 2, 0), (2, 0, 1)]
        .into_iter()
        .flat_map(|(a, b, c)| {
            [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)].map(|(s, t)| {
                let mut v = [0.0; 3];
                (v[a], v[b], v[c]) = (0.0, s, t * golden);
                DVec3::from_array(v).normalize()
            })
        })
        .collect();
    let edge = corners.iter().skip(1).map(|v| v.distance(corners[0])).fold(f64::INFINITY, f64::min);
    let near = |a: DVec3, b: DVec3| a.distance(b) < 1.1 * edge;
    let mut triangles = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                let (a, b, c) = (corners[i], corners[j], corners[k]);
                if near(a, b) && near(b, c) && near(a, c) {
                    let outwards = (b - a).cross(c - a).dot(a) > 0.0;
                    triangles.push(if outwards { [i, j, k] } else { [i, k, j] });
                }
            }
        }
    }
    let mut mesh = Mesh::default();
    for [i, j, k] in triangles {
        let middle = |mut a: usize, mut b: usize, corners: &mut Vec<DVec3>| {
            if a > b {
                std::mem::swap(&mut a, &mut b);
            }
            let m = (corners[a] + corners[b]).normalize();
            corners.iter().position(|v| v.distance(m) < 1e-9).unwrap_or_else(|| {
                corners.push(m);
                corners.len() - 1
            })
        };
        let (ij, jk, ki) = (middle(i, j, &mut corners), middle(j, k, &mut corners), middle(k, i, &mut corners));
        for t in [[i, ij, ki], [j, jk, ij], [k, ki, jk], [ij, jk, ki]] {
            mesh.triangles.push(t.map(|v| v as u32));
        }
    }
    let inside = mesh.triangles.iter().map(|t| {
        let [a, b, c] = t.map(|k| corners[k as usize]);
        ((a + b + c) / 3.0).length()
    });
    let deepest = inside.fold(f64::INFINITY, f64::min);
    let grown = 2.0 / (1.0 + deepest);
    mesh.vertices = corners.into_iter().map(|v| (v * grown).to_array()).collect();
    mesh
}

/// Corners of a face of a convex polyhedron, counter-clockwise seen from outside; fewer than three where nothing is
/// left of the face.
fn outline(faces: &[Face], number: usize) -> Vec<DVec3> {
    let face = &faces[number];
    // A square on the plane, cut by all other half-spaces (Sutherland and Hodgman 1974).
    const FAR: f64 = 1e4;
    let u = face.normal.any_orthonormal_vector();
    let v = face.normal.cross(u);
    let middle = face.normal * face.offset;
    let mut corners: Vec<DVec3> =
        [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)].map(|(a, b)| middle + (u * a + v * b) * FAR).into();
    for (k, other) in faces.iter().enumerate() {
        if k == number {
            continue;
        }
        let above = |p: DVec3| other.normal.dot(p) - other.offset;
        let mut cut = Vec::with_capacity(corners.len() + 1);
        for (k, &p) in corners.iter().enumerate() {
            let q = corners[(k + 1) % corners.len()];
            let (a, b) = (above(p), above(q));
            if a <= 0.0 {
                cut.push(p);
            }
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                cut.push(p + (q - p) * (a / (a - b)));
            }
        }
        corners = cut;
    }
    corners.dedup_by(|a, b| a.distance(*b) < 1e-9);
    corners
}
