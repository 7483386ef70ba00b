//! Writes one value to a range of words.

use super::{Pass, module};
use crate::vk::{Kernel, write};

crate::push_constants! {
    /// Push constants of [`PASS`].
    pub struct Push {
        /// Words to write.
        pub count: u32,
        /// The value.
        pub value: u32,
    }
}

/// The pass.
pub const PASS: Pass = Pass {
    kernel: Kernel {
        name: "fill",
        spirv: module("fill"),
        bindings: &[write("target")],
        push_bytes: Push::BYTES,
        constants: &[],
        local_size: Some(64),
    },
    doc: "One thread owns one word; a workgroup owns 64 consecutive words.",
    dispatch: "one thread per word",
    push: Push::FIELDS,
};
