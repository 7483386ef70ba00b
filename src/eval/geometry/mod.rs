//! How well a model's geometry agrees with what is known of it: depth, normals, splats off the surface,
//! pictures from elsewhere.

mod pictures;
mod sight;
mod surface;
mod truth;

pub use pictures::{Agreement, Judge, JudgedDepth};
pub use surface::{Closest, OffSurface, off_surface};
use truth::Maps;
pub(super) use truth::{DepthFile, depth_maps};
pub use truth::{GeometryError, GeometryTruth, Known};

use serde::{Deserialize, Serialize};

use super::psnr_where;
use crate::dataset::{Dataset, LoadOptions};
use crate::numbers::mean;
use crate::numbers::percent;
use crate::raster::{DepthProbe, Picture};
use crate::scene::{Camera, Gaussians};

/// Geometry metrics. What has no ground truth is absent, also from `metrics.json`,
/// whose keys are the names of the fields.
///
/// Depth and normals are compared on the held-out views that have `depth/NAME.exr` and `normal/NAME.exr`, at the size
/// of these files, in pixels with a true depth. A pixel is *covered* where the picture's opacity, one minus the final
/// transmittance, is above 0.5; its depth is the expected one, sum w z / sum w. Its *median depth* is that of the splat
/// at which the transmittance falls to 0.5 or below. A pixel is *seen* where two or more training photographs see its
/// true surface: the place lies inside of them, and is not hidden by more than 1 % of its depth behind what their own
/// true depth, where there is one, has there.
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
    /// Median of |z - z_true| / z_true of the median depth, over pixels that have one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_of_median_error: Option<f64>,
    /// The same over the off-path views.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_of_median_error_offpath: Option<f64>,
    /// Mean blend weight, over seen pixels, of splats nearer than 0.98 times the true depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floaters_front: Option<f64>,
    /// The same of splats farther than 1.02 times the true depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floaters_behind: Option<f64>,
    /// `floaters_front` of the off-path views.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floaters_front_offpath: Option<f64>,
    /// `floaters_behind` of the off-path views.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floaters_behind_offpath: Option<f64>,
    /// Median angle between the picture's normal and the true one over covered pixels, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normal_median_degrees: Option<f64>,
    /// Median distance of opaque splats from the true surface, in the dataset's units: see [`off_surface`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface_distance: Option<f64>,
    /// The same in ground sample distances: the mean over the training photographs with a true depth of its median over
    /// the focal length, at the size of the map.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface_distance_gsd: Option<f64>,
    /// Share of the opaque mass that is further from the true surface than 1 % of the extent: see [`off_surface`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floaters: Option<f64>,
    /// Median relative error of the median depth at reconstructed points: see [`Judge::of_points`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_points_error: Option<f64>,
    /// The same of the expected depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_points_error_expected: Option<f64>,
    /// Median relative error of the median depth where stereo of the held-out photographs knows a depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_stereo_error: Option<f64>,
    /// The same of the expected depth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_stereo_error_expected: Option<f64>,
}

