//! Memory for the features of a window.

use std::cell::Cell;

use super::Error;
use super::network::{Network, Op};
use super::trunk::Trunk;
use crate::pass::{crop, pool};
use crate::vk::{self, Buffer, BufferSlice, Memory, Pipeline};

/// Buffers of one window size. Each tensor holds its images one after the other, with the channels of a pixel together,
/// and after the last image a pixel of zeros for convolutions that reach outside.
pub(super) struct Activations {
    /// Width and height of each tensor.
    pub(super) sizes: Vec<(u32, u32)>,
    /// Features of both images by tensor. Without gradients, tensors share memory.
    pub(super) features: Vec<Buffer>,
    /// Positions of the maxima, by step; `None` for steps that do not pool.
    pub(super) winners: Vec<Option<Buffer>>,
    /// Distances by layer and pixel.
    pub(super) parts: Buffer,
    /// End of each layer's range in `parts`.
    pub(super) ends: Vec<u32>,
    /// Distance per layer, and their sum.
    pub(super) result: Buffer,
    pub(super) gradients: Option<Gradients>,
    /// Total size of the buffers in bytes.
    pub(super) bytes: u64,
}

/// Buffers and pipelines of the gradients.
pub(super) struct Gradients {
    /// Gradient of the image, in blocks of 2x2 pixels.
    pub(super) blocks: Buffer,
    /// Width and height in blocks.
    pub(super) block_size: (u32, u32),
    /// Gradients of the first image's features by tensor; tensor 0, the image itself, is not used.
    pub(super) features: Vec<Buffer>,
    pub(super) pool_backward: Pipeline,
    pub(super) to_image: Pipeline,
}

impl Activations {
    pub(super) fn new(trunk: &Trunk, width: u32, height: u32, gradient: bool) -> Result<Self, Error> {
        let (gpu, network) = (&trunk.gpu, &trunk.network);
        let sizes = network.sizes(width, height)?;
        let pixels = |t: usize| u64::from(sizes[t].0) * u64::from(sizes[t].1);
        let bytes = |t: usize, images: u64| 16 * u64::from(network.quads(t)) * (images * pixels(t) + 1);
        let of_tensors: Vec<u64> = (0..sizes.len()).map(|t| bytes(t, 2)).collect();
        let slots = if gradient { Slots::apart(&of_tensors) } else { Slots::shared(network, &of_tensors) };
        let total = Cell::new(0);
        let room = |what: &str, bytes: &u64| {
            total.set(total.get() + bytes);
            gpu.buffer(&format!("perceptual {what}"), *bytes, Memory::Device)
        };
        let memory = slots.bytes.iter().map(|b| room("features", b)).collect::<Result<Vec<_>, vk::Error>>()?;
        let features = slots.of.iter().map(|slot| memory[*slot].clone()).collect();

        let mut winners: Vec<Option<Buffer>> = Vec::new();
        for op in &network.ops {
            winners.push(match op {
                Op::Convolution(_) => None,
                // Without gradients nothing reads the winners: all poolings share the first and largest buffer.
                Op::Pool { .. } if !gradient && winners.iter().any(Option::is_some) => {
                    winners.iter().flatten().next().cloned()
                }
                Op::Pool { to, .. } => Some(room("winners", &(bytes(*to, 2) / 4))?),
            });
        }
        let mut ends = Vec::new();
        let mut all = 0;
        for tap in &network.taps {
            all += pixels(tap.tensor) as u32;
            ends.push(all);
        }
        let gradients = if gradient {
            let block_size = (width.div_ceil(2), height.div_ceil(2));
            let blocks = 64 * u64::from(block_size.0) * u64::from(block_size.1);
            let features = (0..sizes.len()).map(|t| room("gradients", &if t == 0 { 16 } else { bytes(t, 1) }));
            let features = features.collect::<Result<Vec<_>, vk::Error>>()?;
            let pool_backward = gpu.pipeline(&pool::BACKWARD.kernel, &[])?;
            let to_image = gpu.pipeline(&crop::GRADIENT.kernel, &[])?;
            Some(Gradients { blocks: room("gradient blocks", &blocks)?, block_size, features, pool_backward, to_image })
        } else {
            None
        };
        let parts = room("distances", &(4 * u64::from(all)))?;
        let result = room("distance", &(4 * (network.taps.len() as u64 + 1)))?;
        let made = Self { parts, result, sizes, features, winners, ends, gradients, bytes: total.get() };
        if gradient {
            made.clear_outsides(trunk)?;
        }
        Ok(made)
    }

