//! Memory that a host lends: errors name the fault of the host's allocator, and no block is lost.

use std::ffi::c_void;
use std::ptr::NonNull;
use std::sync::Arc;

use psrgs_vk::vk::ash::vk;
use psrgs_vk::vk::{Error, Gpu, HostAllocator, Memory, MemoryBlock, MemoryRequest, OpenOptions};

use super::embed::host::memory::Allocator;
use super::host;

/// Makes a block wrong.
type Change = fn(&mut MemoryBlock);

/// The host's allocator with one fault.
struct Wrong {
    inner: Arc<Allocator>,
    change: Change,
    refuse: Option<vk::Result>,
    /// Only buffers of this name.
    name: &'static str,
}

// SAFETY: the engine refuses a changed block, or gives the block back unchanged.
unsafe impl HostAllocator for Wrong {
    fn allocate(&self, request: &MemoryRequest<'_>) -> Result<MemoryBlock, vk::Result> {
        let wrong = request.name == self.name;
        if let (true, Some(result)) = (wrong, self.refuse) {
            return Err(result);
        }
        let mut block = self.inner.allocate(request)?;
        if wrong {
            (self.change)(&mut block);
        }
        Ok(block)
    }

    fn map(&self, block: &MemoryBlock) -> Result<NonNull<c_void>, vk::Result> {
        self.inner.map(block)
    }

    fn free(&self, block: MemoryBlock) {
        self.inner.free(block);
    }
}

#[test]
fn an_allocator_that_gives_what_cannot_be_used_is_told_so() {
    let Some(host) = host() else { return };
    let cases: [(Change, &str); 3] = [
        (|block| block.offset += 1, "alignment"),
        (|block| block.size -= 1, "smaller than requested"),
        (|block| block.memory_type = 31, "memory type"),
    ];
    for (change, said) in cases {
        let inner = Allocator::new(&host);
        let allocator = Arc::new(Wrong { inner: inner.clone(), change, refuse: None, name: "odd" });
        // SAFETY: the handles are those of a live host that outlives the engine.
        let gpu = unsafe { Gpu::adopt(host.describe(Some(allocator)), &OpenOptions::default()) }.unwrap();
        let before = (inner.lent().0, gpu.memory_use().current);
        let error = gpu.buffer("odd", 4096, Memory::Device).unwrap_err();
        assert!(matches!(&error, Error::HostAllocator { buffer, .. } if buffer == "odd"), "{error}");
        assert!(error.to_string().contains(said), "{error}");
        assert_eq!((inner.lent().0, gpu.memory_use().current), before, "what could not be used was not given back");
        gpu.buffer("even", 4096, Memory::Device).unwrap();
    }
}

#[test]
fn an_allocator_that_has_nothing_left_is_lack_of_memory() {
    let Some(host) = host() else { return };
    let refuse = Some(vk::Result::ERROR_OUT_OF_DEVICE_MEMORY);
    let allocator = Arc::new(Wrong { inner: Allocator::new(&host), change: |_| (), refuse, name: "much" });
    // SAFETY: the handles are those of a live host that outlives the engine.
    let gpu = unsafe { Gpu::adopt(host.describe(Some(allocator)), &OpenOptions::default()) }.unwrap();
    let error = gpu.buffer("much", 4096, Memory::Device).unwrap_err();
    assert!(matches!(&error, Error::OutOfDeviceMemory { name, requested, .. } if name == "much" && *requested >= 4096));
}

#[test]
fn host_visible_memory_is_mapped_by_the_allocator() {
    let Some(host) = host() else { return };
    let allocator = Allocator::new(&host);
    // SAFETY: the handles are those of a live host that outlives the engine.
    let gpu = unsafe { Gpu::adopt(host.describe(Some(allocator.clone())), &OpenOptions::default()) }.unwrap();
    let (buffer, values) = (gpu.buffer("there and back", 4000, Memory::Device).unwrap(), Vec::from_iter(0..1000_u32));
    gpu.write(&buffer, &values).unwrap();
    assert_eq!(gpu.read::<u32>(&buffer).unwrap(), values);
    assert!(gpu.memory_use().current >= 4000);
    drop((buffer, gpu));
    assert_eq!(allocator.lent().0, 0);
}
