//! PyTorch's `.pth`: a pickle that describes the tensors, and their storages; concatenated (the legacy format) or in a
//! zip archive.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io::{Cursor, Read};
use std::path::Path;

use super::half_floats::FloatFormat;
use super::pickle::{self, Object, Pickle, Value};
use super::{LARGEST, at_byte, slice};
use crate::perceptual::Error;
use crate::perceptual::tensors::{Tensor, Tensors};

/// First value of the legacy format: 0x1950a86a20f9469cfc6c.
const MAGIC: [u8; 10] = [0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19];

/// Largest number of axes: many tensors may refer to one shape in the pickle, and each gets a copy.
const MOST_AXES: usize = 8;

/// Bytes that the tensors may take for each byte of the file: tensors may share a storage, and half floats become
/// floats.
const PER_BYTE: u64 = 8;

/// A tensor as the pickle describes it.
struct Described<'a> {
    name: &'a str,
    key: &'a str,
    width: FloatFormat,
    /// Number of values in its storage.
    stored: usize,
    /// Index of its first value in the storage.
    offset: usize,
    /// Number of values.
    count: usize,
    shape: Vec<usize>,
}

/// Reads the legacy format: three headers, the pickle, the keys of the storages, the storages.
pub(super) fn read_old(file: &Path, bytes: &[u8]) -> Result<Tensors, Error> {
    let magic = pickle::read(file, bytes, 0)?;
    if !matches!(&magic.top, Value::Big(number) if **number == MAGIC) {
        return Err(at_byte(file, 0, "magic number", "is not PyTorch's"));
    }
    let protocol = pickle::read(file, bytes, magic.end)?;
    let system = pickle::read(file, bytes, protocol.end)?;
    let data = pickle::read(file, bytes, system.end)?;
    let keys = pickle::read(file, bytes, data.end)?;
    let described = described(file, &data)?;
    let mut at = keys.end;
    let mut storages = BTreeMap::new();
    let order =
        keys.parts(&keys.top).ok_or_else(|| at_byte(file, data.end, "keys of the storages", "are not a list"))?;
    let widths = widths(&data);
    for key in order {
        let Value::Text(key) = key else {
            return Err(at_byte(file, data.end, "keys of the storages", "are not text"));
        };
        let field = || format!("storage {key}");
        let count = slice(file, bytes, at, 8, field())?;
        let count = u64::from_le_bytes(count.try_into().unwrap_or_default());
        at += 8;
        let width = widths.get(&**key).copied().ok_or_else(|| at_byte(file, at, field(), "belongs to no tensor"))?;
        let size = usize::try_from(count).ok().and_then(|c| c.checked_mul(width)).unwrap_or(usize::MAX);
        storages.insert(key.to_string(), slice(file, bytes, at, size, field())?);
        at += size;
    }
    let missing = |key: &str| at_byte(file, at, format!("storage {key}"), "is missing");
    tensors(file, bytes.len() as u64, &described, |key| {
        storages.get(key).map(|s| Cow::Borrowed(*s)).ok_or_else(|| missing(key))
    })
}

/// Reads a zip archive with `NAME/data.pkl` and `NAME/data/KEY`.
pub(super) fn read_zip(file: &Path, bytes: &[u8]) -> Result<Tensors, Error> {
    let broken = |what: &str, e: &dyn std::fmt::Display| at_byte(file, 0, what, e);
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).map_err(|e| broken("zip archive", &e))?;
    let mut names = archive.file_names().flatten().map(|name| name.into_owned());
    let index = names.find(|name| name.ends_with("/data.pkl"));
    drop(names);
    let index = index.ok_or_else(|| broken("zip archive", &"has no data.pkl, so PyTorch did not write it"))?;
    let mut entry = |name: &str| -> Result<Vec<u8>, Error> {
        let entry = archive.by_name(name).map_err(|e| broken(name, &e))?;
        let size = entry.size();
        if size > bytes.len() as u64 {
            return Err(broken(name, &format_args!("claims {size} bytes, the file has {}", bytes.len())));
        }
        let mut out = Vec::with_capacity(size as usize);
        entry.take(size).read_to_end(&mut out).map_err(|e| broken(name, &e))?;
        Ok(out)
    };
    let root = index.trim_end_matches("data.pkl").to_owned();
    let pickled = entry(&index)?;
    let data = pickle::read(file, &pickled, 0)?;
    tensors(file, bytes.len() as u64, &described(file, &data)?, |key| {
        entry(&format!("{root}data/{key}")).map(Cow::Owned)
    })
}

