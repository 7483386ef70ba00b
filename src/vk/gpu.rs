//! The public handle of a device.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, Weak};

use ash::vk;

use super::buffer::Buffer;
use super::cache;
use super::caps::Caps;
use super::device::Device;
use super::error::{Error, Named, Result};
use super::hazard::HazardChecker;
use super::host_allocator::Memory;
use super::kernel::Kernel;
use super::lock::lock;
use super::making::Watcher;
use super::memory::MemoryUse;
use super::options::{OpenOptions, Validation};
use super::pipeline::{Pipeline, constants};
use super::pipeline_variant::BindingMode;
use super::profile::{PassTime, Stats};
use super::recorder::Recorder;
use super::submit::{STAGING, State};
use super::submit_sync::SubmitSync;
use super::ticket::Ticket;
use super::validation::Messages;

/// (name of the kernel, address of the kernel's SPIR-V module, constants).
type PipelineKey = (&'static str, usize, Vec<u32>);

struct GpuInner {
    device: Arc<Device>,
    timeline: vk::Semaphore,
    state: Mutex<State>,
    pipelines: Mutex<HashMap<PipelineKey, Pipeline>>,
    /// Called when a pipeline is created.
    watcher: Mutex<Option<Watcher>>,
    cache: vk::PipelineCache,
    /// Valid bits of a timestamp.
    timestamp_mask: u64,
    /// File of the pipeline cache.
    cache_file: Option<PathBuf>,
    /// Whether the pipeline cache has grown since the last save.
    cache_grown: AtomicBool,
    /// Whether to simulate a device loss.
    lost: AtomicBool,
    /// Last ticket waited for, when the host waits for every submit: see [`Validation::GpuAssisted`].
    waited: Option<AtomicU64>,
}

/// An open device with its queue. Cheap to clone. All work runs in order of submission.
#[derive(Clone)]
pub struct Gpu {
    inner: Arc<GpuInner>,
    /// Byte count of [`Self::planning`]: buffers are counted instead of allocated.
    pub(super) planned: Option<Arc<AtomicU64>>,
}

impl Gpu {
    /// Opens a device of this machine.
    pub fn open(options: &OpenOptions) -> Result<Gpu> {
        Self::start(Device::open(options)?, options)
    }

    pub(super) fn start(device: Arc<Device>, options: &OpenOptions) -> Result<Gpu> {
        // SAFETY: the physical device belongs to the instance.
        let families = unsafe { device.instance.get_physical_device_queue_family_properties(device.physical) };
        let bits = families.get(device.family as usize).map_or(0, |f| f.timestamp_valid_bits);
        let mut kind = vk::SemaphoreTypeCreateInfo::default().semaphore_type(vk::SemaphoreType::TIMELINE);
        let info = vk::SemaphoreCreateInfo::default().push_next(&mut kind);
        // SAFETY: timeline semaphores are enabled.
        let timeline = unsafe { device.raw.create_semaphore(&info, None) }.named("vkCreateSemaphore")?;
        let mut state = State::default();
        state.checker = options.check_hazards.then(HazardChecker::default);
        let mut inner = GpuInner {
            timeline,
            state: Mutex::new(state),
            pipelines: Mutex::default(),
            watcher: Mutex::default(),
            cache: vk::PipelineCache::null(),
            timestamp_mask: if bits >= 64 { u64::MAX } else { (1 << bits) - 1 },
            cache_file: options.pipeline_cache.as_deref().map(|folder| cache::file(folder, device.caps.cache_id)),
            cache_grown: AtomicBool::new(false),
            lost: AtomicBool::new(false),
            waited: (device.owned && options.validation == Validation::GpuAssisted).then(AtomicU64::default),
            device,
        };
        let data = inner.cache_file.as_deref().map(cache::load).unwrap_or_default();
        let info = vk::PipelineCacheCreateInfo::default().initial_data(&data);
        // SAFETY: the data are undamaged and came from a driver of this identifier; on failure `inner` destroys its
        // objects.
        inner.cache = unsafe { inner.device.raw.create_pipeline_cache(&info, None) }.named("vkCreatePipelineCache")?;
        if options.breadcrumbs {
            let crumbs = Buffer::new(&inner.device, "breadcrumbs", 4, Memory::Readback)?;
            lock(&inner.state).crumbs = Some(crumbs);
        }
        Ok(Gpu { inner: Arc::new(inner), planned: None })
    }

    /// Capabilities of the device, and the choices made from them.
    pub fn caps(&self) -> &Caps {
        &self.inner.device.caps
    }

    /// A buffer of `bytes` bytes with undefined content. A buffer of fewer than 16 bytes, even 0, has room for 16.
    pub fn buffer(&self, name: &str, bytes: u64, memory: Memory) -> Result<Buffer> {
        if let Some(total) = &self.planned {
            return self.plan_buffer(total, name, bytes, memory);
        }
        self.retire()?;
        Buffer::new(&self.inner.device, name, bytes, memory)
    }

    pub(super) fn watcher(&self) -> &Mutex<Option<Watcher>> {
        &self.inner.watcher
    }

    pub(super) fn device(&self) -> &Arc<Device> {
        &self.inner.device
    }

    /// The pipeline of a kernel with these specialization constants, created at first use.
    pub fn pipeline(&self, kernel: &Kernel, given: &[(&str, u32)]) -> Result<Pipeline> {
        let values = constants(kernel, given)?;
        let mut pipelines = lock(&self.inner.pipelines);
        let key = (kernel.name, kernel.spirv.descriptors.as_ptr() as usize, values);
        if let Some(pipeline) = pipelines.get(&key) {
            return Ok(pipeline.clone());
        }
        let _making = self.making(kernel.name);
        let pipeline = Pipeline::new(&self.inner.device, self.inner.cache, kernel, &key.2)?;
        self.inner.cache_grown.store(true, Ordering::Release);
        pipelines.insert(key, pipeline.clone());
        Ok(pipeline)
    }

    /// Every pipeline that was created so far.
    pub(super) fn pipelines(&self) -> Vec<Pipeline> {
        lock(&self.inner.pipelines).values().cloned().collect()
    }

    /// Creates a variant of a pipeline unless the variant exists.
    pub(super) fn make_variant(&self, pipeline: &Pipeline, mode: BindingMode) -> Result<()> {
        if pipeline.inner.variant(mode).is_some() {
            return Ok(());
        }
        let _making = self.making(pipeline.name());
        if pipeline.make(&self.inner.device, self.inner.cache, mode)? {
            self.inner.cache_grown.store(true, Ordering::Release);
        }
        Ok(())
    }

    /// An empty recorder. `label` names the recorder's command buffer in captures and messages.
    pub fn recorder(&self, label: &str) -> Result<Recorder> {
        self.retire()?;
        Ok(Recorder {
            gpu: self.clone(),
            label: label.to_owned(),
            commands: Vec::new(),
            staging: Vec::new(),
            profile: false,
            omit_barrier: None,
            addresses: None,
            texels: None,
        })
    }

    /// Waits until a submit and all earlier submits have finished.
    pub fn wait(&self, ticket: Ticket) -> Result<()> {
        self.owns(ticket)?;
        if ticket.value() == 0 {
            return Ok(());
        }
        {
            let mut state = lock(&self.inner.state);
            if ticket.value() == state.last {
                state.stats.host_waits += 1;
            } else {
                state.stats.pacing_waits += 1;
            }
        }
        self.inner.wait(ticket.value()).map_err(|error| self.explain(error))?;
        self.retire()
    }

    /// Writes `values` at the beginning of a buffer, in order with all submits. Does not wait.
    pub fn write<T: bytemuck::NoUninit>(&self, buffer: &Buffer, values: &[T]) -> Result<()> {
        let mut recorder = self.recorder("write")?;
        recorder.upload(buffer, 0, bytemuck::cast_slice(values))?;
        recorder.submit().map(|_| ())
    }

    /// Counters since the device was opened.
    pub fn stats(&self) -> Stats {
        lock(&self.inner.state).stats
    }

    /// Bytes allocated for buffers.
    pub fn memory_use(&self) -> MemoryUse {
        lock(&self.inner.device.memory).as_ref().map(|pool| pool.tally()).unwrap_or_default()
    }

    /// Resets [`MemoryUse::peak`] to the bytes allocated now.
    pub fn restart_peak(&self) {
        if let Some(pool) = lock(&self.inner.device.memory).as_mut() {
            pool.restart_peak();
        }
    }

    /// Pass times of a profiled recording whose ticket has passed. `None` before, for a recording that was not
    /// profiled, and from the second call on.
    pub fn timings(&self, ticket: Ticket) -> Result<Option<Vec<PassTime>>> {
        self.owns(ticket)?;
        self.retire()?;
        let mut state = lock(&self.inner.state);
        let found = state.timings.iter().position(|(t, _)| *t == ticket.value());
        Ok(found.and_then(|i| state.timings.remove(i)).map(|(_, times)| times))
    }

    /// Texts of the validation layer's messages so far.
    pub fn validation_messages(&self) -> Vec<String> {
        self.inner.device.messages.all()
    }

    /// Messages of the validation layer, including messages at the closing of the device.
    pub fn messages(&self) -> Messages {
        self.inner.device.messages.clone()
    }

    /// Tests the hazard checker on a recording: returns the number of barriers that would be inferred now, and
    /// descriptions of the barriers that the checker would not miss (none when inference and checker are right).
    pub fn missed_barriers(&self, recorder: &Recorder) -> Result<(usize, Vec<String>)> {
        recorder.of(self.device())?;
        Ok(lock(&self.inner.state).missed_barriers(recorder))
    }

    pub(super) fn submit(&self, recorder: Recorder) -> Result<Ticket> {
        self.submit_ordered(recorder, SubmitSync::default())
    }

    pub(super) fn submit_ordered(&self, mut recorder: Recorder, order: SubmitSync<'_>) -> Result<Ticket> {
        recorder.profile &= self.inner.timestamp_mask != 0 && self.caps().limits.timestamp_ns > 0.0;
        let result = {
            let mut state = lock(&self.inner.state);
            let there = self.inner.there().named("vkQueueSubmit2");
            let done = there.and_then(|()| state.submit(&self.inner.device, self.inner.timeline, recorder, order));
            done.and_then(|unlocked| {
                self.inner.wait_for_queue(state.last)?;
                Ok((self.ticket(state.last), unlocked))
            })
        };
        let (ticket, unlocked) = result.map_err(|error| self.explain(error))?;
        match unlocked {
            Ok(()) => Ok(ticket),
            Err(panic) => std::panic::resume_unwind(panic),
        }
    }

    /// A host-visible staging buffer of at least `bytes` bytes.
    pub(super) fn staging(&self, bytes: u64) -> Result<Buffer> {
        if bytes <= STAGING
            && let Some(chunk) = lock(&self.inner.state).staging.pop()
        {
            return Ok(chunk);
        }
        Buffer::new(&self.inner.device, "staging", bytes.max(STAGING), Memory::Upload)
    }

    pub(super) fn state(&self) -> std::sync::MutexGuard<'_, State> {
        lock(&self.inner.state)
    }

    pub(super) fn raw_timeline(&self) -> vk::Semaphore {
        self.inner.timeline
    }

    /// Every live buffer, by number.
    pub(super) fn live_buffers(&self) -> Vec<Buffer> {
        let live = lock(&self.inner.device.live);
        let mut buffers: Vec<Buffer> = live.values().filter_map(Weak::upgrade).map(|inner| Buffer { inner }).collect();
        // Release the lock before any of the handles can be dropped.
        drop(live);
        buffers.sort_by_key(|b| b.inner.id);
        buffers
    }

    /// Writes the pipeline cache to its file, if a file was given and the cache has grown. Dropping the last handle of
    /// the device does the same, but ignores errors.
    pub fn save_pipeline_cache(&self) -> Result<()> {
        self.inner.save_cache()
    }

    /// From now on every submit, wait and ticket query fails as on a lost device. For tests. Submitted work still runs.
    #[doc(hidden)]
    pub fn simulate_device_loss(&self) {
        self.inner.lost.store(true, Ordering::Release);
    }

    /// Value of the last finished ticket.
    pub(super) fn completed(&self) -> Result<u64> {
        self.inner.completed().map_err(|error| self.explain(error))
    }

    fn retire(&self) -> Result<()> {
        let completed = self.completed()?;
        let period = f64::from(self.caps().limits.timestamp_ns);
        // Dropping commands may free buffers, so the commands are dropped outside the lock.
        let done = lock(&self.inner.state).retire(&self.inner.device, completed, period, self.inner.timestamp_mask);
        done.map(drop)
    }

    /// Adds the last started pass to a device loss.
    fn explain(&self, error: Error) -> Error {
        let Error::DeviceLost { during, .. } = error else { return error };
        Error::DeviceLost { during, pass: self.last_started() }
    }

    /// The last command known to have started: from breadcrumbs if they are on, otherwise the labels of the recordings
    /// in flight.
    pub fn last_started(&self) -> String {
        let state = lock(&self.inner.state);
        if let Some(crumb) =
            state.crumbs.as_ref().and_then(|c| c.load::<u32>(0, 1).ok()).and_then(|v| v.first().copied())
        {
            let found =
                state.in_flight.iter().find_map(|f| f.command_name(crumb).map(|n| format!("{n} of {}", f.label)));
            return found.unwrap_or_else(|| "none in flight".to_owned());
        }
        let labels: Vec<&str> = state.in_flight.iter().map(|f| f.label.as_str()).collect();
        format!("unknown, among recordings {}", labels.join(", "))
    }
}