    pub(super) fn pixels(&self, tensor: usize) -> u32 {
        self.sizes[tensor].0 * self.sizes[tensor].1
    }

    /// The pixel of zeros behind `images` images of a tensor.
    pub(super) fn outside<'a>(
        &self,
        network: &Network,
        of: &'a [Buffer],
        tensor: usize,
        images: u32,
    ) -> BufferSlice<'a> {
        let row = 16 * u64::from(network.quads(tensor));
        let first = u64::from(images) * u64::from(self.pixels(tensor)) * row;
        of[tensor].slice(first..first + row)
    }

    /// Clears every pixel of zeros once: nothing else writes to it where tensors do not share memory.
    fn clear_outsides(&self, trunk: &Trunk) -> Result<(), Error> {
        let mut recorder = trunk.gpu.recorder("perceptual room")?;
        for tensor in 0..self.features.len() {
            recorder.fill(self.outside(&trunk.network, &self.features, tensor, 2), 0)?;
            if let (Some(g), true) = (&self.gradients, tensor > 0) {
                recorder.fill(self.outside(&trunk.network, &g.features, tensor, 1), 0)?;
            }
        }
        recorder.submit()?;
        Ok(())
    }
}

/// Assignment of tensors to buffers.
#[derive(Debug, PartialEq)]
struct Slots {
    of: Vec<usize>,
    bytes: Vec<u64>,
}

impl Slots {
    fn apart(bytes: &[u64]) -> Self {
        Self { of: (0..bytes.len()).collect(), bytes: bytes.to_vec() }
    }

    /// A tensor holds its buffer from the first step that writes the tensor to the last step that reads it.
    fn shared(network: &Network, bytes: &[u64]) -> Self {
        let mut slots = Self { of: vec![usize::MAX; bytes.len()], bytes: Vec::new() };
        let mut free: Vec<usize> = Vec::new();
        slots.take(0, bytes[0], &mut free);
        for (i, op) in network.ops.iter().enumerate() {
            if slots.of[op.to()] == usize::MAX {
                slots.take(op.to(), bytes[op.to()], &mut free);
            }
            if network.readers(op.from()).is_some_and(|(_, last)| last == i) {
                free.push(slots.of[op.from()]);
            }
            if network.readers(op.to()).is_none() && network.completed_by(op.to()) == Some(i) {
                free.push(slots.of[op.to()]);
            }
        }
        slots
    }

    /// Takes the free buffer that fits best; the largest free buffer grows where none is large enough.
    fn take(&mut self, tensor: usize, bytes: u64, free: &mut Vec<usize>) {
        let fits = |slot: &usize| (self.bytes[*slot] < bytes, self.bytes[*slot].abs_diff(bytes));
        let best = free.iter().enumerate().min_by_key(|(_, slot)| fits(slot)).map(|(place, _)| place);
        let slot = match best {
            Some(place) => free.swap_remove(place),
            None => {
                self.bytes.push(0);
                self.bytes.len() - 1
            }
        };
        self.bytes[slot] = self.bytes[slot].max(bytes);
        self.of[tensor] = slot;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perceptual::network::{Convolution, Filters};

    #[test]
    fn memory_is_shared_by_tensors_that_are_never_there_together() {
        let mut network = Network::default();
        let filters = Filters { outputs: 8, inputs: 8, size: 1, taps: vec![0.0; 64], biases: vec![0.0; 8] };
        let tensors: Vec<usize> = (0..5).map(|_| network.tensor(8, false)).collect();
        for (from, to) in [(0, 1), (1, 2), (1, 3), (2, 4), (3, 4)] {
            let step = Convolution::new(tensors[from], tensors[to], filters.clone(), 1, 0);
            network.ops.push(Op::Convolution(step));
        }
        let slots = Slots::shared(&network, &[10, 20, 5, 6, 8]);
        assert_eq!(slots.of[2], slots.of[0], "the image is read for the last time before tensor 2 is written");
        assert!(slots.of[3] != slots.of[1] && slots.of[3] != slots.of[2], "1 and 2 are still read: {slots:?}");
        assert_eq!(slots.of[4], slots.of[1], "1 is free for 4");
        assert_eq!(slots.bytes.len(), 3);
    }
}
