//! The settings of a training run in one struct. Command-line options, `settings.toml` and the library's configuration
//! share its fields, names and defaults.

mod canonical;
mod check;
mod file;
mod group;
mod growth;
mod method;
mod preset;
mod range;
mod set;
mod terms;
mod values;

pub use file::SettingsError;
pub use group::Key;
pub use growth::{Density, Frequencies};
pub use preset::StepsByNeed;
pub use range::Range;
pub use terms::{Geometry, Texture};
pub use values::{
    Background, ByteSize, ConstrainedAgainst, DepthPrior, Exposure, Format, Gate, Growth, Housekeeping, LidarCloud,
    MaskIgnores, Method, Preset, SigmaLearning, Spacing, Split, Start, Transfer, Transparent, Tune,
};

use std::path::PathBuf;

use group::group;

/// Heading of the options that most trainings need.
const MOST_USED: &str = "Most used";
/// Heading of the options for the loss and the learning rates.
const LOSS: &str = "Loss and learning rates";

group! {
    /// The method, its steps and their schedule.
    pub struct Run("Run")
    options {
        /// Train by this method: psrgs makes sharp models of few splats; 3dgs, absgs, gspro, rsgs and mcmc are
        /// published ones to compare with
        #[arg(value_name = "METHOD", help_heading = MOST_USED, display_order = 3)]
        pub method: Method = Method::Reference3dgs,
        /// Take N training steps; a step looks at one photograph. More show finer texture. Where neither N nor
        /// a preset is named, the methods lean, psrgs and psrgs-paper take as many as the photographs need: 2000 to
        /// 30000, on a CPU 2000
        #[arg(value_name = "N", help_heading = MOST_USED, display_order = 5)]
        pub iterations: u32 = 30_000; Range::COUNT,
        /// Seed every random choice with S; another seed gives another model of the same quality
        #[arg(value_name = "S", help_heading = MOST_USED, display_order = 7)]
        pub seed: u64 = 0,
        /// Save a checkpoint every N steps; more often loses less when the run is interrupted (0: only then and at the
        /// end)
        #[arg(value_name = "N")]
        pub checkpoint_every: u32 = 1000,
        /// Score the held-out photographs every N steps, which takes time (0: only at the end)
        #[arg(value_name = "N")]
        pub eval_every: u32 = 500,
        /// Time variants of the GPU passes at the start and take the fastest: auto (from 1000 steps on; kept between
        /// runs), off or again
        #[arg(value_name = "WHEN")]
        pub tune: Tune = Tune::Auto,
    }
    flags {
        /// Shorten the schedule of 30,000 steps to the steps that are taken. On with --preset quick, and with fewer
        /// steps of lean, psrgs and psrgs-paper where no step of the schedule is named; `=false` turns it off
        pub scale_schedule,
        /// Give the same bits on the same device, driver and program each time; a little slower on GPUs
        pub deterministic,
    }
    optional {
        /// Set resolution, steps and schedule: quick (640 pixels, 2000 steps), standard (1600 pixels, 30000 steps) or
        /// full (the photographs' size, 30000 steps) [default: quick on a CPU, else standard]
        #[arg(value_name = "NAME", help_heading = MOST_USED, display_order = 4)]
        pub preset: Preset,
        /// Begin with a model (PLY, SPZ, SOG, .splat, GLB) or cloud (PLY)
        #[arg(value_name = "FILE")]
        pub init: PathBuf,
    }
    constants {
        /// Bands of rows of a photograph; a step looks at one band, and takes about one share of the time of a whole
        /// photograph
        pub bands: u32 = 1; Range::new("a number from 1 to 64", |v| (1.0..=64.0).contains(&v)),
    }
    unset {
        /// Take as many steps as come to N looks at each photograph, but at least 2000, and at most 30000, iterations,
        /// and 2000 on a CPU; with a scaled schedule. The settings of a run have the steps that were taken, and no looks
        pub looks: u32; Range::COUNT,
    }
}

