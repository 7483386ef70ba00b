//! Perceptual distances of two images: LPIPS on SqueezeNet 1.1, and a bank of filters for use without weights, as
//! Vulkan passes with their gradients.
//!
//! ```no_run
//! use psrgs_vk::perceptual::{Distance, GradientOf, LpipsWeights, Metric, ImagePair};
//! # use psrgs_vk::vk::{Buffer, Gpu};
//! # fn example(
//! #     gpu: Gpu, [image, photograph, grad_image]: [Buffer; 3], [rgb, rgba]: [Vec<u8>; 2],
//! # ) -> Result<(), Box<dyn std::error::Error>> {
//! let weights = LpipsWeights::find("weights".as_ref())?;
//! let lpips = Distance::lpips(&gpu, &weights)?;
//! let score = Metric::new(&gpu, lpips.clone()).distance(&rgb, &rgba, 640, 360)?;
//!
//! // As a term of a loss: memory is allocated once, and nothing waits for the device.
//! let windows = lpips.windows(128, 128, true)?;
//! let mut recorder = gpu.recorder("step")?;
//! let pair = ImagePair { image: &image, photograph: &photograph, size: (640, 360), at: (17, 90), cropped: false };
//! windows.record(&mut recorder, &pair, Some(&GradientOf { image: &grad_image, weight: 0.05 }))?;
//! # Ok(())
//! # }
//! ```

mod activations;
mod distance;
mod error;
mod filter_bank;
mod folder;
mod metric;
mod network;
mod read;
mod rows;
mod squeezenet;
mod tensors;
mod trunk;
mod window;

pub use distance::Distance;
pub use error::Error;
pub use folder::{PUBLIC_FILES, PublicFile};
pub use metric::Metric;
pub use read::read_tensors;
pub use squeezenet::LpipsWeights;
pub use tensors::{Tensor, Tensors};
pub use window::{GradientOf, ImagePair, Windows};
