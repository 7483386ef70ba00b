//! Gradients of the 3D Gaussians fused with an optimiser step, without gradients in memory.

use super::adam::{self, AdamSettings};
use super::camera::CameraPush;
use super::project_backward::Penalties;
use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, read_write};

/// [`Push::flags`]: the step includes opacities.
pub const STEPS_OPACITIES: u32 = 4;
/// [`Push::flags`]: `DECIDE` counts in the step.
pub const DECIDES: u32 = 16;
/// [`Push::flags`]: first bit of the degree of spherical harmonics in use.
pub const DEGREE_SHIFT: u32 = 8;

/// [`Push::flags`]: first bit of the step number, modulo 2^16, which keys the rounding of packed moments.
pub const STEP_SHIFT: u32 = 16;

/// Learning rates of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LearningRates {
    /// Of the means, in scene units.
    pub means: f64,
    /// Of the quats.
    pub quats: f64,
    /// Of the log scales.
    pub scales: f64,
    /// Of the opacity logits.
    pub opacities: f64,
    /// Of the sh coefficients of degree 0.
    pub sh_base: f64,
    /// Of the sh coefficients above degree 0.
    pub sh_rest: f64,
}

/// Number of optimiser steps of an element, including this step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepCounts {
    /// Steps of all parameters except opacities.
    pub most: u32,
    /// Steps of opacities; `None` leaves opacities unchanged.
    pub opacities: Option<u32>,
}

crate::push_constants! {
    /// Push constants of [`PASS`]; see [`Push::new`].
    pub struct Push {
        /// See [`CameraPush`].
        pub row0: [f32; 4],
        /// See [`CameraPush`].
        pub row1: [f32; 4],
        /// See [`CameraPush`].
        pub row2: [f32; 4],
        /// Camera centre in the scene.
        pub center: [f32; 3],
        /// Flags of [`CameraPush`], [`STEPS_OPACITIES`] and [`DECIDES`], the degree of spherical harmonics from bit
        /// [`DEGREE_SHIFT`] on, and the step from bit [`STEP_SHIFT`] on.
        pub flags: u32,
        /// See [`CameraPush`].
        pub limits: [f32; 4],
        /// fx, fy in pixels.
        pub focal: [f32; 2],
        /// Learning rate of the means; see [`LearningRates`].
        pub lr_means: f32,
        /// See [`LearningRates`].
        pub lr_quats: f32,
        /// See [`LearningRates`].
        pub lr_scales: f32,
        /// See [`LearningRates`].
        pub lr_opacities: f32,
        /// See [`LearningRates`].
        pub lr_sh_base: f32,
        /// See [`LearningRates`].
        pub lr_sh_rest: f32,
        /// 1 / (1 - beta1^t).
        pub inv_bias1: f32,
        /// 1 / sqrt(1 - beta2^t).
        pub inv_sqrt_bias2: f32,
        /// With t of the opacities.
        pub inv_bias1_opacities: f32,
        /// With t of the opacities.
        pub inv_sqrt_bias2_opacities: f32,
    }
}

impl Push {
    /// The push constants of a step with a view of `camera`.
    pub fn new(camera: &CameraPush, settings: &AdamSettings, rates: &LearningRates, steps: StepCounts) -> Self {
        let adam = |t: u32| adam::Push::new(settings, t, 1, 0, 0.0, 0.0);
        let (most, opacities) = (adam(steps.most), adam(steps.opacities.unwrap_or(1)));
        let stepped = if steps.opacities.is_some() { STEPS_OPACITIES } else { 0 };
        let [x, y, z, _] = camera.center;
        let [fx, fy, ..] = camera.intrinsics;
        Self {
            row0: camera.row0,
            row1: camera.row1,
            row2: camera.row2,
            center: [x, y, z],
            flags: camera.flags | stepped | camera.sh_degree.min(3) << DEGREE_SHIFT | steps.most << STEP_SHIFT,
            limits: camera.limits,
            focal: [fx, fy],
            lr_means: rates.means as f32,
            lr_quats: rates.quats as f32,
            lr_scales: rates.scales as f32,
            lr_opacities: rates.opacities as f32,
            lr_sh_base: rates.sh_base as f32,
            lr_sh_rest: rates.sh_rest as f32,
            inv_bias1: most.inv_bias1,
            inv_sqrt_bias2: most.inv_sqrt_bias2,
            inv_bias1_opacities: opacities.inv_bias1,
            inv_sqrt_bias2_opacities: opacities.inv_sqrt_bias2,
        }
    }

    /// The same, in which [`Penalties::decide`] counts if `decides`.
    pub fn deciding(self, decides: bool) -> Self {
        Self { flags: self.flags | if decides { DECIDES } else { 0 }, ..self }
    }
}

