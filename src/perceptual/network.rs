//! A network as data: what is computed from what, and which of it is compared.

use super::Error;
use crate::pass::pool::pooled;

/// Filters of a convolution and what is added.
#[derive(Clone, Debug)]
pub(super) struct Filters {
    pub(super) outputs: usize,
    pub(super) inputs: usize,
    /// Taps along a side.
    pub(super) size: usize,
    /// By output, input, row, column.
    pub(super) taps: Vec<f32>,
    pub(super) biases: Vec<f32>,
}

impl Filters {
    /// A tap; 0 for inputs that there are none of.
    pub(super) fn at(&self, output: usize, input: usize, row: usize, column: usize) -> f32 {
        let index = ((output * self.inputs + input) * self.size + row) * self.size + column;
        if input < self.inputs { self.taps.get(index).copied().unwrap_or(0.0) } else { 0.0 }
    }
}

/// A convolution from one tensor into channels of another, with what follows it.
#[derive(Clone, Debug)]
pub(super) struct Convolution {
    pub(super) from: usize,
    pub(super) to: usize,
    /// Where its outputs begin among the channels of `to`.
    pub(super) first_channel: usize,
    pub(super) filters: Filters,
    pub(super) stride: u32,
    pub(super) pad: u32,
}

impl Convolution {
    pub(super) fn new(from: usize, to: usize, filters: Filters, stride: u32, pad: u32) -> Self {
        Self { from, to, first_channel: 0, filters, stride, pad }
    }

    /// Pixels along a side of what it makes of `side` pixels.
    fn made(&self, side: u32) -> u32 {
        (side + 2 * self.pad).checked_sub(self.filters.size as u32).map_or(0, |rest| rest / self.stride + 1)
    }
}

/// A step of a network.
#[derive(Clone, Debug)]
pub(super) enum Op {
    Convolution(Convolution),
    /// 3x3, stride 2, ceil mode.
    Pool {
        from: usize,
        to: usize,
    },
}

impl Op {
    pub(super) fn from(&self) -> usize {
        match self {
            Self::Convolution(c) => c.from,
            Self::Pool { from, .. } => *from,
        }
    }

    pub(super) fn to(&self) -> usize {
        match self {
            Self::Convolution(c) => c.to,
            Self::Pool { to, .. } => *to,
        }
    }
}

/// A layer that is compared.
#[derive(Clone, Debug)]
pub(super) struct Tap {
    pub(super) tensor: usize,
    /// Of each channel, not negative.
    pub(super) weights: Vec<f32>,
    /// Added to the length of a feature.
    pub(super) eps: f32,
}

/// Features of an image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tensor {
    pub(super) channels: usize,
    /// It comes out of a ReLU, so that where it is 0 nothing gets a gradient.
    pub(super) rectified: bool,
}

/// Tensor 0 is the image, with four channels of which the last is 0; convolutions from it have stride 2 and no padding.
#[derive(Clone, Debug, Default)]
pub(super) struct Network {
    pub(super) tensors: Vec<Tensor>,
    pub(super) ops: Vec<Op>,
    pub(super) taps: Vec<Tap>,
}

impl Network {
    pub(super) fn tensor(&mut self, channels: usize, rectified: bool) -> usize {
        self.tensors.push(Tensor { channels, rectified });
        self.tensors.len() - 1
    }

    /// Width and height of each tensor for an image of this size.
    pub(super) fn sizes(&self, width: u32, height: u32) -> Result<Vec<(u32, u32)>, Error> {
        let sizes = self.sides(width).into_iter().zip(self.sides(height)).collect::<Vec<_>>();
        if sizes.iter().all(|&(w, h)| w > 0 && h > 0) {
            return Ok(sizes);
        }
        Err(Error::TooSmall { width, height, least: self.least() })
    }

    /// The smallest side of an image of which something is left in every tensor.
    pub(super) fn least(&self) -> u32 {
        (1..256).find(|side| self.sides(*side).iter().all(|s| *s > 0)).unwrap_or(256)
    }

    fn sides(&self, side: u32) -> Vec<u32> {
        let mut sides = vec![0; self.tensors.len()];
        if let Some(first) = sides.first_mut() {
            *first = side;
        }
        for op in &self.ops {
            sides[op.to()] = match op {
                Op::Convolution(c) => c.made(sides[c.from]),
                Op::Pool { from, .. } => pooled(sides[*from]),
            };
        }
        sides
    }

    /// The step that writes a tensor last: from then on it is whole.
    pub(super) fn completed_by(&self, tensor: usize) -> Option<usize> {
        self.ops.iter().rposition(|op| op.to() == tensor)
    }

    /// The first and the last step that reads a tensor.
    pub(super) fn readers(&self, tensor: usize) -> Option<(usize, usize)> {
        let reads = |op: &Op| op.from() == tensor;
        Some((self.ops.iter().position(reads)?, self.ops.iter().rposition(reads)?))
    }

    pub(super) fn tap_of(&self, tensor: usize) -> Option<usize> {
        self.taps.iter().position(|tap| tap.tensor == tensor)
    }

    /// Rows of four channels in a pixel.
    pub(super) fn quads(&self, tensor: usize) -> u32 {
        (self.tensors[tensor].channels / 4) as u32
    }
}
