//! How a device is opened.

use std::path::PathBuf;

/// Whether the Khronos validation layer watches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Validation {
    /// No layer.
    #[default]
    Off,
    /// Core and synchronization validation; [`crate::vk::Error::MissingLayer`] where the layer is not installed.
    CoreAndSync,
    /// GPU-assisted validation: every address that a shader of the form by address uses is checked on the device against the buffers
    /// that there are. The host waits for every submit: the layer (up to 1.3.250) does not follow timelines in this mode and
    /// would let each look at one wait for ten seconds.
    GpuAssisted,
}

/// How floats are added atomically.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FloatAtomics {
    /// `atomicAdd` on floats.
    Native,
    /// A compare-and-swap loop on their bits.
    CompareAndSwap,
}

/// Choices for [`crate::vk::Gpu::open`]. `default()` reads no environment; [`OpenOptions::from_env`] does.
#[derive(Clone, Debug)]
pub struct OpenOptions {
    /// Index in the list of devices, or part of a name in any case; `None` takes a discrete GPU before an integrated one
    /// before a CPU.
    pub device: Option<String>,
    /// The validation layer.
    pub validation: Validation,
    /// Put a guard of known bytes behind every buffer, inside the bound range, for [`crate::vk::Gpu::check_canaries`].
    pub canaries: bool,
    /// Check every submit with the hazard checker before it goes to the device.
    pub check_hazards: bool,
    /// Write a marker before every command, so that a lost device names the pass. Commands no longer overlap.
    pub breadcrumbs: bool,
    /// Use this kind of float atomics rather than the best available.
    pub float_atomics: Option<FloatAtomics>,
    /// Emulate subgroups of this width in shared memory rather than use the hardware's.
    pub emulate_subgroup: Option<u32>,
    /// Refuse allocations past this many bytes rather than past what the device reports.
    pub max_device_memory: Option<u64>,
    /// Treat a storage-buffer descriptor as if it covered no more than this many bytes.
    pub storage_range: Option<u64>,
    /// Reach buffers by address always (`true`) or never (`false`); `None` does so where one is larger than a descriptor's range.
    /// Never, too, on a device without the feature.
    pub addresses: Option<bool>,
    /// Read rows of buffers as texels always (`true`) or never (`false`); `None` does so on CPU devices. Never, too, on a device
    /// without the formats.
    pub texels: Option<bool>,
    /// Bind no more storage buffers to one pass than this, where the device takes more.
    pub max_storage_buffers: Option<u32>,
    /// Give a workgroup no more bytes of shared memory than this, where the device has more.
    pub max_shared_bytes: Option<u32>,
    /// Folder of the pipeline cache; `None` keeps it in memory only.
    pub pipeline_cache: Option<PathBuf>,
}

impl Default for OpenOptions {
    fn default() -> Self {
        OpenOptions {
            device: None,
            validation: Validation::Off,
            canaries: cfg!(debug_assertions),
            check_hazards: cfg!(debug_assertions),
            breadcrumbs: false,
            float_atomics: None,
            emulate_subgroup: None,
            max_device_memory: None,
            storage_range: None,
            addresses: None,
            texels: None,
            max_storage_buffers: None,
            max_shared_bytes: None,
            pipeline_cache: None,
        }
    }
}

impl OpenOptions {
    /// The defaults, changed by these environment variables: `PSRGS_DEVICE` (as [`OpenOptions::device`]),
    /// `PSRGS_VALIDATION=1|gpu`, `PSRGS_CANARIES=0|1`, `PSRGS_BREADCRUMBS=1`, `PSRGS_FLOAT_ATOMICS=native|cas`,
    /// `PSRGS_SUBGROUP=hardware|8|16|32|64`, `PSRGS_MAX_DEVICE_MEMORY=BYTES`, `PSRGS_STORAGE_RANGE=BYTES`,
    /// `PSRGS_ADDRESSES=always|never`, `PSRGS_TEXELS=always|never`, `PSRGS_STORAGE_BUFFERS=N`,
    /// `PSRGS_SHARED_BYTES=BYTES`, `PSRGS_CACHE=FOLDER`. Values that do not parse are ignored. The pipeline cache is on, in the user's cache folder.
    pub fn from_env() -> Self {
        let get = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
        let flag = |name: &str, default: bool| get(name).map_or(default, |value| value != "0");
        let base = OpenOptions::default();
        OpenOptions {
            device: get("PSRGS_DEVICE"),
            validation: match get("PSRGS_VALIDATION").as_deref() {
                None | Some("0") => Validation::Off,
                Some("gpu") => Validation::GpuAssisted,
                Some(_) => Validation::CoreAndSync,
            },
            canaries: flag("PSRGS_CANARIES", base.canaries),
            breadcrumbs: flag("PSRGS_BREADCRUMBS", false),
            float_atomics: get("PSRGS_FLOAT_ATOMICS").and_then(|value| match value.as_str() {
                "native" => Some(FloatAtomics::Native),
                "cas" => Some(FloatAtomics::CompareAndSwap),
                _ => None,
            }),
            emulate_subgroup: get("PSRGS_SUBGROUP")
                .and_then(|value| value.parse().ok())
                .filter(|width| [8, 16, 32, 64].contains(width)),
            max_device_memory: get("PSRGS_MAX_DEVICE_MEMORY").and_then(|value| value.parse().ok()),
            storage_range: get("PSRGS_STORAGE_RANGE").and_then(|value| value.parse().ok()),
            addresses: get("PSRGS_ADDRESSES").and_then(|value| always_or_never(&value)),
            texels: get("PSRGS_TEXELS").and_then(|value| always_or_never(&value)),
            max_storage_buffers: get("PSRGS_STORAGE_BUFFERS").and_then(|value| value.parse().ok()),
            max_shared_bytes: get("PSRGS_SHARED_BYTES").and_then(|value| value.parse().ok()),
            pipeline_cache: get("PSRGS_CACHE").map(PathBuf::from).or_else(cache_folder),
            ..base
        }
    }
}

fn always_or_never(value: &str) -> Option<bool> {
    match value {
        "always" => Some(true),
        "never" => Some(false),
        _ => None,
    }
}

/// `psrgs-vk` in the user's cache folder, by the XDG base directory specification.
fn cache_folder() -> Option<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = absolute("XDG_CACHE_HOME").or_else(|| absolute("HOME").map(|home| home.join(".cache")));
    base.map(|base| base.join("psrgs-vk"))
}
