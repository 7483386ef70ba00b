//! What a page knows of a scene before the first picture.

use std::sync::Arc;

use serde_json::{Value, json};

use crate::scene::{Camera, Frame, up_of};

/// A scene for a page.
#[derive(Clone, Debug)]
pub struct SceneInfo {
    /// What is shown, as a heading.
    pub title: String,
    /// Photographs with their cameras.
    pub shots: Vec<Shot>,
    /// Direction up, in scene coordinates.
    pub up: [f64; 3],
    /// The middle of what is seen.
    pub center: [f64; 3],
    /// Half the size of what is seen, in scene units.
    pub radius: f64,
    /// The dataset's coordinates: distances are told in them.
    pub frame: Frame,
    /// Whether the splats of the low-frequency stage are told apart.
    pub parts: bool,
    /// Whether a training runs.
    pub training: bool,
}

/// A photograph with its camera.
#[derive(Clone, Debug)]
pub struct Shot {
    /// Name.
    pub name: String,
    /// Camera in scene coordinates.
    pub camera: Camera,
    /// Whether the photograph is held out of the training.
    pub held_out: bool,
    /// The pixels, if the photograph is there.
    pub photograph: Option<Source>,
}

/// Where the pixels of a photograph come from.
#[derive(Clone)]
pub struct Source(Arc<dyn Fn() -> Result<Vec<u8>, String> + Send + Sync>);

impl Source {
    /// From a function that gives 8-bit (r, g, b) of each pixel, row-major, at the camera's size.
    pub fn new(pixels: impl Fn() -> Result<Vec<u8>, String> + Send + Sync + 'static) -> Self {
        Self(Arc::new(pixels))
    }

    /// The pixels.
    pub(super) fn pixels(&self) -> Result<Vec<u8>, String> {
        (self.0)()
    }
}

impl std::fmt::Debug for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Source")
    }
}

/// Share of splats or cameras that count as the middle.
const QUARTERS: [f64; 2] = [0.25, 0.75];

impl SceneInfo {
    /// A scene without photographs, seen from nowhere in particular.
    pub fn new(title: &str, frame: Frame) -> Self {
        Self {
            title: title.to_owned(),
            shots: Vec::new(),
            up: [0.0, -1.0, 0.0],
            center: [0.0; 3],
            radius: Frame::EXTENT,
            frame,
            parts: false,
            training: false,
        }
    }

    /// Takes the middle and the size from the means of splats, shape [splats, 3]: half of the splats along each axis.
    #[must_use]
    pub fn around(mut self, means: &[f32]) -> Self {
        let mut radius: f64 = 0.0;
        for axis in 0..3 {
            let mut values: Vec<f32> = means.iter().skip(axis).step_by(3).copied().filter(|v| v.is_finite()).collect();
            if values.is_empty() {
                return self;
            }
            let [low, high] = QUARTERS.map(|share| {
                let at = ((values.len() - 1) as f64 * share).round() as usize;
                f64::from(*values.select_nth_unstable_by(at, f32::total_cmp).1)
            });
            self.center[axis] = 0.5 * (low + high);
            radius = radius.max(high - low);
        }
        self.radius = radius.max(1e-6);
        self
    }

    /// Takes photographs, and from their cameras the direction up.
    #[must_use]
    pub fn with_shots(mut self, shots: Vec<Shot>) -> Self {
        let cameras: Vec<Camera> = shots.iter().map(|shot| shot.camera).collect();
        self.up = up_of(&cameras).unwrap_or(self.up);
        self.shots = shots;
        self
    }

    /// The scene as the page reads it.
    pub(super) fn json(&self) -> Value {
        let shots: Vec<Value> = self.shots.iter().map(shot).collect();
        json!({
            "title": self.title,
            "shots": shots,
            "up": self.up,
            "center": self.center,
            "radius": self.radius,
            "scale": self.frame.scale,
            "offset": self.frame.offset,
            "parts": self.parts,
            "training": self.training,
        })
    }
}

fn shot(shot: &Shot) -> Value {
    let Camera { rotation, width, height, fx, fy, cx, cy, .. } = shot.camera;
    json!({
        "name": shot.name,
        "heldOut": shot.held_out,
        "photograph": shot.photograph.is_some(),
        "width": width,
        "height": height,
        "position": shot.camera.center(),
        "toCamera": rotation,
        "focal": fy / f64::from(height),
        "focalAcross": fx / f64::from(width),
        "middle": [cx / f64::from(width), cy / f64::from(height)],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Marks on a photograph lie where its own camera shows them.
    #[test]
    fn the_page_knows_where_a_camera_looks_from() {
        let camera = Camera {
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
            fx: 30.0,
            fy: 20.0,
            cx: 25.0,
            cy: 8.0,
            width: 40,
            height: 20,
        };
        let told = shot(&Shot { name: "a".to_owned(), camera, held_out: false, photograph: None });
        assert_eq!((&told["focal"], &told["focalAcross"]), (&json!(1.0), &json!(0.75)));
        assert_eq!(told["middle"], json!([0.625, 0.4]));
    }

    #[test]
    fn the_middle_ignores_what_is_far_away() {
        let means: Vec<f32> = (0..100).flat_map(|i| [i as f32 / 100.0, 2.0, if i == 0 { 1e6 } else { 0.0 }]).collect();
        let scene = SceneInfo::new("cloud", Frame::IDENTITY).around(&means);
        assert!((scene.center[0] - 0.5).abs() < 0.02 && scene.center[1] == 2.0 && scene.center[2] == 0.0);
        assert!((scene.radius - 0.5).abs() < 0.02);
    }
}
