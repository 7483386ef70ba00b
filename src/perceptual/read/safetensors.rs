//! `.safetensors`.

use std::path::Path;

use safetensors::{Dtype, SafeTensors};

use super::at_byte;
use super::half_floats::FloatFormat;
use crate::perceptual::Error;
use crate::perceptual::tensors::{Tensor, Tensors};

/// Reads the arrays of floats; other arrays are skipped.
pub(super) fn read(file: &Path, bytes: &[u8]) -> Result<Tensors, Error> {
    let all = SafeTensors::deserialize(bytes).map_err(|e| at_byte(file, 0, "safetensors header", e))?;
    let mut tensors = Tensors::new(file);
    for (name, view) in all.tensors() {
        let width = match view.dtype() {
            Dtype::F16 => FloatFormat::Half,
            Dtype::BF16 => FloatFormat::Brain,
            Dtype::F32 => FloatFormat::Single,
            Dtype::F64 => FloatFormat::Double,
            _ => continue,
        };
        tensors.insert(name, Tensor { shape: view.shape().to_vec(), values: width.numbers(view.data()) });
    }
    Ok(tensors)
}
