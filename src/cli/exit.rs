//! Exit codes, and the message that goes with one. The README lists them.

use psrgs_vk::train::settings::SettingsError;
use psrgs_vk::world::WorldError;
use psrgs_vk::{dataset, format, train, vk};

/// Anything without a code of its own.
const FAILURE: u8 = 1;
/// Options or settings that make no sense.
const USAGE: u8 = 2;
/// A dataset, model or checkpoint that cannot be used.
const INPUT: u8 = 3;
/// No Vulkan device, or none that can do the work.
const DEVICE: u8 = 4;
/// Out of device memory.
const MEMORY: u8 = 5;
/// The device was lost.
const LOST: u8 = 6;
/// A check that was asked for failed.
const CHECK: u8 = 7;
/// An output could not be written.
const OUTPUT: u8 = 8;
/// Stopped by Ctrl-C or SIGTERM.
const INTERRUPTED: u8 = 130;

/// Failures that the commands themselves tell apart.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// The options make no sense together.
    #[error("{0}")]
    Usage(String),
    /// Something that was given to read cannot be used.
    #[error("{0}")]
    Input(String),
    /// A check failed: validation messages, results that are not live.
    #[error("{0}")]
    Check(String),
    /// A file or folder cannot be written.
    #[error("cannot write {0}")]
    Output(String),
    /// Stopped by the user.
    #[error("{0}")]
    Interrupted(String),
}

/// The exit code for an error: what the command said of it, else that of the first cause which has one, from the outside in.
pub(crate) fn code(error: &anyhow::Error) -> u8 {
    // Asked of the error itself: as a context, a `Failure` is not among the causes.
    match error.downcast_ref::<Failure>() {
        Some(Failure::Usage(_)) => USAGE,
        Some(Failure::Input(_)) => INPUT,
        Some(Failure::Check(_)) => CHECK,
        Some(Failure::Output(_)) => OUTPUT,
        Some(Failure::Interrupted(_)) => INTERRUPTED,
        None => error.chain().find_map(code_of).unwrap_or(FAILURE),
    }
}

fn code_of(cause: &(dyn std::error::Error + 'static)) -> Option<u8> {
    if let Some(settings) = cause.downcast_ref::<SettingsError>() {
        return Some(match settings {
            SettingsError::Io { .. } | SettingsError::Parse { .. } | SettingsError::Value { .. } => USAGE,
            SettingsError::Write(_) => FAILURE,
        });
    }
    if let Some(device) = cause.downcast_ref::<vk::Error>() {
        return Some(match device {
            vk::Error::NoVulkan(_)
            | vk::Error::NoDevice { .. }
            | vk::Error::MissingFeature { .. }
            | vk::Error::MissingLayer { .. } => DEVICE,
            vk::Error::OutOfDeviceMemory { .. } => MEMORY,
            vk::Error::DeviceLost { .. } => LOST,
            _ => FAILURE,
        });
    }
    if let Some(training) = cause.downcast_ref::<train::Error>() {
        // Errors that are passed on as they are stand for themselves in the chain of causes.
        return match training {
            train::Error::Device(error) => code_of(error),
            train::Error::Dataset(error) => code_of(error),
            train::Error::File(error) => code_of(error),
            train::Error::Settings(error) => code_of(error),
            train::Error::NotDeterministic | train::Error::NoFloatAtomics => Some(USAGE),
            train::Error::Init(_) | train::Error::NoViews | train::Error::PhotographSize { .. } => Some(INPUT),
            train::Error::Checkpoint { .. } | train::Error::CheckpointText(_) => Some(INPUT),
            _ => None,
        };
    }
    if let Some(world) = cause.downcast_ref::<WorldError>() {
        return Some(match world {
            WorldError::Parameter { .. } | WorldError::EvenSupersample { .. } => USAGE,
            _ => OUTPUT,
        });
    }
    if let Some(data) = cause.downcast_ref::<dataset::Error>() {
        return Some(if matches!(data, dataset::Error::ZeroMaxSide) { USAGE } else { INPUT });
    }
    if let Some(file) = cause.downcast_ref::<format::Error>() {
        return Some(match file {
            format::Error::Io { action, .. } if !["read", "open", "list"].contains(action) => OUTPUT,
            format::Error::Unwritable { .. } => OUTPUT,
            _ => INPUT,
        });
    }
    None
}

/// What to do about an error, where its code says enough to know.
pub(crate) fn remedy(code: u8) -> Option<&'static str> {
    match code {
        DEVICE => Some(
            "`psrgs-vk info` lists the devices. Without a GPU, Mesa's software device will do; on Debian: \
             apt-get install mesa-vulkan-drivers (and vulkan-validationlayers for --validate)",
        ),
        MEMORY => Some("a smaller --max-side or a --max-splats needs less; checkpoints already saved are kept"),
        LOST => Some("`train --resume DIR` goes on from the last checkpoint; PSRGS_BREADCRUMBS=1 finds the pass"),
        _ => None,
    }
}

/// The error and its causes on one line, without a cause that the text before it already says.
pub(crate) fn message(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain() {
        let cause = cause.to_string();
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
}
