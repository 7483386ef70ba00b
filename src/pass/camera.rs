//! The camera of a view as push constants of the projecting passes (`glsl/include/camera.glsl`).

use crate::scene::Camera;

/// [`CameraPush::flags`]: multiply opacities by sqrt(det before / det after dilation), as in Mip-Splatting.
pub const ANTIALIAS: u32 = 1;
/// [`CameraPush::flags`]: where the field-of-view clamp of the EWA Jacobian is active, use the 3DGS reference's
/// derivative by depth, twice the true derivative.
pub const REFERENCE_CLAMP: u32 = 2;
/// [`CameraPush::flags`]: a colour at its lower bound has a gradient if a descent step would raise the colour. Bit 2 is
/// [`super::project_backward_adam::STEPS_OPACITIES`].
pub const BLACK_LEARNS: u32 = 8;

/// The near plane of the 3DGS reference, for scenes of extent 5.
pub const NEAR: f64 = 0.2;

crate::push_constants! {
    /// Push constants of `project` and `project_backward`.
    pub struct CameraPush {
        /// Row 0 of the rotation from scene to camera frame, then the translation along x.
        pub row0: [f32; 4],
        /// Row 1 of the rotation, then the translation along y.
        pub row1: [f32; 4],
        /// Row 2 of the rotation, then the translation along z.
        pub row2: [f32; 4],
        /// Camera centre in scene coordinates, then the near plane (above zero).
        pub center: [f32; 4],
        /// fx, fy, cx, cy in pixels.
        pub intrinsics: [f32; 4],
        /// Smallest and largest x/z, then smallest and largest y/z, for the EWA Jacobian.
        pub limits: [f32; 4],
        /// Image width in pixels.
        pub width: u32,
        /// Image height in pixels.
        pub height: u32,
        /// Highest degree of spherical harmonics in use, 0 to 3.
        pub sh_degree: u32,
        /// Sum of [`ANTIALIAS`], [`REFERENCE_CLAMP`] and [`BLACK_LEARNS`].
        pub flags: u32,
    }
}

/// Options of the projection of splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Highest degree of spherical harmonics in use, 0 to 3.
    pub sh_degree: u32,
    /// Near plane: splats at this depth or nearer are culled. In scene units, above zero.
    pub near: f64,
    /// Whether opacities are multiplied by the anti-aliasing factor.
    pub antialias: bool,
    /// Whether gradients use the 3DGS reference's derivative of the field-of-view clamp.
    pub reference_clamp: bool,
    /// Whether a colour at its lower bound can recover: max(0, .) then passes a gradient that would raise the colour.
    /// If false, max(0, .) passes no gradient at the bound, as in the 3DGS reference.
    pub black_learns: bool,
    /// The range of [`clamp_limits`]; `None` for the range of the camera itself. A window needs the range of its whole
    /// image.
    pub limits: Option<[f64; 4]>,
    /// Whether rays are parallel to the camera's z axis, as those of a map. Focal lengths are then pixels per scene unit,
    /// a splat lies at `(fx x + cx, fy y + cy)`, and the principal point must be whole numbers, so that pictures of
    /// windows have the pixels of the whole. For renders only: such a view has no gradients.
    pub orthographic: bool,
    /// Alpha cutoff n: a splat is skipped at a pixel where its alpha is below 1 / n. `None` stands for 255.
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
            orthographic: false,
            alpha_cutoff: None,
        }
    }
}

/// Ranges of x/z, then y/z, for the EWA Jacobian: the image's field of view, extended by 0.3 tan(fov/2) on each side.
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

/// The range of a projection. Parallel rays have ratios of 0 alone.
pub(crate) fn limits(camera: &Camera, projection: &Projection) -> [f64; 4] {
    match projection.limits {
        _ if projection.orthographic => [-1.0, 1.0, -1.0, 1.0],
        Some(limits) => limits,
        None => clamp_limits(camera),
    }
}

impl CameraPush {
    /// Converts a camera to push constants. Camera centre and limits are computed in double precision, then rounded.
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
            limits: limits(camera, projection).map(|x| x as f32),
            width: camera.width,
            height: camera.height,
            sh_degree: projection.sh_degree.min(3),
            flags,
        }
    }
}
