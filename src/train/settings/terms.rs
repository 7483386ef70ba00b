//! Settings of loss terms other than colour.

use super::group::group;
use super::{ConstrainedAgainst, DepthPrior, Range, Spacing, Start};
use crate::scene::init::FIRST_OPACITY;

/// Least NCC of depths for training and first splats. A lower value would add bare ground (see
/// [`crate::stereo::Settings::least_ncc`]), which makes no difference to the model.
const TRAINED_NCC: f32 = 0.5;
/// Taps along a side of the window, and pixels between taps. The window is as wide as that of
/// [`crate::stereo::Settings`], with 9 taps instead of 25. Depths are equally exact in three fifths of the time, and up
/// to 3 % more pixels have none.
const TRAINED_WINDOW: (u32, u32) = (3, 2);

group! {
    /// Settings of depth and normals: their source, and their losses.
    pub struct Geometry("Model")
    options {
        /// Take depths to train with from: none, stereo (the training photographs), lidar (the cloud of --lidar) or
        /// propagation (renders that stereo improves while training goes on)
        #[arg(value_name = "SOURCE")]
        pub depth_prior: DepthPrior = DepthPrior::None,
        /// Begin with splats on the dataset's points (sfm), or on surfaces too that stereo finds in the training
        /// photographs (stereo), which show finer texture
        #[arg(value_name = "WHERE")]
        pub start: Start = Start::Sfm,
        /// Weigh relative errors of depth by W in the loss; higher follows the known depths more and the photographs
        /// less
        #[arg(value_name = "W", help_heading = super::LOSS)]
        pub lambda_depth: f64 = 0.1; Range::WEIGHT,
        /// Weigh errors of normals by W in the loss; higher makes smoother surfaces
        #[arg(value_name = "W", help_heading = super::LOSS)]
        pub lambda_normal: f64 = 0.01; Range::WEIGHT,
    }
    flags {}
    optional {}
    constants {
        /// Opacity at the start of the splats on the dataset's points
        pub first_opacity: f64 = FIRST_OPACITY; Range::new("a number above 0, below 1", |v| v > 0.0 && v < 1.0),
        /// Width at the start of the splats on the dataset's points, as a share of the root mean square of the distances
        /// to the three nearest points
        pub first_width: f64 = 1.0; Range::POSITIVE,
        /// Pixels of the longer side of the photographs that stereo compares, at most
        pub stereo_side: u32 = 160; Range::new("at least 16 pixels", |v| v >= 16.0),
        /// Share of the time of the steps that stereo takes, at most: photographs become smaller, and sources and
        /// rounds fewer, until it fits
        pub stereo_share: f64 = 0.12; Range::POSITIVE,
        /// Mask value from which a pixel is texture and left out of stereo (1: none is)
        pub stereo_texture: f64 = 1.0; Range::SHARE_ABOVE_0,
        /// Splats that begin on stereo's surfaces (0: as many as the local frequency of the photographs asks for)
        pub stereo_splats: u32 = 0,
        /// Spacing of the splats of stereo. `uniform`: even in the photographs. `frequency`: by local frequency and by
        /// the mask, for the least error in sum
        pub stereo_spacing: Spacing = Spacing::Uniform,
        /// Share of the local contrast that the first splats may lose where frequencies are low (mask value 0)
        pub stereo_error_low: f64 = 0.22; Range::POSITIVE,
        /// The same where frequencies are high (mask value 1)
        pub stereo_error_high: f64 = 0.11; Range::POSITIVE,
        /// Width of the splats of stereo, as a share of the root mean square of the distances to the three nearest
        /// splats
        pub stereo_width: f64 = 1.0; Range::POSITIVE,
        /// How far splats of stereo are long along edges and stripes of the photograph and narrow across them (0: round;
        /// 1: as the wavelengths along and across, up to 3 to 1)
        pub stereo_axes: f64 = 0.0; Range::SHARE,
        /// Thickness of the splats of stereo along their normals, as a share of their width
        pub stereo_thickness: f64 = 1.0; Range::SHARE_ABOVE_0,
        /// Opacity of the splats of stereo at the start
        pub stereo_opacity: f64 = FIRST_OPACITY; Range::new("a number above 0, below 1", |v| v > 0.0 && v < 1.0),
        /// Photographs that look at a place at most for stereo's surfaces to be continued there (0: nowhere)
        pub stereo_alone: u32 = 0,
        /// Width of the skirt beside a photograph, as a share of its longer side: wide splats in the colours of its
        /// edge where no photograph looks (0: no skirt)
        pub stereo_skirt: f64 = 0.0; Range::SHARE,
        /// Share of the steps that have a loss on depth and normals
        pub depth_steps: f64 = 0.5; Range::SHARE,
        /// Steps from one with a loss on depth to the next; each has so many times the weight
        pub depth_every: u32 = 2; Range::COUNT,
        /// Share of the weight of depth that is left at the end of its steps
        pub depth_left: f64 = 0.01; Range::SHARE_ABOVE_0,
        /// Relative error of depth from which its loss is linear
        pub depth_huber: f64 = 0.02; Range::POSITIVE,
        /// Additional weight of an error of depth at an edge of the photograph
        pub depth_edges: f64 = 1.0; Range::WEIGHT,
        /// Weight of second differences of depth, within lambda-depth
        pub lambda_smooth: f64 = 0.01; Range::WEIGHT,
        /// How fast smoothness ends towards edges of the photograph
        pub smooth_edge_stop: f64 = 10.0; Range::WEIGHT,
        /// Weight of the smallest scale of each splat, in units of the scene's extent
        pub lambda_flatten: f64 = 0.0; Range::WEIGHT,
        /// Step after which depths are propagated
        pub propagate_from: u32 = 1000,
        /// Step before which depths are propagated
        pub propagate_until: u32 = 6000,
        /// Steps between propagations
        pub propagate_every: u32 = 20; Range::COUNT,
        /// Relative difference of rendered and propagated depth from which splats are added, at first
        pub propagate_ratio: f64 = 1.0; Range::WEIGHT,
        /// The same at last
        pub propagate_ratio_final: f64 = 0.8; Range::WEIGHT,
    }
    unset {}
}