group! {
    /// The photographs and their size.
    pub struct Photographs("Photographs")
    options {
        /// Reduce photographs until their longer side has at most this many pixels; more show finer texture and need
        /// more memory and time
        #[arg(value_name = "PX", help_heading = MOST_USED, display_order = 6)]
        pub max_side: u32 = 1600; Range::new("at least 16 pixels", |v| v >= 16.0),
        /// Hold photographs out of training and score them, by position in the sorted names: test (0, 8, 16 ...), val
        /// (4, 12, 20 ...; those of test stay out too), none, every:N or every:N:FIRST
        #[arg(value_name = "SPLIT")]
        pub split: Split = Split::Test,
        /// Leave out pixels where the mask in DATA/masks has this colour: black or white
        #[arg(value_name = "COLOUR")]
        pub mask_ignores: MaskIgnores = MaskIgnores::Black,
        /// Treat transparent pixels as unknown (left-out), or lay photographs over the colour of --background
        /// (background)
        #[arg(value_name = "WHAT")]
        pub transparent: Transparent = Transparent::LeftOut,
        /// Take the values of photographs with more than 8 bits per channel as encoded (srgb) or linear; auto takes
        /// whole numbers as encoded and floating-point numbers as linear
        #[arg(value_name = "CURVE")]
        pub transfer: Transfer = Transfer::Auto,
    }
    flags {
        /// Refuse a dataset with an unusable pose, point, camera, photograph or splat; otherwise up to a tenth of each
        /// are left out, with a warning
        pub strict,
    }
    optional {
        /// Read the dataset as: colmap, nerfstudio or opensfm (OpenDroneMap too) [default: the format whose files are
        /// there]
        #[arg(value_name = "FORMAT")]
        pub format: Format,
        /// Take photographs from this folder inside DATA [default: images, or the images_N that fits --max-side]
        #[arg(value_name = "FOLDER")]
        pub images: String,
        /// Show this value of photographs with more than 8 bits per channel as white [default: 65535 of whole numbers,
        /// 1 of floating-point numbers]
        #[arg(value_name = "V")]
        pub white_level: f64; Range::POSITIVE,
    }
    constants {}
    unset {}
}

group! {
    /// The model and how it is rendered.
    pub struct Model("Model")
    options {
        /// Use spherical harmonics of degree 0 to D; a higher degree lets colours change more with the direction
        #[arg(value_name = "D")]
        pub sh_degree: u32 = 3; Range::new("0, 1, 2 or 3", |v| v <= 3.0),
        /// Show this colour behind the splats: black, white or random (a new one each step)
        #[arg(value_name = "COLOUR")]
        pub background: Background = Background::Black,
    }
    flags {
        /// Lower the opacity of splats smaller than a pixel by what the screen-space dilation adds; pictures keep their
        /// sharpness when zoomed
        pub antialias,
    }
    optional {}
    constants {
        /// Steps between raising the degree by one
        pub sh_interval: u32 = 1000; Range::COUNT,
        /// Share of the splats that have spherical harmonics above degree 1 once growth has ended: those whose colour
        /// changes most with the direction (1: all splats, from the beginning)
        pub sh_share: f64 = 1.0; Range::SHARE,
    }
    unset {}
}

