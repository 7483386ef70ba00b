//! Everything that decides what a training run does, as one struct: command-line options, `settings.toml` and the library's
//! configuration are the same fields with the same names and defaults.

mod file;
mod method;
mod preset;
mod values;

pub use file::SettingsError;
pub use values::{
    Background, ByteSize, DepthPrior, Exposure, Format, Gate, Growth, MaskIgnores, Method, Preset, Split, Transfer,
    Tune,
};

use std::path::PathBuf;

/// Declares one group of options: the struct with its command-line options, its keys in `settings.toml` (the option names
/// without the dashes in front), and its defaults, each written once.
macro_rules! group {
    (
        $(#[$meta:meta])* pub struct $name:ident ($heading:literal) {
            $($(#[$vmeta:meta])* pub $value:ident : $vtype:ty = $default:expr,)*
        }
        flags { $($(#[$fmeta:meta])* pub $flag:ident,)* }
        optional { $($(#[$ometa:meta])* pub $option:ident : $otype:ty,)* }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq, clap::Args, serde::Serialize, serde::Deserialize)]
        #[command(next_help_heading = $heading)]
        #[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
        pub struct $name {
            $($(#[$vmeta])* #[arg(long, default_value_t = $default)] pub $value: $vtype,)*
            $(
                $(#[$fmeta])*
                #[arg(
                    long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true",
                    default_value_t = false, action = clap::ArgAction::Set, hide_default_value = true,
                    hide_possible_values = true
                )]
                pub $flag: bool,
            )*
            $(
                $(#[$ometa])*
                #[arg(long)]
                #[serde(skip_serializing_if = "Option::is_none")]
                pub $option: Option<$otype>,
            )*
        }
        impl Default for $name {
            fn default() -> Self {
                Self { $($value: $default,)* $($flag: false,)* $($option: None,)* }
            }
        }
    };
}

group! {
    /// What is run, and for how long.
    pub struct Run("Run") {
        /// Training method
        #[arg(value_name = "M")]
        pub method: Method = Method::Gs,
        /// Training steps; one step looks at one photograph
        #[arg(value_name = "N")]
        pub iterations: u32 = 30_000,
        /// Seed of every random choice
        #[arg(value_name = "S")]
        pub seed: u64 = 0,
        /// Save a checkpoint every N steps (0: only when interrupted and at the end)
        #[arg(value_name = "N")]
        pub checkpoint_every: u32 = 1000,
        /// Score the held-out photographs every N steps (0: only at the end)
        #[arg(value_name = "N")]
        pub eval_every: u32 = 500,
        /// Choose the forms of the GPU passes by timing them at the start: auto (from 1000 steps on; kept between runs), off (by
        /// the device's capabilities) or again; never with --deterministic
        #[arg(value_name = "WHEN")]
        pub tune: Tune = Tune::Auto,
    }
    flags {
        /// Fit the 30,000-step schedule of the method to --iterations
        pub scale_schedule,
        /// Same bits from the same command on the same device, driver and binary
        pub deterministic,
        /// Keep the set of splats fixed: no cloning, splitting, pruning or opacity resets
        pub no_densify,
    }
    optional {
        /// Resolution, steps and schedule: quick (640 pixels, 2000 steps, scaled), standard (1600 pixels, 30000 steps) or full (the
        /// photographs' size, 30000 steps); options given by name win [default: quick on a CPU device, else standard]
        #[arg(value_name = "NAME")]
        pub preset: Preset,
        /// Start from the splats of this PLY file instead of the points of the dataset
        #[arg(value_name = "FILE.ply")]
        pub init: PathBuf,
    }
}

group! {
    /// Which photographs are used, and at what size.
    pub struct Photographs("Photographs") {
        /// Photographs are reduced until their longer side has at most this many pixels
        #[arg(value_name = "PX")]
        pub max_side: u32 = 1600,
        /// Photographs that are held out and scored, by position in the sorted names: `test` is 0, 8, 16 ...; `val` is 4, 12,
        /// 20 ..., for choosing settings (the test photographs stay out of training too); `none` trains on all; `every:N` and
        /// `every:N:FIRST` hold out every Nth, as other trainers do
        #[arg(value_name = "SPLIT")]
        pub split: Split = Split::Test,
        /// Which colour of the masks in DATA/masks means that a pixel is left out
        #[arg(value_name = "COLOUR")]
        pub mask_ignores: MaskIgnores = MaskIgnores::Black,
        /// Curve of photographs with more than 8 bits per channel: `srgb` takes their numbers as encoded, `linear` encodes them;
        /// `auto` takes whole numbers (PNG) as encoded and floating-point ones (OpenEXR) as linear
        #[arg(value_name = "CURVE")]
        pub transfer: Transfer = Transfer::Auto,
    }
    flags {}
    optional {
        /// Format of the dataset: colmap, nerfstudio or opensfm [default: the first of them whose files are there]
        #[arg(value_name = "FORMAT")]
        pub format: Format,
        /// Folder of the photographs inside DATA [default: images, or the images_N that fits --max-side]
        #[arg(value_name = "FOLDER")]
        pub images: String,
        /// The number that is white in photographs with more than 8 bits per channel; larger ones are cut [default: 65535 in PNG,
        /// 1 in OpenEXR]
        #[arg(value_name = "V")]
        pub white_level: f64,
    }
}

group! {
    /// The model and how it is drawn.
    pub struct Model("Model") {
        /// Highest degree of the spherical harmonics, 0 to 3
        #[arg(value_name = "D")]
        pub sh_degree: u32 = 3,
        /// Steps between raising the degree by one
        #[arg(value_name = "N")]
        pub sh_interval: u32 = 1000,
        /// Colour behind the splats: black, white or random (a new one each step)
        #[arg(value_name = "COLOUR")]
        pub background: Background = Background::Black,
    }
    flags {
        /// Lower the opacity of splats smaller than a pixel by what the screen-space dilation adds to them
        pub antialias,
    }
    optional {}
}

group! {
    /// Loss and optimiser. The learning rate of the means is in units of the scene's extent.
    pub struct Optimiser("Optimiser") {
        /// Weight of 1 - SSIM in the loss; L1 has the rest
        #[arg(value_name = "W")]
        pub lambda_dssim: f64 = 0.2,
        /// Learning rate of the means at step 0, per extent of the scene
        #[arg(value_name = "LR")]
        pub lr_means: f64 = 1.6e-4,
        /// Learning rate of the means when its decay ends
        #[arg(value_name = "LR")]
        pub lr_means_final: f64 = 1.6e-6,
        /// Steps over which the learning rate of the means decays (log-linear)
        #[arg(value_name = "N")]
        pub lr_means_steps: u32 = 30_000,
        /// Learning rate of the constant colour
        #[arg(value_name = "LR")]
        pub lr_sh_base: f64 = 2.5e-3,
        /// Learning rate of the higher spherical harmonics
        #[arg(value_name = "LR")]
        pub lr_sh_rest: f64 = 1.25e-4,
        /// Learning rate of the opacity logits
        #[arg(value_name = "LR")]
        pub lr_opacities: f64 = 0.025,
        /// Learning rate of the log scales
        #[arg(value_name = "LR")]
        pub lr_scales: f64 = 5e-3,
        /// Learning rate of the rotations
        #[arg(value_name = "LR")]
        pub lr_rotations: f64 = 1e-3,
        /// What each photograph may differ in from the render: off (nothing) or affine (a colour map per photograph, the identity
        /// in the mean over all; held-out photographs are compared without)
        #[arg(value_name = "KIND")]
        pub exposure: Exposure = Exposure::Off,
        /// Learning rate of the exposures at step 0
        #[arg(value_name = "LR")]
        pub lr_exposure: f64 = 0.01,
        /// Learning rate of the exposures at the last step
        #[arg(value_name = "LR")]
        pub lr_exposure_final: f64 = 1e-3,
    }
    flags {}
    optional {}
}

group! {
    /// Growth and pruning of the set of splats.
    pub struct Density("Density control") {
        /// Growth begins after this step
        #[arg(value_name = "N")]
        pub densify_from: u32 = 500,
        /// Growth ends before this step
        #[arg(value_name = "N")]
        pub densify_until: u32 = 15_000,
        /// Steps between density changes
        #[arg(value_name = "N")]
        pub densify_interval: u32 = 100,
        /// Which splats grow: threshold (all whose gradient reaches it are cloned or split) or sampled (a sample of these is split along
        /// their longest axis)
        #[arg(value_name = "RULE")]
        pub growth: Growth = Growth::Threshold,
        /// Mean screen-space gradient (normalised device coordinates) from which a splat is cloned or split
        #[arg(value_name = "G")]
        pub grad_threshold: f64 = 2e-4,
        /// The same for splats of low frequencies (mask value 0) in the low-frequency stage, where growth is sampled
        #[arg(value_name = "G")]
        pub low_grad_threshold: f64 = 2e-4,
        /// Probability that a splat at the threshold is split, where growth is sampled
        #[arg(value_name = "P")]
        pub sample_rate: f64 = 0.5,
        /// How much of that probability is in proportion to the splat's mask value, from 0 to 1
        #[arg(value_name = "SHARE")]
        pub sample_mask_share: f64 = 0.0,
        /// How much of it is in proportion to the share of views in which the splat is wrong, from 0 to 1
        #[arg(value_name = "SHARE")]
        pub sample_error_share: f64 = 0.0,
        /// Mean absolute difference to the photograph above which the render is wrong at a splat
        #[arg(value_name = "E")]
        pub sample_error: f64 = 0.05,
        /// What opacities are multiplied by at each density change, where growth is sampled
        #[arg(value_name = "SHARE")]
        pub keep_opacity: f64 = 1.0,
        /// Splats larger than this share of the scene's extent are split, smaller ones cloned
        #[arg(value_name = "SHARE")]
        pub percent_dense: f64 = 0.01,
        /// Splats less opaque than this are pruned
        #[arg(value_name = "O")]
        pub prune_opacity: f64 = 0.005,
        /// Splats larger than this share of the scene's extent are pruned once opacities have been reset
        #[arg(value_name = "SHARE")]
        pub prune_extent: f64 = 0.1,
        /// Steps between opacity resets (0: none)
        #[arg(value_name = "N")]
        pub opacity_reset_interval: u32 = 3000,
    }
    flags {
        /// Judge splits by sums of absolute gradients of pixels, which do not cancel; with sampled growth all of it
        pub absgrad,
        /// Prune splats that have blended into no pixel since the last density change, where growth is sampled
        pub prune_unseen,
    }
    optional {
        /// The threshold for splits where it is not that for clones
        #[arg(value_name = "G")]
        pub split_grad_threshold: f64,
        /// Stop growing at this many splats
        #[arg(value_name = "N")]
        pub max_splats: u32,
    }
}

group! {
    /// Low and high frequencies apart.
    pub struct Frequencies("Low and high frequencies") {
        /// Share of the steps that the low-frequency stage takes (0: there is none)
        #[arg(value_name = "SHARE")]
        pub low_stage: f64 = 0.0,
        /// What tells texture from the rest: spectral, phase, gradient, random or off (nothing does)
        #[arg(value_name = "GATE")]
        pub gate: Gate = Gate::Spectral,
        /// Width of the filter of the spectral gate, in bins of a spectrum of 256
        #[arg(value_name = "BINS")]
        pub sigma: f64 = 3.0,
        /// Weight of texture in the loss of the low-frequency stage (1: that of the rest)
        #[arg(value_name = "W")]
        pub low_texture_weight: f64 = 1.0,
        /// Share of the steps that see photographs of half the size or less
        #[arg(value_name = "SHARE")]
        pub coarse_steps: f64 = 0.0,
    }
    flags {}
    optional {}
}

group! {
    /// Depth and normals: where they are known from, and how they are trained with.
    pub struct Geometry("Depth and normals") {
        /// Where depths to train with come from: none, sfm (the reconstructed points) or stereo (the training photographs)
        #[arg(value_name = "SOURCE")]
        pub depth_prior: DepthPrior = DepthPrior::None,
        /// Stereo works on photographs of at most this many pixels on the longer side
        #[arg(value_name = "PX")]
        pub stereo_side: u32 = 160,
        /// Begin with so many splats more, on surfaces that stereo has found (0: none)
        #[arg(value_name = "N")]
        pub stereo_splats: u32 = 0,
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
        /// Weight of the total variation of what is between render and photograph
        #[arg(value_name = "W")]
        pub lambda_variation: f64 = 0.0,
        /// One step in so many has these two, with as much more weight
        #[arg(value_name = "N")]
        pub gradients_every: u32 = 4,
        /// Weight of the perceptual distance
        #[arg(value_name = "W")]
        pub lambda_perceptual: f64 = 0.0,
        /// One step in so many has it, with as much more weight
        #[arg(value_name = "N")]
        pub perceptual_every: u32 = 12,
    }
    flags {}
    optional {}
}

impl Geometry {
    /// The size of what is known of a photograph of this size.
    pub fn prior_size(&self, width: u32, height: u32) -> (u32, u32) {
        self.stereo().size(width, height)
    }

    /// How stereo works.
    pub fn stereo(&self) -> crate::stereo::Settings {
        crate::stereo::Settings { max_side: self.stereo_side, ..Default::default() }
    }
}

impl Texture {
    /// Whether gradient maps have a part in the loss.
    pub fn wants_gradients(&self) -> bool {
        self.lambda_gradients > 0.0 || self.lambda_variation > 0.0
    }
}

group! {
    /// Shortcuts that make steps cheaper and change results. All are off unless asked for.
    pub struct Shortcuts("Shortcuts") {
        /// Bits of each moment of the optimiser in memory: 32, or 16 with the second moment rounded at random
        #[arg(value_name = "BITS")]
        pub moment_bits: u32 = 32,
        /// Step the view-dependent colours only in every Nth step
        #[arg(value_name = "N")]
        pub sh_every: u32 = 1,
        /// Factor of --lr-sh-rest where --sh-every leaves steps out
        #[arg(value_name = "F")]
        pub sh_rate: f64 = 1.0,
    }
    flags {}
    optional {}
}

group! {
    /// How held-out photographs are scored.
    pub struct Scoring("Scores") {
    }
    flags {}
    optional {
        /// Weights for lpips_squeeze: a folder with SqueezeNet 1.1 and the linear layers of LPIPS, or a file of both
        /// (`psrgs-vk weights` says where to get them) [default: the user's weights folder; without weights it is not measured]
        #[arg(value_name = "PATH", env = "PSRGS_WEIGHTS", hide_env_values = true)]
        pub perceptual_weights: PathBuf,
    }
}

group! {
    /// Where it runs.
    pub struct DeviceChoice("Device") {
    }
    flags {}
    optional {
        /// Vulkan device: its index in `psrgs-vk info`, or a part of its name [default: discrete, integrated, then CPU]
        #[arg(value_name = "D", env = "PSRGS_DEVICE", hide_env_values = true)]
        pub device: String,
        /// Device memory that may be used, such as 6GiB or 800M; growth of splats stops where no more fit [default: what the
        /// device reports, or PSRGS_MAX_DEVICE_MEMORY]
        #[arg(value_name = "BYTES")]
        pub max_device_memory: ByteSize,
        /// Memory of this machine that may be used, such as 2GiB: photographs beyond it are kept compressed or read again [default:
        /// half of what is free]
        #[arg(value_name = "BYTES")]
        pub host_memory: ByteSize,
        /// How the blending passes share a tile among threads [default: what suits the device]
        #[arg(value_name = "SHAPE", value_enum)]
        pub tile_shape: crate::raster::TileShape,
        /// Where the blend backward leaves its gradients [default: what suits the device]; slots are bit-reproducible
        #[arg(value_name = "SUM", value_enum)]
        pub gradient_sum: crate::raster::GradientSum,
        /// What the threads of the blend backward own [default: pixels]; per-splat brings pixel tiles
        #[arg(value_name = "FORM", value_enum)]
        pub backward: crate::raster::Backward,
        /// In blending, leave out splats in the blocks of a pixel tile where they do not show [default: blocks]; the picture is the same
        #[arg(value_name = "WHERE", value_enum)]
        pub culling: crate::raster::Culling,
        /// Order of the splats in memory, which changes the speed and not the result [default: morton]
        #[arg(value_name = "ORDER", value_enum)]
        pub splat_order: crate::scene::SplatOrder,
    }
}

/// A training run.
#[derive(Clone, Debug, Default, PartialEq, clap::Args, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// Dataset folder: photographs with a model of COLMAP, nerfstudio, OpenSfM or OpenDroneMap
    #[arg(value_name = "DATA")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub data: Option<PathBuf>,
    /// What is run.
    #[command(flatten)]
    pub run: Run,
    /// Which photographs.
    #[command(flatten)]
    pub photographs: Photographs,
    /// The model.
    #[command(flatten)]
    pub model: Model,
    /// Loss and learning rates.
    #[command(flatten)]
    pub optimiser: Optimiser,
    /// Growth and pruning.
    #[command(flatten)]
    pub density: Density,
    /// Stages.
    #[command(flatten)]
    pub frequencies: Frequencies,
    /// Depth and normals.
    #[command(flatten)]
    pub geometry: Geometry,
    /// Texture.
    #[command(flatten)]
    pub texture: Texture,
    /// What may be left out.
    #[command(flatten)]
    pub shortcuts: Shortcuts,
    /// Scores.
    #[command(flatten)]
    pub scoring: Scoring,
    /// The device.
    #[command(flatten)]
    pub device: DeviceChoice,
}

impl Shortcuts {
    /// What `--fast` stands for; see `docs/PERFORMANCE.md` for what they save and cost.
    pub const FAST: Self = Self { moment_bits: 16, sh_every: 4, sh_rate: 1.0 };
}

impl Settings {
    /// The defaults of a method.
    pub fn of_method(method: Method) -> Self {
        let mut settings = Self::default();
        method.apply(&mut settings, |_| false);
        settings
    }

    /// Whether pixels are told apart by masks.
    pub fn needs_masks(&self) -> bool {
        let (density, frequencies) = (&self.density, &self.frequencies);
        let by_stage = frequencies.low_texture_weight != 1.0
            || (density.growth == Growth::Sampled && density.low_grad_threshold != density.grad_threshold);
        self.texture.lambda_perceptual > 0.0
            || self.texture.wants_gradients()
            || self.geometry.depth_prior != DepthPrior::None
            || (frequencies.low_stage > 0.0 && by_stage)
            || (density.growth == Growth::Sampled && density.sample_mask_share > 0.0)
    }

    /// Whether the values make sense together; the error names the option and what it takes.
    pub fn check(&self) -> Result<(), SettingsError> {
        let ok = |good: bool, key: &'static str, want: &'static str| {
            if good { Ok(()) } else { Err(SettingsError::Value { key, want }) }
        };
        let (run, density, optimiser) = (&self.run, &self.density, &self.optimiser);
        ok(run.iterations >= 1, "iterations", "at least 1")?;
        ok(self.photographs.max_side >= 16, "max-side", "at least 16 pixels")?;
        let white = self.photographs.white_level;
        ok(white.is_none_or(|v| v > 0.0 && v.is_finite()), "white-level", "a positive number")?;
        ok(self.model.sh_degree <= 3, "sh-degree", "0, 1, 2 or 3")?;
        ok(self.model.sh_interval >= 1, "sh-interval", "at least 1")?;
        ok((0.0..=1.0).contains(&optimiser.lambda_dssim), "lambda-dssim", "a number from 0 to 1")?;
        ok(optimiser.lr_means > 0.0 && optimiser.lr_means.is_finite(), "lr-means", "a positive number")?;
        ok(
            optimiser.lr_means_final > 0.0 && optimiser.lr_means_final.is_finite(),
            "lr-means-final",
            "a positive number",
        )?;
        ok(optimiser.lr_means_steps >= 1, "lr-means-steps", "at least 1")?;
        for (rate, key) in [(optimiser.lr_exposure, "lr-exposure"), (optimiser.lr_exposure_final, "lr-exposure-final")]
        {
            ok(rate > 0.0 && rate.is_finite(), key, "a positive number")?;
        }
        for (rate, key) in [
            (optimiser.lr_sh_base, "lr-sh-base"),
            (optimiser.lr_sh_rest, "lr-sh-rest"),
            (optimiser.lr_opacities, "lr-opacities"),
            (optimiser.lr_scales, "lr-scales"),
            (optimiser.lr_rotations, "lr-rotations"),
        ] {
            ok(rate >= 0.0 && rate.is_finite(), key, "a number that is not negative")?;
        }
        ok(matches!(self.shortcuts.moment_bits, 16 | 32), "moment-bits", "16 or 32")?;
        ok(self.shortcuts.sh_every >= 1, "sh-every", "at least 1")?;
        let rate = self.shortcuts.sh_rate;
        ok(rate >= 0.0 && rate.is_finite(), "sh-rate", "a number that is not negative")?;
        ok(density.densify_interval >= 1, "densify-interval", "at least 1")?;
        for (share, key) in [
            (density.sample_rate, "sample-rate"),
            (density.sample_mask_share, "sample-mask-share"),
            (density.sample_error_share, "sample-error-share"),
            (self.frequencies.low_stage, "low-stage"),
            (self.frequencies.low_texture_weight, "low-texture-weight"),
            (self.frequencies.coarse_steps, "coarse-steps"),
            (self.geometry.depth_steps, "depth-steps"),
        ] {
            ok((0.0..=1.0).contains(&share), key, "a number from 0 to 1")?;
        }
        ok(density.keep_opacity > 0.0 && density.keep_opacity <= 1.0, "keep-opacity", "a number above 0, at most 1")?;
        ok(
            density.sample_error >= 0.0 && density.sample_error.is_finite(),
            "sample-error",
            "a number that is not negative",
        )?;
        let (geometry, texture) = (&self.geometry, &self.texture);
        for (weight, key) in [
            (geometry.lambda_depth, "lambda-depth"),
            (geometry.depth_edges, "depth-edges"),
            (geometry.lambda_smooth, "lambda-smooth"),
            (geometry.smooth_edge_stop, "smooth-edge-stop"),
            (geometry.lambda_normal, "lambda-normal"),
            (geometry.lambda_flatten, "lambda-flatten"),
            (texture.lambda_gradients, "lambda-gradients"),
            (texture.lambda_variation, "lambda-variation"),
            (texture.lambda_perceptual, "lambda-perceptual"),
        ] {
            ok(weight >= 0.0 && weight.is_finite(), key, "a number that is not negative")?;
        }
        ok(geometry.depth_left > 0.0 && geometry.depth_left <= 1.0, "depth-left", "a number above 0, at most 1")?;
        ok(geometry.depth_huber > 0.0 && geometry.depth_huber.is_finite(), "depth-huber", "a positive number")?;
        ok(geometry.stereo_side >= 16, "stereo-side", "at least 16 pixels")?;
        ok(geometry.depth_every >= 1, "depth-every", "at least 1")?;
        ok(texture.gradients_every >= 1, "gradients-every", "at least 1")?;
        ok(texture.perceptual_every >= 1, "perceptual-every", "at least 1")?;
        let dense = geometry.stereo_splats == 0 || geometry.depth_prior == DepthPrior::Stereo;
        ok(dense, "stereo-splats", "0 unless --depth-prior is stereo")?;
        ok((0.0..=1000.0).contains(&self.frequencies.sigma), "sigma", "a number from 0 to 1000")?;
        for (share, key) in [
            (density.low_grad_threshold, "low-grad-threshold"),
            (density.split_grad_threshold.unwrap_or(1.0), "split-grad-threshold"),
            (density.grad_threshold, "grad-threshold"),
            (density.percent_dense, "percent-dense"),
            (density.prune_extent, "prune-extent"),
        ] {
            ok(share > 0.0 && !share.is_nan(), key, "a positive number")?;
        }
        ok((0.0..1.0).contains(&density.prune_opacity), "prune-opacity", "a number from 0 to 1")?;
        ok(density.max_splats != Some(0), "max-splats", "at least 1")
    }
}
