//! Gradients of the 3D Gaussians from the gradients of their projections.

use super::camera::CameraPush;
use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, read_write};

/// Weights of losses on the splats themselves; zero for none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Penalties {
    /// Of the smallest standard deviation, in scene units, of every splat on the image.
    pub flatten: f32,
    /// Of half the squared view-dependent sh coefficients in use, of every splat on the image.
    pub shrink: f32,
    /// Of the mean opacity of all splats.
    pub opacity: f32,
    /// Of the mean standard deviation, in scene units, of all splats and axes.
    pub scale: f32,
    /// Of o (1 - o) of the opacity o of every splat on the image.
    pub decide: f32,
}

impl Penalties {
    /// The penalties that count in a view beside that of the step.
    pub fn beside(self) -> Self {
        Self { shrink: self.shrink, decide: self.decide, ..Self::default() }
    }

    /// The specialization constants of the penalties.
    pub fn constants(self) -> [(&'static str, u32); 5] {
        [
            ("FLATTEN", self.flatten.to_bits()),
            ("SHRINK", self.shrink.to_bits()),
            ("PRICE_OPACITY", self.opacity.to_bits()),
            ("PRICE_SCALE", self.scale.to_bits()),
            ("DECIDE", self.decide.to_bits()),
        ]
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "project_backward",
        spirv: module("project_backward"),
        bindings: &[
            read("counters"),
            read("means"),
            read("quats"),
            read("scales"),
            read("opacities"),
            read("sh0"),
            read("sh1"),
            read("sh2"),
            read("sh3"),
            read("splat2d"),
            read("tile_counts"),
            read("grad2d"),
            read("grad_normals"),
            read_write("g_means"),
            read_write("g_quats"),
            read_write("g_scales"),
            read_write("g_opacities"),
            read_write("g_sh0"),
            read_write("g_sh1"),
            read_write("g_sh2"),
            read_write("g_sh3"),
        ],
        push_bytes: CameraPush::BYTES,
        constants: &[
            Constant { id: 0, name: "AUX", default: 0 },
            Constant { id: 1, name: "FLATTEN", default: 0 },
            Constant { id: 2, name: "ADD", default: 0 },
            Constant { id: 3, name: "SHRINK", default: 0 },
            Constant { id: 4, name: "PRICE_OPACITY", default: 0 },
            Constant { id: 5, name: "PRICE_SCALE", default: 0 },
            Constant { id: 6, name: "DECIDE", default: 0 },
        ],
        local_size: Some(64),
    },
    doc: "One thread owns one splat; a workgroup owns 64 consecutive splats. Recomputes the projection and writes the \
          gradients of all 59 parameters, zeros for culled splats; with ADD = 1 adds to them instead. \
          Normals take part when AUX = 1. FLATTEN and SHRINK, floats as bits, are the weights of the smallest \
          standard deviation and of half the squares of the view-dependent coefficients in use in the loss; DECIDE \
          is that of o (1 - o) of opacities. PRICE_OPACITY and PRICE_SCALE are the weights of the mean opacity and of \
          the mean standard deviation of all splats, culled splats included.",
    dispatch: "one thread per splat of the model",
    push: CameraPush::FIELDS,
};
