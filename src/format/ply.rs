//! Models as PLY files in the layout of INRIA's 3DGS, which viewers and editors can read.
//!
//! Vertex properties: `x y z nx ny nz f_dc_0..2 f_rest_0..44 opacity scale_0..2 rot_0..3`, f32, binary little endian.
//! `f_rest` has all coefficients of red, then green, then blue. Opacities are logits, scales natural logarithms,
//! rotations quaternions (w, x, y, z) of unit length in trained models. Normals are zero. Data without a place in the
//! layout is in comments:
//!
//! ```text
//! comment psrgs-vk version 0.1.0
//! comment SplatRenderMode: default
//! comment psrgs-vk offset 500000 4600000 100
//! comment psrgs-vk constrained 12345
//! ```
//!
//! `SplatRenderMode` is `mip` where opacities carry the anti-aliasing factor; other viewers and converters read this
//! line too. The reader also accepts `antialiased 0` or `1` and `psrgs-vk antialias 0` or `1`; the last such line
//! counts. `constrained` is the number of splats from the beginning of the file that existed at the end of the
//! low-frequency stage. Positions plus `offset` are dataset coordinates; without this line the offset is zero.

mod cloud;
mod colours;
mod columns;
mod compressed;
mod header;
mod mesh;
mod read;
mod stream;
mod write;

use std::path::Path;

use super::{Error, LeftOut};
use crate::scene::{Frame, Gaussians, Similarity};

pub use cloud::{Cloud, Content, read_content, read_content_with};
pub(crate) use colours::of_numbers as colours_of_numbers;
pub use compressed::encode_compressed;
pub use mesh::Mesh;
pub use read::{read, read_with};
pub use stream::{SPLAT_BYTES, SplatBytes, Splats, position, set_position, write_splats};
pub(super) use write::inconsistent;
pub use write::{write, write_degree};

/// Spherical harmonics coefficients per colour channel without the constant one, by degree.
pub(super) const REST_BY_DEGREE: [usize; 4] = [0, 3, 8, 15];

/// The content of a model file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// The splats at dataset coordinates minus [`Model::shift`]. Ids are 0, 1, 2, ... in the order of the file.
    pub gaussians: Gaussians,
    /// Degree of the file's spherical harmonics; higher coefficients are zero.
    pub sh_degree: u32,
    /// Vector from the means' coordinates to dataset coordinates.
    pub shift: [f64; 3],
    /// Whether the model was trained with the anti-aliasing factor on the opacity, if the file says so.
    pub antialias: Option<bool>,
    /// Number of splats at the beginning of the file that existed at the end of the low-frequency stage, if the file
    /// says so.
    pub constrained: Option<usize>,
    /// Version of this program that wrote the file, if one did.
    pub version: Option<String>,
    /// The file's splats with values that are not finite, which are not in `gaussians`.
    pub left_out: Option<LeftOut>,
}

/// Writes splats in scene coordinates as dataset coordinates minus [`Frame::shift`], with unit quaternions.
pub fn save(file: &Path, gaussians: &Gaussians, frame: &Frame, antialias: bool) -> Result<(), Error> {
    save_staged(file, gaussians, frame, antialias, None)
}

/// [`save`] for a model whose first `constrained` splats existed at the end of the low-frequency stage.
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
    /// The model with the splats of the given rows only, in ascending order.
    pub fn rows(&self, rows: &[u32]) -> Self {
        let mut gaussians = self.gaussians.rows(rows);
        gaussians.ids = (0..rows.len() as u32).collect();
        let first = |count: usize| rows.partition_point(|row| (*row as usize) < count);
        Self {
            gaussians,
            sh_degree: self.sh_degree,
            shift: self.shift,
            antialias: self.antialias,
            constrained: self.constrained.map(first),
            version: self.version.clone(),
            left_out: self.left_out.clone(),
        }
    }

    /// The splats in scene coordinates.
    pub fn in_scene(&self, frame: &Frame) -> Gaussians {
        frame.gaussians_to_scene(&self.gaussians, self.shift)
    }

    /// The splats in scene coordinates, for a model in other coordinates than the dataset's. `from_model` maps the
    /// model's coordinates (with [`Model::shift`] added) to the dataset's.
    pub fn placed_in_scene(&self, from_model: &Similarity, frame: &Frame) -> Gaussians {
        // One map in f64 avoids rounding between the steps.
        from_model.after_shift(self.shift).then(&Similarity::to_scene(frame)).gaussians(&self.gaussians)
    }
}
