//! Machines without a usable Vulkan device: every command that needs one fails with the exit code of a missing device
//! and a message with a remedy.

use std::fs;
use std::path::Path;

use psrgs_vk::format::ply;
use psrgs_vk::scene::{Frame, Gaussians};
use psrgs_vk::world::{WorldParams, generate};

use crate::common;
use crate::run::{command, stderr, text};

/// Runs a command with this Vulkan driver alone, and checks that the command fails for want of a device.
#[track_caller]
fn without_device(args: &[&str], driver: &Path) -> String {
    let mut command = command(args);
    for name in ["VK_LOADER_DRIVERS_SELECT", "VK_LOADER_DRIVERS_DISABLE", "VK_ADD_DRIVER_FILES"] {
        command.env_remove(name);
    }
    let output =
        command.envs(["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].map(|name| (name, driver))).output().expect("a process");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(4), "{args:?} with {}: {said}", driver.display());
    assert!(!said.contains("panicked"), "{said}");
    for word in ["mesa-vulkan-drivers", text(driver), "Vulkan"] {
        assert!(said.contains(word), "{args:?} does not say `{word}`: {said}");
    }
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn a_driver_that_cannot_be_read_or_loaded_is_no_device() {
    let folder = tempfile::tempdir().expect("a folder");
    let manifest = |library: &str| {
        format!(r#"{{"file_format_version": "1.0.0", "ICD": {{"library_path": "{library}", "api_version": "1.3.0"}}}}"#)
    };
    let library = folder.path().join("driver.so");
    fs::write(&library, "no library").expect("written");
    let mut drivers = vec![folder.path().join("nowhere.json")];
    for (name, content) in [
        ("empty.json", String::new()),
        ("broken.json", "{ \"ICD\": ".to_owned()),
        ("no-library.json", manifest("/nowhere/driver.so")),
        ("bad-library.json", manifest(text(&library))),
    ] {
        let file = folder.path().join(name);
        fs::write(&file, content).expect("written");
        drivers.push(file);
    }
    // Installed drivers of GPUs that are not in this machine: the loader reads them, and they find no device.
    let installed = ["radeon_icd.x86_64.json", "intel_icd.x86_64.json", "nouveau_icd.x86_64.json"];
    let gpus = Path::new("/dev/dri").exists();
    let installed = installed.map(|name| Path::new("/usr/share/vulkan/icd.d").join(name));
    drivers.extend(installed.into_iter().filter(|file| !gpus && file.exists()));
    for driver in drivers {
        without_device(&["info"], &driver);
        let json = without_device(&["info", "--json"], &driver);
        let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
        assert!(json["devices"].as_array().is_some_and(Vec::is_empty), "{json}");
    }
}

/// Chromium's packages bring a driver with a mock device, which lacks all features.
#[test]
fn a_device_that_lacks_features_is_named_with_those_features() {
    let library = Path::new("/usr/lib/chromium/libVkICD_mock_icd.so");
    if !library.exists() {
        return common::left_out("there is no driver of a device that lacks something");
    }
    let folder = tempfile::tempdir().expect("a folder");
    let driver = folder.path().join("mock.json");
    let manifest = format!(
        r#"{{"file_format_version": "1.0.1", "ICD": {{"library_path": {library:?}, "api_version": "1.3.0"}}}}"#
    );
    fs::write(&driver, manifest).expect("written");
    for args in [&["info"][..], &["demo", "--out", "nowhere"]] {
        let mut command = command(args);
        let output = command
            .envs(["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].map(|name| (name, &driver)))
            .output()
            .expect("a process");
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(4), "{said}");
        assert!(said.contains("Mock Device lacks ") && said.contains("--device"), "{said}");
    }
}

#[test]
fn every_command_that_needs_a_device_says_that_there_is_none() {
    let folder = tempfile::tempdir().expect("a folder");
    let (data, model, out) = (folder.path().join("scene"), folder.path().join("model.ply"), folder.path().join("out"));
    let params = WorldParams { images: 3, max_side: 32, pixels_per_point: 64, offpath: 1, ..WorldParams::default() };
    generate(&params, &data, &mut |_| ()).expect("a scene");
    ply::save(&model, &Gaussians::zeros(3), &Frame::IDENTITY, true).expect("written");
    let (data, model, out) = (text(&data), text(&model), text(&out));
    let nowhere = Path::new("/nowhere/driver.json");
    for args in [
        &["train", data, "--out", out, "--iterations", "1"][..],
        &["train", data, "--out", out, "--overwrite", "--init", model],
        &["render", model, "--cameras", data, "--out", out],
        &["eval", model, data],
        &["stereo", data, "--out", out],
        &["bench", data],
        // Reported at once, not after minutes of making the scene.
        &["demo", "--out", out, "--images", "60", "--max-side", "4000"],
        &["compare", data, "--out", out, "--methods", "3dgs", "--seeds", "1", "--iterations", "1"],
    ] {
        without_device(args, nowhere);
    }
}
