//! Measures the device: a copy, and arithmetic on registers only. Benchmarks derive lower bounds on time from the
//! results.

use super::{Pass, module};
use crate::vk::{Binding, Constant, Kernel, read, write};

/// Groups of four words that a workgroup of [`COPY`] owns.
pub const COPY_GROUPS: u32 = 256;
/// Chains of operations per thread of the arithmetic passes.
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
    /// Push constants of the arithmetic passes.
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

const SUMS: &[Binding] = &[write("sums")];
const LOCAL_SIZE: &[Constant] = &[Constant { id: 0, name: "LOCAL_SIZE", default: 8 }];

const fn rate(name: &'static str) -> Pass {
    Pass {
        kernel: Kernel {
            name,
            spirv: module(name),
            bindings: SUMS,
            push_bytes: RatePush::BYTES,
            constants: LOCAL_SIZE,
            local_size: None,
        },
        doc: "One thread owns eight chains of operations and their sum.",
        dispatch: "as many workgroups as take a time that can be measured",
        push: RatePush::FIELDS,
    }
}

/// Repeated x a + b: two operations each.
pub const MULTIPLY_ADD: Pass = rate("probe_rate_multiply_add");
/// Repeated 2^-x.
pub const EXP2: Pass = rate("probe_rate_exp2");
