//! Passes for one digit of a stable radix sort of (key, value) words: digit counts, and the scatter.
//!
//! Between them runs one prefix sum over the table of digit counts (runs), or one per row of the table ([`ROWS`],
//! groups). Two shapes: `RUNS` for CPU devices (a thread owns a block and private counters), `GROUPS` for GPUs (a
//! workgroup owns a block). Digits have up to 8 bits.

use super::{Pass, module};
use crate::vk::{Binding, Constant, Kernel, read, write};

/// Threads in a workgroup of the runs shape, each with a block of its own.
pub const RUNS_LOCAL_SIZE: u32 = 8;
/// Default of the constant `BLOCK`: keys per thread of the runs shape.
pub const RUNS_BLOCK: u32 = 1024;
/// Most bits of a digit.
pub const MOST_BITS: u32 = 8;
/// Threads in a workgroup of the groups shape.
pub const GROUPS_LOCAL_SIZE: u32 = 256;
/// Default of the constant `ITEMS`: keys per thread of the groups shape.
pub const GROUPS_ITEMS: u32 = 8;

crate::push_constants! {
    /// Push constants of the radix passes.
    pub struct Push {
        /// Counter that holds the number of keys, or [`super::plan::NO_COUNTER`].
        pub source: u32,
        /// The number of keys for `NO_COUNTER`.
        pub count: u32,
        /// A key's digit is `(key >> shift) & mask`.
        pub shift: u32,
        /// See `shift`.
        pub mask: u32,
        /// Rows of the table, more than `mask`.
        pub digits: u32,
    }
}

const RUNS: &[Constant] = &[Constant { id: 0, name: "BLOCK", default: RUNS_BLOCK }];
const GROUPS: &[Constant] = &[Constant { id: 0, name: "ITEMS", default: GROUPS_ITEMS }];
const SUBGROUPS: &[Constant] =
    &[Constant { id: 0, name: "ITEMS", default: GROUPS_ITEMS }, Constant { id: 1, name: "WIDTH", default: 32 }];
const EMULATED: &[Constant] = &[
    Constant { id: 0, name: "ITEMS", default: GROUPS_ITEMS },
    Constant { id: 100, name: "EMULATED_WIDTH", default: 32 },
];

const COUNT: &[Binding] = &[read("keys"), read("counters"), write("table")];
const ROWS_OF_TABLE: &[Binding] = &[read("counters"), read("table"), write("places")];
const SCATTER: &[Binding] =
    &[read("keys"), read("vals"), read("counters"), read("places"), write("keys_out"), write("vals_out")];

const fn pass(name: &'static str, bindings: &'static [Binding], constants: &'static [Constant]) -> Pass {
    let runs = constants.len() == 1 && constants[0].default == RUNS_BLOCK;
    Pass {
        kernel: Kernel {
            name,
            spirv: module(name),
            bindings,
            push_bytes: Push::BYTES,
            constants,
            local_size: Some(if runs { RUNS_LOCAL_SIZE } else { GROUPS_LOCAL_SIZE }),
        },
        doc: if runs {
            "One thread owns BLOCK consecutive keys; a workgroup owns 8 blocks."
        } else {
            "One thread owns ITEMS keys; a workgroup owns a block of 256 * ITEMS."
        },
        dispatch: if runs { "one thread per BLOCK keys" } else { "one workgroup per 256 * ITEMS keys" },
        push: Push::FIELDS,
    }
}

/// Digit counts, runs shape.
pub const COUNT_RUNS: Pass = pass("radix_count_runs", COUNT, RUNS);
/// Digit counts, groups shape.
pub const COUNT_GROUPS: Pass = pass("radix_count_groups", COUNT, GROUPS);
/// Scatter by a digit, runs shape.
pub const SCATTER_RUNS: Pass = pass("radix_scatter_runs", SCATTER, RUNS);
/// Scatter by a digit, groups shape. WIDTH is the subgroup width.
pub const SCATTER_GROUPS: Pass = pass("radix_scatter_groups", SCATTER, SUBGROUPS);
/// Scatter by a digit, groups shape with emulated subgroups.
pub const SCATTER_GROUPS_EMULATED: Pass = pass("radix_scatter_groups_emulated", SCATTER, EMULATED);

const fn rows(name: &'static str, constants: &'static [Constant]) -> Pass {
    Pass {
        kernel: Kernel {
            name,
            spirv: module(name),
            bindings: ROWS_OF_TABLE,
            push_bytes: Push::BYTES,
            constants,
            local_size: Some(GROUPS_LOCAL_SIZE),
        },
        doc: "A workgroup owns a digit, a row of the table; one thread owns 4 of every 1,024 words of it.",
        dispatch: "one workgroup per digit",
        push: Push::FIELDS,
    }
}

/// Prefix sums within the rows of the table, followed by the sums of the rows; groups shape.
pub const ROWS: Pass = rows("radix_rows_subgroup", GROUPS);
/// [`ROWS`] with emulated subgroups.
pub const ROWS_EMULATED: Pass = rows("radix_rows_emulated", EMULATED);
