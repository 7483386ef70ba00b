//! The engine on a host's device: it works, creates no device or instance, never waits for an idle device, and leaves
//! no objects.

// Nothing of a test binary is reachable from outside; both examples have the same host.
#![allow(unreachable_pub, clippy::duplicate_mod)]

#[path = "../common/mod.rs"]
mod common;
#[path = "../../examples/embed.rs"]
mod embed;
mod examples;
mod foreign;
mod hooks;
mod lending;
mod order;
mod panics;
mod training;
#[path = "../../examples/view_while_training.rs"]
mod view_while_training;

use psrgs_vk::pass::fill;
use psrgs_vk::vk::ash::vk;
use psrgs_vk::vk::{Addresses, Error, Features, Gpu, Groups, Memory, OpenOptions, REQUIRED, required_features};

fn host() -> Option<embed::host::Host> {
    host_with(required_features())
}

/// As [`host`], with more features.
fn host_with(features: Features) -> Option<embed::host::Host> {
    let host = embed::host::Host::with(features).unwrap();
    if host.is_none() {
        common::skipped("no Vulkan driver");
    }
    host
}

/// An engine on a host's device.
fn adopt(host: &embed::host::Host) -> Gpu {
    // SAFETY: the handles are those of a live host that outlives the engine.
    unsafe { Gpu::adopt(host.describe(None), &OpenOptions::default()) }.unwrap()
}

#[test]
fn an_old_or_poor_host_is_refused_by_name() {
    let Some(host) = host() else { return };
    let refused = |change: &dyn Fn(&mut psrgs_vk::vk::HostDevice<'_>)| {
        let mut description = host.describe(None);
        change(&mut description);
        // SAFETY: the handles are those of a live host.
        unsafe { Gpu::adopt(description, &OpenOptions::default()) }.err().unwrap()
    };
    // Every requirement is missing once.
    let without: [(&str, Features); 2] = [
        ("synchronization2", Features { synchronization2: false, ..required_features() }),
        ("timelineSemaphore", Features { timeline_semaphore: false, ..required_features() }),
    ];
    let mut missed = vec![("Vulkan 1.3", refused(&|d| d.api_version = vk::API_VERSION_1_2))];
    missed.extend(without.map(|(name, features)| (name, refused(&|d| d.features = features))));
    assert_eq!(missed.len(), REQUIRED.len());
    for (name, error) in missed {
        assert!(matches!(&error, Error::MissingFeature { feature, .. } if *feature == name), "{error}");
        let text = error.to_string();
        assert!(text.contains("needed for") && text.contains("as created by the host"), "{text}");
    }
    for (family, index) in [(99, 0), (0, 99)] {
        let error = refused(&|d| (d.queue_family, d.queue_index) = (family, index));
        assert!(matches!(error, Error::BadQueue { family: f, index: i, .. } if (f, i) == (family, index)), "{error}");
    }
}

#[test]
fn what_a_device_could_do_more_is_told_before_it_is_made() {
    let Some(host) = host() else { return };
    let d = host.describe(None);
    // SAFETY: loader, instance and physical device of a live host.
    let usable = unsafe { Gpu::usable_features(d.get_instance_proc_addr, d.instance, d.physical_device) }.unwrap();
    assert_eq!(usable.features.and(&required_features()), required_features());
    // Equal to the features of an own device.
    let own = common::gpu().unwrap();
    assert_eq!(usable.features, own.caps().features);
}

#[test]
fn features_that_the_host_does_not_state_are_not_used() {
    let Some(host) = host() else { return };
    let gpu = adopt(&host);
    let caps = gpu.caps();
    assert_eq!(caps.buffer_floats, psrgs_vk::vk::FloatAtomics::CompareAndSwap);
    assert_eq!(caps.features, required_features());
    // A feature of an extension that the host does not state is not used.
    let mut careless = host.describe(None);
    careless.features.buffer_float_atomic_add = true;
    // SAFETY: the handles are those of a live host that outlives the engine, which does not use the feature.
    let gpu = unsafe { Gpu::adopt(careless, &OpenOptions::default()) }.unwrap();
    assert_eq!(gpu.caps().buffer_floats, psrgs_vk::vk::FloatAtomics::CompareAndSwap);
}

#[test]
fn buffers_go_by_address_only_where_the_host_enabled_it() {
    let features = Features { buffer_device_address: true, ..required_features() };
    let Some(host) = host_with(features) else { return };
    let options = OpenOptions { addresses: Some(true), ..OpenOptions::default() };
    for (stated, picked) in [(true, Addresses::Always), (false, Addresses::Never)] {
        let allocator = embed::host::memory::Allocator::new(&host);
        let mut description = host.describe(Some(allocator.clone()));
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
        assert_eq!(target.address().is_some(), stated);
        assert!(allocator.lent().0 > 0);
    }
}

#[test]
fn engines_side_by_side_do_not_meet() {
    let Some(host) = host() else { return };
    let adopted = adopt(&host);
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
    // An engine refuses a ticket of another.
    let ticket = gpus[0].last_ticket();
    let fresh = common::gpu().unwrap();
    assert!(matches!(fresh.wait(ticket), Err(Error::ForeignTicket { .. })));
}