group! {
    /// Loss and optimiser. The learning rate of the means is in units of the scene's extent.
    pub struct Optimiser("Loss and learning rates")
    options {
        /// Weigh 1 - SSIM by W and L1 by 1 - W in the loss; higher shows finer texture and makes more splats
        #[arg(value_name = "W")]
        pub lambda_dssim: f64 = 0.2; Range::SHARE,
        /// Move means at this rate at step 0, in extents of the scene
        #[arg(value_name = "RATE")]
        pub lr_means: f64 = 1.6e-4; Range::POSITIVE,
        /// Change constant colours at this rate
        #[arg(value_name = "RATE")]
        pub lr_sh_base: f64 = 2.5e-3; Range::WEIGHT,
        /// Change view-dependent colours at this rate
        #[arg(value_name = "RATE")]
        pub lr_sh_rest: f64 = 1.25e-4; Range::WEIGHT,
        /// Change opacity logits at this rate
        #[arg(value_name = "RATE")]
        pub lr_opacities: f64 = 0.025; Range::WEIGHT,
        /// Change log scales at this rate
        #[arg(value_name = "RATE")]
        pub lr_scales: f64 = 5e-3; Range::WEIGHT,
        /// Change rotations at this rate
        #[arg(value_name = "RATE")]
        pub lr_rotations: f64 = 1e-3; Range::WEIGHT,
        /// Learn a colour map of each photograph (affine), none (off), or affine where exposures differ and off
        /// elsewhere (auto). Other viewers show the model without it
        #[arg(value_name = "KIND", help_heading = "Photographs")]
        pub exposure: Exposure = Exposure::Off,
    }
    flags {}
    optional {}
    constants {
        /// Weight of half the squares of the view-dependent coefficients of every splat on the image, over the pixels
        /// of a photograph
        pub lambda_sh: f64 = 0.0; Range::WEIGHT,
        /// Weight of the mean opacity of all splats (visible-adam: of those on the image, over the number of all)
        pub lambda_opacity: f64 = 0.0; Range::WEIGHT,
        /// Weight of the mean standard deviation of all splats over their three axes, in units of which the scene's
        /// extent has 5 (visible-adam: of those on the image, over the number of all)
        pub lambda_scale: f64 = 0.0; Range::WEIGHT,
        /// Weight of o (1 - o) of the opacity o of every splat on the image, over the pixels of a photograph: pushes
        /// opacities to 0 or 1
        pub lambda_binary: f64 = 0.0; Range::WEIGHT,
        /// Share of the steps after which lambda-binary counts
        pub binary_from: f64 = 0.5; Range::SHARE,
        /// Learning rate of the means when its decay ends
        pub lr_means_final: f64 = 1.6e-6; Range::POSITIVE,
        /// Steps over which the learning rate of the means decays, log-linearly
        pub lr_means_steps: u32 = 30_000; Range::COUNT,
        /// Exponent E of scaled schedules: learning rates begin at (30000 / iterations)^E times their values (0: at
        /// their values)
        pub lr_scaling: f64 = 0.5; Range::SHARE,
        /// The same exponent for lr-sh-rest
        pub lr_scaling_sh: f64 = 0.6; Range::SHARE,
        /// Exponent E of scaled schedules: learning rates but that of the means fall to (iterations / 30000)^E of their
        /// first values at the last step (0: they stay)
        pub lr_decay: f64 = 0.6; Range::SHARE,
        /// Learning rate of the exposures at step 0
        pub lr_exposure: f64 = 0.01; Range::POSITIVE,
        /// Learning rate of the exposures at the last step
        pub lr_exposure_final: f64 = 1e-3; Range::POSITIVE,
    }
    unset {}
}

group! {
    /// Settings that make steps cheaper and change results.
    pub struct Shortcuts("Machine")
    options {
        /// Store each moment of the optimiser in 32 or 16 bits; 16 saves 236 bytes per splat
        #[arg(value_name = "BITS")]
        pub moment_bits: u32 = 32; Range::new("16 or 32", |v| v == 16.0 || v == 32.0),
    }
    flags {}
    optional {}
    constants {
        /// Share of the steps, the first ones, that skip splats at a pixel below an alpha of 1/early-cutoff, at most up
        /// to the first opacity reset or relocation; all others skip below 1/255
        pub early_steps: f64 = 0.0; Range::SHARE,
        /// N of 1/N, the alpha below which a splat is skipped at a pixel in early steps
        pub early_cutoff: u32 = 64; CUTOFF,
        /// Whether only the splats on the image are stepped: they make up for missed steps, and a step takes time by
        /// what a photograph shows
        pub visible_adam: bool = false,
    }
    unset {}
}

/// The N of an alpha cut-off of 1/N.
const CUTOFF: Range = Range::new("a whole number from 2 to 65535", |v| (2.0..=65535.0).contains(&v));

group! {
    /// How held-out photographs are scored.
    pub struct Scoring("Machine")
    options {}
    flags {}
    optional {
        /// Measure LPIPS with these weights: a folder with SqueezeNet 1.1 and the linear layers of LPIPS, or a file of
        /// both (`psrgs-vk weights` fetches them) [default: the user's weights folder; without weights LPIPS is not
        /// measured]
        #[arg(value_name = "PATH", env = "PSRGS_WEIGHTS", hide_env_values = true)]
        pub perceptual_weights: PathBuf,
    }
    constants {}
    unset {}
}

