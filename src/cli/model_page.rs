//! A model within a report, to look around in.

use psrgs_vk::dataset::Dataset;
#[cfg(feature = "html-viewer")]
use psrgs_vk::dataset::Role;
use psrgs_vk::eval::Interactive;
#[cfg(feature = "html-viewer")]
use psrgs_vk::scene::Camera;
use psrgs_vk::scene::Gaussians;

/// A model in the scene's coordinates, and how a report shows it.
#[cfg_attr(not(feature = "html-viewer"), allow(dead_code, reason = "without a viewer no report shows a model"))]
pub(crate) struct InReport<'a> {
    pub(crate) title: &'a str,
    pub(crate) gaussians: &'a Gaussians,
    pub(crate) dataset: &'a Dataset,
    pub(crate) background: [f32; 3],
    pub(crate) antialias: bool,
}

/// The remedy where a report has no model.
#[cfg(feature = "html-viewer")]
const EXPORT: &str = "psrgs-vk export writes an HTML file of any size.";

impl InReport<'_> {
    /// No model.
    #[cfg(not(feature = "html-viewer"))]
    pub(crate) fn interactive(&self) -> Interactive {
        Interactive::absent(format!("The model is not here to look around in: {NO_VIEWER}."))
    }

    /// The model without higher spherical harmonics, which would take most of its size.
    #[cfg(feature = "html-viewer")]
    pub(crate) fn interactive(&self) -> Interactive {
        let splats = self.gaussians.len();
        if splats == 0 {
            return Interactive::absent("The model has no splats.");
        }
        let too_large = || {
            let count = psrgs_vk::numbers::counted(splats, "splat");
            Interactive::absent(format!("{count} are too many to look around in within this page; {EXPORT}"))
        };
        if splats > Interactive::MOST_SPLATS {
            return too_large();
        }
        match self.page() {
            Ok(page) => Interactive::page(&page).unwrap_or_else(too_large),
            Err(why) => Interactive::absent(format!("The model is not here to look around in: {why}.")),
        }
    }

    #[cfg(feature = "html-viewer")]
    fn page(&self) -> Result<String, String> {
        let shown = psrgs_vk::format::html::Shown {
            title: self.title,
            gaussians: self.gaussians,
            cameras: &cameras(self.dataset),
            up: None,
            sh_degree: 0,
            background: self.background,
            antialias: self.antialias,
        };
        shown.html().map_err(|error| error.to_string())
    }
}

/// Why a build without the feature has no pages.
#[cfg(not(feature = "html-viewer"))]
pub(crate) const NO_VIEWER: &str = "this psrgs-vk was built without its feature html-viewer";

/// Names and cameras of a dataset's photographs, in the scene.
#[cfg(feature = "html-viewer")]
pub(crate) fn cameras(dataset: &Dataset) -> Vec<(String, Camera)> {
    let views = dataset.views.iter().enumerate().filter(|(_, view)| view.role != Role::Unused);
    views.filter_map(|(k, view)| Some((view.name.clone(), dataset.scene_camera(k)?))).collect()
}