group! {
    /// Losses on texture after the low-frequency stage.
    pub struct Texture("Loss and learning rates")
    options {
        /// Weigh the perceptual distance by W in the loss; higher makes texture sharper and PSNR lower
        #[arg(value_name = "W")]
        pub lambda_perceptual: f64 = 0.0; Range::WEIGHT,
    }
    flags {}
    optional {}
    constants {
        /// Weight of the correlation of gradient maps
        pub lambda_gradients: f64 = 0.0; Range::WEIGHT,
        /// Weight of the correlation of gradient maps of the constrained set: the splats of the end of the
        /// low-frequency stage, rendered alone
        pub lambda_constrained: f64 = 0.0; Range::WEIGHT,
        /// What these maps are correlated with: those of the photograph, or those of the full render, from which both
        /// sets learn (render)
        pub constrained_against: ConstrainedAgainst = ConstrainedAgainst::Photograph,
        /// Weight of the total variation of the difference between render and photograph
        pub lambda_variation: f64 = 0.0; Range::WEIGHT,
        /// Steps from one with these three losses to the next; each has so many times the weight
        pub gradients_every: u32 = 4; Range::COUNT,
        /// Steps from one with a perceptual loss to the next; each has so many times the weight
        pub perceptual_every: u32 = 12; Range::COUNT,
        /// Photographs of which a perceptual step sees a window: its own and those of the steps before it
        pub perceptual_views: u32 = 1; Range::new("from 1 to 8", |v| (1.0..=8.0).contains(&v)),
    }
    unset {}
}

impl Geometry {
    /// The size of the depth and normal maps of a photograph of this size.
    pub fn prior_size(&self, width: u32, height: u32) -> (u32, u32) {
        self.stereo().size(width, height)
    }

    /// Whether steps have a loss on depth and normals.
    pub fn has_loss(&self) -> bool {
        self.depth_prior != DepthPrior::None
            && self.depth_steps > 0.0
            && (self.lambda_depth > 0.0 || self.lambda_normal > 0.0)
    }

    /// Whether the training begins with splats on stereo's surfaces.
    pub fn begins_on_surfaces(&self) -> bool {
        self.start == Start::Stereo
    }

    /// The settings of stereo.
    pub fn stereo(&self) -> crate::stereo::Settings {
        let (taps, step) = TRAINED_WINDOW;
        crate::stereo::Settings { max_side: self.stereo_side, least_ncc: TRAINED_NCC, taps, step, ..Default::default() }
    }
}

impl Texture {
    /// Most views that one step uses.
    pub fn views_at_once(&self) -> u32 {
        if self.lambda_perceptual > 0.0 { self.perceptual_views.max(1) } else { 1 }
    }

    /// Whether the loss uses gradient maps.
    pub fn wants_gradients(&self) -> bool {
        self.lambda_gradients > 0.0 || self.lambda_variation > 0.0 || self.lambda_constrained > 0.0
    }
}
