//! Advice where no Vulkan device can be used, from the error, the environment and the machine.

use std::error::Error;
use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use psrgs_vk::{bench, perceptual, stereo, train, vk};

/// Variables that tell the Vulkan loader which drivers to try.
const LOADER: [&str; 5] = [
    "VK_DRIVER_FILES",
    "VK_ICD_FILENAMES",
    "VK_LOADER_DRIVERS_SELECT",
    "VK_LOADER_DRIVERS_DISABLE",
    "VK_LOADER_DEVICE_SELECT",
];

/// Remedies for an error of the device layer, a line each; none for other errors.
pub(crate) fn remedies(error: &anyhow::Error) -> Vec<String> {
    match error.chain().find_map(device_error) {
        Some(vk::Error::NoDevice { .. }) => vec!["`psrgs-vk info` lists the devices".to_owned()],
        Some(vk::Error::MissingLayer { .. }) => {
            vec!["on Debian and Ubuntu: apt-get install vulkan-validationlayers".to_owned()]
        }
        Some(vk::Error::MissingFeature { .. }) => {
            vec![format!(
                "a newer driver may have it; `psrgs-vk info` lists the devices, and --device takes another. {SOFTWARE}"
            )]
        }
        Some(vk::Error::NoVulkan(_) | vk::Error::Unopened { .. }) => {
            let mut lines = chosen_drivers(|name| std::env::var(name).ok());
            lines.extend(access(Path::new("/")));
            lines.push(format!(
                "a GPU needs the Vulkan driver of its maker (for AMD and Intel: mesa-vulkan-drivers). {SOFTWARE}"
            ));
            lines
        }
        _ => Vec::new(),
    }
}

const SOFTWARE: &str =
    "Without a GPU Mesa's software device will do; on Debian and Ubuntu: apt-get install mesa-vulkan-drivers";

/// The error of the device layer in `cause`, also where another error wraps it.
fn device_error<'a>(cause: &'a (dyn Error + 'static)) -> Option<&'a vk::Error> {
    let of_training = |error: &'a train::Error| match error {
        train::Error::Device(device) => Some(device),
        _ => None,
    };
    if let Some(device) = cause.downcast_ref::<vk::Error>() {
        return Some(device);
    }
    if let Some(training) = cause.downcast_ref::<train::Error>() {
        return of_training(training);
    }
    match cause.downcast_ref::<bench::Error>() {
        Some(bench::Error::Device(device)) => return Some(device),
        Some(bench::Error::Train(training)) => return of_training(training),
        _ => {}
    }
    if let Some(stereo::Error::Device(device)) = cause.downcast_ref::<stereo::Error>() {
        return Some(device);
    }
    match cause.downcast_ref::<perceptual::Error>() {
        Some(perceptual::Error::Device(device)) => Some(device),
        _ => None,
    }
}

/// Names the variables that restrict the loader to certain drivers.
fn chosen_drivers(variable: impl Fn(&str) -> Option<String>) -> Vec<String> {
    let set = LOADER.into_iter().filter_map(|name| Some((name, variable(name).filter(|value| !value.is_empty())?)));
    set.map(|(name, value)| {
        format!("{name}={value} is set: the Vulkan loader looks nowhere else; unset it, or name a driver that is there")
    })
    .collect()
}

/// Says that this user or this container may not use the GPU. `root` is the root of the file system.
fn access(root: &Path) -> Option<String> {
    let contained = || [".dockerenv", "run/.containerenv"].iter().any(|mark| root.join(mark).exists());
    let none_given = || {
        (nodes(root).is_empty() && contained()).then(|| {
            "this is a container that was given no GPU: start it with --device /dev/dri (AMD, Intel), or with --gpus \
             all -e NVIDIA_DRIVER_CAPABILITIES=all (NVIDIA)"
                .to_owned()
        })
    };
    refused(root).or_else(none_given)
}

/// Says that this user may not use a GPU that exists. `root` is the root of the file system.
pub(crate) fn refused(root: &Path) -> Option<String> {
    let refused: Vec<PathBuf> = nodes(root).into_iter().filter(|node| is_refused(node)).collect();
    refused.first().map(|node| {
        let node = Path::new("/").join(node.strip_prefix(root).unwrap_or(node));
        format!(
            "{} may not be opened by this user: add the user to the groups that own it (`sudo usermod -aG \
             render,video $USER`, then log in again); for a container: --group-add with the number of that group",
            node.display()
        )
    })
}

/// The device files through which drivers reach GPUs.
fn nodes(root: &Path) -> Vec<PathBuf> {
    let in_folder = |folder: &str, prefix: &str| {
        let entries = fs::read_dir(root.join(folder)).into_iter().flatten().flatten();
        let named = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix));
        named.map(|entry| entry.path()).collect::<Vec<_>>()
    };
    let mut all = in_folder("dev/dri", "renderD");
    all.extend(in_folder("dev", "nvidiactl"));
    all.extend(in_folder("dev", "dxg"));
    all.sort();
    all
}

fn is_refused(node: &Path) -> bool {
    let opened = File::options().read(true).write(true).open(node);
    opened.is_err_and(|error| error.kind() == ErrorKind::PermissionDenied)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gpu_that_may_not_be_opened_is_told_with_its_groups() {
        use std::os::unix::fs::PermissionsExt as _;
        let root = tempfile::tempdir().unwrap();
        assert_eq!(access(root.path()), None, "no container, no GPU");
        fs::write(root.path().join(".dockerenv"), "").unwrap();
        assert!(access(root.path()).unwrap().contains("--device /dev/dri"));
        fs::create_dir_all(root.path().join("dev/dri")).unwrap();
        let node = root.path().join("dev/dri/renderD128");
        fs::write(&node, "").unwrap();
        assert_eq!(access(root.path()), None, "there and open");
        fs::set_permissions(&node, fs::Permissions::from_mode(0o000)).unwrap();
        // The superuser may open every file.
        if File::open(&node).is_err() {
            let told = access(root.path()).unwrap();
            assert!(told.starts_with("/dev/dri/renderD128") && told.contains("render,video"), "{told}");
        }
    }

    #[test]
    fn variables_of_the_loader_are_named() {
        let told = chosen_drivers(|name| (name == "VK_DRIVER_FILES").then(|| "/nowhere.json".to_owned()));
        assert_eq!(told.len(), 1);
        assert!(told[0].starts_with("VK_DRIVER_FILES=/nowhere.json is set"), "{told:?}");
        assert!(chosen_drivers(|_| Some(String::new())).is_empty());
    }

    #[test]
    fn the_error_of_the_device_is_found_however_it_is_handed_on() {
        let gone = || vk::Error::NoVulkan("gone".into());
        let errors: [anyhow::Error; 5] = [
            gone().into(),
            anyhow::Error::new(gone()).context("train"),
            train::Error::from(gone()).into(),
            bench::Error::from(train::Error::from(gone())).into(),
            stereo::Error::from(gone()).into(),
        ];
        for error in errors {
            let told = remedies(&error);
            assert!(told.iter().any(|line| line.contains("mesa-vulkan-drivers")), "{error}: {told:?}");
        }
        assert!(remedies(&anyhow::anyhow!("else")).is_empty());
    }
}
