//! A finished training.

use std::time::Instant;

use psrgs_vk::dataset::{Dataset, Undecoded, Warning};
use psrgs_vk::train::Settings;
use psrgs_vk::vk::Gpu;

use super::run_folder::RunFolder;

/// The state of a finished training, from which its results are written.
pub(crate) struct Finished<'a> {
    /// Settings of the training.
    pub(crate) settings: &'a Settings,
    pub(crate) folder: &'a RunFolder,
    pub(crate) dataset: &'a Dataset,
    pub(crate) gpu: &'a Gpu,
    /// Whether the whole scene was trained: geometry says nothing of a part.
    pub(crate) whole: bool,
    /// When the process started.
    pub(crate) started: Instant,
    /// Seconds of training, earlier stretches of a resumed run included.
    pub(crate) training_seconds: f64,
    /// Seconds of training in earlier stretches of a resumed run.
    pub(crate) earlier_seconds: f64,
    /// Seconds of multi-view stereo.
    pub(crate) stereo_seconds: f64,
    /// Warnings about photographs that were left out when they were decoded.
    pub(crate) left_out: &'a [Warning],
    /// The photographs that could not be decoded.
    pub(crate) undecoded: &'a Undecoded,
}
