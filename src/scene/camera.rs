//! A pinhole camera.

/// A pinhole camera in the COLMAP frame: x right, y down, z forward. Pixel (i, j) covers [i, i+1) x [j, j+1), its
/// centre is at (i + 0.5, j + 0.5); a point (x, y, z) of the camera frame projects to (fx x / z + cx, fy y / z + cy).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Rotation from the scene to the camera frame, row-major.
    pub rotation: [[f64; 3]; 3],
    /// Translation from the scene to the camera frame: x_cam = rotation x + translation.
    pub translation: [f64; 3],
    /// Focal length along x in pixels.
    pub fx: f64,
    /// Focal length along y in pixels.
    pub fy: f64,
    /// Principal point along x in pixels.
    pub cx: f64,
    /// Principal point along y in pixels.
    pub cy: f64,
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
}

impl Camera {
    /// The camera centre in the scene: -R^T t.
    pub fn center(&self) -> [f64; 3] {
        let (r, t) = (&self.rotation, &self.translation);
        std::array::from_fn(|i| -(r[0][i] * t[0] + r[1][i] * t[1] + r[2][i] * t[2]))
    }

    /// Position in pixels and depth of a scene point; `None` behind the camera and outside of the photograph.
    pub fn placed(&self, point: [f64; 3]) -> Option<[f64; 3]> {
        let c = self.center();
        let [x, y, z] = self.rotation.map(|row| (0..3).map(|k| row[k] * (point[k] - c[k])).sum::<f64>());
        let (u, v) = (self.fx * x / z + self.cx, self.fy * y / z + self.cy);
        let inside = z > 0.0 && (0.0..f64::from(self.width)).contains(&u) && (0.0..f64::from(self.height)).contains(&v);
        inside.then_some([u, v, z])
    }

    /// The scene point at a position in pixels and a depth.
    pub fn lifted(&self, [u, v]: [f64; 2], depth: f64) -> [f64; 3] {
        let ray = [(u - self.cx) / self.fx * depth, (v - self.cy) / self.fy * depth, depth];
        let c = self.center();
        std::array::from_fn(|i| c[i] + (0..3).map(|k| self.rotation[k][i] * ray[k]).sum::<f64>())
    }

    /// The camera of a window of the image. `left` and `top` are the window's first column and row; its pixels are
    /// those of the image.
    pub fn window(&self, (left, top): (u32, u32), (width, height): (u32, u32)) -> Self {
        Self { cx: self.cx - f64::from(left), cy: self.cy - f64::from(top), width, height, ..*self }
    }

    /// The same camera for an image of another size; the principal point and focal lengths follow the pixel grid.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let (sx, sy) = (f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height));
        Self { fx: self.fx * sx, cx: self.cx * sx, fy: self.fy * sy, cy: self.cy * sy, width, height, ..*self }
    }
}
