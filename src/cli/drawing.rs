//! Options of how a model is drawn that trade accuracy for speed.

use clap::builder::PossibleValuesParser;
use psrgs_vk::raster::ShStorage;

/// What pictures may lose to be drawn faster.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Shortcuts")]
pub(crate) struct DrawingArgs {
    /// Bits in which the numbers of spherical harmonics are stored on the device
    #[arg(long, value_name = "BITS", default_value = "32", value_parser = PossibleValuesParser::new(["16", "32"]))]
    sh_bits: String,
}

impl DrawingArgs {
    /// How spherical harmonics are stored.
    pub(crate) fn sh(&self) -> ShStorage {
        if self.sh_bits == "16" { ShStorage::Half } else { ShStorage::Full }
    }
}
