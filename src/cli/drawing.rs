//! Options of how a model is drawn that trade accuracy for speed.

use clap::builder::PossibleValuesParser;
use psrgs_vk::raster::{Approximation, ShStorage};

/// What pictures may lose to be drawn faster.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Shortcuts")]
pub(crate) struct DrawingArgs {
    /// Skip a splat at a pixel where its alpha is below 1/N
    #[arg(long, value_name = "N", default_value_t = Approximation::NONE.alpha_cutoff,
          value_parser = clap::value_parser!(u32).range(2..=65535))]
    alpha_cutoff: u32,
    /// Bits in which the numbers of spherical harmonics are stored on the device
    #[arg(long, value_name = "BITS", default_value = "32", value_parser = PossibleValuesParser::new(["16", "32"]))]
    sh_bits: String,
}

impl DrawingArgs {
    /// Cut-offs.
    pub(crate) fn approximation(&self) -> Approximation {
        Approximation { alpha_cutoff: self.alpha_cutoff }
    }

    /// How spherical harmonics are stored.
    pub(crate) fn sh(&self) -> ShStorage {
        if self.sh_bits == "16" { ShStorage::Half } else { ShStorage::Full }
    }
}
