//! SPZ, versions 1 to 4: fixed steps for every value, compressed with gzip (1 to 3) or zstd (4).
//!
//! | value | bytes | step |
//! |---|---|---|
//! | position | 3 x 24 bits, signed, with a number of fractional bits for the file | 2^-bits |
//! | opacity | 1: `255 opacity` | 1/255 |
//! | colour | 3: `0.15 * 255 c + 127.5` | 0.026, from -3.3 to 3.3 |
//! | scale | 3: `16 (ln s + 10)` | 1/16 of the logarithm, from -10 to 5.9 |
//! | rotation, version 2 | x, y, z as `127.5 q + 127.5` | 1/127.5 |
//! | rotation, versions 3, 4 | 32 bits: index of the largest of x, y, z, w, and sign and 9 bits of the others | 1/723 |
//! | harmonics | 1 each: `128 + 128 c`; even in degree 1, multiples of 4 above | 1/64 and 1/32, from -1 to 1 |
//!
//! The reference writer takes steps of 1/16 and 1/8 for harmonics, which are coarser than most harmonics of trained
//! models are large. Readers need not know.
//!
//! The axes of a file are right, up, back: y and z of models are negated, so that the up of viewers, -y, is +y.
//! Version 1 has positions of 16-bit floats; nothing writes that version any more.

mod read;
mod write;

pub use read::decode;
pub use write::{Version, encode};

/// First bytes of the header: `NGSP`.
pub(super) const MAGIC: [u8; 4] = *b"NGSP";
/// Flag: opacities carry the anti-aliasing factor.
const ANTIALIASED: u8 = 1;
/// Flag: data of other programs lies between header and table.
const EXTENSIONS: u8 = 2;
/// Bytes of the header of version 4, and of earlier ones.
const HEADER: usize = 32;
const OLD_HEADER: usize = 16;
/// Steps of a colour per unit.
const COLOUR: f64 = 0.15 * 255.0;

/// Bytes of a splat in each of the six parts of a file: positions, opacities, colours, scales, rotations, harmonics.
fn parts(version: u32, degree: u32) -> [usize; 6] {
    let (position, rotation) = (if version == 1 { 6 } else { 9 }, if version < 3 { 3 } else { 4 });
    [position, 1, 3, 3, rotation, 3 * super::encoding::rest(degree)]
}
