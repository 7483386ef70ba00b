//! How a device is opened.

use std::path::PathBuf;

use super::error::{Error, Result};
use crate::byte_size;

/// Mode of the Khronos validation layer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Validation {
    /// No layer.
    #[default]
    Off,
    /// Core and synchronization validation. Fails with [`crate::vk::Error::MissingLayer`] when the layer is not
    /// installed.
    CoreAndSync,
    /// GPU-assisted validation: the device checks every buffer address that a shader uses against the existing buffers.
    /// The host waits for every submit, because in this mode the layer (up to 1.3.250) does not follow timeline
    /// semaphores and would block each query of one for ten seconds.
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

/// Options of [`crate::vk::Gpu::open`]. `default()` ignores environment variables; [`OpenOptions::from_env`] reads
/// them.
#[derive(Clone, Debug)]
pub struct OpenOptions {
    /// Index in [`crate::vk::devices`], or part of a device name (case-insensitive). `None` prefers a discrete GPU to
    /// an integrated GPU to a CPU.
    pub device: Option<String>,
    /// Mode of the validation layer.
    pub validation: Validation,
    /// Put a guard of known bytes after every buffer, inside the bound range, for [`crate::vk::Gpu::check_canaries`].
    pub canaries: bool,
    /// Fill new buffers with a word that is invalid as a float, a half or a count, to reveal passes that read unwritten
    /// memory.
    pub garbage: bool,
    /// Check every submit with the hazard checker before the device gets the commands.
    pub check_hazards: bool,
    /// Write a marker before every command, so that a device loss names the pass. Commands then no longer overlap.
    pub breadcrumbs: bool,
    /// Use this kind of float atomics instead of the best available kind.
    pub float_atomics: Option<FloatAtomics>,
    /// Emulate subgroups of this width in shared memory instead of using the hardware's subgroups.
    pub emulate_subgroup: Option<u32>,
    /// Most bytes of device memory, instead of the limit derived from the device's report.
    pub max_device_memory: Option<u64>,
    /// Largest range of a storage-buffer descriptor in bytes, where the device allows more.
    pub storage_range: Option<u64>,
    /// Reach buffers by address always (`true`) or never (`false`). `None` does so only for bindings larger than a
    /// descriptor's range. A device without `bufferDeviceAddress` never does.
    pub addresses: Option<bool>,
    /// Read rows of buffers as texels always (`true`) or never (`false`). `None` does so on CPU devices. A device
    /// without the texel formats never does.
    pub texels: Option<bool>,
    /// Most storage buffers of one pass, where the device allows more.
    pub max_storage_buffers: Option<u32>,
    /// Most bytes of shared memory of a workgroup, where the device allows more.
    pub max_shared_bytes: Option<u32>,
    /// Have the driver keep statistics of the pipelines, for [`crate::vk::Gpu::pipeline_statistics`]. Fails with
    /// [`crate::vk::Error::MissingFeature`] where the device has none. Pipelines of a cache on disk may have none either.
    pub statistics: bool,
    /// Folder of the pipeline cache; `None` keeps the cache in memory only.
    pub pipeline_cache: Option<PathBuf>,
}

impl Default for OpenOptions {
    fn default() -> Self {
        OpenOptions {
            device: None,
            validation: Validation::Off,
            canaries: cfg!(debug_assertions),
            garbage: cfg!(debug_assertions),
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
            statistics: false,
            pipeline_cache: None,
        }
    }
}

impl OpenOptions {
    /// The defaults, changed by these environment variables: `PSRGS_DEVICE` (as [`OpenOptions::device`]),
    /// `PSRGS_VALIDATION=1|gpu`, `PSRGS_CANARIES=0|1`, `PSRGS_GARBAGE=0|1`, `PSRGS_BREADCRUMBS=1`,
    /// `PSRGS_FLOAT_ATOMICS=native|cas`, `PSRGS_SUBGROUP=hardware|8|16|32|64`, `PSRGS_MAX_DEVICE_MEMORY=BYTES`,
    /// `PSRGS_STORAGE_RANGE=BYTES`, `PSRGS_ADDRESSES=always|never`, `PSRGS_TEXELS=always|never`,
    /// `PSRGS_STORAGE_BUFFERS=N`, `PSRGS_SHARED_BYTES=BYTES`, `PSRGS_CACHE=FOLDER`; BYTES may be written as `6GiB` or
    /// `800M`. An invalid value is [`Error::Variable`]. Without `PSRGS_CACHE` the pipeline cache is kept in the user's
    /// cache folder.
    pub fn from_env() -> Result<Self> {
        Self::from_variables(|name| std::env::var(name).ok())
    }

