//! What a page asks for: pictures and points.

use glam::{DMat3, DQuat};

use super::http::Request;
use super::scene_info::SceneInfo;
use crate::raster::{Look, Part, Style};
use crate::scene::Camera;

/// Most pixels on a side of a picture.
const MOST_SIDE: u32 = 4096;

/// Something to be drawn or measured.
#[derive(Clone, Debug, PartialEq)]
pub enum Ask {
    /// A picture.
    Frame(FrameAsk),
    /// The surface at a pixel.
    Pick(PickAsk),
}

/// A picture to be drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameAsk {
    /// From where.
    pub pose: Pose,
    /// Most pixels (width, height).
    pub size: (u32, u32),
    /// What to show.
    pub channel: Channel,
    /// Which splats; all without a part.
    pub part: Option<Part>,
    /// Whether more pictures follow at once.
    pub moving: bool,
}

/// The surface at a pixel of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct PickAsk {
    /// From where.
    pub pose: Pose,
    /// Size of the picture in pixels.
    pub size: (u32, u32),
    /// Position in shares of width and height, from the upper left corner.
    pub at: [f64; 2],
}

/// Where a picture is taken.
#[derive(Clone, Debug, PartialEq)]
pub enum Pose {
    /// With the camera of a photograph, by its index.
    Photograph(usize),
    /// Anywhere.
    Free {
        /// Camera centre in scene coordinates.
        position: [f64; 3],
        /// Rotation from the camera frame to the scene, a quaternion (w, x, y, z).
        rotation: [f64; 4],
        /// Focal length in heights of the picture.
        focal: f64,
    },
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Colours.
    Colour,
    /// Expected depth.
    Depth,
    /// Normals in the camera frame.
    Normals,
    /// Outlines of splats.
    Outlines,
    /// Difference to the photograph.
    Error,
}

impl Channel {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "colour" => Self::Colour,
            "depth" => Self::Depth,
            "normals" => Self::Normals,
            "outlines" => Self::Outlines,
            "error" => Self::Error,
            _ => return None,
        })
    }
}

impl FrameAsk {
    /// How the picture is drawn.
    pub fn look(&self) -> Look {
        let style = match self.channel {
            Channel::Colour | Channel::Error => Style::Blended,
            Channel::Depth | Channel::Normals => Style::Surfaces,
            Channel::Outlines => Style::Outlines,
        };
        Look { style, part: self.part }
    }

    /// From the query of a request.
    pub(super) fn read(request: &Request) -> Option<Self> {
        Some(Self {
            pose: Pose::read(request)?,
            size: size(request)?,
            channel: Channel::named(request.value("c")?)?,
            part: match request.value("s")? {
                "low" => Some(Part::Low),
                "high" => Some(Part::High),
                _ => None,
            },
            moving: request.value("m") == Some("1"),
        })
    }
}

impl PickAsk {
    /// The point of the surface, from the median depths of a camera, row-major; `None` where there is no surface.
    pub fn point(&self, camera: &Camera, depths: &[f32]) -> Option<[f64; 3]> {
        let [u, v] = [self.at[0] * f64::from(camera.width), self.at[1] * f64::from(camera.height)];
        let depth = f64::from(*depths.get(v as usize * camera.width as usize + u as usize)?);
        (depth > 0.0).then(|| camera.lifted([u, v], depth))
    }

    /// From the query of a request.
    pub(super) fn read(request: &Request) -> Option<Self> {
        let at = numbers::<2>(request.value("at")?)?;
        if at.iter().any(|share| !(0.0..1.0).contains(share)) {
            return None;
        }
        Some(Self { pose: Pose::read(request)?, size: size(request)?, at })
    }
}

impl Pose {
    fn read(request: &Request) -> Option<Self> {
        if let Some(index) = request.value("k") {
            return index.parse().ok().map(Self::Photograph);
        }
        let (position, rotation) = (numbers(request.value("p")?)?, numbers::<4>(request.value("q")?)?);
        let [focal] = numbers(request.value("f")?)?;
        let length = rotation.iter().map(|v| v * v).sum::<f64>().sqrt();
        let possible = (0.01..=1000.0).contains(&focal) && (0.5..=2.0).contains(&length);
        possible.then(|| Self::Free { position, rotation: rotation.map(|v| v / length), focal })
    }

