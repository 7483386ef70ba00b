//! Sizes of renders by the rules of other trainers.

use psrgs_vk::dataset::{LoadOptions, Rounding, Sizing};

/// Options in place of `--max-side`.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Size of other trainers")]
pub(crate) struct SizeArgs {
    /// Divide the sides of the calibration by this, as `images_N` folders are made; in place of --max-side
    #[arg(long, value_name = "F", conflicts_with_all = ["max_side", "width"])]
    pub(crate) downscale: Option<f64>,
    /// Exactly this width, with --height; in place of --max-side
    #[arg(long, value_name = "PX", requires = "height", conflicts_with = "max_side")]
    pub(crate) width: Option<u32>,
    /// Exactly this height, with --width
    #[arg(long, value_name = "PX", requires = "width")]
    pub(crate) height: Option<u32>,
    /// How sides that are no whole number of pixels are rounded
    #[arg(long, value_enum, value_name = "HOW", default_value_t = Round::Nearest)]
    pub(crate) rounding: Round,
}

/// See [`Rounding`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Round {
    /// Nearest whole number
    #[default]
    Nearest,
    /// Next whole number below
    Down,
    /// Next whole number above
    Up,
}

impl SizeArgs {
    /// Applies the sizes to the load options.
    pub(crate) fn apply(&self, options: LoadOptions) -> LoadOptions {
        let rounding = match self.rounding {
            Round::Nearest => Rounding::Nearest,
            Round::Down => Rounding::Down,
            Round::Up => Rounding::Up,
        };
        let sizing = match (self.downscale, self.width, self.height) {
            (Some(factor), _, _) => Some(Sizing::Downscale(factor)),
            (None, Some(width), Some(height)) => Some(Sizing::Exact(width, height)),
            _ => None,
        };
        LoadOptions { sizing, rounding, ..options }
    }
}
