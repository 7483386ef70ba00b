//! Notification of pipeline creation: a driver may take seconds for one pipeline, and minutes for all.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::gpu::Gpu;
use super::lock::lock;

/// An event of pipeline creation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PipelineEvent {
    /// The driver starts to compile the pipeline, or to look the pipeline up in its cache.
    Begun {
        /// Name of the kernel.
        kernel: &'static str,
    },
    /// Creation has finished or failed.
    Made {
        /// Name of the kernel.
        kernel: &'static str,
        /// Duration of the creation.
        took: Duration,
    },
}

/// Callback for pipeline events.
pub(super) type Watcher = Arc<dyn Fn(PipelineEvent) + Send + Sync>;

impl Gpu {
    /// Calls `told` for every pipeline created from now on, and replaces an earlier callback. The thread that creates
    /// the pipeline calls `told` and waits for its return; `told` must not call the engine.
    pub fn watch_pipelines(&self, told: impl Fn(PipelineEvent) + Send + Sync + 'static) {
        *lock(self.watcher()) = Some(Arc::new(told));
    }

    /// Reports that a pipeline is being created, until the returned guard is dropped.
    pub(super) fn making(&self, kernel: &'static str) -> PipelineCreation {
        let watcher = lock(self.watcher()).clone();
        watcher.iter().for_each(|told| told(PipelineEvent::Begun { kernel }));
        PipelineCreation { watcher, kernel, begun: Instant::now() }
    }
}

/// Guard for a pipeline under creation.
pub(super) struct PipelineCreation {
    watcher: Option<Watcher>,
    kernel: &'static str,
    begun: Instant,
}

impl Drop for PipelineCreation {
    fn drop(&mut self) {
        let (kernel, took) = (self.kernel, self.begun.elapsed());
        self.watcher.iter().for_each(|told| told(PipelineEvent::Made { kernel, took }));
    }
}
