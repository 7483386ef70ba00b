//! Helpers that the integration tests share.
#![allow(dead_code, unreachable_pub)]

pub mod browser;
pub mod guards;
pub mod plane_scene;
pub mod skips;
pub mod splats;
pub mod swiftshader;

use std::path::PathBuf;

use psrgs_vk::scene::random::Random;
use psrgs_vk::vk::{Error, Gpu, OpenOptions};

pub use skips::{left_out, skipped};

/// A picture of noise.
pub fn noise(seed: u64, width: u32, height: u32) -> image::RgbImage {
    let mut random = Random::new(seed);
    image::RgbImage::from_fn(width, height, |_, _| image::Rgb([(); 3].map(|()| random.bits() as u8)))
}

/// The default device, with `PSRGS_*` variables honoured (`PSRGS_VALIDATION=1` turns the layers on). `None`, with a
/// printed reason, only where there is no Vulkan driver at all.
pub fn gpu() -> Option<Gpu> {
    gpu_with(|_| ())
}

/// As [`gpu`], with the options changed.
pub fn gpu_with(change: impl FnOnce(&mut OpenOptions)) -> Option<Gpu> {
    let mut options = OpenOptions::from_env().expect("the environment");
    change(&mut options);
    match Gpu::open(&options) {
        Ok(gpu) => Some(gpu),
        Err(Error::NoVulkan(why)) => {
            skipped(format_args!("no Vulkan driver: {why}"));
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Fails on any message of the validation layer so far.
pub fn assert_no_messages(gpu: &Gpu) {
    let messages = gpu.validation_messages();
    assert!(messages.is_empty(), "{} validation messages, first: {}", messages.len(), messages[0]);
}

/// The first version of the validation layer whose GPU-assisted mode is known to handle all shaders of the engine.
const ABLE_TO_ASSIST: [u32; 3] = [1, 4, 363];

/// Whether the GPU-assisted mode of the installed layer handles all shaders; prints a reason where not.
pub fn layer_assists() -> bool {
    let found = psrgs_vk::vk::validation_layer().ok().flatten();
    let able = found.is_some_and(|version| version >= ABLE_TO_ASSIST);
    if !able {
        left_out(format_args!(
            "GPU-assisted validation of all shaders needs layer {ABLE_TO_ASSIST:?} or later, not {found:?}"
        ));
    }
    able
}

/// A folder or file of the shared test data: under `$PSRGS_DATA`, else `../shared/data`. `None`, with a printed reason,
/// where it is not there.
pub fn data(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("PSRGS_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let path = root.join(name);
    if path.exists() {
        return Some(path);
    }
    skipped(format_args!("{} is not there", path.display()));
    None
}

/// A file of the shared weights: under `$PSRGS_WEIGHTS`, else `../shared/weights`. `None`, with a printed reason, where
/// it is not there.
pub fn weights(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("PSRGS_WEIGHTS")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/weights"), PathBuf::from);
    let path = root.join(name);
    if path.exists() {
        return Some(path);
    }
    skipped(format_args!("{} is not there", path.display()));
    None
}
