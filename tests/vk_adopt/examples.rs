//! The two examples: their renders, no effect on objects of the host, and no message of the layer.

use std::process::Command;

use psrgs_vk::format::image_out;
use psrgs_vk::raster::{Picture, Viewer};
use psrgs_vk::train::Pacing;

use super::{common, embed, hooks, host, training, view_while_training};

/// Checks three balls, the host's line in the first row, and nothing elsewhere.
fn check(picture: &Picture) {
    let shot = embed::shot(embed::FRAMES - 1);
    let (camera, rgb) = (shot.camera, picture.rgb8());
    assert_eq!((picture.width, picture.height), (camera.width, camera.height));
    let pixel = |x: u32, y: u32| {
        let at = 3 * (y * camera.width + x) as usize;
        [rgb[at], rgb[at + 1], rgb[at + 2]]
    };
    for ([x, y, z], colour) in embed::SPLATS {
        let (u, v) = (camera.fx as f32 * x / z + camera.cx as f32, camera.fy as f32 * y / z + camera.cy as f32);
        for (got, want) in pixel(u as u32, v as u32).into_iter().zip(colour) {
            assert!((f32::from(got) / 255.0 - want).abs() < 0.06, "{got} instead of {want} at {u} {v}");
        }
    }
    assert_eq!([pixel(0, 0), pixel(95, 0)], [[255; 3]; 2]);
    assert_eq!([pixel(0, 1), pixel(95, 63), pixel(48, 10)], [[0; 3]; 3]);
    let depth = picture.depth().expect("depth was asked for");
    // The mean of z in the ball along the ray of the pixel, half a pixel right of the ball's centre.
    let [x, _, z] = embed::SPLATS[0].0;
    let ratio = x / z;
    let wanted = z - 0.5 * z / camera.fx as f32 * ratio / (1.0 + ratio * ratio);
    assert!((depth[(32 * 96 + 18) as usize] - wanted).abs() < 1e-3, "the red ball is {wanted} units away");
}

#[test]
fn a_picture_is_drawn_between_the_hosts_own_submits() {
    let Some(host) = host() else { return };
    let allocator = embed::host::memory::Allocator::new(&host);
    let outcome = embed::run(&host, host.describe(Some(allocator.clone()))).unwrap();
    check(&outcome.picture);
    let (engine, own) = (outcome.submits, outcome.host_submits);
    assert_eq!(host.turn.uses(), engine + own, "a submit without the host's lock");
    let (left, most) = allocator.lent();
    assert!(left == 0 && most > 10, "{left} blocks of {most} were not given back");

    // The written file has the rendered pixels.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("picture.png");
    let rgb = outcome.picture.rgb8();
    image_out::write_png(&file, outcome.picture.width, outcome.picture.height, &rgb).unwrap();
    assert_eq!(image::open(&file).unwrap().to_rgb8().into_raw(), rgb);
}

#[test]
fn a_hosts_device_gives_the_picture_of_our_own() {
    let Some(host) = host() else { return };
    let adopted = embed::run(&host, host.describe(None)).unwrap().picture;
    let gpu = common::gpu().unwrap();
    let mut viewer = Viewer::new(&gpu);
    let model = embed::model();
    let planes = viewer.upload(&model).unwrap();
    let own = viewer.render(&planes, model.len() as u32, &embed::shot(embed::FRAMES - 1), true).unwrap();
    let row = 4 * own.width as usize;
    for (a, b) in adopted.rgbt[row..].iter().zip(&own.rgbt[row..]) {
        assert!((a - b).abs() <= 1e-5, "{a} and {b}");
    }
}

#[test]
fn nothing_of_the_hosts_is_created_destroyed_or_waited_idle() {
    let Some(host) = host() else { return };
    let _turn = hooks::TURN.lock().unwrap();
    // A forbidden command, a submit to another queue or without the lock, and destroying a foreign object end the
    // process.
    let allocator = embed::host::memory::Allocator::new(&host);
    let turn = host.turn.clone();
    let description = hooks::watched(host.describe(Some(allocator.clone())), Box::new(move || turn.is_taken()));
    let outcome = embed::run(&host, description).unwrap();
    check(&outcome.picture);
    let (created, left, submits) = hooks::seen();
    assert!(created > 50, "{created} objects seen");
    assert_eq!((left, submits, allocator.lent().0), (0, outcome.submits, 0), "left over");
    drop(host);

    // As above, of the example that watches a training.
    let host = view_while_training::host::Host::new().unwrap().unwrap();
    let allocator = view_while_training::host::memory::Allocator::new(&host);
    let turn = host.turn.clone();
    let description = hooks::watched(host.describe(Some(allocator.clone())), Box::new(move || turn.is_taken()));
    training::watch(&host, description, Pacing::default());
    let (created, left, submits) = hooks::seen();
    assert!(created > 100 && submits > u64::from(training::STEPS), "{created} objects, {submits} submits seen");
    assert_eq!((left, allocator.lent().0), (0, 0), "left over");
}

/// Set to make the host leak a semaphore, which the layer must report.
const LEAK: &str = "PSRGS_TEST_LEAK";

/// Run by the test below in a process of its own, where the layer reports to the standard output.
#[test]
#[ignore = "a part of examples_leave_the_device_clean_and_the_layer_silent"]
fn embedded_run() {
    let Some(host) = host() else { return };
    let allocator = embed::host::memory::Allocator::new(&host);
    embed::run(&host, host.describe(Some(allocator))).unwrap();
    if std::env::var_os(LEAK).is_some() {
        host.timeline().unwrap().forget();
    }
    drop(host);
    println!("host closed");
}

/// As above.
#[test]
#[ignore = "a part of examples_leave_the_device_clean_and_the_layer_silent"]
fn watched_training() {
    let Some(host) = view_while_training::host::Host::new().unwrap() else {
        return common::skipped("no Vulkan driver");
    };
    // Without the host's allocator, and with buffers that have to grow.
    let pacing = Pacing { splat_capacity: 1, pair_capacity: 64, ..Pacing::default() };
    let outcome = training::watch(&host, host.describe(None), pacing);
    assert!(outcome.grown > 0);
    drop(host);
    println!("host closed");
}

#[test]
fn examples_leave_the_device_clean_and_the_layer_silent() {
    if host().is_none() {
        return;
    }
    // The layer checks at the end of the device that no object of it is left.
    let run = |name: &str, leak: bool| {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command
            .args(["--exact", &format!("examples::{name}"), "--ignored", "--nocapture"])
            .env("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation")
            .env("VK_LAYER_ENABLES", "VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT");
        if leak {
            command.env(LEAK, "1");
        }
        let output = command.output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && text.contains("host closed"), "{text}");
        let messages = ["VUID", "SYNC-HAZARD", "UNASSIGNED"].iter().any(|sign| text.contains(sign));
        (messages, text.into_owned())
    };
    let (messages, text) = run("embedded_run", true);
    assert!(messages, "the layer does not see a leak: {text}");
    for name in ["embedded_run", "watched_training"] {
        let (messages, text) = run(name, false);
        assert!(!messages, "{name}: {text}");
    }
}