group! {
    /// The device that runs the training.
    pub struct DeviceChoice("Machine")
    options {}
    flags {}
    optional {
        /// Run on this Vulkan device: its index in `psrgs-vk info`, or a part of its name [default: discrete,
        /// integrated, then CPU]
        #[arg(value_name = "DEVICE", env = "PSRGS_DEVICE", hide_env_values = true)]
        pub device: String,
        /// Use at most this much device memory, such as 6GiB or 800M; growth stops at the limit [default: what the
        /// device reports, or PSRGS_MAX_DEVICE_MEMORY]
        #[arg(value_name = "BYTES")]
        pub max_device_memory: ByteSize,
    }
    constants {}
    unset {}
}

group! {
    /// Limits of host memory.
    pub struct HostChoice("Machine")
    options {}
    flags {}
    optional {
        /// Use at most this much memory of the machine, such as 2GiB; photographs beyond it are kept compressed or read
        /// again [default: half of what is free]
        #[arg(value_name = "BYTES")]
        pub host_memory: ByteSize,
    }
    constants {}
    unset {}
}

group! {
    /// Variants of the rendering passes: they change the speed, not the render.
    pub struct BlendingVariants("Variants of the GPU passes")
    options {}
    flags {}
    optional {
        /// Share a tile among threads in this way [default: what suits the device]
        #[arg(value_name = "SHAPE", value_enum)]
        pub tile_shape: crate::raster::TileShape,
    }
    constants {}
    unset {
        /// Put the splats of tiles in depth order by sorts of all splats and pairs (global), or each tile's list by itself
        /// (tiles); unset: what suits the device
        pub list_sort: crate::raster::ListSort,
        /// Walk along the lists of pixel tiles in the backward pass as a whole, or in chunks by need; unset: by need
        pub chunks: crate::raster::Chunks,
    }
}

group! {
    /// Variants of the other passes of a training step: they change the speed.
    pub struct SteppingVariants("Variants of the GPU passes")
    options {}
    flags {}
    optional {
        /// Sum the gradients of the blend backward in this way [default: what suits the device]; slots give equal bits
        /// each time
        #[arg(value_name = "SUM", value_enum)]
        pub gradient_sum: crate::raster::GradientSum,
    }
    constants {}
    unset {}
}

/// The settings of a training run.
#[derive(Clone, Debug, Default, PartialEq, clap::Args, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct Settings {
    /// Dataset folder: photographs with a model of COLMAP, nerfstudio, OpenSfM or OpenDroneMap
    #[arg(value_name = "DATA")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub data: Option<PathBuf>,
    /// Method, steps and schedule.
    #[command(flatten)]
    pub run: Run,
    /// Photographs.
    #[command(flatten)]
    pub photographs: Photographs,
    /// Model.
    #[command(flatten)]
    pub model: Model,
    /// Loss and learning rates.
    #[command(flatten)]
    pub optimiser: Optimiser,
    /// Growth and pruning.
    #[command(flatten)]
    pub density: Density,
    /// Low and high frequencies.
    #[command(flatten)]
    pub frequencies: Frequencies,
    /// Depth and normals.
    #[command(flatten)]
    pub geometry: Geometry,
    /// Texture.
    #[command(flatten)]
    pub texture: Texture,
    /// Shortcuts.
    #[command(flatten)]
    pub shortcuts: Shortcuts,
    /// Scores.
    #[command(flatten)]
    pub scoring: Scoring,
    /// The device.
    #[command(flatten)]
    pub device: DeviceChoice,
    /// Host memory.
    #[command(flatten)]
    pub host: HostChoice,
    /// Variants of the rendering passes.
    #[arg(skip)]
    pub blending: BlendingVariants,
    /// Variants of the other passes.
    #[arg(skip)]
    pub stepping: SteppingVariants,
}

impl Settings {
    /// The method's name in tables. Without a laser scan, that of `rsgs` says so.
    pub fn method_name(&self) -> String {
        match (self.run.method, &self.density.lidar) {
            (Method::Rsgs, Some(LidarCloud::Mvs)) => format!("{} (MVS cloud, no LiDAR)", self.run.method),
            (method, _) => method.to_string(),
        }
    }

    /// The defaults of a method.
    pub fn of_method(method: Method) -> Self {
        let mut settings = Self::default();
        method.apply(&mut settings, |_| false);
        settings
    }
}
