//! Models as PLY files in the layout of INRIA's 3DGS, which viewers and editors read.
//!
//! Per vertex `x y z nx ny nz f_dc_0..2 f_rest_0..44 opacity scale_0..2 rot_0..3`, f32, binary little endian; `f_rest`
//! has all coefficients of red, then of green, then of blue; opacities are logits, scales natural logarithms, rotations
//! (w, x, y, z), of unit length in trained models. Normals are zero. What the layout has no place for stands in
//! comments:
//!
//! ```text
//! comment psrgs-vk version 0.1.0
//! comment SplatRenderMode: default
//! comment psrgs-vk offset 500000 4600000 100
//! comment psrgs-vk constrained 12345
//! ```
//!
//! `SplatRenderMode` is `mip` where opacities carry the anti-aliasing factor; viewers and converters of others read
//! this line. In its place `antialiased 0` or `1` is read too, and `psrgs-vk antialias 0` or `1`; the last such line
//! counts. `constrained` is the number of splats from the beginning of the file that existed at the end of the
//! low-frequency stage. Positions plus `offset` are coordinates of the dataset; without such a line the offset is zero.

mod cloud;
mod colours;
mod columns;
mod header;
mod mesh;
mod read;
mod write;

use std::path::Path;

use super::{Error, LeftOut};
use crate::scene::{Frame, Gaussians, Similarity};

pub use cloud::{Cloud, Content, read_content, read_content_with};
pub(crate) use colours::of_numbers as colours_of_numbers;
pub use mesh::Mesh;
pub use read::{read, read_with};
pub use write::write;

/// Coefficients of spherical harmonics per colour channel, without the constant one, by degree.
pub(super) const REST_BY_DEGREE: [usize; 4] = [0, 3, 8, 15];

/// The content of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// The splats at dataset coordinates minus [`Model::shift`]; ids are 0, 1, 2, ... in the order of the file.
    pub gaussians: Gaussians,
    /// Degree of the spherical harmonics the file has; higher coefficients are zero.
    pub sh_degree: u32,
    /// The vector from coordinates of the means to coordinates of the dataset.
    pub shift: [f64; 3],
    /// Whether the model was trained with the anti-aliasing factor on the opacity, where the file says it.
    pub antialias: Option<bool>,
    /// How many of the splats, the first ones, were there at the end of the low-frequency stage,
    /// where the file says it.
    pub constrained: Option<usize>,
    /// The version of this program that wrote the file, where one did.
    pub version: Option<String>,
    /// Splats of the file that are not finite, and are not among these.
    pub left_out: Option<LeftOut>,
}

/// Writes splats given in scene coordinates in the dataset's units and axes, minus [`Frame::shift`],
/// with quaternions of unit length.
pub fn save(file: &Path, gaussians: &Gaussians, frame: &Frame, antialias: bool) -> Result<(), Error> {
    save_staged(file, gaussians, frame, antialias, None)
}

/// The same of a model whose first `constrained` splats were there at the end of the low-frequency stage.
pub fn save_staged(
    file: &Path,
    gaussians: &Gaussians,
    frame: &Frame,
    antialias: bool,
    constrained: Option<usize>,
) -> Result<(), Error> {
    let shift = frame.shift();
    let mut gaussians = frame.gaussians_to_dataset(gaussians, shift);
    gaussians.normalise_quats();
    let model = Model {
        gaussians,
        sh_degree: 3,
        shift,
        antialias: Some(antialias),
        constrained,
        version: Some(env!("CARGO_PKG_VERSION").to_owned()),
        left_out: None,
    };
    write(file, &model)
}

impl Model {
    /// The splats in the coordinates of a scene.
    pub fn in_scene(&self, frame: &Frame) -> Gaussians {
        frame.gaussians_to_scene(&self.gaussians, self.shift)
    }

    /// The splats in the coordinates of a scene, where the file's (with [`Model::shift`] added) are not the dataset's:
    /// `from_model` takes them there.
    pub fn placed_in_scene(&self, from_model: &Similarity, frame: &Frame) -> Gaussians {
        // One map in f64, so that nothing is rounded in between.
        from_model.after_shift(self.shift).then(&Similarity::to_scene(frame)).gaussians(&self.gaussians)
    }
}
