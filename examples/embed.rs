//! A host program with its own `VkDevice` that runs this engine on it: the host creates instance, device and queue with ash,
//! hands them over, runs a pass after work of its own, and reads the result back.

// A host speaks Vulkan itself, so this is the one place outside the device layer with `unsafe`.
use std::error::Error;
use std::sync::{Arc, Condvar, Mutex, PoisonError};

use psrgs_vk::pass::fill;
use psrgs_vk::vk::ash::{self, vk};
use psrgs_vk::vk::{Features, Gpu, Groups, HostDevice, HostSemaphore, Memory, OpenOptions, QueueLock};

/// The host's side: everything here was made, and will be destroyed, by the host.
pub struct Host {
    entry: ash::Entry,
    instance: ash::Instance,
    physical_device: vk::PhysicalDevice,
    device: ash::Device,
    queue: vk::Queue,
    family: u32,
    features: Features,
}

impl Host {
    /// Creates an instance and, on the first device with Vulkan 1.3 and a compute queue, a device with one queue. `None` where
    /// there is no Vulkan driver.
    pub fn new() -> Result<Option<Host>, Box<dyn Error>> {
        // SAFETY: loads the system's Vulkan loader.
        let Ok(entry) = (unsafe { ash::Entry::load() }) else { return Ok(None) };
        let app = vk::ApplicationInfo::default().application_name(c"host").api_version(vk::API_VERSION_1_3);
        let info = vk::InstanceCreateInfo::default().application_info(&app);
        // SAFETY: valid description.
        let instance = match unsafe { entry.create_instance(&info, None) } {
            Err(vk::Result::ERROR_INCOMPATIBLE_DRIVER) => return Ok(None),
            instance => instance?,
        };
        // SAFETY: instance and physical devices are valid, and only features that every Vulkan 1.3 device has are enabled.
        unsafe {
            let mut found = None;
            for physical in instance.enumerate_physical_devices()? {
                let new_enough = instance.get_physical_device_properties(physical).api_version >= vk::API_VERSION_1_3;
                let families = instance.get_physical_device_queue_family_properties(physical);
                let compute = families.iter().position(|f| f.queue_flags.contains(vk::QueueFlags::COMPUTE));
                if let (true, Some(family), None) = (new_enough, compute, found) {
                    found = Some((physical, family as u32));
                }
            }
            let Some((physical_device, family)) = found else {
                instance.destroy_instance(None);
                return Ok(None);
            };
            let priorities = [1.0];
            let queues =
                [vk::DeviceQueueCreateInfo::default().queue_family_index(family).queue_priorities(&priorities)];
            let mut f12 = vk::PhysicalDeviceVulkan12Features::default().timeline_semaphore(true);
            let mut f13 = vk::PhysicalDeviceVulkan13Features::default().synchronization2(true).maintenance4(true);
            let info =
                vk::DeviceCreateInfo::default().queue_create_infos(&queues).push_next(&mut f12).push_next(&mut f13);
            let device = instance.create_device(physical_device, &info, None)?;
            let queue = device.get_device_queue(family, 0);
            let features = Features {
                synchronization2: true,
                timeline_semaphore: true,
                maintenance4: true,
                ..Features::default()
            };
            Ok(Some(Host { entry, instance, physical_device, device, queue, family, features }))
        }
    }

    /// What the engine needs to know.
    pub fn describe(&self, lock: Option<QueueLock>) -> HostDevice {
        HostDevice {
            get_instance_proc_addr: self.entry.static_fn().get_instance_proc_addr,
            instance: self.instance.handle(),
            physical_device: self.physical_device,
            device: self.device.handle(),
            api_version: vk::API_VERSION_1_3,
            features: self.features,
            debug_utils: false,
            queue: self.queue,
            queue_family: self.family,
            lock,
        }
    }

    /// A timeline semaphore of the host.
    pub fn timeline(&self) -> Result<vk::Semaphore, vk::Result> {
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: timeline semaphores are enabled.
        unsafe { self.device.create_semaphore(&info, None) }
    }

