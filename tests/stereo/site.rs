//! Textured planes in front of cameras, rendered by casting rays, with exact depth and normals.

use glam::{DMat3, DVec3};
use psrgs_vk::scene::Camera;
use psrgs_vk::stereo::{InitialPlanes, StereoView};

/// A part of a plane: the points p with normal . p = offset within `bounds` (x and y, least and most).
pub struct Sheet {
    pub normal: DVec3,
    pub offset: f64,
    pub bounds: [f64; 4],
    /// Contrast of the texture; 0 is a single colour.
    pub contrast: f64,
}

impl Sheet {
    /// An infinite plane.
    pub fn plane(normal: DVec3, through: DVec3) -> Self {
        let normal = normal.normalize();
        Self { normal, offset: normal.dot(through), bounds: [-1e9, 1e9, -1e9, 1e9], contrast: 1.0 }
    }

    pub fn within(self, bounds: [f64; 4]) -> Self {
        Self { bounds, ..self }
    }

    fn meets(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        let t = (self.offset - self.normal.dot(origin)) / self.normal.dot(direction);
        let p = origin + direction * t;
        let [x0, x1, y0, y1] = self.bounds;
        (t > 0.0 && (x0..x1).contains(&p.x) && (y0..y1).contains(&p.y)).then_some(t)
    }
}

/// Colours, depths and normals of a photograph.
pub struct Truth {
    pub luma: Vec<f32>,
    pub depth: Vec<f64>,
    /// Unit normals in the camera frame, towards the camera.
    pub normals: Vec<DVec3>,
}

/// A pinhole camera at a place, looking along +z, turned by small angles (radians) about y and x.
pub fn camera(at: [f64; 3], turn: [f64; 2], width: u32, height: u32) -> Camera {
    let rotation = DMat3::from_rotation_y(turn[0]) * DMat3::from_rotation_x(turn[1]);
    let translation = -(rotation * DVec3::from_array(at));
    let rows = rotation.transpose().to_cols_array_2d();
    let f = 1.1 * f64::from(width);
    let (cx, cy) = (0.5 * f64::from(width) + 0.7, 0.5 * f64::from(height) - 0.4);
    Camera { rotation: rows, translation: translation.to_array(), fx: f, fy: 1.02 * f, cx, cy, width, height }
}

fn hash(cell: [i64; 3], octave: i64) -> f64 {
    let mut z = (cell[0].wrapping_mul(0x9e37_79b9)
        ^ cell[1].wrapping_mul(0x85eb_ca6b)
        ^ cell[2].wrapping_mul(0xc2b2_ae35)) as u64;
    z = z.wrapping_add(octave as u64).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 31)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 29)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Smooth noise of one wavelength.
fn noise(p: DVec3, octave: i64) -> f64 {
    let cell = p.floor();
    let f = p - cell;
    let s = f * f * (3.0 - 2.0 * f);
    let at = |dx: i64, dy: i64, dz: i64| hash([cell.x as i64 + dx, cell.y as i64 + dy, cell.z as i64 + dz], octave);
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let layer = |dz| mix(mix(at(0, 0, dz), at(1, 0, dz), s.x), mix(at(0, 1, dz), at(1, 1, dz), s.x), s.y);
    mix(layer(0), layer(1), s.z)
}

/// Luma of a surface at a place, with detail from the size of the scene down to a few pixels.
fn texture(p: DVec3) -> f64 {
    let octaves = [(3.0, 0.25), (7.0, 0.3), (16.0, 0.3), (33.0, 0.15)];
    octaves.iter().zip(0..).map(|(&(frequency, share), k)| share * noise(p * frequency + 0.37, k)).sum()
}

/// Renders the sheets. Pixels without a sheet are black at depth 0.
pub fn render(sheets: &[Sheet], camera: &Camera) -> Truth {
    const FINE: u32 = 3;
    let rotation = DMat3::from_cols_array_2d(&camera.rotation).transpose();
    let origin = DVec3::from_array(camera.center());
    let cast = |u: f64, v: f64| {
        let seen = DVec3::new((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0);
        let direction = rotation.transpose() * seen;
        let hits = sheets.iter().filter_map(|sheet| Some((sheet.meets(origin, direction)?, sheet)));
        hits.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(t, sheet)| (t, sheet, origin + direction * t))
    };
    let mut truth = Truth { luma: Vec::new(), depth: Vec::new(), normals: Vec::new() };
    for y in 0..camera.height {
        for x in 0..camera.width {
            let mut sum = 0.0;
            for k in 0..FINE * FINE {
                let part = |k: u32| (f64::from(k) + 0.5) / f64::from(FINE);
                let hit = cast(f64::from(x) + part(k % FINE), f64::from(y) + part(k / FINE));
                sum += hit.map_or(0.0, |(_, sheet, p)| 0.5 + sheet.contrast * (texture(p) - 0.5));
            }
            truth.luma.push((sum / f64::from(FINE * FINE)) as f32);
            let middle = cast(f64::from(x) + 0.5, f64::from(y) + 0.5);
            truth.depth.push(middle.map_or(0.0, |(t, ..)| t));
            let normal = middle.map_or(DVec3::ZERO, |(_, sheet, p)| {
                let towards = if sheet.normal.dot(p - origin) < 0.0 { sheet.normal } else { -sheet.normal };
                rotation * towards
            });
            truth.normals.push(normal);
        }
    }
    truth
}

/// Views of the sheets, each with all others as sources and a random start.
pub fn views(sheets: &[Sheet], cameras: &[Camera], depths: [f64; 2]) -> (Vec<StereoView>, Vec<Truth>) {
    let truths: Vec<Truth> = cameras.iter().map(|camera| render(sheets, camera)).collect();
    let views = cameras.iter().zip(&truths).enumerate().map(|(i, (camera, truth))| StereoView {
        camera: *camera,
        luma: truth.luma.clone(),
        colours: Vec::new(),
        sources: (0..cameras.len()).filter(|j| *j != i).take(4).collect(),
        depths,
        start: InitialPlanes::Random,
        wanted: None,
    });
    (views.collect(), truths)
}

/// Five cameras in a cross, `apart` from the middle one, turned a little.
pub fn cross(apart: f64, width: u32, height: u32) -> Vec<Camera> {
    let places = [[0.0, 0.0], [-1.0, 0.1], [1.0, -0.05], [0.05, -1.0], [-0.1, 1.0]];
    let one = |[x, y]: [f64; 2]| {
        let (at, turn) = ([apart * x, apart * y, 0.02 * x], [0.1 * apart * x, -0.1 * apart * y]);
        camera(at, turn, width, height)
    };
    places.map(one).to_vec()
}
