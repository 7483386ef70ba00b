//! The distance of two images within a window.

use std::sync::Arc;

use super::Error;
use super::activations::{Activations, Gradients};
use super::network::Op;
use super::rows::DeviceConvolution;
use super::trunk::Trunk;
use crate::pass::convolution::{self as conv, FLAG_ADD, FLAG_GATE, FLAG_RELU};
use crate::pass::feature_distance::{self as features, FLAG_GRADIENT};
use crate::pass::{crop, pool};
use crate::vk::{Buffer, Groups, Recorder};

/// Windows of one size, with the memory for their features. The memory holds one distance at a time.
pub struct Windows {
    trunk: Arc<Trunk>,
    width: u32,
    height: u32,
    room: Activations,
}

/// Two images on the device and the position of a window in them.
#[derive(Clone, Copy, Debug)]
pub struct ImagePair<'a> {
    /// One vec4 per pixel, the first three components being colours in [0, 1].
    pub image: &'a Buffer,
    /// RGBA8; where alpha is 0 the images count as equal.
    pub photograph: &'a Buffer,
    /// Width and height of the photograph in pixels.
    pub size: (u32, u32),
    /// First column and row of the window.
    pub at: (u32, u32),
    /// Whether `image` and its gradient cover the window alone; `photograph` is always whole.
    pub cropped: bool,
}

/// Destination of a gradient.
#[derive(Clone, Copy, Debug)]
pub struct GradientOf<'a> {
    /// One vec4 per pixel of the image; the gradient of the distance is added to the first three components.
    pub image: &'a Buffer,
    /// Factor of the gradient.
    pub weight: f32,
}

/// Input or output of a convolution.
#[derive(Clone, Copy)]
struct Side<'a> {
    buffer: &'a Buffer,
    size: (u32, u32),
    /// Rows of four channels per pixel.
    row: u32,
    /// First row that is read or written.
    first: u32,
}

/// Inputs and outputs of a convolution.
#[derive(Clone, Copy)]
struct Convolved<'a> {
    source: Side<'a>,
    result: Side<'a>,
    /// Features in the layout of the result; gradients pass where a feature is positive.
    gate: Option<&'a Buffer>,
    images: u32,
    flags: u32,
}

impl Windows {
    pub(super) fn new(trunk: &Arc<Trunk>, width: u32, height: u32, gradient: bool) -> Result<Self, Error> {
        let room = Activations::new(trunk, width, height, gradient)?;
        Ok(Self { trunk: trunk.clone(), width, height, room })
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Bytes of device memory.
    pub fn bytes(&self) -> u64 {
        self.room.bytes
    }

    /// The last recorded distance: a float per layer, and their sum.
    pub fn result(&self) -> &Buffer {
        &self.room.result
    }

    /// Records the distance within a window, and its gradient with respect to the image. Does not wait for the device.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        pair: &ImagePair<'_>,
        gradient: Option<&GradientOf<'_>>,
    ) -> Result<(), Error> {
        let inside = |at: u32, side: u32, all: u32| at.checked_add(side).is_some_and(|end| end <= all);
        if !(inside(pair.at.0, self.width, pair.size.0) && inside(pair.at.1, self.height, pair.size.1)) {
            let size = (self.width, self.height);
            return Err(Error::Outside { size, at: pair.at, image: pair.size });
        }
        let gradients = match (gradient, &self.room.gradients) {
            (None, _) => None,
            (Some(_), None) => return Err(Error::ValueOnly),
            (Some(of), Some(gradients)) => Some((of, gradients)),
        };
        self.forward(recorder, pair, gradients.map(|(_, g)| g))?;
        if let Some((of, gradients)) = gradients {
            self.backward(recorder, gradients)?;
            let push = crop::GradientPush {
                image_width: pair.size.0,
                left: pair.at.0,
                top: pair.at.1,
                width: self.width,
                height: self.height,
                weight: of.weight,
                cropped: u32::from(pair.cropped),
            };
            let buffers = [&gradients.blocks, pair.photograph, of.image];
            recorder.dispatch(&gradients.to_image, &buffers, &push, self.pixels())?;
        }
        Ok(())
    }

