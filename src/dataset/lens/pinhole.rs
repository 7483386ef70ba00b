//! The pinhole camera of an undistorted photograph.

use super::Lens;
use crate::scene::Camera;

/// Largest angle from the axis in an undistorted image, along a row or a column. Towards 90 degrees a plane stretches
/// without end, and the linear approximation of projected splats does not hold.
const WIDEST_DEGREES: f64 = 60.0;

impl Lens {
    /// The pinhole camera of the undistorted image, with the identity as pose.
    ///
    /// The image is the rectangle through the four rays that end in the middle of the photograph's sides (on the row
    /// and the column of the principal point), none of them further than 60 degrees from the axis. With barrel
    /// distortion the image is filled to its edges and loses slivers at the corners. With pincushion distortion it
    /// shows the whole photograph and has empty corners, which are masked. Pixels at the principal point keep their
    /// size, unless the image would be longer than the photograph; then it is reduced.
    pub fn pinhole(&self) -> Camera {
        let [width, height] = self.size;
        let sides = [f64::from(width), f64::from(height)];
        let inside = [self.center[0].clamp(0.0, sides[0]), self.center[1].clamp(0.0, sides[1])];
        let most = WIDEST_DEGREES.to_radians().tan().min(self.reach);
        // The coordinate along an axis of the ray that ends at a side. Outside the lens's range, that of the last ray
        // inside.
        let reaches = |axis: usize, pixel: f64| {
            let mut at = inside;
            at[axis] = pixel;
            let outwards = if pixel < self.center[axis] { -most } else { most };
            self.ray(at).map_or(outwards, |ray| ray[axis].clamp(-most, most))
        };
        let (x0, x1) = (reaches(0, 0.0), reaches(0, sides[0]));
        let (y0, y1) = (reaches(1, 0.0), reaches(1, sides[1]));
        let natural = [self.focal[0] * (x1 - x0), self.focal[1] * (y1 - y0)];
        let longest = width.max(height);
        let by = (f64::from(longest) / natural[0].max(natural[1])).min(1.0);
        let size = natural.map(|side| (side * by).round().max(1.0));
        let focal = [size[0] / (x1 - x0), size[1] / (y1 - y0)];
        Camera {
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
            fx: focal[0],
            fy: focal[1],
            cx: -x0 * focal[0],
            cy: -y0 * focal[1],
            width: size[0] as u32,
            height: size[1] as u32,
        }
    }
}