/// Specialization constants, by name.
pub type Constants = [(&'static str, u32); 15];

/// Adds losses on the splats themselves to `constants`. [`Penalties::decide`] counts only in steps with [`DECIDES`].
pub fn penalising(constants: Constants, penalties: Penalties) -> Constants {
    let weights = penalties.constants();
    constants.map(|(name, value)| (name, weights.iter().find(|(of, _)| *of == name).map_or(value, |(_, bits)| *bits)))
}

/// Changes `constants` for a step of only the splats on the image. The buffer `on_image` then lists these splats in
/// index order, and `counters.visible` holds their number. Each splat first makes up for its missed steps, by its row
/// of `stats`.
pub fn listed(constants: Constants) -> Constants {
    constants.map(|(name, value)| (name, if name == "LISTED" { 1 } else { value }))
}

/// Changes `constants` to make up for the missed steps of every splat, without a new step.
pub fn catching_up(constants: Constants) -> Constants {
    constants.map(|(name, value)| (name, if name == "CATCHES_UP" { 1 } else { value }))
}

/// Changes `constants` so that sh coefficients are read again where they step, which takes fewer registers. The same
/// bits.
pub fn reading_again(constants: Constants) -> Constants {
    constants.map(|(name, value)| (name, if name == "READS_AGAIN" { 1 } else { value }))
}

/// The specialization constants of [`PASS`]. No sh coefficient above `degree` ever had a gradient, so their moments are
/// zero and the step skips them.
pub fn constants(settings: &AdamSettings, degree: u32, aux: bool) -> Constants {
    let adam = adam::Push::new(settings, 1, 1, 0, 0.0, 0.0);
    [
        ("AUX", u32::from(aux)),
        ("DEGREE", degree.min(3)),
        ("BETA1", adam.beta1.to_bits()),
        ("GAIN1", adam.gain1.to_bits()),
        ("BETA2", adam.beta2.to_bits()),
        ("GAIN2", adam.gain2.to_bits()),
        ("EPS", adam.eps.to_bits()),
        ("FLATTEN", 0),
        ("SHRINK", 0),
        ("LISTED", 0),
        ("CATCHES_UP", 0),
        ("PRICE_OPACITY", 0),
        ("PRICE_SCALE", 0),
        ("DECIDE", 0),
        ("READS_AGAIN", 0),
    ]
}

pub(super) const CONSTANTS: &[Constant] = &[
    Constant { id: 0, name: "AUX", default: 0 },
    Constant { id: 1, name: "DEGREE", default: 3 },
    Constant { id: 2, name: "BETA1", default: 0x3f66_6666 },
    Constant { id: 3, name: "GAIN1", default: 0x3dcc_cccd },
    Constant { id: 4, name: "BETA2", default: 0x3f7f_be77 },
    Constant { id: 5, name: "GAIN2", default: 0x3a83_126f },
    Constant { id: 6, name: "EPS", default: 0x2690_1d7d },
    Constant { id: 7, name: "FLATTEN", default: 0 },
    Constant { id: 8, name: "SHRINK", default: 0 },
    Constant { id: 9, name: "LISTED", default: 0 },
    Constant { id: 10, name: "CATCHES_UP", default: 0 },
    Constant { id: 11, name: "PRICE_OPACITY", default: 0 },
    Constant { id: 12, name: "PRICE_SCALE", default: 0 },
    Constant { id: 13, name: "DECIDE", default: 0 },
    Constant { id: 14, name: "READS_AGAIN", default: 0 },
];

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "project_backward_adam",
        spirv: module("project_backward_adam"),
        bindings: &[
            read("counters"),
            read("splat2d"),
            read("on_image"),
            read("grad2d"),
            read("grad_normals"),
            read_write("means"),
            read_write("quats"),
            read_write("scales"),
            read_write("opacities"),
            read_write("sh0"),
            read_write("sh1"),
            read_write("sh2"),
            read_write("sh3"),
            read_write("m_means"),
            read_write("m_quats"),
            read_write("m_scales"),
            read_write("m_opacities"),
            read_write("m_sh0"),
            read_write("m_sh1"),
            read_write("m_sh2"),
            read_write("m_sh3"),
            read_write("v_means"),
            read_write("v_quats"),
            read_write("v_scales"),
            read_write("v_opacities"),
            read_write("v_sh0"),
            read_write("v_sh1"),
            read_write("v_sh2"),
            read_write("v_sh3"),
            read_write("stats"),
        ],
        push_bytes: Push::BYTES,
        constants: CONSTANTS,
        local_size: Some(64),
    },
    doc: "One thread owns one splat, its parameters and their moments; a workgroup owns 64 consecutive splats. \
          Gradients as in project_backward, its weights included, then a step of adam on every parameter; \
          culled splats step with a gradient of zero. Coefficients above DEGREE stay unchanged. With LISTED, \
          `on_image` holds the splats on the image instead of tile counts, and only these splats step, after \
          making up for their missed steps (since the step in their row of `stats`) with gradients of zero. \
          CATCHES_UP makes up for the missed steps of every splat, without a step.",
    dispatch: "one thread per splat of the model, or of the image (LISTED)",
    push: Push::FIELDS,
};

/// Storage buffers that a device must bind at once for [`PASS`].
pub const BINDINGS: u32 = PASS.kernel.bindings.len() as u32;

#[cfg(test)]
mod tests {
    use super::{AdamSettings, PASS, constants};

    #[test]
    fn default_constants_are_the_default_settings() {
        for ((name, value), constant) in
            constants(&AdamSettings::default(), 3, false).into_iter().zip(PASS.kernel.constants)
        {
            assert_eq!((name, value), (constant.name, constant.default));
        }
    }
}