impl GpuInner {
    fn there(&self) -> std::result::Result<(), vk::Result> {
        if self.lost.load(Ordering::Acquire) { Err(vk::Result::ERROR_DEVICE_LOST) } else { Ok(()) }
    }

    fn completed(&self) -> Result<u64> {
        self.there().named("vkGetSemaphoreCounterValue")?;
        if let Some(waited) = &self.waited {
            return Ok(waited.load(Ordering::Acquire));
        }
        // SAFETY: the semaphore lives as long as `self`.
        unsafe { self.device.raw.get_semaphore_counter_value(self.timeline) }.named("vkGetSemaphoreCounterValue")
    }

    fn wait(&self, ticket: u64) -> Result<()> {
        self.there().named("vkWaitSemaphores")?;
        self.wait_really(ticket)
    }

    /// Waits until the queue is idle, in the mode that waits for every submit.
    fn wait_for_queue(&self, ticket: u64) -> Result<()> {
        if let Some(waited) = &self.waited {
            // SAFETY: the caller holds the lock on the state, which guards the queue; no host shares an owned device.
            unsafe { self.device.raw.queue_wait_idle(self.device.queue) }.named("vkQueueWaitIdle")?;
            waited.store(ticket, Ordering::Release);
        }
        Ok(())
    }

