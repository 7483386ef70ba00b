//! A finished training, as its results are made of it.

use std::time::Instant;

use psrgs_vk::dataset::{Dataset, Undecoded, Warning};
use psrgs_vk::train::Settings;
use psrgs_vk::vk::Gpu;

use super::run_folder::RunFolder;

/// A training that came to its end.
pub(crate) struct Finished<'a> {
    /// Those that it was trained with.
    pub(crate) settings: &'a Settings,
    pub(crate) folder: &'a RunFolder,
    pub(crate) dataset: &'a Dataset,
    pub(crate) gpu: &'a Gpu,
    /// When the process started.
    pub(crate) started: Instant,
    /// Seconds of training, earlier stretches of a resumed run included.
    pub(crate) training_seconds: f64,
    /// Seconds of training in earlier stretches of a resumed run.
    pub(crate) earlier_seconds: f64,
    /// Seconds of multi-view stereo.
    pub(crate) stereo_seconds: f64,
    /// What is to be told of photographs that were left out when they were decoded.
    pub(crate) left_out: &'a [Warning],
    /// Those of them that could not be.
    pub(crate) undecoded: &'a Undecoded,
}
