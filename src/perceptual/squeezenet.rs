//! SqueezeNet 1.1 (Iandola et al. 2016) in torchvision's variant, up to its last fire module, and the linear layers of
//! LPIPS v0.1 (Zhang et al. 2018).

use std::path::Path;

use super::network::{Convolution, Filters, Network, Op, Tap};
use super::read::read_tensors;
use super::{Error, Tensors};

/// The network's name in messages.
pub(super) const NETWORK: &str = "SqueezeNet 1.1";
const LINEAR: &str = "the linear layers of LPIPS on SqueezeNet";

/// Fire modules: index among torchvision's `features`, input channels, squeezed channels, and channels of each of the
/// two expansions.
const FIRES: [(usize, usize, usize, usize); 8] = [
    (3, 64, 16, 64),
    (4, 128, 16, 64),
    (6, 128, 32, 128),
    (7, 256, 32, 128),
    (9, 256, 48, 192),
    (10, 384, 48, 192),
    (11, 384, 64, 256),
    (12, 512, 64, 256),
];
/// Fire modules that have a pooling before them.
const AFTER_POOL: [usize; 3] = [3, 6, 9];
/// Channels of the layers that are compared: the first convolution, and the fire modules in `TAPPED`.
const TAPS: [usize; 7] = [64, 128, 256, 384, 384, 512, 512];
/// Fire modules that are compared, by index among the features.
const TAPPED: [usize; 6] = [4, 7, 9, 10, 11, 12];
/// LPIPS's scaling of an input in [-1, 1].
const SHIFT: [f64; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f64; 3] = [0.458, 0.448, 0.450];
/// Added to the length of a feature before normalisation.
const EPS: f32 = 1e-10;

/// The convolutions of the whole classifier: torchvision's names, in the order of ncnn's conversion.
pub(super) fn names() -> impl Iterator<Item = String> {
    let fires = FIRES
        .iter()
        .flat_map(|(at, ..)| ["squeeze", "expand1x1", "expand3x3"].map(|part| format!("features.{at}.{part}")));
    std::iter::once("features.0".to_owned()).chain(fires).chain(std::iter::once("classifier.1".to_owned()))
}

/// The weights of LPIPS on SqueezeNet 1.1.
#[derive(Clone, Debug)]
pub struct LpipsWeights {
    trunk: Tensors,
    linear: Tensors,
}

impl LpipsWeights {
    /// From the arrays of the trunk, by torchvision's names, and of the linear layers, by LPIPS's names. All arrays are
    /// checked. One file may hold both.
    pub fn new(trunk: Tensors, linear: Tensors) -> Result<Self, Error> {
        let weights = Self { trunk, linear };
        weights.network()?;
        Ok(weights)
    }

    /// Reads and checks both files. Formats: see [`read_tensors`].
    pub fn read(trunk: &Path, linear: &Path) -> Result<Self, Error> {
        Self::new(read_tensors(trunk)?, read_tensors(linear)?)
    }

    /// The files of the trunk and of the linear layers.
    pub fn files(&self) -> [&Path; 2] {
        [self.trunk.file(), self.linear.file()]
    }

    /// CRC-32 of the weights that the distance uses, independent of the files' formats.
    pub fn checksum(&self) -> u32 {
        let of_trunk = names().filter(|name| name.starts_with("features."));
        let of_trunk = of_trunk.flat_map(|name| ["weight", "bias"].map(|part| (&self.trunk, format!("{name}.{part}"))));
        let of_linear = (0..TAPS.len()).map(|layer| (&self.linear, format!("lin{layer}.model.1.weight")));
        let mut all = crc32fast::Hasher::new();
        for (tensors, name) in of_trunk.chain(of_linear) {
            all.update(bytemuck::cast_slice(tensors.values(&name)));
        }
        all.finalize()
    }

    fn filters(&self, name: &str, outputs: usize, inputs: usize, size: usize) -> Result<Filters, Error> {
        let taps = self.trunk.get(&format!("{name}.weight"), &[outputs, inputs, size, size], NETWORK)?.to_vec();
        let biases = self.trunk.get(&format!("{name}.bias"), &[outputs], NETWORK)?.to_vec();
        Ok(Filters { outputs, inputs, size, taps, biases })
    }

    fn tap(&self, network: &mut Network, layer: usize, tensor: usize) -> Result<(), Error> {
        let field = format!("lin{layer}.model.1.weight");
        let weights = self.linear.get(&field, &[1, TAPS[layer], 1, 1], LINEAR)?.to_vec();
        if let Some(&value) = weights.iter().find(|w| **w < 0.0) {
            return Err(Error::Value { file: self.linear.file().to_owned(), field, value });
        }
        network.taps.push(Tap { tensor, weights, eps: EPS });
        Ok(())
    }

    /// The network, for images in [0, 1].
    pub(super) fn network(&self) -> Result<Network, Error> {
        let mut network = Network::default();
        let image = network.tensor(4, false);
        let first = network.tensor(64, true);
        let filters = scaled(self.filters("features.0", 64, 3, 3)?);
        network.ops.push(Op::Convolution(Convolution::new(image, first, filters, 2, 0)));
        self.tap(&mut network, 0, first)?;
        let mut last = first;
        for (at, inputs, squeezed, expanded) in FIRES {
            if AFTER_POOL.contains(&at) {
                let pooled = network.tensor(inputs, true);
                network.ops.push(Op::Pool { from: last, to: pooled });
                last = pooled;
            }
            let squeeze = network.tensor(squeezed, true);
            let out = network.tensor(2 * expanded, true);
            let name = |part: &str| format!("features.{at}.{part}");
            let filters = self.filters(&name("squeeze"), squeezed, inputs, 1)?;
            network.ops.push(Op::Convolution(Convolution::new(last, squeeze, filters, 1, 0)));
            let filters = self.filters(&name("expand1x1"), expanded, squeezed, 1)?;
            network.ops.push(Op::Convolution(Convolution::new(squeeze, out, filters, 1, 0)));
            let filters = self.filters(&name("expand3x3"), expanded, squeezed, 3)?;
            let second = Convolution { first_channel: expanded, ..Convolution::new(squeeze, out, filters, 1, 1) };
            network.ops.push(Op::Convolution(second));
            if let Some(layer) = TAPPED.iter().position(|tapped| *tapped == at) {
                self.tap(&mut network, layer + 1, out)?;
            }
            last = out;
        }
        Ok(network)
    }
}

/// The first convolution with LPIPS's input scaling folded in, which is exact because the convolution has no padding.
fn scaled(mut filters: Filters) -> Filters {
    let of_input = filters.size * filters.size;
    let of_output = of_input * filters.inputs;
    for (output, taps) in filters.taps.chunks_mut(of_output).enumerate() {
        let mut shifted = 0.0;
        for (c, taps) in taps.chunks_mut(of_input).enumerate() {
            for tap in taps {
                shifted += f64::from(*tap) * (-1.0 - SHIFT[c]) / SCALE[c];
                *tap = (f64::from(*tap) * 2.0 / SCALE[c]) as f32;
            }
        }
        filters.biases[output] = (f64::from(filters.biases[output]) + shifted) as f32;
    }
    filters
}