    fn wait_really(&self, ticket: u64) -> Result<()> {
        if self.waited.as_ref().is_some_and(|waited| waited.load(Ordering::Acquire) >= ticket) {
            return Ok(());
        }
        let (semaphores, values) = ([self.timeline], [ticket]);
        let info = vk::SemaphoreWaitInfo::default().semaphores(&semaphores).values(&values);
        // SAFETY: as above.
        unsafe { self.device.raw.wait_semaphores(&info, u64::MAX) }.named("vkWaitSemaphores")
    }
}

impl GpuInner {
    fn save_cache(&self) -> Result<()> {
        let Some(path) = &self.cache_file else { return Ok(()) };
        if !self.cache_grown.swap(false, Ordering::AcqRel) {
            return Ok(());
        }
        // SAFETY: the cache lives as long as `self`.
        let data = unsafe { self.device.raw.get_pipeline_cache_data(self.cache) }.named("vkGetPipelineCacheData")?;
        cache::save(path, &data)
    }
}

impl Drop for GpuInner {
    fn drop(&mut self) {
        let last = lock(&self.state).last;
        // A caller who wants the error calls `save_pipeline_cache`.
        let _ = self.save_cache();
        // The wait fails on a lost device, whose objects may be destroyed without waiting.
        let _ = self.wait_really(last);
        // SAFETY: everything submitted has finished, or the device is lost.
        unsafe {
            lock(&self.state).close(&self.device);
            self.device.raw.destroy_semaphore(self.timeline, None);
            self.device.raw.destroy_pipeline_cache(self.cache, None);
        }
    }
}
