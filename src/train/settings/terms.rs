//! Terms of the loss beside that of colours.

use super::DepthPrior;
use super::group::group;
use crate::scene::init::FIRST_OPACITY;

/// Least NCC of the depths that a model is trained with and begins on. Bare ground, which a lower one would add (see
/// [`crate::stereo::Settings::least_ncc`]), makes no difference to the model.
const TRAINED_NCC: f32 = 0.5;
/// Taps along a side of the window, and pixels between them: as wide as the window of [`crate::stereo::Settings`], with 9 taps for its 25. The
/// depths are as exact, at three fifths of the time; up to 3 % of the pixels have none for it.
const TRAINED_WINDOW: (u32, u32) = (3, 2);

group! {
    /// Depth and normals: where they are known from, and how they are trained with.
    pub struct Geometry("Depth and normals") {
        /// Where depths to train with come from: none, sfm (the reconstructed points), stereo (the training photographs), lidar (the
        /// cloud of --lidar) or propagation (renders that stereo goes on from in early steps, once for each photograph)
        #[arg(value_name = "SOURCE")]
        pub depth_prior: DepthPrior = DepthPrior::None,
        /// Stereo works on photographs of at most this many pixels on the longer side
        #[arg(value_name = "PX")]
        pub stereo_side: u32 = 160,
        /// Stereo takes at most about this share of the time of the steps: where it would take more, photographs become smaller, and
        /// sources and rounds fewer
        #[arg(value_name = "SHARE")]
        pub stereo_share: f64 = 0.12,
        /// Stereo leaves out pixels whose mask value is this or more, which are texture (1: none)
        #[arg(value_name = "M")]
        pub stereo_texture: f64 = 1.0,
        /// Begin with so many splats more, on surfaces that stereo has found (0: none)
        #[arg(value_name = "N")]
        pub stereo_splats: u32 = 0,
        /// So many of them for each photograph that these surfaces would fill, where that is more than --stereo-splats and memory allows it:
        /// flights begin with more than what is seen from all around (0: --stereo-splats as it is)
        #[arg(value_name = "N")]
        pub stereo_density: u32 = 0,
        /// Of --stereo-splats no more than so many for each such photograph: little surface asks for few (0: all of them)
        #[arg(value_name = "N")]
        pub stereo_densest: u32 = 0,
        /// These numbers are for photographs of so many pixels on the longer side; a training on larger ones begins with more where memory
        /// allows it, in proportion to that side, but at most to the square root of the steps: with twice as many from 7,000 steps on (0: with
        /// as many at any size)
        #[arg(value_name = "PX")]
        pub stereo_splats_for: u32 = 0,
        /// How wide these are to begin with, as a share of the root mean square of the distances to the three nearest splats
        #[arg(value_name = "SHARE")]
        pub stereo_width: f64 = 1.0,
        /// How thick these are along the normals that stereo has found, as a share of their width
        #[arg(value_name = "SHARE")]
        pub stereo_thickness: f64 = 1.0,
        /// How opaque these are to begin with (splats of reconstructed points: 0.1)
        #[arg(value_name = "O")]
        pub stereo_opacity: f64 = FIRST_OPACITY,
        /// Some of these lie where stereo knows nothing and at most so many photographs look, on its surfaces continued (0: nowhere)
        #[arg(value_name = "N")]
        pub stereo_alone: u32 = 0,
        /// Towards the end wide splats come where no photograph looks, up to this share of its longer side beside one, in the colours of its
        /// edge (0: none; none with --sh-share either)
        #[arg(value_name = "SHARE")]
        pub stereo_skirt: f64 = 0.0,
        /// Share of the steps that have a loss on depth and normals
        #[arg(value_name = "SHARE")]
        pub depth_steps: f64 = 0.5,
        /// One step in so many has it, with as much more weight
        #[arg(value_name = "N")]
        pub depth_every: u32 = 2,
        /// What is left of its weight at the end of these steps
        #[arg(value_name = "SHARE")]
        pub depth_left: f64 = 0.01,
        /// Weight of relative errors of depth
        #[arg(value_name = "W")]
        pub lambda_depth: f64 = 0.1,
        /// Relative error of depth from which on its loss is linear
        #[arg(value_name = "R")]
        pub depth_huber: f64 = 0.02,
        /// How much more an error of depth counts at an edge of the photograph
        #[arg(value_name = "B")]
        pub depth_edges: f64 = 1.0,
        /// Weight of second differences of depth, within that of depth
        #[arg(value_name = "W")]
        pub lambda_smooth: f64 = 0.01,
        /// How fast smoothness ends towards edges of the photograph
        #[arg(value_name = "G")]
        pub smooth_edge_stop: f64 = 10.0,
        /// Weight of errors of normals
        #[arg(value_name = "W")]
        pub lambda_normal: f64 = 0.01,
        /// Weight of the smallest standard deviation of each splat, in units of the scene's extent
        #[arg(value_name = "W")]
        pub lambda_flatten: f64 = 0.0,
        /// Depths are propagated after this step
        #[arg(value_name = "N")]
        pub propagate_from: u32 = 1000,
        /// Depths are propagated before this step
        #[arg(value_name = "N")]
        pub propagate_until: u32 = 6000,
        /// Steps between propagations
        #[arg(value_name = "N")]
        pub propagate_every: u32 = 20,
        /// Splats are added where the rendered depth differs from the propagated one by more than this share of it, at first ...
        #[arg(value_name = "R")]
        pub propagate_ratio: f64 = 1.0,
        /// ... and at last
        #[arg(value_name = "R")]
        pub propagate_ratio_final: f64 = 0.8,
    }
    flags {}
    optional {}
}

