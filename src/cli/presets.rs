//! Chooses the preset, and the values of the method.

use psrgs_vk::train::Settings;
use psrgs_vk::train::settings::Preset;
use psrgs_vk::vk::{DeviceKind, device_kind};

use super::device;

/// Applies the preset that the user names, else that of the device, and the method. `named` says which options were
/// given by name. Returns the message for a preset that the user did not name, where it changes anything.
pub(crate) fn apply(settings: &mut Settings, named: impl Fn(&str) -> bool) -> anyhow::Result<Option<String>> {
    if let Some(preset) = settings.run.preset {
        preset.apply(settings, false, &named);
        settings.run.method.apply(settings, named);
        return Ok(None);
    }
    let kind = kind(settings)?;
    let before = settings.clone();
    let preset = Preset::for_device(kind);
    preset.apply(settings, true, &named);
    settings.run.method.apply(settings, &named);
    // Steps by need are told when the photographs are known.
    let by_need = settings.run.looks.is_some() && !named("iterations");
    let changed = !by_need && settings.run.iterations != before.run.iterations
        || settings.photographs.max_side != before.photographs.max_side;
    Ok(changed.then(|| {
        let schedule = if settings.run.scale_schedule { ", the schedule scaled to them" } else { "" };
        let steps = if by_need { String::new() } else { format!(", {} steps{schedule}", settings.run.iterations) };
        format!(
            "preset {preset}, because this is a {kind} device: {} px{steps}; --preset standard or full asks for more",
            settings.photographs.max_side
        )
    }))
}

/// The kind of the device in use. Without a device nothing is trained. Its error is reported when it is opened.
pub(crate) fn kind(settings: &Settings) -> anyhow::Result<DeviceKind> {
    let wanted = device::options(&settings.device, false)?.device;
    Ok(device_kind(wanted.as_deref()).unwrap_or(DeviceKind::Other))
}
