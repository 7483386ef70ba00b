//! Chooses the preset.

use psrgs_vk::train::Settings;
use psrgs_vk::train::settings::Preset;
use psrgs_vk::vk::{DeviceKind, device_kind};

use super::device;

/// Applies the preset that the user names, else that of the device. `named` says which options were given by name.
/// Returns the message for a preset that the user did not name, where it changes anything.
pub(crate) fn apply(settings: &mut Settings, named: impl Fn(&str) -> bool) -> anyhow::Result<Option<String>> {
    if let Some(preset) = settings.run.preset {
        preset.apply(settings, false, named);
        return Ok(None);
    }
    let wanted = device::options(&settings.device, false)?.device;
    // Without a device nothing is trained. Its error is reported when it is opened.
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