    /// Sets a timeline semaphore from the host, as a submit of the host's would.
    pub fn signal(&self, at: HostSemaphore) -> Result<(), vk::Result> {
        let info = vk::SemaphoreSignalInfo::default().semaphore(at.semaphore).value(at.value);
        // SAFETY: the semaphore is the host's, and values only grow.
        unsafe { self.device.signal_semaphore(&info) }
    }

    /// Waits for a timeline semaphore and destroys it.
    pub fn wait_and_destroy(&self, at: HostSemaphore) -> Result<(), vk::Result> {
        let (semaphores, values) = ([at.semaphore], [at.value]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the semaphore is the host's, and no submit that uses it is left once it has this value.
        unsafe {
            self.device.wait_semaphores(&info, u64::MAX)?;
            self.device.destroy_semaphore(at.semaphore, None);
        }
        Ok(())
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        // SAFETY: the engine and all its buffers are gone: hosts drop them first.
        unsafe {
            self.device.destroy_device(None);
            self.instance.destroy_instance(None);
        }
    }
}

/// A lock around the queue that a host might have. Engine and host threads take it around every submit.
pub fn queue_lock() -> (QueueLock, Arc<Mutex<u64>>) {
    let uses = Arc::new(Mutex::new(0));
    let held = Arc::new((Mutex::new(false), Condvar::new()));
    let (counted, taken, given) = (uses.clone(), held.clone(), held);
    let lock = move || {
        let (mutex, freed) = &*taken;
        let mut busy = mutex.lock().unwrap_or_else(PoisonError::into_inner);
        while *busy {
            busy = freed.wait(busy).unwrap_or_else(PoisonError::into_inner);
        }
        *busy = true;
        *counted.lock().unwrap_or_else(PoisonError::into_inner) += 1;
    };
    let unlock = move || {
        *given.0.lock().unwrap_or_else(PoisonError::into_inner) = false;
        given.1.notify_one();
    };
    ((Box::new(lock), Box::new(unlock)), uses)
}

/// Runs a pass on the host's device, between two points of the host's own timeline.
pub fn run(host: &Host, description: HostDevice) -> Result<Vec<u32>, Box<dyn Error>> {
    // SAFETY: the host's handles outlive `gpu` and its buffers, which end with this function.
    let gpu = unsafe { Gpu::adopt(description, &OpenOptions::default()) }?;
    let target = gpu.buffer("picture", 4 * 1000, Memory::Device)?;
    let pipeline = gpu.pipeline(&fill::PASS.kernel, &[])?;
    let timeline = host.timeline()?;
    let (before, after) =
        (HostSemaphore { semaphore: timeline, value: 1 }, HostSemaphore { semaphore: timeline, value: 2 });

    let mut recorder = gpu.recorder("engine's part of a frame")?;
    recorder.fill(&target, 0)?;
    recorder.dispatch(&pipeline, &[&target], &fill::Push { count: 900, value: 3 }, Groups::Items(900))?;
    // SAFETY: a timeline semaphore of this device, with rising values.
    unsafe { recorder.submit_with(&[before], &[after]) }?;

    // The host's part comes first, and the host waits for the engine's on its own timeline.
    host.signal(before)?;
    host.wait_and_destroy(after)?;
    let picture = gpu.read(&target)?;
    gpu.check_canaries()?;
    Ok(picture)
}

#[allow(dead_code)]
fn main() -> Result<(), Box<dyn Error>> {
    let Some(host) = Host::new()? else {
        println!("no Vulkan driver");
        return Ok(());
    };
    let (lock, uses) = queue_lock();
    let picture = run(&host, host.describe(Some(lock)))?;
    let written = picture.iter().filter(|&&word| word == 3).count();
    let submits = *uses.lock().unwrap_or_else(PoisonError::into_inner);
    println!("{written} of {} words written on the host's device in {submits} submits", picture.len());
    Ok(())
}