    fn from_variables(variable: impl Fn(&str) -> Option<String>) -> Result<Self> {
        let get = |name: &str| variable(name).filter(|value| !value.is_empty());
        let flag = |name: &str, default: bool| get(name).map_or(default, |value| value != "0");
        let base = OpenOptions::default();
        Ok(OpenOptions {
            device: get("PSRGS_DEVICE"),
            validation: match get("PSRGS_VALIDATION").as_deref() {
                None | Some("0") => Validation::Off,
                Some("gpu") => Validation::GpuAssisted,
                Some(_) => Validation::CoreAndSync,
            },
            canaries: flag("PSRGS_CANARIES", base.canaries),
            garbage: flag("PSRGS_GARBAGE", base.garbage),
            breadcrumbs: flag("PSRGS_BREADCRUMBS", false),
            float_atomics: read(get, "PSRGS_FLOAT_ATOMICS", "native or cas", float_atomics)?,
            emulate_subgroup: read(get, "PSRGS_SUBGROUP", "hardware, 8, 16, 32 or 64", subgroup)?.flatten(),
            max_device_memory: read(get, "PSRGS_MAX_DEVICE_MEMORY", SIZE, byte_size::parse)?,
            storage_range: read(get, "PSRGS_STORAGE_RANGE", SIZE, byte_size::parse)?,
            addresses: read(get, "PSRGS_ADDRESSES", "always or never", always_or_never)?,
            texels: read(get, "PSRGS_TEXELS", "always or never", always_or_never)?,
            max_storage_buffers: read(get, "PSRGS_STORAGE_BUFFERS", "a number", |value| value.parse().ok())?,
            max_shared_bytes: read(get, "PSRGS_SHARED_BYTES", SIZE, |value| {
                u32::try_from(byte_size::parse(value)?).ok()
            })?,
            pipeline_cache: get("PSRGS_CACHE").map(PathBuf::from).or_else(cache_folder),
            ..base
        })
    }
}

/// Description of a valid size.
const SIZE: &str = "a size in bytes: 6GiB, 800M or plain digits";

/// Value of a variable; `None` for an unset variable.
fn read<T>(
    get: impl Fn(&str) -> Option<String>,
    name: &'static str,
    want: &'static str,
    parse: impl Fn(&str) -> Option<T>,
) -> Result<Option<T>> {
    let Some(value) = get(name) else { return Ok(None) };
    match parse(&value) {
        None => Err(Error::Variable { name, value, want }),
        known => Ok(known),
    }
}

fn float_atomics(value: &str) -> Option<FloatAtomics> {
    match value {
        "native" => Some(FloatAtomics::Native),
        "cas" => Some(FloatAtomics::CompareAndSwap),
        _ => None,
    }
}

/// The width to emulate; `Some(None)` for `hardware`.
fn subgroup(value: &str) -> Option<Option<u32>> {
    match value {
        "hardware" => Some(None),
        _ => value.parse().ok().filter(|width| [8, 16, 32, 64].contains(width)).map(Some),
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

#[cfg(test)]
mod tests {
    use super::*;

    fn with(name: &str, value: &str) -> Result<OpenOptions> {
        OpenOptions::from_variables(|asked| (asked == name).then(|| value.to_owned()))
    }

    #[test]
    fn variables_are_written_as_options_are() {
        for (value, bytes) in [("6GiB", 6 << 30), ("800M", 800 << 20), ("123", 123)] {
            assert_eq!(with("PSRGS_MAX_DEVICE_MEMORY", value).unwrap().max_device_memory, Some(bytes), "{value}");
            assert_eq!(with("PSRGS_STORAGE_RANGE", value).unwrap().storage_range, Some(bytes), "{value}");
        }
        assert_eq!(with("PSRGS_SHARED_BYTES", "16K").unwrap().max_shared_bytes, Some(16 << 10));
        assert_eq!(with("PSRGS_STORAGE_BUFFERS", "8").unwrap().max_storage_buffers, Some(8));
        assert_eq!(with("PSRGS_SUBGROUP", "hardware").unwrap().emulate_subgroup, None);
        assert_eq!(with("PSRGS_SUBGROUP", "16").unwrap().emulate_subgroup, Some(16));
        assert_eq!(with("PSRGS_FLOAT_ATOMICS", "cas").unwrap().float_atomics, Some(FloatAtomics::CompareAndSwap));
        assert_eq!(with("PSRGS_TEXELS", "never").unwrap().texels, Some(false));
        assert_eq!(with("PSRGS_ADDRESSES", "").unwrap().addresses, None);
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        for (name, value) in [
            ("PSRGS_MAX_DEVICE_MEMORY", "6GX"),
            ("PSRGS_MAX_DEVICE_MEMORY", "-1"),
            ("PSRGS_STORAGE_RANGE", "much"),
            ("PSRGS_SHARED_BYTES", "6GiB"),
            ("PSRGS_STORAGE_BUFFERS", "8.5"),
            ("PSRGS_SUBGROUP", "7"),
            ("PSRGS_FLOAT_ATOMICS", "yes"),
            ("PSRGS_ADDRESSES", "1"),
            ("PSRGS_TEXELS", "1"),
        ] {
            let error = with(name, value).unwrap_err().to_string();
            assert!(error.starts_with(&format!("{name}={value}: expected ")), "{error}");
        }
    }
}
