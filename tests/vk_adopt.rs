//! The engine on a host's device: it works there, creates no device or instance, waits for nothing idle, and leaves nothing.

// Nothing of a test binary is reachable from outside.
#![allow(unreachable_pub)]

mod common;
#[path = "../examples/embed.rs"]
mod embed;

use std::ffi::{CStr, c_char};
use std::process::Command;
use std::sync::OnceLock;

use psrgs_vk::format::image_out;
use psrgs_vk::pass::fill;
use psrgs_vk::raster::{Picture, Viewer};
use psrgs_vk::vk::ash::vk;
use psrgs_vk::vk::{Addresses, Error, Features, Gpu, Groups, Memory, OpenOptions};

fn host() -> Option<embed::Host> {
    let host = embed::Host::new().unwrap();
    if host.is_none() {
        println!("skipped: no Vulkan driver");
    }
    host
}

/// Three balls where they should be, and nothing elsewhere.
fn check(picture: &Picture) {
    let shot = embed::shot();
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
    assert_eq!([pixel(0, 0), pixel(95, 63), pixel(48, 10)], [[0; 3]; 3]);
    let depth = picture.depth().expect("depth was asked for");
    assert!((depth[(32 * 96 + 18) as usize] - 4.0).abs() < 1e-3, "the red ball is 4 units away");
}

#[test]
fn a_picture_is_rendered_inside_the_hosts_lock() {
    let Some(host) = host() else { return };
    let (lock, uses) = embed::queue_lock();
    let frame = embed::run(&host, host.describe(Some(lock))).unwrap();
    check(&frame.picture);
    assert_eq!(*uses.lock().unwrap(), frame.submits, "a submit for which the host's lock was not taken");

    // What comes out as a file is what was rendered.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("picture.png");
    let rgb = frame.picture.rgb8();
    image_out::write_png(&file, frame.picture.width, frame.picture.height, &rgb).unwrap();
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
    let own = viewer.render(&planes, model.len() as u32, &embed::shot(), true).unwrap();
    for (a, b) in adopted.rgbt.iter().zip(&own.rgbt) {
        assert!((a - b).abs() <= 1e-5, "{a} and {b}");
    }
}

#[test]
fn an_old_or_poor_host_is_refused_by_name() {
    let Some(host) = host() else { return };
    let mut old = host.describe(None);
    old.api_version = vk::API_VERSION_1_2;
    let mut poor = host.describe(None);
    poor.features = Features { synchronization2: true, ..Features::default() };
    for (description, missing) in [(old, "Vulkan 1.3"), (poor, "timelineSemaphore")] {
        // SAFETY: the handles are those of a live host.
        let error = unsafe { Gpu::adopt(description, &OpenOptions::default()) }.err().unwrap();
        assert!(matches!(&error, Error::MissingFeature { feature, .. } if *feature == missing), "{error}");
        assert!(error.to_string().contains("needed for"));
    }
}

#[test]
fn features_that_the_host_does_not_state_are_not_used() {
    let Some(host) = host() else { return };
    // SAFETY: the handles are those of a live host that outlives `gpu`.
    let gpu = unsafe { Gpu::adopt(host.describe(None), &OpenOptions::default()) }.unwrap();
    let caps = gpu.caps();
    assert_eq!(caps.buffer_floats, psrgs_vk::vk::FloatAtomics::CompareAndSwap);
    assert!(!caps.features.int64 && !caps.features.storage_16bit);
}

#[test]
fn buffers_go_by_address_only_where_the_host_enabled_it() {
    let Some(host) = host() else { return };
    let options = OpenOptions { addresses: Some(true), ..OpenOptions::default() };
    for (stated, picked) in [(true, Addresses::Always), (false, Addresses::Never)] {
        let mut description = host.describe(None);
        description.features.buffer_device_address = stated;
        // SAFETY: the handles are those of a live host that outlives `gpu`.
        let gpu = unsafe { Gpu::adopt(description, &options) }.unwrap();
        assert_eq!(gpu.caps().addresses, picked);
        let target = gpu.buffer("target", 4 * 1000, Memory::Device).unwrap();
        let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
        let mut rec = gpu.recorder("fill").unwrap();
        rec.dispatch(&pipeline, &[&target], &fill::Push { count: 1000, value: 6 }, Groups::Items(1000)).unwrap();
        rec.submit().unwrap();
        assert_eq!(gpu.read::<u32>(&target).unwrap(), [6; 1000]);
        assert_eq!(gpu.stats().by_address, u64::from(stated));
    }
}

