//! A network as data: its steps, its tensors, and the layers that are compared.

use super::Error;
use crate::pass::pool::pooled;

/// Filters and biases of a convolution.
#[derive(Clone, Debug)]
pub(super) struct Filters {
    pub(super) outputs: usize,
    pub(super) inputs: usize,
    /// Taps along a side.
    pub(super) size: usize,
    /// Ordered by output, input, row, column.
    pub(super) taps: Vec<f32>,
    pub(super) biases: Vec<f32>,
}

impl Filters {
    /// A tap; 0 for inputs beyond the last.
    pub(super) fn at(&self, output: usize, input: usize, row: usize, column: usize) -> f32 {
        let index = ((output * self.inputs + input) * self.size + row) * self.size + column;
        if input < self.inputs { self.taps.get(index).copied().unwrap_or(0.0) } else { 0.0 }
    }
}

/// A convolution from one tensor into channels of another.
#[derive(Clone, Debug)]
pub(super) struct Convolution {
    pub(super) from: usize,
    pub(super) to: usize,
    /// First channel of `to` that the outputs go to.
    pub(super) first_channel: usize,
    pub(super) filters: Filters,
    pub(super) stride: u32,
    pub(super) pad: u32,
}

impl Convolution {
    pub(super) fn new(from: usize, to: usize, filters: Filters, stride: u32, pad: u32) -> Self {
        Self { from, to, first_channel: 0, filters, stride, pad }
    }

    /// Output pixels along a side of `side` input pixels.
    fn made(&self, side: u32) -> u32 {
        (side + 2 * self.pad).checked_sub(self.filters.size as u32).map_or(0, |rest| rest / self.stride + 1)
    }
}

/// A step of a network.
#[derive(Clone, Debug)]
pub(super) enum Op {
    Convolution(Convolution),
    /// Maximum over 3x3 pixels, stride 2, ceil mode.
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

/// A layer whose features are compared.
#[derive(Clone, Debug)]
pub(super) struct Tap {
    pub(super) tensor: usize,
    /// Weight of each channel, not negative.
    pub(super) weights: Vec<f32>,
    /// Added to the length of a feature before normalisation.
    pub(super) eps: f32,
}

/// The features of an image after a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tensor {
    pub(super) channels: usize,
    /// Whether a ReLU precedes the tensor: values of 0 then pass no gradient.
    pub(super) rectified: bool,
}

/// A network. Tensor 0 is the image, with four channels, the last of which is 0. Convolutions from the image have
/// stride 2 and no padding.
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

    /// Width and height of each tensor for an image of `width` x `height` pixels.
    pub(super) fn sizes(&self, width: u32, height: u32) -> Result<Vec<(u32, u32)>, Error> {
        let sizes = self.sides(width).into_iter().zip(self.sides(height)).collect::<Vec<_>>();
        if sizes.iter().all(|&(w, h)| w > 0 && h > 0) {
            return Ok(sizes);
        }
        Err(Error::TooSmall { width, height, least: self.least() })
    }

    /// The smallest side of an image for which no tensor is empty.
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

    /// The last step that writes a tensor, after which the tensor is complete.
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

    /// Number of groups of four channels in a pixel.
    pub(super) fn quads(&self, tensor: usize) -> u32 {
        (self.tensors[tensor].channels / 4) as u32
    }
}
