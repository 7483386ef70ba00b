//! Measures the device: a copy, and arithmetic on registers only. Benchmarks derive lower bounds on time from the
//! results.

use super::{Pass, module};
use crate::vk::{Constant, Kernel, read, write};

/// Groups of four words that a workgroup of [`COPY`] owns.
pub const COPY_GROUPS: u32 = 256;
/// Chains of operations per thread of [`RATE`].
pub const CHAINS: u32 = 8;
/// Operations per chain and turn of the loop.
pub const UNROLL: u32 = 8;

crate::push_constants! {
    /// Push constants of [`COPY`].
    pub struct CopyPush {
        /// Number of groups of four words.
        pub count: u32,
    }
}

crate::push_constants! {
    /// Push constants of [`RATE`].
    pub struct RatePush {
        /// Turns of [`UNROLL`] operations in every chain, at most 65,535.
        pub turns: u32,
        /// Threads that write a sum.
        pub threads: u32,
        /// Factor of a multiply-add.
        pub a: f32,
        /// Summand of a multiply-add.
        pub b: f32,
    }
}

/// Copies four words at a time.
pub const COPY: Pass = Pass {
    kernel: Kernel {
        name: "probe_copy",
        spirv: module("probe_copy"),
        bindings: &[read("source"), write("target")],
        push_bytes: CopyPush::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns four groups of four words; a workgroup owns 256 consecutive groups.",
    dispatch: "one workgroup per 256 groups of four words",
    push: CopyPush::FIELDS,
};

/// Repeated x a + b, two operations each; with the constant `EXP2` repeated 2^-x.
pub const RATE: Pass = Pass {
    kernel: Kernel {
        name: "probe_rate",
        spirv: module("probe_rate"),
        bindings: &[write("sums")],
        push_bytes: RatePush::BYTES,
        constants: &[Constant { id: 0, name: "LOCAL_SIZE", default: 8 }, Constant { id: 1, name: "EXP2", default: 0 }],
        local_size: None,
    },
    doc: "One thread owns eight chains of operations and their sum.",
    dispatch: "as many workgroups as take a time that can be measured",
    push: RatePush::FIELDS,
};