    /// The camera for a picture of at most `size` pixels, in scene coordinates. A photograph's camera keeps the shape of
    /// the photograph. `None` where there is no such photograph.
    pub fn camera(&self, scene: &SceneInfo, (width, height): (u32, u32)) -> Option<Camera> {
        match self {
            Self::Photograph(index) => {
                let camera = &scene.shots.get(*index)?.camera;
                let share =
                    (f64::from(width) / f64::from(camera.width)).min(f64::from(height) / f64::from(camera.height));
                let sized = |v: u32| ((f64::from(v) * share).round() as u32).max(1);
                Some(camera.resized(sized(camera.width), sized(camera.height)))
            }
            Self::Free { position, rotation, focal } => {
                let [w, x, y, z] = *rotation;
                // Columns of the rotation to the scene are rows of the rotation to the camera.
                let to_camera = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w)).to_cols_array_2d();
                let focal = focal * f64::from(height);
                Some(Camera {
                    rotation: to_camera,
                    translation: to_camera.map(|row| -(0..3).map(|k| row[k] * position[k]).sum::<f64>()),
                    fx: focal,
                    fy: focal,
                    cx: 0.5 * f64::from(width),
                    cy: 0.5 * f64::from(height),
                    width,
                    height,
                })
            }
        }
    }
}

/// `N` finite numbers with commas between them.
fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let found: Vec<f64> =
        text.split(',').map(|v| v.parse().ok().filter(|v: &f64| v.is_finite())).collect::<Option<_>>()?;
    found.try_into().ok()
}

fn size(request: &Request) -> Option<(u32, u32)> {
    let side = |key| request.value(key)?.parse().ok().filter(|v| (1..=MOST_SIDE).contains(v));
    Some((side("w")?, side("h")?))
}

#[cfg(test)]
mod tests {
    use super::super::http::Method;
    use super::*;
    use crate::scene::Frame;

    fn request(query: &str) -> Request {
        Request {
            method: Method::Get,
            path: "/frame".to_owned(),
            query: query.to_owned(),
            host: None,
            origin: None,
            cookie: None,
            closes: false,
        }
    }

    #[test]
    fn queries_of_the_page_are_read_and_others_refused() {
        let free = "w=320&h=200&p=1,2,-3&q=1,0,0,0&f=1.2&c=depth&s=low&m=1";
        let ask = FrameAsk::read(&request(free)).expect("a frame");
        assert_eq!((ask.size, ask.channel, ask.part, ask.moving), ((320, 200), Channel::Depth, Some(Part::Low), true));
        assert_eq!(ask.look().style, Style::Surfaces);
        let at = FrameAsk::read(&request("w=3&h=2&k=7&c=colour&s=full")).expect("a frame");
        assert_eq!((at.pose, at.moving), (Pose::Photograph(7), false));
        for query in [
            "w=0&h=200&k=1&c=colour&s=full",
            "w=100000&h=200&k=1&c=colour&s=full",
            "w=10&h=20&k=-1&c=colour&s=full",
            "w=10&h=20&k=1&c=secret&s=full",
            "w=10&h=20&p=1,2&q=1,0,0,0&f=1&c=colour&s=full",
            "w=10&h=20&p=1,2,nan&q=1,0,0,0&f=1&c=colour&s=full",
            "w=10&h=20&p=1,2,inf&q=1,0,0,0&f=1&c=colour&s=full",
            "w=10&h=20&p=1,2,3&q=0,0,0,0&f=1&c=colour&s=full",
            "w=10&h=20&p=1,2,3&q=1,0,0,0&f=0&c=colour&s=full",
            "",
        ] {
            assert_eq!(FrameAsk::read(&request(query)), None, "{query}");
        }
        let pick = PickAsk::read(&request("w=10&h=20&k=1&at=0.5,0.25")).expect("a point");
        assert_eq!(pick.at, [0.5, 0.25]);
    }

    #[test]
    fn a_free_pose_sees_along_its_axis() {
        let scene = SceneInfo::new("model", Frame::IDENTITY);
        // Turned by a quarter about y: the camera looks along x of the scene.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let pose = Pose::Free { position: [1.0, 2.0, 3.0], rotation: [half, 0.0, half, 0.0], focal: 2.0 };
        let camera = pose.camera(&scene, (40, 20)).expect("a camera");
        let placed = camera.placed([6.0, 2.0, 3.0]).expect("in sight");
        assert!((placed[0] - 20.0).abs() < 1e-9 && (placed[1] - 10.0).abs() < 1e-9 && (placed[2] - 5.0).abs() < 1e-9);
        let right = camera.placed([6.0, 2.0, 2.0]).expect("in sight");
        assert!((right[0] - 28.0).abs() < 1e-9, "{right:?}");
        assert_eq!(Pose::Photograph(0).camera(&scene, (40, 20)), None);
    }
}
