//! Which parts of a photograph are texture: spectral residual saliency (Hou and Zhang, CVPR 2007), a soft mask from it,
//! and a small network that learns the width of its filter. All computations run on the CPU in double precision and are
//! reproducible.
//!
//! ```
//! use psrgs_vk::dataset::Pixels;
//! use psrgs_vk::saliency::{Gate, Plane, Settings};
//!
//! # fn main() -> Result<(), psrgs_vk::saliency::Error> {
//! let photograph = Pixels::Rgba8(vec![90; 24]);
//! let settings = Settings::default();
//! let luma = Plane::luma(3, 2, &photograph)?.reduced(settings.side);
//! let saliency = Gate::Spectral.mask(&luma, 3.0, 0, &settings)?;
//! assert_eq!((saliency.mask.width(), saliency.mask.height()), (3, 2));
//! # Ok(())
//! # }
//! ```
//!
//! A [`Spectrum`] holds what all maps of an image share. [`Spectrum::map`] costs two transforms and gives the map with
//! its derivative with respect to sigma; [`Map::mask`] gives the soft mask with its derivative. [`SigmaLearner`]
//! chooses a sigma for each image.

mod blur;
mod cache;
mod curve;
mod detail;
mod error;
mod features;
mod fft;
mod gate;
mod learner;
mod losses;
mod map;
mod mask;
mod network;
mod plane;
mod replay_buffer;
mod resample;
mod settings;
mod spectrum;

pub use cache::Cache;
pub use curve::{Agreement, Curve, agreement, spaced};
pub use detail::{WIDEST_SPACING, spacing, spacing_by_mask, variation, variation_floor};
pub use error::Error;
pub use features::{Features, RINGS};
pub use gate::{Gate, Saliency};
pub use learner::{Choice, LearnSettings, Renders, SigmaLearner, Update};
pub use losses::{MaskTarget, composite, cross_entropy};
pub use map::Map;
pub use mask::SoftMask;
pub use network::{Network, PARAMETERS};
pub use plane::{Plane, split};
pub use settings::{Border, Settings};
pub use spectrum::Spectrum;