#[test]
fn engines_side_by_side_do_not_meet() {
    let Some(host) = host() else { return };
    // SAFETY: the handles are those of a live host that outlives the engine.
    let adopted = unsafe { Gpu::adopt(host.describe(None), &OpenOptions::default()) }.unwrap();
    let gpus = [common::gpu().unwrap(), common::gpu().unwrap(), adopted];
    let fills = |gpu: &Gpu, value: u32| {
        let target = gpu.buffer("target", 4 * 4096, Memory::Device).unwrap();
        let pipeline = gpu.pipeline(&fill::PASS.kernel, &[]).unwrap();
        for round in 0..20 {
            let mut rec = gpu.recorder("side by side").unwrap();
            let push = fill::Push { count: 4096, value: value + round };
            rec.dispatch(&pipeline, &[&target], &push, Groups::Items(4096)).unwrap();
            rec.submit().unwrap();
        }
        assert_eq!(gpu.read::<u32>(&target).unwrap(), vec![value + 19; 4096]);
        assert_eq!(gpu.stats().dispatches, 20);
    };
    std::thread::scope(|scope| {
        for (gpu, value) in gpus.iter().zip([1000, 2000, 3000]) {
            scope.spawn(move || fills(gpu, value));
        }
    });
    // A ticket of one is not taken by another.
    let ticket = gpus[0].last_ticket();
    let fresh = common::gpu().unwrap();
    assert!(matches!(fresh.wait(ticket), Err(Error::ForeignTicket { .. })));
}

/// The loader's own entry point, for the hooks below.
static LOADER: OnceLock<vk::PFN_vkGetInstanceProcAddr> = OnceLock::new();
static DEVICE_LOADER: OnceLock<vk::PFN_vkGetDeviceProcAddr> = OnceLock::new();

const FORBIDDEN: [&CStr; 6] = [
    c"vkCreateInstance",
    c"vkCreateDevice",
    c"vkDestroyInstance",
    c"vkDestroyDevice",
    c"vkDeviceWaitIdle",
    c"vkQueueWaitIdle",
];

extern "system" fn trap() {
    eprintln!("the engine called a command that belongs to the host");
    std::process::abort();
}

unsafe extern "system" fn hooked_instance(instance: vk::Instance, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: called by the engine with a valid name; set before the hook is handed out.
    unsafe {
        let wanted = CStr::from_ptr(name);
        if FORBIDDEN.contains(&wanted) {
            return Some(std::mem::transmute::<extern "system" fn(), unsafe extern "system" fn()>(trap));
        }
        let real = LOADER.get().and_then(|loader| loader(instance, name));
        if wanted == c"vkGetDeviceProcAddr" {
            let real = real.expect("every loader has vkGetDeviceProcAddr");
            let _ = DEVICE_LOADER
                .set(std::mem::transmute::<unsafe extern "system" fn(), vk::PFN_vkGetDeviceProcAddr>(real));
            let hook: vk::PFN_vkGetDeviceProcAddr = hooked_device;
            return Some(std::mem::transmute::<vk::PFN_vkGetDeviceProcAddr, unsafe extern "system" fn()>(hook));
        }
        real
    }
}

unsafe extern "system" fn hooked_device(device: vk::Device, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: as above.
    unsafe {
        if FORBIDDEN.contains(&CStr::from_ptr(name)) {
            return Some(std::mem::transmute::<extern "system" fn(), unsafe extern "system" fn()>(trap));
        }
        DEVICE_LOADER.get().and_then(|loader| loader(device, name))
    }
}

#[test]
fn nothing_of_the_hosts_is_created_destroyed_or_waited_idle() {
    let Some(host) = host() else { return };
    let mut description = host.describe(None);
    LOADER.get_or_init(|| description.get_instance_proc_addr);
    description.get_instance_proc_addr = hooked_instance;
    // A call of a forbidden command ends the process.
    check(&embed::run(&host, description).unwrap().picture);
}

/// Set to make the host forget a semaphore, to see that the layer would say so.
const LEAK: &str = "PSRGS_TEST_LEAK";

/// Run by the test below in a process of its own, where the layer reports to the standard output.
#[test]
#[ignore = "a part of adopted_device_is_left_clean"]
fn embedded_run() {
    let Some(host) = host() else { return };
    embed::run(&host, host.describe(None)).unwrap();
    if std::env::var_os(LEAK).is_some() {
        host.timeline().unwrap();
    }
    drop(host);
    println!("host closed");
}

#[test]
fn adopted_device_is_left_clean() {
    if host().is_none() {
        return;
    }
    // The layer checks at the end of the device that nothing made from it is left.
    let run = |leak: bool| {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command
            .args(["--exact", "embedded_run", "--ignored", "--nocapture"])
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
    let (messages, text) = run(true);
    assert!(messages, "the layer does not see a leak: {text}");
    let (messages, text) = run(false);
    assert!(!messages, "{text}");
}
