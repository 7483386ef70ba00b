//! Files of weights. Sizes that a file claims are checked against its length before memory is allocated.

mod half_floats;
mod ncnn;
mod pickle;
mod safetensors;
mod torch;

use std::fs;
use std::path::Path;

use super::{Error, Tensors};
use crate::format;

/// Largest file that is read, in bytes: the trunk has 5 MB.
const LARGEST: u64 = 1 << 28;

/// Reads the arrays of a file: ncnn (`.param` with the `.bin` beside it), PyTorch's `.pth` (legacy and zip format),
/// safetensors.
pub fn read_tensors(file: &Path) -> Result<Tensors, Error> {
    let ending = file.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    if ending == "param" || ending == "bin" {
        return ncnn::read(&file.with_extension("param"), &file.with_extension("bin"));
    }
    let bytes = whole(file)?;
    if bytes.starts_with(b"PK\x03\x04") {
        torch::read_zip(file, &bytes)
    } else if bytes.starts_with(&[0x80, 2]) {
        torch::read_old(file, &bytes)
    } else if ending == "safetensors" || bytes.get(8) == Some(&b'{') {
        safetensors::read(file, &bytes)
    } else {
        Err(Error::UnknownFormat { file: file.to_owned() })
    }
}

/// All bytes of a file; fails for a file too large to hold weights.
fn whole(file: &Path) -> Result<Vec<u8>, Error> {
    let size = fs::metadata(file).map_err(format::Error::io(file, "open"))?.len();
    if size > LARGEST {
        return Err(at_byte(file, 0, "size", format_args!("{size} bytes are more than any weights have")));
    }
    Ok(fs::read(file).map_err(format::Error::io(file, "read"))?)
}

/// An error in a field at a byte.
fn at_byte(file: &Path, at: usize, field: impl std::fmt::Display, problem: impl std::fmt::Display) -> Error {
    format::Error::malformed(file, field, format::At::Byte(at as u64), problem).into()
}

/// `count` bytes from `at` on.
fn slice<'a>(
    file: &Path,
    bytes: &'a [u8],
    at: usize,
    count: usize,
    field: impl std::fmt::Display,
) -> Result<&'a [u8], Error> {
    let rest = bytes.get(at..).unwrap_or_default();
    rest.get(..count)
        .ok_or_else(|| at_byte(file, at, field, format_args!("needs {count} bytes, the file has {} more", rest.len())))
}
