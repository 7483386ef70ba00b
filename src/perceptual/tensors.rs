//! Named arrays of a file of weights.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::Error;

/// An array in row-major order.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Extent of each axis.
    pub shape: Vec<usize>,
    /// The values; their number is the product of the extents.
    pub values: Vec<f32>,
}

/// The arrays of a file.
#[derive(Clone, Debug)]
pub struct Tensors {
    file: PathBuf,
    tensors: BTreeMap<String, Tensor>,
}

impl Tensors {
    /// No arrays yet; messages name `file`.
    pub fn new(file: &Path) -> Self {
        Self { file: file.to_owned(), tensors: BTreeMap::new() }
    }

    /// Adds an array, or replaces the array of this name.
    pub fn insert(&mut self, name: impl Into<String>, tensor: Tensor) {
        self.tensors.insert(name.into(), tensor);
    }

    /// The file.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The names of the arrays.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    /// The values of an array; empty where the array is missing.
    pub fn values(&self, name: &str) -> &[f32] {
        self.tensors.get(name).map_or(&[], |tensor| &tensor.values)
    }

    /// The values of an array of `network`. Fails unless the array exists, has the given shape and is finite.
    pub fn get(&self, name: &str, shape: &[usize], network: &'static str) -> Result<&[f32], Error> {
        let (file, field) = (|| self.file.clone(), || name.to_owned());
        let tensor = self.tensors.get(name).ok_or_else(|| Error::Missing { file: file(), field: field(), network })?;
        if tensor.shape != shape || tensor.values.len() != shape.iter().product::<usize>() {
            let (found, wanted) = (tensor.shape.clone(), shape.to_vec());
            return Err(Error::Shape { file: file(), field: field(), found, wanted });
        }
        match tensor.values.iter().find(|v| !v.is_finite()) {
            Some(&value) => Err(Error::Value { file: file(), field: field(), value }),
            None => Ok(&tensor.values),
        }
    }
}
