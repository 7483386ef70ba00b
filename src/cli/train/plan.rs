//! A training as the command line asks for it.

use std::path::PathBuf;

use psrgs_vk::train::Settings;

/// A run as the options describe it.
#[derive(Debug)]
pub(crate) struct Plan {
    /// Every setting, with absolute paths.
    pub(crate) settings: Settings,
    /// Folder for the results.
    pub(crate) out: PathBuf,
    /// Whether to go on from the checkpoint in `out`.
    pub(crate) resume: bool,
    /// Whether `out` may hold an earlier run.
    pub(crate) overwrite: bool,
    /// What to say of the preset that holds.
    pub(crate) preset: Option<String>,
    /// For tests: the step after which the device is as if lost.
    pub(crate) lose_device_at: Option<u32>,
    /// For tests: whether photographs are read again in each step.
    pub(crate) keep_no_photographs: bool,
}
