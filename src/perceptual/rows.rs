//! Filters in the order in which `glsl/convolution.comp` reads them.

use super::network::Convolution;

/// Rows of four values: the filters and biases of all network steps.
#[derive(Debug, Default)]
pub(super) struct Rows {
    pub(super) filters: Vec<[f32; 4]>,
    pub(super) biases: Vec<[f32; 4]>,
}

/// A convolution's place in the rows, and its sizes.
#[derive(Clone, Copy, Debug)]
pub(super) struct DeviceConvolution {
    /// First row of its filters.
    pub(super) filter_row: u32,
    /// First row of its biases.
    pub(super) bias_row: u32,
    /// Groups of eight outputs.
    pub(super) groups: u32,
    /// Rows of four inputs.
    pub(super) quads: u32,
    pub(super) size: u32,
    pub(super) stride: u32,
    pub(super) pad: u32,
}

impl Rows {
    /// Appends filters and returns their first row. Order: group of eight outputs, tap, input; two rows of four outputs
    /// each.
    fn push(
        &mut self,
        outputs: usize,
        quads: usize,
        size: usize,
        tap: impl Fn(usize, usize, usize, usize) -> f32,
    ) -> u32 {
        let first = self.filters.len() as u32;
        for group in 0..outputs / 8 {
            for at in 0..size * size {
                for input in 0..4 * quads {
                    for half in 0..2 {
                        let row = |k| tap(8 * group + 4 * half + k, input, at / size, at % size);
                        self.filters.push(std::array::from_fn(row));
                    }
                }
            }
        }
        first
    }

    /// Appends the filters and biases of the convolution itself.
    pub(super) fn forward(&mut self, convolution: &Convolution) -> DeviceConvolution {
        let f = &convolution.filters;
        let quads = f.inputs.div_ceil(4);
        let bias_row = self.biases.len() as u32;
        self.biases.extend(f.biases.chunks_exact(4).map(|b| [b[0], b[1], b[2], b[3]]));
        DeviceConvolution {
            filter_row: self.push(f.outputs, quads, f.size, |o, i, y, x| f.at(o, i, y, x)),
            bias_row,
            groups: (f.outputs / 8) as u32,
            quads: quads as u32,
            size: f.size as u32,
            stride: convolution.stride,
            pad: convolution.pad,
        }
    }

    /// Appends the filters of the gradient with respect to the convolution's input: for a stride of 1, a convolution
    /// with rotated filters.
    pub(super) fn backward(&mut self, convolution: &Convolution) -> DeviceConvolution {
        let f = &convolution.filters;
        let last = f.size - 1;
        DeviceConvolution {
            filter_row: self.push(f.inputs, f.outputs / 4, f.size, |i, o, y, x| f.at(o, i, last - y, last - x)),
            bias_row: self.zeros(f.inputs),
            groups: (f.inputs / 8) as u32,
            quads: (f.outputs / 4) as u32,
            size: f.size as u32,
            stride: 1,
            pad: last as u32 - convolution.pad,
        }
    }

    /// Appends the filters of the gradient with respect to an image that is read with stride 2 and no padding. The
    /// gradient is in blocks of 2x2 pixels, with four channels per pixel. A pixel of the block gets every second tap of
    /// a filter.
    pub(super) fn image_gradient(&mut self, convolution: &Convolution) -> DeviceConvolution {
        let f = &convolution.filters;
        let size = f.size.div_ceil(2);
        let tap = |output: usize, o: usize, y: usize, x: usize| {
            let (pixel, channel) = (output / 4, output % 4);
            let (row, column) = (pixel / 2 + 2 * (size - 1 - y), pixel % 2 + 2 * (size - 1 - x));
            let there = row < f.size && column < f.size && channel < f.inputs;
            if there { f.at(o, channel, row, column) } else { 0.0 }
        };
        DeviceConvolution {
            filter_row: self.push(16, f.outputs / 4, size, tap),
            bias_row: self.zeros(16),
            groups: 2,
            quads: (f.outputs / 4) as u32,
            size: size as u32,
            stride: 1,
            pad: size as u32 - 1,
        }
    }

    /// Appends rows of zeros as the biases of `outputs` outputs.
    fn zeros(&mut self, outputs: usize) -> u32 {
        let first = self.biases.len() as u32;
        self.biases.extend(std::iter::repeat_n([0.0; 4], outputs / 4));
        first
    }
}
