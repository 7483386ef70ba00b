//! Orders the rows after a density change along a space-filling curve.
//!
//! Decisions, identities and random draws follow the order of birth, so the order in memory does not matter. `BIRTHS`
//! writes keys that sort the old rows by birth, and `FLAGS` reorders the flags accordingly. `CODES` writes keys that
//! sort the new rows along the curve, and `ORDER` reorders map and identities accordingly.

use super::{Pass, module};
use crate::vk::{Binding, Kernel, read, read_write, write};

crate::push_constants! {
    /// Push constants of [`BIRTHS`] and [`FLAGS`].
    pub struct Push {
        /// Rows of the capacity: words between the four segments of flags.
        pub stride: u32,
    }
}

crate::push_constants! {
    /// Push constants of [`CODES`].
    pub struct CodesPush {
        /// Inverse of the distance from the origin within which cells are smallest.
        pub scale: f32,
    }
}

/// Bits of a curve code.
pub const CODE_BITS: u32 = 30;

const fn kernel(name: &'static str, bindings: &'static [Binding], push_bytes: u32) -> Kernel {
    Kernel { name, spirv: module(name), bindings, push_bytes, constants: &[], local_size: Some(64) }
}

/// Writes identities as sort keys, and rows as values.
pub const BIRTHS: Pass = Pass {
    kernel: kernel("densify_births", &[read("counters"), read("ids"), write("keys"), write("vals")], Push::BYTES),
    doc: "One thread owns one row of the capacity; a workgroup owns 64 consecutive rows. Rows beyond the model get \
        the largest key.",
    dispatch: "one thread per splat of the capacity",
    push: Push::FIELDS,
};

/// Reorders flags from row order to the order of birth.
pub const FLAGS: Pass = Pass {
    kernel: kernel("densify_flags", &[read("row_of"), read("by_row"), write("flags")], Push::BYTES),
    doc: "One thread owns one splat of the capacity and its four flags; a workgroup owns 64 consecutive splats.",
    dispatch: "one thread per splat of the capacity",
    push: Push::FIELDS,
};

/// Writes curve codes of the new rows as sort keys, and their ranks in the order of birth as values.
pub const CODES: Pass = Pass {
    kernel: kernel(
        "densify_codes",
        &[read("counters"), read("row_of"), read("means"), read_write("map"), write("codes"), write("births")],
        CodesPush::BYTES,
    ),
    doc: "One thread owns one new row, counted in the order of birth; a workgroup owns 64 consecutive rows. Entries \
          of `map` name the source by its rank in the order of birth before, and by its row after.",
    dispatch: "one thread per new row, through `args`",
    push: CodesPush::FIELDS,
};

/// Reorders map and identities into the sorted order of the codes.
pub const ORDER: Pass = Pass {
    kernel: kernel(
        "densify_order",
        &[read("counters"), read("births"), read("map_by_birth"), read("ids_by_birth"), write("map"), write("ids")],
        0,
    ),
    doc: "One thread owns one new row; a workgroup owns 64 consecutive rows.",
    dispatch: "one thread per new row, through `args`",
    push: &[],
};