/// Compares a model, given in scene coordinates, with the truth of its dataset. `render` draws it from a camera of the
/// scene, with depth and normals, and tells its depths at the pixels by the known ones, in scene units, where they are
/// given ([`crate::raster::Viewer::probe`]).
pub fn measure<E: From<GeometryError>>(
    truth: &GeometryTruth,
    model: &Gaussians,
    mut render: impl FnMut(&Camera, Option<&[f32]>) -> Result<(Picture, DepthProbe), E>,
) -> Result<Geometry, E> {
    let scale = truth.frame.scale;
    let off_path = truth.offpath.iter().filter_map(|view| view.maps.as_ref());
    let maps: Vec<&Maps> = truth.views.iter().chain(off_path).collect();
    let (mut held_out, mut offpath) = (Agreement::default(), Agreement::default());
    for (k, (maps, seen)) in maps.iter().zip(sight::seen(truth, &maps)?).enumerate() {
        let known = maps.read()?;
        let (picture, probe) = render(&known.camera, Some(&known.scaled(scale)))?;
        let agreement = if k < truth.views.len() { &mut held_out } else { &mut offpath };
        agreement.add(&picture, &known, scale);
        agreement.add_probe(&probe, &known, &seen, scale);
    }
    let mut decibels = Vec::new();
    for view in &truth.offpath {
        let photograph = view.photograph()?;
        let picture = render(&view.camera, None)?.0.rgb8();
        let (colours, counts): (Vec<[u8; 3]>, Vec<bool>) =
            photograph.rgba8().chunks_exact(4).map(|p| ([p[0], p[1], p[2]], p[3] >= 128)).unzip();
        decibels.extend(psnr_where(&picture, colours.as_flattened(), &counts));
    }
    let off = match truth.surface()? {
        Some(surface) => off_surface(model, &truth.frame, truth.extent, &surface),
        None => OffSurface::default(),
    };
    let sample = if off.distance.is_some() { sight::ground_sample(truth)? } else { None };
    let [floaters_front, floaters_behind] = held_out.floaters();
    let [floaters_front_offpath, floaters_behind_offpath] = offpath.floaters();
    Ok(Geometry {
        psnr_offpath: if decibels.is_empty() { None } else { mean(decibels.into_iter()) },
        depth_median_error: held_out.median_error(),
        depth_within_0_5_percent: held_out.within(0.005),
        depth_within_2_percent: held_out.within(0.02),
        depth_coverage: held_out.coverage(),
        depth_median_error_offpath: offpath.median_error(),
        depth_of_median_error: held_out.error_of_median(),
        depth_of_median_error_offpath: offpath.error_of_median(),
        floaters_front,
        floaters_behind,
        floaters_front_offpath,
        floaters_behind_offpath,
        normal_median_degrees: held_out.median_degrees(),
        surface_distance: off.distance,
        surface_distance_gsd: off.distance.zip(sample).map(|(distance, sample)| distance / sample),
        floaters: off.floaters,
        ..Geometry::default()
    })
}

/// All that a dataset tells of the geometry of a model in scene coordinates: by the ground truth beside it, and by its
/// reconstructed points. `options` are those with which it was loaded; `render` as for [`measure`].
pub fn measure_by<E: From<GeometryError>>(
    dataset: &Dataset,
    options: &LoadOptions,
    model: &Gaussians,
    mut render: impl FnMut(&Camera, Option<&[f32]>) -> Result<(Picture, DepthProbe), E>,
) -> Result<Geometry, E> {
    let truth = GeometryTruth::find(dataset, options)?;
    let measured = if truth.is_empty() { Geometry::default() } else { measure(&truth, model, &mut render)? };
    let points = JudgedDepth::of(&Judge::of_points(dataset), render)?;
    Ok(Geometry { depth_points_error: points.median, depth_points_error_expected: points.expected, ..measured })
}

/// Names of [`Geometry::rows_in_short`].
const IN_SHORT: [&str; 6] = [
    "PSNR off the path",
    "error of the median depth, median",
    "weight in front of the surface",
    "normal error, median",
    "distance in ground sample distances",
    "error of the median depth at reconstructed points",
];

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
            ("error of the median depth, median", self.depth_of_median_error.map(percent)),
            ("error of the median depth off the path, median", self.depth_of_median_error_offpath.map(percent)),
            ("weight in front of the surface", self.floaters_front.map(percent)),
            ("weight behind the surface", self.floaters_behind.map(percent)),
            ("weight in front of the surface, off the path", self.floaters_front_offpath.map(percent)),
            ("weight behind the surface, off the path", self.floaters_behind_offpath.map(percent)),
            ("normal error, median", self.normal_median_degrees.map(|v| format!("{v:.1}\u{b0}"))),
            ("distance to the surface, median", self.surface_distance.map(|v| format!("{v:.3} units"))),
            ("distance in ground sample distances", self.surface_distance_gsd.map(|v| format!("{v:.2}"))),
            ("opaque mass off the surface", self.floaters.map(percent)),
            ("error of the median depth at reconstructed points", self.depth_points_error.map(percent)),
            ("depth error at reconstructed points", self.depth_points_error_expected.map(percent)),
            ("error of the median depth where stereo knows it", self.depth_stereo_error.map(percent)),
            ("depth error where stereo knows it", self.depth_stereo_error_expected.map(percent)),
        ]
        .into_iter()
        .filter_map(|(name, value)| Some((name, value?)))
        .collect()
    }

    /// The [`rows`](Self::rows) that one line has room for.
    pub fn rows_in_short(&self) -> Vec<(&'static str, String)> {
        self.rows().into_iter().filter(|(name, _)| IN_SHORT.contains(name)).collect()
    }
}
