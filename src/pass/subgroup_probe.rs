//! Every subgroup operation on one word per thread, to test a device.

use super::{Pass, module};
use crate::vk::{Binding, Constant, Kernel, read, write};

/// Threads in a workgroup.
pub const LOCAL_SIZE: u32 = 128;
/// Words of results per thread.
pub const RESULTS: usize = 12;

crate::push_constants! {
    /// Push constants of the passes.
    pub struct Push {
        /// Expected subgroup width.
        pub width: u32,
    }
}

const BINDINGS: &[Binding] = &[read("source"), write("results")];

const fn pass(name: &'static str, constants: &'static [Constant]) -> Pass {
    Pass {
        kernel: Kernel {
            name,
            spirv: module(name),
            bindings: BINDINGS,
            push_bytes: Push::BYTES,
            constants,
            local_size: Some(LOCAL_SIZE),
        },
        doc: "One thread owns one word and 12 words of results; a workgroup owns 128 consecutive words.",
        dispatch: "one thread per word",
        push: Push::FIELDS,
    }
}

/// The hardware's operations.
pub const SUBGROUP: Pass = pass("subgroup_probe_subgroup", &[]);
/// The emulation in shared memory.
pub const EMULATED: Pass =
    pass("subgroup_probe_emulated", &[Constant { id: 100, name: "EMULATED_WIDTH", default: 32 }]);
