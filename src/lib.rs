//! Gaussian splatting on raw Vulkan compute: read posed photographs, train a 3D Gaussian model, render and score it.
//!
//! [`train`] composes [`raster`], which composes [`pass`], which describes compute shaders that [`vk`] runs. Vulkan
//! handles stay inside [`vk`]; [`scene`], [`dataset`], [`mod@format`] and [`saliency`] do not use Vulkan. [`twin`]
//! computes the passes' results on the CPU. Conventions (frames, units, orders) are in `docs/CONVENTIONS.md`.
//!
//! # Rendering a model
//!
//! ```no_run
//! use psrgs_vk::dataset::{Dataset, LoadOptions};
//! use psrgs_vk::format::{image_out, ply};
//! use psrgs_vk::pass::camera::Projection;
//! use psrgs_vk::raster::{RenderView, Viewer};
//! use psrgs_vk::vk::{Gpu, OpenOptions};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let gpu = Gpu::open(&OpenOptions::default())?;
//! let cameras = Dataset::load("fox".as_ref(), &LoadOptions { photographs: false, ..LoadOptions::default() })?;
//! // Model files are in dataset coordinates, renders in scene coordinates.
//! let model = ply::read("fox-model/point_cloud.ply".as_ref())?.in_scene(&cameras.frame);
//! let camera = cameras.scene_camera(0).ok_or("the dataset has no camera")?;
//!
//! let mut viewer = Viewer::new(&gpu);
//! let planes = viewer.upload(&model)?;
//! let shot = RenderView { camera, projection: Projection::default(), background: [0.0; 3] };
//! let render = viewer.render(&planes, model.len() as u32, &shot, false)?;
//! image_out::write_png("fox.png".as_ref(), render.width, render.height, &render.rgb8())?;
//! # Ok(())
//! # }
//! ```
//!
//! On a device that belongs to a host program, [`vk::Gpu::adopt`] takes the place of `open`
//! (`docs/EMBEDDING.md`, `examples/embed.rs`, `examples/view_while_training.rs`).
//!
//! # Training
//!
//! A [`train::Trainer`] works only while a caller waits for the next [`train::Message`]. Between any two messages the
//! caller can read the model, save a checkpoint or stop.
//!
//! ```no_run
//! use psrgs_vk::dataset::Dataset;
//! use psrgs_vk::format::ply;
//! use psrgs_vk::train::{Message, Pacing, Settings, Trainer, prepare};
//! use psrgs_vk::vk::{Gpu, OpenOptions};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let gpu = Gpu::open(&OpenOptions::default())?;
//! let mut settings = Settings::default();
//! settings.run.iterations = 2000;
//! settings.run.scale_schedule = true;
//! let options = prepare::load_options(&settings.photographs, settings.model.background.evaluated());
//! let dataset = Dataset::load("fox".as_ref(), &options)?;
//! let input = prepare::input(&dataset, &settings)?;
//!
//! let mut trainer = Trainer::new(&gpu, input, &settings, Pacing::default(), None)?;
//! while let Some(message) = trainer.next_message()? {
//!     match message {
//!         Message::Step { step, loss, splats, .. } => println!("{step}: {loss}, {splats} splats"),
//!         Message::Evaluated { step, quality, .. } => println!("{step}: {:.2} dB", quality.psnr),
//!         _ => {}
//!     }
//! }
//! ply::save("point_cloud.ply".as_ref(), &trainer.model()?, &dataset.frame, settings.model.antialias)?;
//! # Ok(())
//! # }
//! ```

pub mod bench;
pub mod blocks;
mod byte_size;
pub mod compare;
pub mod dataset;
pub mod eval;
pub mod format;
pub mod geodesy;
mod host_memory;
pub mod lod;
pub mod loss;
pub mod map;
pub mod numbers;
pub mod pass;
pub mod perceptual;
pub mod raster;
pub mod saliency;
pub mod scene;
pub mod stereo;
pub mod train;
pub mod twin;
pub mod view;
pub mod vk;
pub mod world;