/// Bytes per value of each storage that the pickle names.
fn widths(data: &Pickle) -> BTreeMap<&str, usize> {
    let persistent = data.objects.iter().filter_map(|o| if let Object::Persistent(id) = o { Some(id) } else { None });
    let one = |id| match data.parts(id)? {
        [_, Value::Global(class), Value::Text(key), ..] => Some((&**key, bytes_of(class)?)),
        _ => None,
    };
    persistent.filter_map(one).collect()
}

fn bytes_of(class: &str) -> Option<usize> {
    Some(match class {
        "torch.DoubleStorage" | "torch.LongStorage" => 8,
        "torch.FloatStorage" | "torch.IntStorage" => 4,
        "torch.HalfStorage" | "torch.BFloat16Storage" | "torch.ShortStorage" => 2,
        "torch.ByteStorage" | "torch.CharStorage" | "torch.BoolStorage" => 1,
        _ => return None,
    })
}

/// The tensors of floats in a dictionary of tensors; other entries are skipped.
fn described<'a>(file: &Path, data: &'a Pickle) -> Result<Vec<Described<'a>>, Error> {
    let wrong = |what: &str| at_byte(file, 0, "pickle", what);
    let pairs: Vec<(&Value, &Value)> = match data.object(&data.top) {
        Some(Object::Dict(items)) => items.iter().map(|(k, v)| (k, v)).collect(),
        Some(Object::Call { function: Value::Global(class), arguments, items })
            if **class == *"collections.OrderedDict" =>
        {
            let lists = data.parts(arguments).and_then(|parts| data.parts(parts.first()?)).unwrap_or_default();
            let listed = lists.iter().filter_map(|pair| match data.parts(pair)? {
                [k, v] => Some((k, v)),
                _ => None,
            });
            listed.chain(items.iter().map(|(k, v)| (k, v))).collect()
        }
        _ => return Err(wrong("is not a dictionary of tensors")),
    };
    let mut out = Vec::new();
    for (name, value) in pairs {
        if let Value::Text(name) = name {
            out.extend(tensor(file, data, name, value)?);
        }
    }
    Ok(out)
}

