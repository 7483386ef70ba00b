//! Multi-view stereo: depth, normals and confidence of posed photographs, by PatchMatch on the device.
//!
//! Every pixel holds a hypothesis, a piece of a plane. A hypothesis is scored by how well the window around the pixel
//! matches other views when the plane maps it there (bilateral NCC). Good hypotheses spread to neighbours and are
//! refined by random changes (PatchMatch: Barnes et al. 2009; for stereo Bleyer et al. 2011; the checkerboard with
//! eight arms and the constants: ACMH and ACMM of Xu and Tao 2019, COLMAP of Schönberger et al. 2016). Hypotheses that
//! several views agree on are kept.
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
mod depth_extrapolation;
mod device_state;
mod error;
mod extrapolate;
mod fuse;
mod homography;
mod initial_planes;
mod matcher;
mod memory_estimate;
mod prior;
mod scene;
mod settings;
mod skirt;
mod surface;
mod view;
mod view_selection;

pub use accuracy::{Accuracy, ViewTruth};
pub use error::Error;
pub use extrapolate::extend;
pub use fuse::{FusedPoint, fuse, lifted_pixel};
pub use initial_planes::{InitialPlanes, depth_range};
pub use matcher::Matcher;
pub use memory_estimate::MemoryEstimate;
pub use prior::Prior;
pub use scene::{PendingPhotograph, Scene, SkippedView, WithoutDepth};
pub use settings::{Budget, Settings};
pub use skirt::{SkirtPoint, skirt};
pub use surface::{surface, surface_of_points};
pub use view::StereoView;
pub use view_selection::{Observations, choose_sources};
