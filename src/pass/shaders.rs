//! The SPIR-V modules that `build.rs` compiled into the binary.

use crate::vk::{Spirv, TexelFormat, TexelView, Texels};

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));

/// SPIR-V of the shader called `name` (file stem, or stem_variant). Evaluated at compile time in the passes' constants,
/// so a wrong name fails the build.
pub const fn module(name: &str) -> Spirv {
    let mut i = 0;
    while i < MODULES.len() {
        if same(MODULES[i].0.as_bytes(), name.as_bytes()) {
            return MODULES[i].1;
        }
        i += 1;
    }
    panic!("no shader of that name in glsl/")
}

const fn same(a: &[u8], b: &[u8]) -> bool {
    if a.len() != b.len() {
        return false;
    }
    let mut i = 0;
    while i < a.len() {
        if a[i] != b[i] {
            return false;
        }
        i += 1;
    }
    true
}
