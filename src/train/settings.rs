//! Everything that decides what a training run does, as one struct: command-line options, `settings.toml` and the library's
//! configuration are the same fields with the same names and defaults.

mod check;
mod file;
mod group;
mod growth;
mod idle;
mod method;
mod preset;
mod terms;
mod values;

pub use file::SettingsError;
pub use growth::{Density, Frequencies};
pub use terms::{Geometry, Texture};
pub use values::{
    Background, ByteSize, DepthPrior, Exposure, Format, Gate, Growth, LidarCloud, MaskIgnores, Method, Preset,
    SigmaLearning, Split, Transfer, Transparent, Tune,
};

use std::path::PathBuf;

use crate::raster::{Approximation, Exponential};
use group::group;

group! {
    /// What is run, and for how long.
    pub struct Run("Run") {
        /// Training method
        #[arg(value_name = "M")]
        pub method: Method = Method::Gs,
        /// Training steps; one step looks at one photograph, or with --bands at a part of it
        #[arg(value_name = "N")]
        pub iterations: u32 = 30_000,
        /// Each step looks at one of N bands of rows of its photograph, the next step at the next band: a step takes about 1/N of the time, and
        /// it takes N steps to look at a photograph once (1: each looks at all of it)
        #[arg(value_name = "N")]
        pub bands: u32 = 1,
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
        /// Fit the 30,000-step schedule to --iterations: always with --preset quick, and with fewer steps of lean, psrgs and psrgs-paper
        /// where no step of the schedule is named (--densify-until, say), unless it is =false
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
        /// What transparent pixels of photographs are: `left-out`, where nothing is known (from half transparent on), or `background`:
        /// photographs are laid over the colour of --background, and nothing is to be seen there
        #[arg(value_name = "WHAT")]
        pub transparent: Transparent = Transparent::LeftOut,
        /// Curve of photographs with more than 8 bits per channel: `srgb` takes their numbers as encoded, `linear` encodes them;
        /// `auto` takes whole numbers (PNG, TIFF) as encoded and floating-point ones (OpenEXR, TIFF) as linear
        #[arg(value_name = "CURVE")]
        pub transfer: Transfer = Transfer::Auto,
    }
    flags {
        /// Refuse a dataset with a pose, point, camera, photograph or splat that cannot be used; otherwise up to a tenth of each are
        /// left out, with a warning
        pub strict,
    }
    optional {
        /// Format of the dataset: colmap, nerfstudio or opensfm [default: the first of them whose files are there]
        #[arg(value_name = "FORMAT")]
        pub format: Format,
        /// Folder of the photographs inside DATA [default: images, or the images_N that fits --max-side]
        #[arg(value_name = "FOLDER")]
        pub images: String,
        /// The number that is white in photographs with more than 8 bits per channel; larger ones are cut [default: 65535 of
        /// whole numbers, 1 of floating-point ones]
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
        /// Share of the splats that have spherical harmonics above degree 1: those whose colour changes most with the direction when
        /// growth has ended; before, none has any (1: all have, from the beginning)
        #[arg(value_name = "SHARE")]
        pub sh_share: f64 = 1.0,
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
        /// Weight of half the squares of the view-dependent coefficients of every splat on the image, over the pixels of a photograph: a
        /// colour changes with the direction only where photographs ask for it
        #[arg(value_name = "W")]
        pub lambda_sh: f64 = 0.0,
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
        /// Scaled schedules: these rates begin at (30000 / --iterations)^E times what they are (0: as they are)
        #[arg(value_name = "E")]
        pub lr_scaling: f64 = 0.5,
        /// The same for --lr-sh-rest
        #[arg(value_name = "E")]
        pub lr_scaling_sh: f64 = 0.6,
        /// Scaled schedules: and fall to (--iterations / 30000)^E of that at the last step, means apart (0: they stay)
        #[arg(value_name = "E")]
        pub lr_decay: f64 = 0.6,
        /// Scaled schedules: Adam forgets squared gradients (30000 / --iterations)^E times as fast, 0.001 of them in a step (0: as fast)
        #[arg(value_name = "E")]
        pub beta2_scaling: f64 = 0.0,
        /// What each photograph may differ in from the render: off (nothing) or affine (a colour map per photograph, the identity
        /// in the mean over all; held-out photographs are compared as exposed like
        /// those before, after and near them)
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
        /// In training, skip a splat at a pixel where its alpha is below 1/N; held-out pictures are always drawn with 255
        #[arg(value_name = "N")]
        pub alpha_cutoff: u32 = Approximation::NONE.alpha_cutoff,
        /// Share of the steps, the first ones, that have --early-cutoff in the place of --alpha-cutoff: lists are shorter while splats find
        /// their places
        #[arg(value_name = "SHARE")]
        pub early_steps: f64 = 0.0,
        /// In these steps, skip a splat at a pixel where its alpha is below 1/N
        #[arg(value_name = "N")]
        pub early_cutoff: u32 = 64,
        /// In training, stop a pixel before the splat that would take its transmittance below 1/N; held-out pictures are always drawn
        /// with 10000
        #[arg(value_name = "N")]
        pub transmittance_cutoff: u32 = Approximation::NONE.transmittance_cutoff,
        /// In training, the exponential of blending; held-out pictures are always drawn with exact
        #[arg(value_name = "HOW", value_enum)]
        pub exponential: Exponential = Exponential::Exact,
    }
    flags {
        /// Step only the splats that are on the image: they make up for the steps they have missed, and move by what they are expected to miss in
        /// advance. A step takes time by what a photograph shows, not by the size of the scene
        pub visible_adam,
    }
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
    }
}

