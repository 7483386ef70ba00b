//! Exit codes and error messages. docs/GUIDE.md lists the codes.

use std::error::Error;
use std::fmt;

use psrgs_vk::eval::{GeometryError, MetricsError, ReportError};
use psrgs_vk::saliency;
use psrgs_vk::train::settings::SettingsError;
use psrgs_vk::world::WorldError;
use psrgs_vk::{bench, blocks, dataset, format, map, perceptual, stereo, train, vk};

use super::driver_hint;

/// Every failure without a code of its own.
const FAILURE: u8 = 1;
/// Options or settings that make no sense.
const USAGE: u8 = 2;
/// A dataset, model or checkpoint that cannot be used.
const INPUT: u8 = 3;
/// No Vulkan device, or none that can do the work.
const DEVICE: u8 = 4;
/// The device's memory, or the budget of host memory, is too small.
const MEMORY: u8 = 5;
/// The device was lost.
const LOST: u8 = 6;
/// A check that was asked for failed.
const CHECK: u8 = 7;
/// An output could not be written.
const OUTPUT: u8 = 8;
/// Stopped by Ctrl-C, SIGTERM or the end of the terminal.
pub(super) const INTERRUPTED: u8 = 130;

/// Failures that the commands tell apart.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// Options that contradict each other.
    #[error("{0}")]
    Usage(String),
    /// An input that cannot be used.
    #[error("{0}")]
    Input(String),
    /// A failed check: validation messages, or a benchmark without real work.
    #[error("{0}")]
    Check(String),
    /// A file or folder cannot be written.
    #[error("cannot write {0}")]
    Output(String),
    /// Stopped by the user.
    #[error("{0}")]
    Interrupted(String),
    /// A child process that ended with a code of its own.
    #[error("{1}")]
    Ended(u8, String),
}

/// A remedy that the command knows beyond the failure's code: the outermost context of an error.
#[derive(Debug)]
pub(crate) struct Remedy(pub(crate) String);

impl fmt::Display for Remedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// The exit code of an error: that of the command's `Failure`, else that of the outermost cause that has one.
pub(crate) fn code(error: &anyhow::Error) -> u8 {
    // A `Failure` added as context is not among the causes, so it is looked up in the error itself.
    match error.downcast_ref::<Failure>() {
        Some(Failure::Usage(_)) => USAGE,
        Some(Failure::Input(_)) => INPUT,
        Some(Failure::Check(_)) => CHECK,
        Some(Failure::Output(_)) => OUTPUT,
        Some(Failure::Interrupted(_)) => INTERRUPTED,
        Some(Failure::Ended(code, _)) => *code,
        None => error.chain().find_map(code_of).unwrap_or(FAILURE),
    }
}

/// Whether the device's memory, or the budget of host memory, was too small.
pub(crate) fn is_of_memory(error: &anyhow::Error) -> bool {
    code(error) == MEMORY
}

