//! What can go wrong in training.

use std::path::{Path, PathBuf};

use super::cloud::Bounds;
use crate::byte_size::readable;
use crate::{dataset, format, scene, vk};

/// An error of training.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The device layer failed.
    #[error(transparent)]
    Device(#[from] vk::Error),
    /// The dataset could not be read.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] format::Error),
    /// There are no splats to begin with.
    #[error(transparent)]
    Init(#[from] scene::init::InitError),
    /// A saliency mask could not be made.
    #[error(transparent)]
    Saliency(#[from] crate::saliency::Error),
    /// Stereo failed.
    #[error(transparent)]
    Stereo(#[from] crate::stereo::Error),
    /// The perceptual distance could not be set up.
    #[error(transparent)]
    Perceptual(#[from] crate::perceptual::Error),
    /// Settings could not be written into a checkpoint.
    #[error(transparent)]
    Settings(#[from] super::settings::SettingsError),
    /// A variant that does not give equal bits was asked for in a deterministic training.
    #[error(
        "of the values of `gradient-sum` only slots gives equal bits: leave `gradient-sum` or `deterministic` unset"
    )]
    NotDeterministic,
    /// Float atomics were asked for on a device (or with a switch) that has none.
    #[error("`gradient-sum` atomic: this device has no float atomics on buffers; use compare-and-swap or slots")]
    NoFloatAtomics,
    /// A variant of the blending passes takes more shared memory than a workgroup has.
    #[error(
        "{form}: more than the {most} bytes of shared memory that this device has for a workgroup; \
         `tile-shape` column with `gradient-sum` slots takes next to none"
    )]
    SharedMemory {
        /// The variant.
        form: String,
        /// Bytes of shared memory that a workgroup has.
        most: u32,
    },
    /// A shortcut of the optimiser was asked for on a device that binds too few buffers to a pass.
    #[error(
        "`sh-share`: with it a pass of the optimiser needs {needed} storage buffers, and this device has {limit}; \
         leave `sh-share` unset, or set `moment-bits` to 16"
    )]
    ShortcutBuffers {
        /// Storage buffers of the pass.
        needed: u32,
        /// Storage buffers that the device binds.
        limit: u32,
    },
    /// A point cloud is not where the cameras look.
    #[error(
        "{}: the cloud is in another frame than the cameras: {}, and they look at {scene}. \
         Give the cloud in the coordinates of the dataset, or set `lidar` to mvs",
        file.display(),
        where_cloud(cloud.as_deref())
    )]
    CloudElsewhere {
        /// File of the cloud.
        file: PathBuf,
        /// Bounds of the cloud; none where it has no points.
        cloud: Option<Box<Bounds>>,
        /// Bounds of the reconstructed points.
        scene: Box<Bounds>,
    },
    /// Stereo found no surface for a cloud.
    #[error("`lidar` mvs: stereo found no surface that photographs agree on; give a laser scan (PLY, LAS or LAZ)")]
    NoCloud,
    /// The photographs of a role have no pixel that is not masked.
    #[error(
        "{}: {} is masked all over, by its mask or by its transparency \
         (`mask-ignores` names the colour of a mask that leaves pixels out, \
         `transparent` says what transparent pixels are)",
        dataset.display(),
        which_photographs(*role)
    )]
    AllMasked {
        /// Folder of the dataset.
        dataset: PathBuf,
        /// Whether the photographs are trained on or held out.
        role: dataset::Role,
    },
    /// No photograph to train on.
    #[error("there is no photograph to train on")]
    NoViews,
    /// The pixels of a photograph do not fit the camera's size.
    #[error("photograph '{name}': {found} bytes of pixels where the camera's size needs {expected}")]
    PhotographSize {
        /// Name of the photograph.
        name: String,
        /// Bytes given.
        found: usize,
        /// Bytes needed.
        expected: usize,
    },
    /// The loss is not a finite number: the model is beyond repair.
    #[error(
        "step {step}: the loss is not a finite number. \
         Go back to the last checkpoint, or train with lower learning rates"
    )]
    LossNotFinite {
        /// Step.
        step: u32,
    },
    /// The number of splats or pairs exceeds what a buffer of the device can hold.
    #[error("{what}: {wanted} would be needed, and {limit} is the most; lower it with {remedy}")]
    TooMany {
        /// What there are too many of.
        what: &'static str,
        /// How many are needed.
        wanted: u64,
        /// The limit.
        limit: u64,
        /// The setting that helps.
        remedy: &'static str,
    },
    /// The training does not fit the device memory that may be used.
    #[error(
        "out of device memory: no room for {} {what}; with them the training needs {}, and may use {} \
         ({} are in use now, the limit is {}). Raise `max-device-memory`, or lower `max-side` or `max-splats`{}",
        crate::numbers::grouped(*wanted),
        readable(*needed),
        readable(*room),
        readable(*in_use),
        readable(*limit),
        where_saved(saved.as_deref())
    )]
    MemoryLimit {
        /// What there is no room for.
        what: &'static str,
        /// How many were wanted.
        wanted: u64,
        /// Bytes of the training with the wanted number.
        needed: u64,
        /// Bytes that the training may use.
        room: u64,
        /// Bytes in use when the error was found.
        in_use: u64,
        /// Limit of device memory, in bytes.
        limit: u64,
        /// Checkpoint of the training so far, where one was saved.
        saved: Option<PathBuf>,
    },
    /// The training does not fit the host memory that may be used.
    #[error(
        "out of host memory: {} are needed at the least, {} of them in use now, and {} may be used, {}; \
         allow more host memory, or need less with smaller photographs or fewer splats",
        readable(*needed),
        readable(*in_use),
        readable(*most),
        if *asked { "as was asked for" } else { "which is all that is free" }
    )]
    HostMemoryLimit {
        /// Bytes needed at the least, those in use included.
        needed: u64,
        /// Bytes that may be used.
        most: u64,
        /// Bytes in use when the error was found.
        in_use: u64,
        /// Whether the limit was asked for.
        asked: bool,
    },
    /// A run cannot go on with photographs other than those it was trained on.
    #[error(
        "the dataset is not the one that the run was trained on: {what}. \
         Put back what the run was trained on, or train anew in another folder"
    )]
    OtherPhotographs {
        /// The first difference.
        what: String,
    },
    /// A resumed training would compare by another perceptual distance.
    #[error(
        "the perceptual loss compared by {before} so far, and would now compare by {now}: give the same weights \
         (`perceptual-weights`, PSRGS_WEIGHTS, or the folder of `psrgs-vk weights`), or train anew in another folder"
    )]
    OtherPerceptual {
        /// What the loss compared by so far.
        before: String,
        /// What the loss would compare by.
        now: String,
    },
    /// A section of a checkpoint has the wrong size.
    #[error("checkpoint, section '{section}': {found} values where {expected} are expected")]
    Checkpoint {
        /// Name of the section.
        section: String,
        /// Values found.
        found: usize,
        /// Values expected.
        expected: usize,
    },
    /// A text section of a checkpoint cannot be read.
    #[error("checkpoint: {0}")]
    CheckpointText(#[from] serde_json::Error),
}

fn where_cloud(cloud: Option<&Bounds>) -> String {
    cloud.map_or_else(|| "it has no points".to_owned(), |bounds| format!("it has {bounds}"))
}

fn which_photographs(role: dataset::Role) -> &'static str {
    match role {
        dataset::Role::HeldOut => "every held-out photograph",
        _ => "every photograph to train on",
    }
}

fn where_saved(file: Option<&Path>) -> String {
    file.map_or(String::new(), |f| {
        format!(". The training so far is saved in {}: `resume` goes on from there", f.display())
    })
}
