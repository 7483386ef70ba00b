//! Exclusive prefix sum of words in three passes: sums of blocks, prefix sum of the sums, prefix sums within blocks.
//! For few words, one workgroup in one pass.
//!
//! No workgroup waits for another. Each pass exists with hardware subgroup operations and with emulated ones.

use super::{Pass, module};
use crate::vk::{Binding, Constant, Kernel, read, read_write, write};

/// Threads in a workgroup.
pub const LOCAL_SIZE: u32 = 64;
/// Threads in the workgroup of [`ONCE`] on GPUs, where every turn waits for memory.
pub const WIDE_LOCAL_SIZE: u32 = 512;
/// Default of the constant `ITEMS`: consecutive words per thread.
pub const ITEMS: u32 = 16;

crate::push_constants! {
    /// Push constants of the passes.
    pub struct Push {
        /// Counter that holds the count, or [`super::plan::NO_COUNTER`].
        pub source: u32,
        /// The count for `NO_COUNTER`.
        pub count: u32,
        /// The number of words is `ceil(count / divide) * multiply`.
        pub divide: u32,
        /// See `divide`.
        pub multiply: u32,
        /// Nonzero: sum 1 for every nonzero word.
        pub predicate: u32,
        /// Counter that gets the total, or [`super::plan::NO_COUNTER`].
        pub total: u32,
    }
}

const HARDWARE: &[Constant] = &[Constant { id: 0, name: "ITEMS", default: ITEMS }];
const EMULATION: &[Constant] =
    &[Constant { id: 0, name: "ITEMS", default: ITEMS }, Constant { id: 100, name: "EMULATED_WIDTH", default: 32 }];

const fn pass(
    name: &'static str,
    bindings: &'static [Binding],
    constants: &'static [Constant],
    dispatch: &'static str,
) -> Pass {
    Pass {
        kernel: Kernel {
            name,
            spirv: module(name),
            bindings,
            push_bytes: Push::BYTES,
            constants,
            local_size: Some(LOCAL_SIZE),
        },
        doc: "One thread owns ITEMS words; a workgroup owns 64 * ITEMS consecutive ones.",
        dispatch,
        push: Push::FIELDS,
    }
}

const REDUCE_BINDINGS: &[Binding] = &[read("source"), read("counters"), write("sums")];
const SPINE_BINDINGS: &[Binding] = &[read_write("counters"), read_write("sums")];
const ADD_BINDINGS: &[Binding] = &[read("source"), read("counters"), read("sums"), write("target")];
const ONCE_BINDINGS: &[Binding] = &[read("source"), read_write("counters"), write("target")];
const PER_BLOCK: &str = "one workgroup per 64 * ITEMS words";

/// Sum of each block.
pub const REDUCE: Pass = pass("scan_reduce_subgroup", REDUCE_BINDINGS, HARDWARE, PER_BLOCK);
/// Prefix sum of the block sums, and the total.
pub const SPINE: Pass = pass("scan_spine_subgroup", SPINE_BINDINGS, HARDWARE, "one workgroup");
/// Prefix sum of every word.
pub const ADD: Pass = pass("scan_add_subgroup", ADD_BINDINGS, HARDWARE, PER_BLOCK);
/// [`REDUCE`] with emulated subgroups.
pub const REDUCE_EMULATED: Pass = pass("scan_reduce_emulated", REDUCE_BINDINGS, EMULATION, PER_BLOCK);
/// [`SPINE`] with emulated subgroups.
pub const SPINE_EMULATED: Pass = pass("scan_spine_emulated", SPINE_BINDINGS, EMULATION, "one workgroup");
/// [`ADD`] with emulated subgroups.
pub const ADD_EMULATED: Pass = pass("scan_add_emulated", ADD_BINDINGS, EMULATION, PER_BLOCK);
/// The whole prefix sum by one workgroup of LOCAL_SIZE threads.
pub const ONCE: Pass = {
    let constants = &[
        Constant { id: 0, name: "ITEMS", default: ITEMS },
        Constant { id: 1, name: "LOCAL_SIZE", default: LOCAL_SIZE },
    ];
    let once = pass("scan_once_subgroup", ONCE_BINDINGS, constants, "one workgroup");
    let kernel = Kernel { local_size: None, ..once.kernel };
    Pass { kernel, doc: "One thread owns ITEMS consecutive words of every LOCAL_SIZE * ITEMS.", ..once }
};
/// [`ONCE`] by one subgroup of 8 threads, for CPU devices.
pub const ONCE_RUNS: Pass = {
    let blocks = pass("scan_once_runs", ONCE_BINDINGS, &[], "one workgroup");
    let kernel = Kernel { local_size: Some(8), ..blocks.kernel };
    Pass { kernel, doc: "One thread owns a run of consecutive words, an eighth of all.", ..blocks }
};
/// [`ONCE`] with emulated subgroups.
pub const ONCE_EMULATED: Pass = pass("scan_once_emulated", ONCE_BINDINGS, EMULATION, "one workgroup");