    fn pixels(&self) -> Groups<'static> {
        Groups::Items(u64::from(self.width) * u64::from(self.height))
    }

    fn forward(
        &self,
        recorder: &mut Recorder,
        pair: &ImagePair<'_>,
        gradients: Option<&Gradients>,
    ) -> Result<(), Error> {
        let (trunk, room, network) = (&self.trunk, &self.room, &self.trunk.network);
        let ((left, top), (width, height)) = (pair.at, (self.width, self.height));
        let cropped = u32::from(pair.cropped);
        let push = crop::Push { image_width: pair.size.0, left, top, width, height, cropped };
        let buffers = [pair.image, pair.photograph, &room.features[0]];
        recorder.dispatch(&trunk.pair, &buffers, &push, self.pixels())?;
        for (i, op) in network.ops.iter().enumerate() {
            let (from, to) = (op.from(), op.to());
            match (op, &trunk.forward[i], &room.winners[i]) {
                (Op::Convolution(c), Some(placed), _) => {
                    if c.pad > 0 && room.gradients.is_none() {
                        recorder.fill(room.outside(network, &room.features, from, 2), 0)?;
                    }
                    let source = self.side(&room.features, from, 0);
                    let result = self.side(&room.features, to, (c.first_channel / 4) as u32);
                    let flags = if network.tensors[to].rectified { FLAG_RELU } else { 0 };
                    self.convolve(recorder, placed, &Convolved { source, result, gate: None, images: 2, flags })?;
                }
                (_, _, Some(winners)) => {
                    let ((in_width, in_height), (out_width, out_height)) = (room.sizes[from], room.sizes[to]);
                    let quads = network.quads(to);
                    let push = pool::Push { in_width, in_height, out_width, out_height, quads, images: 2 };
                    let threads = 2 * u64::from(room.pixels(to)) * u64::from(quads);
                    let buffers = [&room.features[from], &room.features[to], winners];
                    recorder.dispatch(&trunk.pool, &buffers, &push, Groups::Items(threads))?;
                }
                _ => {}
            }
            if let Some(tap) = network.tap_of(to).filter(|_| network.completed_by(to) == Some(i)) {
                self.compare(recorder, tap, to, gradients)?;
            }
        }
        let mut ends = [0; features::MOST_LAYERS];
        ends.iter_mut().zip(&room.ends).for_each(|(to, end)| *to = *end);
        let push = features::SumPush { ends, layers: room.ends.len() as u32 };
        recorder.dispatch(&trunk.sum, &[&room.parts, &room.result], &push, Groups::Workgroups(1))?;
        Ok(())
    }

    /// Records the distance of a layer's features, and its gradient with respect to the first image's features.
    fn compare(
        &self,
        recorder: &mut Recorder,
        tap: usize,
        tensor: usize,
        gradients: Option<&Gradients>,
    ) -> Result<(), Error> {
        let (trunk, room, network) = (&self.trunk, &self.room, &self.trunk.network);
        // Where other steps read the features, the last step that adds to their gradient applies the gate.
        let alone = network.tensors[tensor].rectified && network.readers(tensor).is_none();
        let gate = if alone { FLAG_GATE } else { 0 };
        let push = features::Push {
            pixels: room.pixels(tensor),
            quads: network.quads(tensor),
            weight_row: trunk.weight_rows[tap],
            part_first: tap.checked_sub(1).map_or(0, |before| room.ends[before]),
            eps: network.taps[tap].eps,
            flags: if gradients.is_some() { FLAG_GRADIENT | gate } else { 0 },
        };
        let grads = gradients.map_or(&trunk.nothing, |g| &g.features[tensor]);
        let buffers = [&room.features[tensor], &trunk.channel_weights, &room.parts, grads];
        recorder.dispatch(&trunk.feature_distance, &buffers, &push, Groups::Items(room.pixels(tensor).into()))?;
        Ok(())
    }

    /// Runs from the last step to the first: the gradient of a step's output adds to the gradient of the step's input.
    fn backward(&self, recorder: &mut Recorder, gradients: &Gradients) -> Result<(), Error> {
        let (trunk, room, network) = (&self.trunk, &self.room, &self.trunk.network);
        let mut begun: Vec<bool> = (0..network.tensors.len()).map(|t| network.tap_of(t).is_some()).collect();
        for (i, op) in network.ops.iter().enumerate().rev() {
            let (from, to) = (op.from(), op.to());
            if !begun[to] {
                continue;
            }
            let add = if begun[from] { FLAG_ADD } else { 0 };
            begun[from] = true;
            let complete = network.readers(from).is_some_and(|(first, _)| first == i);
            let flags = if complete && network.tensors[from].rectified { add | FLAG_GATE } else { add };
            match (op, &trunk.backward[i], &room.winners[i]) {
                (Op::Convolution(c), Some(placed), _) => {
                    let source = self.side(&gradients.features, to, (c.first_channel / 4) as u32);
                    let image = Side { buffer: &gradients.blocks, size: gradients.block_size, row: 4, first: 0 };
                    let result = if from == 0 { image } else { self.side(&gradients.features, from, 0) };
                    let gate = Some(&room.features[from]).filter(|_| flags & FLAG_GATE != 0);
                    self.convolve(recorder, placed, &Convolved { source, result, gate, images: 1, flags })?;
                }
                (_, _, Some(winners)) => {
                    let ((in_width, in_height), (out_width, out_height)) = (room.sizes[from], room.sizes[to]);
                    let quads = network.quads(from);
                    let push = pool::BackwardPush { in_width, in_height, out_width, out_height, quads, flags };
                    let threads = u64::from(room.pixels(from)) * u64::from(quads);
                    let (grad_out, grad_in) = (&gradients.features[to], &gradients.features[from]);
                    let buffers = [grad_out, winners, &room.features[from], grad_in];
                    recorder.dispatch(&gradients.pool_backward, &buffers, &push, Groups::Items(threads))?;
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn side<'a>(&self, of: &'a [Buffer], tensor: usize, first: u32) -> Side<'a> {
        let row = self.trunk.network.quads(tensor);
        Side { buffer: &of[tensor], size: self.room.sizes[tensor], row, first }
    }

    fn convolve(&self, recorder: &mut Recorder, placed: &DeviceConvolution, of: &Convolved<'_>) -> Result<(), Error> {
        let (trunk, Convolved { source, result, gate, images, flags }) = (&self.trunk, *of);
        let push = conv::Push {
            in_width: source.size.0,
            in_height: source.size.1,
            in_row: source.row,
            in_first: source.first,
            in_quads: placed.quads,
            zero_pixel: if placed.pad > 0 { images * source.size.0 * source.size.1 } else { 0 },
            out_width: result.size.0,
            out_height: result.size.1,
            out_row: result.row,
            out_first: result.first,
            groups: placed.groups,
            images,
            size: placed.size,
            stride: placed.stride,
            pad: placed.pad,
            filter_row: placed.filter_row,
            bias_row: placed.bias_row,
            flags,
        };
        let gate = gate.unwrap_or(&trunk.filters);
        let buffers = [source.buffer, &trunk.filters, &trunk.biases, gate, result.buffer];
        recorder.dispatch(&trunk.convolution, &buffers, &push, Groups::Items(push.threads()))?;
        Ok(())
    }
}
