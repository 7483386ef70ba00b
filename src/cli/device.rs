//! Opening the device that the options name.

use std::path::{Path, PathBuf};

use psrgs_vk::train::settings::DeviceChoice;
use psrgs_vk::vk::{DeviceKind, Gpu, OpenOptions, Validation};

use super::compiling;
use super::console::Console;
use super::driver_hint;

/// Options for opening the device, from the command line and the environment. The command line wins.
pub(crate) fn options(choice: &DeviceChoice, validate: bool) -> anyhow::Result<OpenOptions> {
    let mut options = OpenOptions::from_env()?;
    if choice.device.is_some() {
        options.device.clone_from(&choice.device);
    }
    if let Some(limit) = choice.max_device_memory {
        options.max_device_memory = Some(limit.0);
    }
    if validate {
        options.validation = Validation::CoreAndSync;
    }
    Ok(options)
}

/// Fails where the device cannot be opened.
pub(crate) fn probe(choice: &DeviceChoice) -> anyhow::Result<()> {
    Gpu::open(&options(choice, false)?)?;
    Ok(())
}

/// Opens the device and prints its name.
pub(crate) fn open(choice: &DeviceChoice, validate: bool, console: &Console) -> anyhow::Result<Gpu> {
    open_with(&options(choice, validate)?, console)
}

/// Opens the device with the caller's options and prints its name.
pub(crate) fn open_with(options: &OpenOptions, console: &Console) -> anyhow::Result<Gpu> {
    let gpu = Gpu::open(options)?;
    if options.validation != Validation::Off {
        console.watch(gpu.messages());
    }
    compiling::tell(&gpu, console);
    let caps = gpu.caps();
    if caps.kind == DeviceKind::Cpu
        && options.device.is_none()
        && let Some(refused) = driver_hint::refused(Path::new("/"))
    {
        console.warn(format_args!("a processor computes where a GPU could: {refused}"));
    }
    console.say(format_args!("device: {} ({})", caps.device, caps.kind));
    for choice in &caps.choices {
        console.detail(format_args!("  {}: {} ({})", choice.what, choice.picked, choice.why));
    }
    Ok(gpu)
}

/// Folder for compiled pipelines and chosen variants, kept between runs.
pub(crate) fn cache_folder() -> Option<PathBuf> {
    OpenOptions::from_env().ok()?.pipeline_cache
}