group! {
    /// Losses on texture, after the low-frequency stage.
    pub struct Texture("Texture") {
        /// Weight of the correlation of gradient maps
        #[arg(value_name = "W")]
        pub lambda_gradients: f64 = 0.0,
        /// The same of the gradient maps of the constrained set: the splats that were there at the end of the low-frequency stage,
        /// rendered alone
        #[arg(value_name = "W")]
        pub lambda_constrained: f64 = 0.0,
        /// Weight of the total variation of what is between render and photograph
        #[arg(value_name = "W")]
        pub lambda_variation: f64 = 0.0,
        /// One step in so many has these three, with as much more weight
        #[arg(value_name = "N")]
        pub gradients_every: u32 = 4,
        /// Weight of the perceptual distance
        #[arg(value_name = "W")]
        pub lambda_perceptual: f64 = 0.0,
        /// One step in so many has it, with as much more weight
        #[arg(value_name = "N")]
        pub perceptual_every: u32 = 12,
        /// Such a step has windows of so many views, with the weight of one among them: its own and those of the steps before it (at
        /// most 8)
        #[arg(value_name = "N")]
        pub perceptual_views: u32 = 1,
    }
    flags {}
    optional {}
}

impl Geometry {
    /// The size of what is known of a photograph of this size.
    pub fn prior_size(&self, width: u32, height: u32) -> (u32, u32) {
        self.stereo().size(width, height)
    }

    /// Whether steps have a loss on depth and normals.
    pub fn has_loss(&self) -> bool {
        self.depth_prior != DepthPrior::None
            && self.depth_steps > 0.0
            && (self.lambda_depth > 0.0 || self.lambda_normal > 0.0)
    }

    /// Whether splats begin on surfaces that stereo has found.
    pub fn begins_on_surfaces(&self) -> bool {
        self.stereo_splats > 0 || self.stereo_density > 0
    }

    /// A file's settings after `given` options have said how many splats begin on surfaces: whoever gives a number has that number, and
    /// what only refines one that is 0 now falls with it, unless it was given too.
    pub fn begin_as_asked(&mut self, given: impl Fn(&str) -> bool) {
        if !given("stereo-density") {
            self.stereo_density = 0;
        }
        if self.stereo_density == 0 && !given("stereo-densest") {
            self.stereo_densest = 0;
        }
        if self.stereo_density == 0 && !given("stereo-splats-for") {
            self.stereo_splats_for = 0;
        }
    }

    /// How stereo works.
    pub fn stereo(&self) -> crate::stereo::Settings {
        let (taps, step) = TRAINED_WINDOW;
        crate::stereo::Settings { max_side: self.stereo_side, least_ncc: TRAINED_NCC, taps, step, ..Default::default() }
    }
}

impl Texture {
    /// Most views that one step looks at.
    pub fn views_at_once(&self) -> u32 {
        if self.lambda_perceptual > 0.0 { self.perceptual_views.max(1) } else { 1 }
    }

    /// Whether gradient maps have a part in the loss.
    pub fn wants_gradients(&self) -> bool {
        self.lambda_gradients > 0.0 || self.lambda_variation > 0.0 || self.lambda_constrained > 0.0
    }
}
