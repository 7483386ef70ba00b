//! How well a model's geometry agrees with a known one: depth, normals, splats off the surface,
//! pictures from elsewhere.

mod closest;
mod pictures;
mod surface;
mod truth;

pub use closest::Closest;
pub use pictures::Agreement;
pub use surface::{OffSurface, off_surface};
pub(super) use truth::{DepthFile, depth_maps};
pub use truth::{GeometryError, GeometryTruth, Known};

use serde::{Deserialize, Serialize};

use super::psnr_where;
use crate::numbers::mean;
use crate::numbers::percent;
use crate::raster::Picture;
use crate::scene::{Camera, Gaussians};

/// Geometry metrics. What has no ground truth is absent, also from `metrics.json`,
/// whose keys are the names of the fields.
///
/// Depth and normals are compared on the held-out views that have `depth/NAME.exr` and `normal/NAME.exr`, at the size
/// of these files, in pixels with a true depth. A pixel is *covered* where the picture's opacity, one minus the final
/// transmittance, is above 0.5; its depth is the expected one, sum w z / sum w.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Geometry {
    /// Mean PSNR of the off-path views, decibels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub psnr_offpath: Option<f64>,
    /// Median of |z - z_true| / z_true over covered pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_median_error: Option<f64>,
    /// Share of the pixels that are covered and whose depth is off by 0.5 % at most.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_within_0_5_percent: Option<f64>,
    /// The same for 2 %.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_within_2_percent: Option<f64>,
    /// Share of the pixels that are covered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_coverage: Option<f64>,
    /// Median error of the depth as above, over the off-path views.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_median_error_offpath: Option<f64>,
    /// Median angle between the picture's normal and the true one over covered pixels, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normal_median_degrees: Option<f64>,
    /// Median distance of opaque splats from the true surface, in the dataset's units: see [`off_surface`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface_distance: Option<f64>,
    /// Share of the opaque mass that is further from the true surface than 1 % of the extent: see [`off_surface`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floaters: Option<f64>,
}

/// Compares a model, given in scene coordinates, with the truth of its dataset. `render` draws it from a camera of the
/// scene, with depth and normals.
pub fn measure<E: From<GeometryError>>(
    truth: &GeometryTruth,
    model: &Gaussians,
    mut render: impl FnMut(&Camera) -> Result<Picture, E>,
) -> Result<Geometry, E> {
    let mut held_out = Agreement::default();
    for view in &truth.views {
        let known = view.read()?;
        held_out.add(&render(&known.camera)?, &known, truth.frame.scale);
    }
    let (mut offpath, mut decibels) = (Agreement::default(), Vec::new());
    for view in &truth.offpath {
        let photograph = view.photograph()?;
        let picture = render(&view.camera)?.rgb8();
        let (colours, counts): (Vec<[u8; 3]>, Vec<bool>) =
            photograph.rgba8().chunks_exact(4).map(|p| ([p[0], p[1], p[2]], p[3] >= 128)).unzip();
        decibels.extend(psnr_where(&picture, colours.as_flattened(), &counts));
        if let Some(maps) = &view.maps {
            let known = maps.read()?;
            offpath.add(&render(&known.camera)?, &known, truth.frame.scale);
        }
    }
    let off = match truth.surface()? {
        Some(surface) => off_surface(model, &truth.frame, truth.extent, &surface),
        None => OffSurface::default(),
    };
    Ok(Geometry {
        psnr_offpath: if decibels.is_empty() { None } else { mean(decibels.into_iter()) },
        depth_median_error: held_out.median_error(),
        depth_within_0_5_percent: held_out.within(0.005),
        depth_within_2_percent: held_out.within(0.02),
        depth_coverage: held_out.coverage(),
        depth_median_error_offpath: offpath.median_error(),
        normal_median_degrees: held_out.median_degrees(),
        surface_distance: off.distance,
        floaters: off.floaters,
    })
}

impl Geometry {
    /// Names and values of what is there, to be shown.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let percent = |v: f64| percent(v, 2);
        [
            ("PSNR off the path", self.psnr_offpath.map(|v| format!("{v:.2} dB"))),
            ("depth error, median", self.depth_median_error.map(percent)),
            ("depth within 0.5 %", self.depth_within_0_5_percent.map(percent)),
            ("depth within 2 %", self.depth_within_2_percent.map(percent)),
            ("pixels with depth", self.depth_coverage.map(percent)),
            ("depth error off the path, median", self.depth_median_error_offpath.map(percent)),
            ("normal error, median", self.normal_median_degrees.map(|v| format!("{v:.1}\u{b0}"))),
            ("distance to the surface, median", self.surface_distance.map(|v| format!("{v:.3} units"))),
            ("floaters", self.floaters.map(percent)),
        ]
        .into_iter()
        .filter_map(|(name, value)| Some((name, value?)))
        .collect()
    }
}
