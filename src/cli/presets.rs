//! Which preset holds, and what is said of it.

use psrgs_vk::train::Settings;
use psrgs_vk::train::settings::Preset;
use psrgs_vk::vk::{DeviceKind, device_kind};

use super::device;

/// Applies the preset that is asked for, else the device's; `named` tells which options were given by name. Gives what
/// to say of one that nobody asked for, where it changes anything.
pub(crate) fn apply(settings: &mut Settings, named: impl Fn(&str) -> bool) -> anyhow::Result<Option<String>> {
    if let Some(preset) = settings.run.preset {
        preset.apply(settings, false, named);
        return Ok(None);
    }
    let wanted = device::options(&settings.device, false)?.device;
    // Without a device nothing is trained: what is wrong with it is told when it is opened.
    let kind = device_kind(wanted.as_deref()).unwrap_or(DeviceKind::Other);
    let before = settings.clone();
    let preset = Preset::for_device(kind);
    preset.apply(settings, true, named);
    let changed = settings.run.iterations != before.run.iterations
        || settings.photographs.max_side != before.photographs.max_side;
    Ok(changed.then(|| {
        let schedule = if settings.run.scale_schedule { ", the schedule scaled to them" } else { "" };
        format!(
            "preset {preset}, because this is a {kind} device: {} px, {} steps{schedule}; --preset standard or full \
             asks for more",
            settings.photographs.max_side, settings.run.iterations
        )
    }))
}
