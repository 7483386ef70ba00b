//! Turns counts into workgroup counts for indirect dispatches, and voids an event.

use super::{Pass, module};
use crate::vk::{Kernel, read_write, write};

/// "No counter" in push constants.
pub const NO_COUNTER: u32 = u32::MAX;

/// Most entries that one dispatch of `plan` writes.
pub const MOST_ENTRIES: usize = 8;

/// Most workgroups on one axis; more workgroups are spread over y.
pub const MOST_ON_AXIS: u32 = 32_768;

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Counter that holds the count.
        pub source: u32,
        /// Largest count that fits.
        pub capacity: u32,
        /// Bit to set in `status` when the count does not fit.
        pub status_bit: u32,
        /// Counter that keeps the largest count seen, or [`NO_COUNTER`].
        pub want: u32,
        /// First entry of `args` to write.
        pub first: u32,
        /// Entries to write, at most [`MOST_ENTRIES`].
        pub entries: u32,
        /// Number of entries, from the first entry of `args`, to zero when the event is void.
        pub void_entries: u32,
        /// Per entry, the number of elements is `ceil(count / divide) * multiply`.
        pub divide: [u32; 8],
        /// See `divide`.
        pub multiply: [u32; 8],
        /// Elements per workgroup; 0 stands for `multiply` workgroups regardless of the count.
        pub items: [u32; 8],
    }
}

/// Plan of one entry of `args`: how a count becomes a number of workgroups.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// The number of elements is `ceil(count / divide) * multiply`.
    pub divide: u32,
    /// See `divide`.
    pub multiply: u32,
    /// Elements per workgroup; 0 stands for `multiply` workgroups regardless of the count.
    pub items: u32,
}

impl Entry {
    /// One workgroup per `items` elements.
    pub const fn items(items: u32) -> Entry {
        Entry { divide: 1, multiply: 1, items }
    }

    /// `groups` workgroups regardless of the count, even for a count of zero.
    pub const fn fixed(groups: u32) -> Entry {
        Entry { divide: 1, multiply: groups, items: 0 }
    }

    /// Byte offset of entry `n` in `args`.
    pub const fn offset(n: u32) -> u64 {
        16 * n as u64
    }
}

impl Push {
    /// Plans `entries` (at most [`MOST_ENTRIES`]; further entries are ignored) from entry `first` on, for a count
    /// without a limit.
    pub fn unlimited(source: u32, first: u32, entries: &[Entry]) -> Push {
        let mut push = Push {
            source,
            capacity: u32::MAX,
            want: NO_COUNTER,
            first,
            entries: entries.len().min(MOST_ENTRIES) as u32,
            divide: [1; 8],
            multiply: [1; 8],
            ..Push::default()
        };
        for (i, entry) in entries.iter().take(MOST_ENTRIES).enumerate() {
            push.divide[i] = entry.divide;
            push.multiply[i] = entry.multiply;
            push.items[i] = entry.items;
        }
        push
    }

    /// Also zeroes the first `entries` entries of `args` when the event is void.
    pub fn voiding(self, entries: u32) -> Push {
        Push { void_entries: entries, ..self }
    }

    /// Adds a capacity, the status bit for a count above the capacity, and the counter that keeps the largest count.
    pub fn limited(self, capacity: u32, status_bit: u32, want: u32) -> Push {
        Push { capacity, status_bit, want, ..self }
    }
}

/// Turns a count into workgroup counts; zeros when the count does not fit or `status` is set. Zeros can extend to
/// entries planned before: see [`Push::voiding`].
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "plan",
        spirv: module("plan"),
        bindings: &[read_write("counters"), write("args")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(1),
    },
    doc: "One thread owns everything.",
    dispatch: "one workgroup",
    push: Push::FIELDS,
};
