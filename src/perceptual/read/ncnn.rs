//! SqueezeNet 1.1 in ncnn's format: `.param` (text, a layer per line) and `.bin` (the layers' weights one after the
//! other).

use std::path::Path;

use super::half_floats::FloatFormat;
use super::{at_byte, slice, whole};
use crate::format::source::{Line, Lines};
use crate::perceptual::Error;
use crate::perceptual::squeezenet::{self, NETWORK};
use crate::perceptual::tensors::{Tensor, Tensors};

/// First line of a `.param`.
const MAGIC: &str = "7767517";
/// Tag before numbers of 16 bits in a `.bin`.
const HALF: u32 = 0x0130_6B47;
/// Tags before numbers of 32 bits.
const SINGLE: [u32; 2] = [0, 0x0002_C056];

/// A convolution layer of a `.param`.
struct Convolution {
    name: String,
    outputs: usize,
    kernel: usize,
    /// Number of filter weights.
    values: usize,
    /// Name of its output.
    blob: String,
}

/// Reads both files; the arrays get torchvision's names.
pub(super) fn read(param: &Path, bin: &Path) -> Result<Tensors, Error> {
    let layers = convolutions(param)?;
    let bytes = whole(bin)?;
    let mut at = 0;
    let mut tensors = Tensors::new(bin);
    for (layer, target) in layers.iter().zip(squeezenet::names()) {
        let field = |what: &str| format!("{what} of {}", layer.name);
        let tag = slice(bin, &bytes, at, 4, field("tag"))?;
        let width = match u32::from_le_bytes([tag[0], tag[1], tag[2], tag[3]]) {
            HALF => FloatFormat::Half,
            tag if SINGLE.contains(&tag) => FloatFormat::Single,
            tag => {
                return Err(at_byte(bin, at, field("tag"), format_args!("{tag:#010x} is no known number format")));
            }
        };
        at += 4;
        let size = layer.values.saturating_mul(width.bytes());
        let values = width.numbers(slice(bin, &bytes, at, size, field("filters"))?);
        at += size.next_multiple_of(4);
        let size = layer.outputs.saturating_mul(4);
        let biases = FloatFormat::Single.numbers(slice(bin, &bytes, at, size, field("biases"))?);
        at += size;
        let (outputs, kernel) = (layer.outputs, layer.kernel);
        let of_input = outputs.saturating_mul(kernel).saturating_mul(kernel).max(1);
        let inputs = layer.values / of_input;
        tensors.insert(format!("{target}.weight"), Tensor { shape: vec![outputs, inputs, kernel, kernel], values });
        tensors.insert(format!("{target}.bias"), Tensor { shape: vec![outputs], values: biases });
    }
    match bytes.len() - at.min(bytes.len()) {
        0 => Ok(tensors),
        left => Err(at_byte(bin, at, "end", format_args!("{left} bytes follow the last layer of the .param"))),
    }
}

/// The convolutions of a `.param` in the order of [`squeezenet::names`]: a fire module's 1x1 expansion before the 3x3
/// one. Fails for a wrong number of convolutions, or where the expansions are concatenated in the other order.
fn convolutions(param: &Path) -> Result<Vec<Convolution>, Error> {
    let mut lines = Lines::open(param)?;
    let first = lines.next()?.map(|line| line.text.trim() == MAGIC);
    if first != Some(true) {
        return Err(lines.error("first line", format_args!("is not {MAGIC}")).into());
    }
    lines.next()?;
    let mut found: Vec<Convolution> = Vec::new();
    while let Some(mut line) = lines.next()? {
        if line.text.trim().is_empty() {
            continue;
        }
        match line.word("layer")? {
            "Convolution" => found.push(convolution(&mut line)?),
            "Concat" => {
                let joined = concat(&mut line)?;
                let expansions = found.len().checked_sub(2).map(|first| &found[first..]);
                let in_order = |pair: &[Convolution]| {
                    joined.len() == 2 && pair.iter().zip(&joined).all(|(c, blob)| c.blob == *blob)
                };
                if !expansions.is_some_and(in_order) {
                    return Err(line
                        .error("Concat", "does not join the two convolutions before it in their order")
                        .into());
                }
            }
            _ => {}
        }
    }
    let wanted = squeezenet::names().count();
    if found.len() != wanted {
        let (found, wanted) = (vec![found.len()], vec![wanted]);
        return Err(Error::Shape {
            file: param.to_owned(),
            field: format!("convolutions of {NETWORK}"),
            found,
            wanted,
        });
    }
    Ok(found)
}

/// Parses a convolution after its layer type: name, numbers of inputs and outputs, their names, and `key=value` pairs.
fn convolution(line: &mut Line<'_>) -> Result<Convolution, Error> {
    let name = line.word("name")?.to_owned();
    let (_, outputs) = blobs(line)?;
    let blob = outputs.into_iter().next().unwrap_or_default();
    let [mut outputs, mut kernel, mut values] = [0usize; 3];
    while !line.is_done() {
        let pair = line.word("parameter")?;
        let (key, value) = pair.split_once('=').ok_or_else(|| line.error(pair, "is not of the form key=value"))?;
        let target = match key {
            "0" => &mut outputs,
            "1" => &mut kernel,
            "6" => &mut values,
            _ => continue,
        };
        *target = value.parse().map_err(|_| line.error(pair, "is not a whole number"))?;
    }
    if outputs == 0 || kernel == 0 {
        return Err(line.error(name, "has no outputs (0=) or no kernel (1=)").into());
    }
    Ok(Convolution { name, outputs, kernel, values, blob })
}

fn concat(line: &mut Line<'_>) -> Result<Vec<String>, Error> {
    line.word("name")?;
    Ok(blobs(line)?.0)
}

/// Names of a layer's inputs and outputs.
fn blobs(line: &mut Line<'_>) -> Result<(Vec<String>, Vec<String>), Error> {
    let inputs: usize = line.whole("number of inputs")?;
    let outputs: usize = line.whole("number of outputs")?;
    let mut some = |count: usize| {
        (0..count.min(line.left())).map(|_| line.word("blob").map(str::to_owned)).collect::<Result<Vec<_>, _>>()
    };
    Ok((some(inputs)?, some(outputs)?))
}
