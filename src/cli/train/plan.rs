//! A training run from the options of the command line.

use std::path::PathBuf;

use psrgs_vk::train::Settings;

/// A training run.
#[derive(Debug)]
pub(crate) struct RunPlan {
    /// Every setting, with absolute paths.
    pub(crate) settings: Settings,
    /// Folder of the results.
    pub(crate) out: PathBuf,
    /// Whether to resume from the checkpoint in `out`.
    pub(crate) resume: bool,
    /// Whether `out` may hold an earlier run, which is replaced.
    pub(crate) overwrite: bool,
    /// Message about the preset.
    pub(crate) preset: Option<String>,
    /// For tests: the step after which the device counts as lost.
    pub(crate) lose_device_at: Option<u32>,
    /// For tests: whether every step decodes its photographs again.
    pub(crate) keep_no_photographs: bool,
}
