//! A loader that watches the engine: it must destroy all objects that it creates, and no others, and must not use
//! commands that belong to the host.

use std::collections::{HashMap, HashSet};
use std::ffi::{CStr, CString, c_char, c_void};
use std::sync::{Mutex, OnceLock};

use psrgs_vk::vk::HostDevice;
use psrgs_vk::vk::ash::vk::{self, Handle};

type Create = unsafe extern "system" fn(vk::Device, *const c_void, *const c_void, *mut u64) -> vk::Result;
type Destroy = unsafe extern "system" fn(vk::Device, u64, *const c_void);
type Pipelines = unsafe extern "system" fn(vk::Device, u64, u32, *const c_void, *const c_void, *mut u64) -> vk::Result;
type Submit = unsafe extern "system" fn(u64, u32, *const vk::SubmitInfo2<'static>, vk::Fence) -> vk::Result;
type Void = unsafe extern "system" fn();

/// The host's queue, and whether the host's lock is held.
struct Queue {
    handle: u64,
    locked: Box<dyn Fn() -> bool + Send>,
    submits: u64,
}

#[derive(Default)]
struct Watch {
    /// The loader's own functions, valid as long as a host lives, because the library is unloaded with the last host.
    loader: Option<vk::PFN_vkGetInstanceProcAddr>,
    device_loader: Option<vk::PFN_vkGetDeviceProcAddr>,
    real: HashMap<CString, usize>,
    /// Objects that the engine has created and not destroyed, by the function that destroys them.
    live: HashSet<(&'static str, u64)>,
    created: u64,
    queue: Option<Queue>,
}

static WATCH: OnceLock<Mutex<Watch>> = OnceLock::new();
/// One watched engine at a time.
pub(crate) static TURN: Mutex<()> = Mutex::new(());

fn watch() -> std::sync::MutexGuard<'static, Watch> {
    WATCH.get_or_init(Mutex::default).lock().unwrap()
}

fn fail(what: &str) -> ! {
    eprintln!("{what}");
    std::process::abort()
}

fn real(name: &CStr) -> usize {
    match watch().real.get(name) {
        Some(address) => *address,
        None => fail("a function was called that was never loaded"),
    }
}

fn made(destroy: &'static str, handle: u64) {
    let mut watch = watch();
    watch.created += 1;
    if !watch.live.insert((destroy, handle)) {
        fail("a handle was created twice");
    }
}

fn gone(destroy: &'static str, handle: u64) {
    if handle != 0 && !watch().live.remove(&(destroy, handle)) {
        fail(&format!("{destroy} of something that the engine did not create"));
    }
}

macro_rules! pairs {
    ($($create:ident $destroy:ident;)*) => {
        #[allow(non_snake_case)]
        mod hooked {
            use super::*;
            $(
                pub(super) unsafe extern "system" fn $create(
                    device: vk::Device, info: *const c_void, callbacks: *const c_void, out: *mut u64,
                ) -> vk::Result {
                    let name = CString::new(stringify!($create)).unwrap();
                    // SAFETY: the real function of this name, with the engine's arguments.
                    unsafe {
                        let result = std::mem::transmute::<usize, Create>(real(&name))(device, info, callbacks, out);
                        if result == vk::Result::SUCCESS {
                            made(stringify!($destroy), *out);
                        }
                        result
                    }
                }
                pub(super) unsafe extern "system" fn $destroy(device: vk::Device, handle: u64, callbacks: *const c_void) {
                    gone(stringify!($destroy), handle);
                    let name = CString::new(stringify!($destroy)).unwrap();
                    // SAFETY: as above.
                    unsafe { std::mem::transmute::<usize, Destroy>(real(&name))(device, handle, callbacks) }
                }
            )*
        }
        fn pair(name: &CStr) -> Option<usize> {
            let name = name.to_str().unwrap();
            $(
                if name == stringify!($create) { return Some(hooked::$create as *const () as usize); }
                if name == stringify!($destroy) { return Some(hooked::$destroy as *const () as usize); }
            )*
            None
        }
    };
}

pairs! {
    vkCreateBuffer vkDestroyBuffer;
    vkCreateBufferView vkDestroyBufferView;
    vkCreateSemaphore vkDestroySemaphore;
    vkCreateCommandPool vkDestroyCommandPool;
    vkCreateDescriptorPool vkDestroyDescriptorPool;
    vkCreateDescriptorSetLayout vkDestroyDescriptorSetLayout;
    vkCreatePipelineLayout vkDestroyPipelineLayout;
    vkCreatePipelineCache vkDestroyPipelineCache;
    vkCreateShaderModule vkDestroyShaderModule;
    vkCreateQueryPool vkDestroyQueryPool;
    vkCreateFence vkDestroyFence;
    vkCreateEvent vkDestroyEvent;
    vkCreateImage vkDestroyImage;
}

unsafe extern "system" fn create_pipelines(
    device: vk::Device,
    cache: u64,
    count: u32,
    infos: *const c_void,
    callbacks: *const c_void,
    out: *mut u64,
) -> vk::Result {
    // SAFETY: the real function, with the engine's arguments.
    unsafe {
        let function = std::mem::transmute::<usize, Pipelines>(real(c"vkCreateComputePipelines"));
        let result = function(device, cache, count, infos, callbacks, out);
        if result == vk::Result::SUCCESS {
            (0..count as usize).for_each(|i| made("vkDestroyPipeline", *out.add(i)));
        }
        result
    }
}

unsafe extern "system" fn destroy_pipeline(device: vk::Device, handle: u64, callbacks: *const c_void) {
    gone("vkDestroyPipeline", handle);
    // SAFETY: as above.
    unsafe { std::mem::transmute::<usize, Destroy>(real(c"vkDestroyPipeline"))(device, handle, callbacks) }
}

unsafe extern "system" fn submit(
    queue: u64,
    count: u32,
    infos: *const vk::SubmitInfo2<'static>,
    fence: vk::Fence,
) -> vk::Result {
    match &mut watch().queue {
        Some(host) if host.handle != queue => fail("a submit to a queue that the host did not hand over"),
        Some(host) if !(host.locked)() => fail("a submit outside of the host's lock"),
        Some(host) => host.submits += 1,
        None => fail("a submit before there was a host"),
    }
    // SAFETY: as above.
    unsafe { std::mem::transmute::<usize, Submit>(real(c"vkQueueSubmit2"))(queue, count, infos, fence) }
}

/// Commands that belong to the host: its instance, devices, queues, and, where it lends an allocator, memory.
const FORBIDDEN: [&CStr; 16] = [
    c"vkCreateInstance",
    c"vkCreateDevice",
    c"vkDestroyInstance",
    c"vkDestroyDevice",
    c"vkDeviceWaitIdle",
    c"vkQueueWaitIdle",
    c"vkGetDeviceQueue",
    c"vkGetDeviceQueue2",
    c"vkQueueSubmit",
    c"vkQueueBindSparse",
    c"vkAllocateMemory",
    c"vkFreeMemory",
    c"vkMapMemory",
    c"vkUnmapMemory",
    c"vkResetQueryPool",
    c"vkSignalSemaphore",
];

unsafe extern "system" fn trap() {
    fail("the engine called a command that belongs to the host");
}

fn replaced(name: &CStr) -> Option<usize> {
    if FORBIDDEN.contains(&name) {
        return Some(trap as *const () as usize);
    }
    match name.to_bytes() {
        b"vkCreateComputePipelines" => Some(create_pipelines as *const () as usize),
        b"vkDestroyPipeline" => Some(destroy_pipeline as *const () as usize),
        b"vkQueueSubmit2" => Some(submit as *const () as usize),
        _ => pair(name),
    }
}

/// The function that the engine gets for a name, from the loader's function.
fn choose(name: &CStr, loaded: vk::PFN_vkVoidFunction) -> vk::PFN_vkVoidFunction {
    let (Some(function), Some(hook)) = (loaded, replaced(name)) else { return loaded };
    watch().real.entry(name.to_owned()).or_insert(function as *const () as usize);
    // SAFETY: a function with the signature of this name.
    Some(unsafe { std::mem::transmute::<usize, Void>(hook) })
}

unsafe extern "system" fn instance_function(instance: vk::Instance, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: called by the engine with a valid name; the loader's function was set before this one was handed out.
    unsafe {
        let wanted = CStr::from_ptr(name);
        let loader = watch().loader;
        let loaded = loader.and_then(|loader| loader(instance, name));
        if wanted == c"vkGetDeviceProcAddr" {
            let function = loaded.expect("every loader has vkGetDeviceProcAddr");
            watch().device_loader = Some(std::mem::transmute::<Void, vk::PFN_vkGetDeviceProcAddr>(function));
            let hook: vk::PFN_vkGetDeviceProcAddr = device_function;
            return Some(std::mem::transmute::<vk::PFN_vkGetDeviceProcAddr, Void>(hook));
        }
        choose(wanted, loaded)
    }
}

unsafe extern "system" fn device_function(device: vk::Device, name: *const c_char) -> vk::PFN_vkVoidFunction {
    // SAFETY: as above.
    unsafe {
        let loader = watch().device_loader;
        choose(CStr::from_ptr(name), loader.and_then(|loader| loader(device, name)))
    }
}

/// The description with the watching loader in place of the real one. `locked` tells whether the host's lock is held.
pub(crate) fn watched<'a>(mut host: HostDevice<'a>, locked: Box<dyn Fn() -> bool + Send>) -> HostDevice<'a> {
    let mut watch = watch();
    (watch.loader, watch.device_loader) = (Some(host.get_instance_proc_addr), None);
    watch.real.clear();
    host.get_instance_proc_addr = instance_function;
    watch.queue = Some(Queue { handle: host.queue.as_raw(), locked, submits: 0 });
    watch.created = 0;
    host
}

/// Numbers of an engine's created objects, objects left, and submits.
pub(crate) fn seen() -> (u64, usize, u64) {
    let watch = watch();
    (watch.created, watch.live.len(), watch.queue.as_ref().map_or(0, |q| q.submits))
}