/// A tensor, or `None` where the value is no tensor of floats.
fn tensor<'a>(file: &Path, data: &'a Pickle, name: &'a str, value: &'a Value) -> Result<Option<Described<'a>>, Error> {
    let Some(Object::Call { function: Value::Global(function), arguments, .. }) = data.object(value) else {
        return Ok(None);
    };
    let arguments = data.parts(arguments).unwrap_or_default();
    let arguments = match (&**function, arguments) {
        ("torch._utils._rebuild_tensor_v2" | "torch._utils._rebuild_tensor", arguments) => arguments,
        ("torch._utils._rebuild_parameter", [inner, ..]) => return tensor_of_parameter(file, data, name, inner),
        _ => return Ok(None),
    };
    let wrong = |what: &str| at_byte(file, 0, format!("tensor '{name}'"), what);
    let [storage, Value::Int(offset), shape, strides, ..] = arguments else {
        return Err(wrong("has an unknown description"));
    };
    let Some(Object::Persistent(id)) = data.object(storage) else { return Err(wrong("has no storage")) };
    let Some([_, Value::Global(class), Value::Text(key), _, Value::Int(stored), ..]) = data.parts(id) else {
        return Err(wrong("has a storage with an unknown description"));
    };
    let width = match &**class {
        "torch.FloatStorage" => FloatFormat::Single,
        "torch.HalfStorage" => FloatFormat::Half,
        "torch.BFloat16Storage" => FloatFormat::Brain,
        "torch.DoubleStorage" => FloatFormat::Double,
        _ => return Ok(None),
    };
    let sizes = |value: &Value| -> Option<Vec<usize>> {
        let one = |v: &Value| if let Value::Int(n) = v { usize::try_from(*n).ok() } else { None };
        data.parts(value)?.iter().map(one).collect()
    };
    let (Some(shape), Some(strides)) = (sizes(shape), sizes(strides)) else {
        return Err(wrong("has a shape or strides that are no sizes"));
    };
    if shape.len() > MOST_AXES {
        return Err(wrong("has more axes than any weights have"));
    }
    let mut expected = 1usize;
    for (size, stride) in shape.iter().zip(&strides).rev() {
        if *size > 1 && *stride != expected {
            return Err(wrong("is not stored row by row"));
        }
        expected = expected.saturating_mul(*size);
    }
    let (Ok(stored), Ok(offset)) = (usize::try_from(*stored), usize::try_from(*offset)) else {
        return Err(wrong("has a storage of a negative size"));
    };
    if shape.len() != strides.len() || offset.saturating_add(expected) > stored {
        return Err(wrong("is larger than its storage"));
    }
    Ok(Some(Described { name, key, width, stored, offset, count: expected, shape }))
}

/// The tensor inside a parameter; `None` for a parameter inside a parameter.
fn tensor_of_parameter<'a>(
    file: &Path,
    data: &'a Pickle,
    name: &'a str,
    inner: &'a Value,
) -> Result<Option<Described<'a>>, Error> {
    match data.object(inner) {
        Some(Object::Call { function: Value::Global(f), .. }) if **f == *"torch._utils._rebuild_parameter" => Ok(None),
        _ => tensor(file, data, name, inner),
    }
}

/// Reads the tensors' values from the bytes of their storages.
fn tensors<'b>(
    file: &Path,
    size: u64,
    described: &[Described<'_>],
    mut storage: impl FnMut(&str) -> Result<Cow<'b, [u8]>, Error>,
) -> Result<Tensors, Error> {
    let mut out = Tensors::new(file);
    // Tensors may share a storage, and storages may share the bytes of an archive: either total may exceed the file.
    let numbers = described.iter().fold(0usize, |sum, t| sum.saturating_add(t.count.saturating_mul(4)));
    let sizes: BTreeMap<&str, usize> =
        described.iter().map(|t| (t.key, t.stored.saturating_mul(t.width.bytes()))).collect();
    let stored = sizes.values().fold(0usize, |sum, size| sum.saturating_add(*size));
    let all = numbers.max(stored);
    if all as u64 > LARGEST.min((PER_BYTE * size).saturating_add(1 << 20)) {
        return Err(at_byte(file, 0, "tensors", format_args!("{all} bytes are more than any weights have")));
    }
    let mut storages: BTreeMap<&str, Cow<'b, [u8]>> = BTreeMap::new();
    for t in described {
        let bytes = match storages.entry(t.key) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(place) => place.insert(storage(t.key)?),
        };
        let field = || format!("tensor '{}'", t.name);
        let expected = t.stored.saturating_mul(t.width.bytes());
        if bytes.len() != expected {
            let problem = format_args!("its storage has {} bytes, expected {expected}", bytes.len());
            return Err(at_byte(file, 0, field(), problem));
        }
        let part = slice(file, bytes, t.offset * t.width.bytes(), t.count * t.width.bytes(), field())?;
        out.insert(t.name, Tensor { shape: t.shape.clone(), values: t.width.numbers(part) });
    }
    Ok(out)
}
