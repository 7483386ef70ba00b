//! Multi-view stereo: depth, normals and how far to trust them, for posed photographs, by PatchMatch on the device.
//!
//! Every pixel holds a hypothesis, a piece of a plane. Hypotheses are scored by how well the picture's window looks in other views when
//! it is taken there by the plane (bilateral NCC), spread to neighbours that do better with them, and are refined by random changes
//! (PatchMatch: Barnes et al. 2009; for stereo Bleyer et al. 2011; the checkerboard with eight arms and the constants: ACMH and ACMM of
//! Xu and Tao 2019, COLMAP of Schönberger et al. 2016). What views agree on is kept.
//!
//! ```no_run
//! use psrgs_vk::stereo::{self, Matcher, Settings};
//! # use psrgs_vk::{dataset::{Dataset, HostShare}, vk::Gpu};
//! # fn example(gpu: Gpu, dataset: Dataset) -> Result<(), Box<dyn std::error::Error>> {
//! let settings = Settings::default();
//! let scene = stereo::Scene::of(&dataset, &settings, &HostShare::unlimited(), |view| view.photograph())?;
//! let priors = Matcher::new(&gpu, &settings)?.run(&scene.views, |_| ())?;
//! let cloud = stereo::fuse(&scene.views, &priors, &settings);
//! # Ok(())
//! # }
//! ```

mod accuracy;
mod continued;
mod error;
mod extend;
mod fuse;
mod links;
mod matcher;
mod prior;
mod room;
mod scene;
mod settings;
mod skirt;
mod sources;
mod start;
mod surface;
mod view;
mod work;

pub use accuracy::{Accuracy, Known};
pub use error::Error;
pub use extend::extend;
pub use fuse::{FusedPoint, fuse, lifted_pixel};
pub use matcher::Matcher;
pub use prior::Prior;
pub use room::Room;
pub use scene::{Pending, Scene, Skipped, WithoutDepth};
pub use settings::{Budget, Settings};
pub use skirt::{SkirtPoint, skirt};
pub use sources::{Observations, choose_sources};
pub use start::{Start, depth_range};
pub use surface::{surface, surface_of_points};
pub use view::View;