/// The code of one error of a chain. `transparent` errors hide the error that they pass on from the chain, so they are
/// opened here.
fn code_of(cause: &(dyn Error + 'static)) -> Option<u8> {
    if let Some(training) = cause.downcast_ref::<train::Error>() {
        return Some(of_training(training));
    }
    if let Some(settings) = cause.downcast_ref::<SettingsError>() {
        return Some(of_settings(settings));
    }
    if let Some(device) = cause.downcast_ref::<vk::Error>() {
        return Some(of_device(device));
    }
    if let Some(world) = cause.downcast_ref::<WorldError>() {
        return Some(match world {
            WorldError::Parameter { .. }
            | WorldError::EvenSupersample { .. }
            | WorldError::Lens
            | WorldError::Taken { .. } => USAGE,
            _ => OUTPUT,
        });
    }
    if let Some(data) = cause.downcast_ref::<dataset::Error>() {
        return Some(of_dataset(data));
    }
    if let Some(file) = cause.downcast_ref::<format::Error>() {
        return Some(of_file(file));
    }
    if let Some(bench) = cause.downcast_ref::<bench::Error>() {
        return Some(match bench {
            bench::Error::Device(device) => of_device(device),
            bench::Error::Train(training) => of_training(training),
            bench::Error::NotLive(_) => CHECK,
            bench::Error::NoTimestamps { .. } => DEVICE,
            bench::Error::NoSteps => USAGE,
            _ => FAILURE,
        });
    }
    if let Some(planning) = cause.downcast_ref::<blocks::Error>() {
        return Some(match planning {
            blocks::Error::File(file) => of_file(file),
            blocks::Error::Train(training) => of_training(training),
            blocks::Error::TooSmall { .. } => MEMORY,
            _ => INPUT,
        });
    }
    if let Some(saliency) = cause.downcast_ref::<saliency::Error>() {
        return Some(if matches!(saliency, saliency::Error::Setting { .. }) { USAGE } else { INPUT });
    }
    if let Some(stereo) = cause.downcast_ref::<stereo::Error>() {
        return Some(match stereo {
            stereo::Error::Device(device) => of_device(device),
            stereo::Error::Dataset(data) => of_dataset(data),
            stereo::Error::Setting { .. } => USAGE,
            _ => FAILURE,
        });
    }
    if let Some(map) = cause.downcast_ref::<map::Error>() {
        return Some(match map {
            map::Error::Device(device) => of_device(device),
            map::Error::File(file) => of_file(file),
            map::Error::Gsd(_) | map::Error::Bounds(_) | map::Error::Cells { .. } => USAGE,
            map::Error::NoSplats | map::Error::NoCameras | map::Error::Nowhere => INPUT,
        });
    }
    if cause.is::<GeometryError>() {
        return Some(INPUT);
    }
    if let Some(metrics) = cause.downcast_ref::<MetricsError>() {
        return Some(if let MetricsError::Write(file) = metrics { of_file(file) } else { INPUT });
    }
    if let Some(weights) = cause.downcast_ref::<perceptual::Error>() {
        return Some(match weights {
            perceptual::Error::Device(device) => of_device(device),
            perceptual::Error::File(file) => of_file(file),
            _ => INPUT,
        });
    }
    // Only the commands write reports.
    cause.is::<ReportError>().then_some(OUTPUT)
}

fn of_training(error: &train::Error) -> u8 {
    match error {
        train::Error::Device(device) => of_device(device),
        train::Error::Dataset(data) => of_dataset(data),
        train::Error::File(file) => of_file(file),
        train::Error::Settings(settings) => of_settings(settings),
        train::Error::NotDeterministic | train::Error::NoFloatAtomics | train::Error::SharedMemory { .. } => USAGE,
        train::Error::Init(_)
        | train::Error::NoViews
        | train::Error::CloudElsewhere { .. }
        | train::Error::NoCloud
        | train::Error::AllMasked { .. }
        | train::Error::PhotographSize { .. }
        | train::Error::OtherPhotographs { .. }
        | train::Error::Checkpoint { .. }
        | train::Error::CheckpointText(_) => INPUT,
        train::Error::TooMany { .. } | train::Error::MemoryLimit { .. } | train::Error::HostMemoryLimit { .. } => {
            MEMORY
        }
        _ => FAILURE,
    }
}

fn of_settings(error: &SettingsError) -> u8 {
    match error {
        SettingsError::Io { .. }
        | SettingsError::Parse { .. }
        | SettingsError::Value { .. }
        | SettingsError::UnknownKey { .. }
        | SettingsError::BadValue { .. } => USAGE,
        SettingsError::Write(_) => FAILURE,
    }
}

fn of_device(error: &vk::Error) -> u8 {
    match error {
        vk::Error::NoVulkan(_)
        | vk::Error::Unopened { .. }
        | vk::Error::NoDevice { .. }
        | vk::Error::MissingFeature { .. }
        | vk::Error::MissingLayer { .. } => DEVICE,
        vk::Error::OutOfDeviceMemory { .. } | vk::Error::BindingTooLarge { .. } | vk::Error::BufferTooLarge { .. } => {
            MEMORY
        }
        vk::Error::Vulkan { result: vk::ash::vk::Result::ERROR_OUT_OF_DEVICE_MEMORY, .. } => MEMORY,
        vk::Error::DeviceLost { .. } => LOST,
        vk::Error::Variable { .. } => USAGE,
        vk::Error::File { .. } => OUTPUT,
        _ => FAILURE,
    }
}

fn of_dataset(error: &dataset::Error) -> u8 {
    match error {
        dataset::Error::ZeroMaxSide | dataset::Error::BadSize => USAGE,
        // A picture over the user's limit is out of memory. A picture too large for any machine is bad input.
        dataset::Error::PictureTooLarge { limit, .. } if limit.asked => MEMORY,
        dataset::Error::NoMemoryForPicture { .. } => MEMORY,
        _ => INPUT,
    }
}

fn of_file(error: &format::Error) -> u8 {
    match error {
        format::Error::Io { action, .. } if !["read", "open", "list"].contains(action) => OUTPUT,
        format::Error::Unwritable { .. } => OUTPUT,
        _ => INPUT,
    }
}

/// Remedies for an error: those of its code and that of the command, a line each.
pub(crate) fn remedies(error: &anyhow::Error) -> Vec<String> {
    let usual = match code(error) {
        MEMORY => Some("a smaller --max-side or a --max-splats needs less; checkpoints already saved are kept"),
        LOST => Some("a driver or its GPU has failed; with PSRGS_BREADCRUMBS=1 the message names the pass"),
        OUTPUT => Some("make room there, or choose another place; what stood there before is as it was"),
        _ => None,
    };
    let device = driver_hint::remedies(error);
    let known = error.downcast_ref::<Remedy>().map(|remedy| remedy.0.clone());
    let host = error.chain().any(is_of_host_memory).then(|| "--host-memory says what may be used".to_owned());
    usual.map(str::to_owned).into_iter().chain(device).chain(host).chain(known).collect()
}

/// Whether the budget of host memory was too small.
fn is_of_host_memory(cause: &(dyn Error + 'static)) -> bool {
    let picture = |error: &dataset::Error| matches!(error, dataset::Error::PictureTooLarge { .. });
    match (cause.downcast_ref::<train::Error>(), cause.downcast_ref::<dataset::Error>()) {
        (Some(train::Error::Dataset(error)), _) | (None, Some(error)) => picture(error),
        (Some(error), _) => matches!(error, train::Error::HostMemoryLimit { .. }),
        (None, None) => false,
    }
}

/// The error and its causes on one line, without causes that an outer text repeats, and without the remedy.
pub(crate) fn message(error: &anyhow::Error) -> String {
    let remedy = error.downcast_ref::<Remedy>().map(|remedy| remedy.0.as_str());
    let mut text = String::new();
    for cause in error.chain() {
        let cause = cause.to_string();
        if Some(cause.as_str()) == remedy {
            continue;
        }
        if text.is_empty() {
            text = cause;
        } else if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context as _;

    #[test]
    fn the_code_is_found_below_its_context() {
        let error = Err::<(), _>(Failure::Check("no pairs".into())).context("bench").unwrap_err();
        assert_eq!((code(&error), message(&error).as_str()), (CHECK, "bench: no pairs"));
        let error = Err::<(), _>(std::io::Error::other("gone")).context(Failure::Input("a.ply".into())).unwrap_err();
        assert_eq!((code(&error), message(&error).as_str()), (INPUT, "a.ply: gone"));
        let lost = vk::Error::DeviceLost { during: "vkQueueSubmit2", pass: "adam".into() };
        let error = Err::<(), _>(train::Error::from(lost)).context("training").unwrap_err();
        assert_eq!(code(&error), LOST);
        assert_eq!(code(&anyhow::anyhow!("else")), FAILURE);
    }

    #[test]
    fn a_cause_is_not_said_twice() {
        let io = std::io::Error::other("disk full");
        let error = anyhow::Error::new(io).context("a.ply: disk full").context("saving");
        assert_eq!(message(&error), "saving: a.ply: disk full");
    }

    #[test]
    fn a_remedy_changes_neither_code_nor_message() {
        let error = Err::<(), _>(Failure::Output("a.ply".into())).context(Remedy("go on so".into())).unwrap_err();
        assert_eq!((code(&error), message(&error).as_str()), (OUTPUT, "cannot write a.ply"));
        let told = remedies(&error);
        assert!(told.len() == 2 && told[0].contains("make room") && told[1] == "go on so", "{told:?}");
        assert!(remedies(&anyhow::anyhow!("else")).is_empty());
    }

    /// The codes of the error itself, of the error below a context, and of the error passed on by training.
    fn codes<E>(make: impl Fn() -> E) -> [u8; 3]
    where
        E: Error + Send + Sync + 'static,
        train::Error: From<E>,
    {
        [
            code(&make().into()),
            code(&anyhow::Error::new(make()).context("train")),
            code(&train::Error::from(make()).into()),
        ]
    }

    #[test]
    fn every_way_to_fail_has_its_documented_code() {
        let device = || "D".to_owned();
        let lost = || vk::Error::DeviceLost { during: "vkQueueSubmit2", pass: "adam".into() };
        let full = || vk::Error::OutOfDeviceMemory { requested: 9, name: device(), in_use: 1, limit: 2 };
        let refused =
            || vk::Error::Vulkan { call: "vkCreateBuffer", result: vk::ash::vk::Result::ERROR_OUT_OF_DEVICE_MEMORY };
        let wide = || vk::Error::BindingTooLarge { buffer: device(), bytes: 9, limit: 2 };
        assert_eq!(codes(|| vk::Error::NoVulkan(device())), [DEVICE; 3]);
        let unopened =
            || vk::Error::Unopened { device: device(), result: vk::ash::vk::Result::ERROR_INITIALIZATION_FAILED };
        assert_eq!(codes(unopened), [DEVICE; 3]);
        assert_eq!(codes(|| vk::Error::NoDevice { wanted: device(), found: vec![] }), [DEVICE; 3]);
        assert_eq!(codes(|| vk::Error::MissingLayer { layer: "l" }), [DEVICE; 3]);
        assert_eq!(
            codes(|| vk::Error::MissingFeature { feature: "f", needed_for: device(), device: device() }),
            [DEVICE; 3]
        );
        assert_eq!(codes(full), [MEMORY; 3]);
        assert_eq!(codes(refused), [MEMORY; 3]);
        assert_eq!(codes(wide), [MEMORY; 3]);
        let vast = || vk::Error::BufferTooLarge { buffer: device(), bytes: 9, limit: 2 };
        assert_eq!(codes(vast), [MEMORY; 3]);
        assert_eq!(codes(lost), [LOST; 3]);
        assert_eq!(codes(|| vk::Error::Hazard(device())), [FAILURE; 3]);
        assert_eq!(codes(|| vk::Error::Variable { name: "N", value: device(), want: "w" }), [USAGE; 3]);

        let file = std::path::PathBuf::from("f");
        let io = || std::io::Error::other("no");
        assert_eq!(codes(|| format::Error::Io { file: file.clone(), action: "read", source: io() }), [INPUT; 3]);
        assert_eq!(codes(|| format::Error::Io { file: file.clone(), action: "rename", source: io() }), [OUTPUT; 3]);
        let unwritable = || format::Error::Unwritable { file: file.clone(), what: "the PNG", problem: device() };
        assert_eq!(codes(unwritable), [OUTPUT; 3]);
        let section = || format::Error::NoSection { file: file.clone(), section: device() };
        assert_eq!(codes(section), [INPUT; 3]);
        assert_eq!(codes(|| dataset::Error::ZeroMaxSide), [USAGE; 3]);
        assert_eq!(codes(|| dataset::Error::NoImages { file: file.clone() }), [INPUT; 3]);
        let large = |asked| {
            let limit = dataset::DecodeLimit { most: 1, asked };
            dataset::Error::PictureTooLarge { file: file.clone(), size: (9, 9), needed: 2, limit }
        };
        assert_eq!((codes(|| large(true)), codes(|| large(false))), ([MEMORY; 3], [INPUT; 3]));
        assert!(
            remedies(&train::Error::from(large(true)).into()).iter().any(|remedy| remedy.contains("--host-memory"))
        );
        let no_room = || train::Error::HostMemoryLimit { needed: 2, most: 1, in_use: 1, asked: true };
        assert_eq!((code(&no_room().into()), remedies(&no_room().into()).len()), (MEMORY, 2));
        assert_eq!(codes(|| dataset::Error::from(section())), [INPUT; 3]);
        assert_eq!(codes(|| psrgs_vk::scene::init::InitError::NoPoints)[2], INPUT);
        assert_eq!(codes(|| SettingsError::Value { key: "iterations".into(), want: "1" }), [USAGE; 3]);

        let training = |error: train::Error| code(&error.into());
        assert_eq!(training(train::Error::NoViews), INPUT);
        let size = train::Error::PhotographSize { name: device(), found: 1, expected: 2 };
        assert_eq!(training(size), INPUT);
        assert_eq!(training(train::Error::Checkpoint { section: device(), found: 1, expected: 2 }), INPUT);
        assert_eq!(training(train::Error::NotDeterministic), USAGE);
        assert_eq!(training(train::Error::NoFloatAtomics), USAGE);
        let many = train::Error::TooMany { what: "splats", wanted: 9, limit: 2, remedy: "--max-splats" };
        assert_eq!(training(many), MEMORY);
        let (what, wanted, needed) = ("pairs", 9, 5);
        let no_room = train::Error::MemoryLimit { what, wanted, needed, room: 4, in_use: 3, limit: 5, saved: None };
        assert_eq!(training(no_room), MEMORY);
        assert_eq!(training(train::Error::LossNotFinite { step: 7 }), FAILURE);
        let setting = saliency::Error::Setting { name: "sigma", want: "less", value: 9.0 };
        assert_eq!(code(&setting.into()), USAGE);
        assert_eq!(code(&saliency::Error::Empty { width: 0, height: 1 }.into()), INPUT);
        assert_eq!(code(&bench::Error::NotLive(device()).into()), CHECK);
        assert_eq!(code(&bench::Error::NoTimestamps { device: device() }.into()), DEVICE);
        assert_eq!(code(&bench::Error::NoSteps.into()), USAGE);
        assert_eq!(code(&bench::Error::from(lost()).into()), LOST);
        assert_eq!(code(&bench::Error::from(train::Error::from(full())).into()), MEMORY);
        let full = || format::Error::Io { file: file.clone(), action: "write", source: io() };
        assert_eq!(code(&ReportError::Write(full()).into()), OUTPUT);
        assert_eq!(code(&MetricsError::Write(full()).into()), OUTPUT);
        assert_eq!(code(&MetricsError::File { path: file.clone(), source: io() }.into()), INPUT);
    }
}
