//! Telling whoever wants to know that a pipeline is being made: a driver may take seconds for one, and minutes for all.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::gpu::Gpu;
use super::lock::lock;

/// What happens to a pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PipelineEvent {
    /// The driver begins to compile it, or to look for it in its cache.
    Begun {
        /// The kernel.
        kernel: &'static str,
    },
    /// It is there, or has failed.
    Made {
        /// The kernel.
        kernel: &'static str,
        /// How long it took.
        took: Duration,
    },
}

/// Somebody who is told.
pub(super) type Watcher = Arc<dyn Fn(PipelineEvent) + Send + Sync>;

impl Gpu {
    /// From now on tells of every pipeline that is made, in place of whoever was told before. The call comes from the
    /// thread that makes the pipeline and waits for it; it must not call the engine.
    pub fn watch_pipelines(&self, told: impl Fn(PipelineEvent) + Send + Sync + 'static) {
        *lock(self.watcher()) = Some(Arc::new(told));
    }

    /// Tells that a pipeline is being made until what is returned is dropped.
    pub(super) fn making(&self, kernel: &'static str) -> Making {
        let watcher = lock(self.watcher()).clone();
        watcher.iter().for_each(|told| told(PipelineEvent::Begun { kernel }));
        Making { watcher, kernel, begun: Instant::now() }
    }
}

/// A pipeline that is being made.
pub(super) struct Making {
    watcher: Option<Watcher>,
    kernel: &'static str,
    begun: Instant,
}

impl Drop for Making {
    fn drop(&mut self) {
        let (kernel, took) = (self.kernel, self.begun.elapsed());
        self.watcher.iter().for_each(|told| told(PipelineEvent::Made { kernel, took }));
    }
}
