//! A host program with its own `VkDevice` that renders a Gaussian model on it: the host creates instance, device and queue with
//! ash, hands them over, has a picture rendered between two points of its own timeline, and reads it back.
//!
//! ```text
//! cargo run --example embed -- picture.png
//! ```

// A host speaks Vulkan itself, so this is the one place outside the device layer with `unsafe`.
use std::error::Error;
use std::sync::{Arc, Condvar, Mutex, PoisonError};

use psrgs_vk::format::image_out;
use psrgs_vk::pass::camera::Projection;
use psrgs_vk::raster::{Picture, Shot, Viewer};
use psrgs_vk::scene::init::SH_C0;
use psrgs_vk::scene::{Camera, Gaussians, SH_GROUP_FLOATS};
use psrgs_vk::vk::ash::{self, vk};
use psrgs_vk::vk::{Features, Gpu, HostDevice, HostSemaphore, OpenOptions, QueueLock};

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
            let mut f12 =
                vk::PhysicalDeviceVulkan12Features::default().timeline_semaphore(true).buffer_device_address(true);
            let mut f13 = vk::PhysicalDeviceVulkan13Features::default().synchronization2(true).maintenance4(true);
            let info =
                vk::DeviceCreateInfo::default().queue_create_infos(&queues).push_next(&mut f12).push_next(&mut f13);
            let device = instance.create_device(physical_device, &info, None)?;
            let queue = device.get_device_queue(family, 0);
            let features = Features {
                synchronization2: true,
                timeline_semaphore: true,
                maintenance4: true,
                buffer_device_address: true,
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

    /// Waits until a timeline semaphore has a value.
    pub fn wait(&self, at: HostSemaphore) -> Result<(), vk::Result> {
        let (semaphores, values) = ([at.semaphore], [at.value]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: the semaphore is the host's.
        unsafe { self.device.wait_semaphores(&info, u64::MAX) }
    }

    /// Destroys a timeline semaphore.
    ///
    /// # Safety
    /// No submit that uses it is left.
    pub unsafe fn destroy(&self, semaphore: vk::Semaphore) {
        // SAFETY: the semaphore is the host's; the rest is the caller's promise.
        unsafe { self.device.destroy_semaphore(semaphore, None) }
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

/// Where the splats of [`model`] are, and their colours.
pub const SPLATS: [([f32; 3], [f32; 3]); 3] =
    [([-1.5, 0.0, 4.0], [1.0, 0.1, 0.1]), ([0.0, 0.5, 4.0], [0.1, 1.0, 0.1]), ([1.5, 0.0, 4.0], [0.1, 0.1, 1.0])];

/// A red, a green and a blue ball. A host with a file would take `psrgs_vk::format::ply::read(file)?.gaussians`.
pub fn model() -> Gaussians {
    let mut model = Gaussians::zeros(SPLATS.len());
    for (i, (mean, colour)) in SPLATS.into_iter().enumerate() {
        model.means[3 * i..3 * i + 3].copy_from_slice(&mean);
        model.quats[4 * i] = 1.0;
        model.scales[3 * i..3 * i + 3].fill(0.3_f32.ln());
        // A logit: almost opaque.
        model.opacities[i] = 5.0;
        for (k, value) in colour.into_iter().enumerate() {
            model.sh[0][SH_GROUP_FLOATS * i + k] = (value - 0.5) / SH_C0 as f32;
        }
    }
    model
}

/// What is rendered: from the origin along z.
pub fn shot() -> Shot {
    let rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let (width, height) = (96, 64);
    let camera = Camera { rotation, translation: [0.0; 3], fx: 80.0, fy: 80.0, cx: 48.0, cy: 32.0, width, height };
    Shot { camera, projection: Projection::default(), background: [0.0; 3] }
}

/// What the engine gave.
pub struct Frame {
    /// The picture.
    pub picture: Picture,
    /// How often the engine submitted work for it.
    pub submits: u64,
}

/// Renders on the host's device, between two points of the host's own timeline.
pub fn run(host: &Host, description: HostDevice) -> Result<Frame, Box<dyn Error>> {
    // SAFETY: the host's handles outlive `gpu` and what is made with it, which end with this function.
    let gpu = unsafe { Gpu::adopt(description, &OpenOptions::default()) }?;
    let mut viewer = Viewer::new(&gpu);
    let model = model();
    let splats = model.len() as u32;
    let model = viewer.upload(&model)?;
    let timeline = host.timeline()?;
    let at = |value| HostSemaphore { semaphore: timeline, value };

    let mut now = 0;
    let picture = loop {
        let (before, after) = (at(now + 1), at(now + 2));
        let mut recorder = gpu.recorder("engine's part of a frame")?;
        viewer.record(&mut recorder, &model, splats, &shot(), true)?;
        // SAFETY: a timeline semaphore of this device, with rising values.
        unsafe { recorder.submit_with(&[before], &[after]) }?;

        // The host's part of the frame comes first, and the host waits for the engine's on its own timeline. A host that goes on
        // with the picture on the device would use `viewer.target()` in a submit that waits for `after`.
        host.signal(before)?;
        host.wait(after)?;
        now += 2;
        // None: there was no room yet for so many splats in so many tiles. The next frame has it.
        if let Some(picture) = viewer.collect()? {
            break picture;
        }
    };
    // SAFETY: the submits that used it have signalled it.
    unsafe { host.destroy(timeline) };
    gpu.check_canaries()?;
    Ok(Frame { picture, submits: gpu.stats().submits })
}

#[allow(dead_code)]
fn main() -> Result<(), Box<dyn Error>> {
    let Some(host) = Host::new()? else {
        println!("no Vulkan driver");
        return Ok(());
    };
    let (lock, uses) = queue_lock();
    let Frame { picture, .. } = run(&host, host.describe(Some(lock)))?;
    let file = std::env::args().nth(1).unwrap_or_else(|| "embed.png".to_owned());
    image_out::write_png(file.as_ref(), picture.width, picture.height, &picture.rgb8())?;
    let submits = *uses.lock().unwrap_or_else(PoisonError::into_inner);
    println!("{file}: rendered on the host's device in {submits} submits");
    Ok(())
}
