//! The camera of a frame as push constants, shared by the passes that project (`glsl/include/camera.glsl`).

use crate::scene::Camera;

/// [`CameraPush::flags`]: multiply opacities by sqrt(det before / det after dilation), as in Mip-Splatting.
pub const ANTIALIAS: u32 = 1;
/// [`CameraPush::flags`]: where the field-of-view clamp of the EWA Jacobian is active, keep the 3DGS reference's
/// derivative by depth (twice the true one) instead of the true one.
pub const REFERENCE_CLAMP: u32 = 2;
/// [`CameraPush::flags`]: a colour at its lower bound has a gradient where a descent step would raise it. Bit 2 is
/// [`super::project_backward_adam::STEPS_OPACITIES`].
pub const BLACK_LEARNS: u32 = 8;

/// The near plane of the 3DGS reference, for scenes of extent 5.
pub const NEAR: f64 = 0.2;

crate::push_constants! {
    /// Push constants of `project` and `project_backward`.
    pub struct CameraPush {
        /// Row 0 of the rotation from the scene to the camera frame, and the translation along x.
        pub row0: [f32; 4],
        /// Row 1 and the translation along y.
        pub row1: [f32; 4],
        /// Row 2 and the translation along z.
        pub row2: [f32; 4],
        /// Camera centre in the scene; fourth: the near plane, above zero.
        pub center: [f32; 4],
        /// fx, fy, cx, cy in pixels.
        pub intrinsics: [f32; 4],
        /// Smallest and largest x/z, then y/z, that the EWA Jacobian sees.
        pub limits: [f32; 4],
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Highest degree of spherical harmonics in use, 0 to 3.
        pub sh_degree: u32,
        /// [`ANTIALIAS`], [`REFERENCE_CLAMP`], [`BLACK_LEARNS`].
        pub flags: u32,
    }
}

/// How a camera's splats are projected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Highest degree of spherical harmonics in use, 0 to 3.
    pub sh_degree: u32,
    /// Splats at this depth or nearer are culled; scene units, above zero.
    pub near: f64,
    /// Whether opacities carry the anti-aliasing factor.
    pub antialias: bool,
    /// Whether gradients keep the 3DGS reference's derivative of the field-of-view clamp.
    pub reference_clamp: bool,
    /// Whether gradients lead colours at their lower bound back inside: max(0, .) passes a gradient there where a
    /// descent step would raise the colour, and none otherwise. Without, it passes none, as in the 3DGS reference.
    pub black_learns: bool,
    /// The range of [`clamp_limits`] where it is not that of the camera itself: a window's is that of its whole image.
    pub limits: Option<[f64; 4]>,
    /// A splat is skipped at a pixel where its alpha is below 1 / this, where that is not 255.
    pub alpha_cutoff: Option<u32>,
}

impl Default for Projection {
    fn default() -> Self {
        Self {
            sh_degree: 3,
            near: NEAR,
            antialias: false,
            reference_clamp: false,
            black_learns: false,
            limits: None,
            alpha_cutoff: None,
        }
    }
}

/// Range of x/z, then y/z, that the EWA Jacobian sees: the image's field of view, and 0.3 tan(fov/2) on each side.
pub fn clamp_limits(camera: &Camera) -> [f64; 4] {
    let axis = |size: u32, focal: f64, principal: f64| {
        let size = f64::from(size);
        let margin = 0.3 * 0.5 * size / focal;
        [-principal / focal - margin, (size - principal) / focal + margin]
    };
    let [x0, x1] = axis(camera.width, camera.fx, camera.cx);
    let [y0, y1] = axis(camera.height, camera.fy, camera.cy);
    [x0, x1, y0, y1]
}

impl CameraPush {
    /// Rounds a camera to what the device gets; the camera centre and the limits are computed in double precision
    /// first.
    pub fn new(camera: &Camera, projection: &Projection) -> Self {
        let row = |k: usize| {
            let r = camera.rotation[k];
            [r[0] as f32, r[1] as f32, r[2] as f32, camera.translation[k] as f32]
        };
        let c = camera.center();
        let flags = if projection.antialias { ANTIALIAS } else { 0 }
            | if projection.reference_clamp { REFERENCE_CLAMP } else { 0 }
            | if projection.black_learns { BLACK_LEARNS } else { 0 };
        Self {
            row0: row(0),
            row1: row(1),
            row2: row(2),
            center: [c[0] as f32, c[1] as f32, c[2] as f32, projection.near as f32],
            intrinsics: [camera.fx as f32, camera.fy as f32, camera.cx as f32, camera.cy as f32],
            limits: projection.limits.unwrap_or_else(|| clamp_limits(camera)).map(|x| x as f32),
            width: camera.width,
            height: camera.height,
            sh_degree: projection.sh_degree.min(3),
            flags,
        }
    }
}