group! {
    /// What it may take of the machine.
    pub struct HostChoice("Host") {
    }
    flags {}
    optional {
        /// Memory of this machine that may be used, such as 2GiB: photographs beyond it are kept compressed or read again [default:
        /// half of what is free]
        #[arg(value_name = "BYTES")]
        pub host_memory: ByteSize,
    }
}

group! {
    /// Forms of the passes that draw: they change the speed, and not the picture.
    pub struct BlendingForms("Forms of the GPU passes") {
    }
    flags {}
    optional {
        /// How the blending passes share a tile among threads [default: what suits the device]
        #[arg(value_name = "SHAPE", value_enum)]
        pub tile_shape: crate::raster::TileShape,
        /// In blending, leave out splats in the blocks of a pixel tile where they do not show [default: blocks]; the picture is the same
        #[arg(value_name = "WHERE", value_enum)]
        pub culling: crate::raster::Culling,
    }
}

group! {
    /// Forms of the passes of a training step beyond those: they change the speed.
    pub struct SteppingForms("Forms of the GPU passes") {
    }
    flags {}
    optional {
        /// Where the blend backward leaves its gradients [default: what suits the device]; slots are bit-reproducible
        #[arg(value_name = "SUM", value_enum)]
        pub gradient_sum: crate::raster::GradientSum,
        /// What the threads of the blend backward own [default: pixels]; per-splat brings pixel tiles
        #[arg(value_name = "FORM", value_enum)]
        pub backward: crate::raster::Backward,
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
    /// The machine beside it.
    #[command(flatten)]
    pub host: HostChoice,
    /// How it draws.
    #[command(flatten)]
    pub blending: BlendingForms,
    /// How it steps.
    #[command(flatten)]
    pub stepping: SteppingForms,
}

impl Shortcuts {
    /// What `--fast` stands for; see `docs/PERFORMANCE.md` for what they save and cost.
    pub const FAST: Self = Self {
        moment_bits: 16,
        sh_every: 4,
        sh_rate: 4.0,
        visible_adam: false,
        early_steps: 0.0,
        early_cutoff: 64,
        alpha_cutoff: Approximation::NONE.alpha_cutoff,
        transmittance_cutoff: Approximation::NONE.transmittance_cutoff,
        exponential: Exponential::Exact,
    };

    /// What the passes lose by them.
    pub fn approximation(&self) -> Approximation {
        Approximation {
            alpha_cutoff: self.alpha_cutoff,
            transmittance_cutoff: self.transmittance_cutoff,
            exponential: self.exponential,
        }
    }
}

impl Settings {
    /// What the method is called in tables: without a laser scan `rsgs` says so.
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
