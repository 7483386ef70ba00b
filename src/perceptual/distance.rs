//! The perceptual distance: a network on the device.

use std::sync::Arc;

use super::filter_bank;
use super::network::{Network, Op};
use super::rows::Rows;
use super::trunk::Trunk;
use super::window::Windows;
use super::{Error, LpipsWeights};
use crate::pass::{convolution, crop, feature_distance, pool};
use crate::vk::{self, Buffer, Gpu, Memory};

/// Perceptual distance of two images: a network, its weights and its passes on a device.
///
/// Features of both images are compared per layer and pixel (LPIPS, Zhang et al. 2018). Images are in [0, 1].
#[derive(Clone)]
pub struct Distance {
    trunk: Arc<Trunk>,
}

impl Distance {
    /// LPIPS v0.1 on SqueezeNet 1.1, the metric `lpips_squeeze`.
    pub fn lpips(gpu: &Gpu, weights: &LpipsWeights) -> Result<Self, Error> {
        Self::new(gpu, weights.network()?)
    }

    /// Oriented band-pass filters of two scales in place of a learned network, for use without weights. The distance is
    /// at most 1.
    pub fn filter_bank(gpu: &Gpu) -> Result<Self, Error> {
        Self::new(gpu, filter_bank::network())
    }

    fn new(gpu: &Gpu, network: Network) -> Result<Self, Error> {
        let mut rows = Rows::default();
        let (mut forward, mut backward) = (Vec::new(), Vec::new());
        for op in &network.ops {
            let Op::Convolution(c) = op else {
                forward.push(None);
                backward.push(None);
                continue;
            };
            forward.push(Some(rows.forward(c)));
            backward.push(Some(if c.from == 0 { rows.image_gradient(c) } else { rows.backward(c) }));
        }
        let mut channel_weights: Vec<f32> = Vec::new();
        let mut weight_rows = Vec::new();
        for tap in &network.taps {
            weight_rows.push((channel_weights.len() / 4) as u32);
            channel_weights.extend(&tap.weights);
        }
        let filled = |name: &str, values: &[f32]| -> Result<Buffer, vk::Error> {
            let buffer = gpu.buffer(name, 4 * values.len() as u64, Memory::Device)?;
            gpu.write(&buffer, values)?;
            Ok(buffer)
        };
        let pipeline = |pass: &crate::pass::Pass| gpu.pipeline(&pass.kernel, &[]);
        let trunk = Trunk {
            gpu: gpu.clone(),
            pair: pipeline(&crop::PAIR)?,
            convolution: pipeline(&convolution::PASS)?,
            pool: pipeline(&pool::FORWARD)?,
            feature_distance: pipeline(&feature_distance::PASS)?,
            sum: pipeline(&feature_distance::SUM)?,
            filters: filled("perceptual filters", bytemuck::cast_slice(&rows.filters))?,
            biases: filled("perceptual biases", bytemuck::cast_slice(&rows.biases))?,
            channel_weights: filled("perceptual channel weights", &channel_weights)?,
            weight_rows,
            forward,
            backward,
            nothing: gpu.buffer("perceptual nothing", 16, Memory::Device)?,
            network,
        };
        Ok(Self { trunk: Arc::new(trunk) })
    }

    /// Number of layers whose features are compared.
    pub fn layers(&self) -> usize {
        self.trunk.network.taps.len()
    }

    /// Smallest allowed side of an image in pixels.
    pub fn least_side(&self) -> u32 {
        self.trunk.network.least()
    }

    /// Memory for windows of the given size in pixels. Without `gradient`, only the value can be computed, in much less
    /// memory.
    pub fn windows(&self, width: u32, height: u32, gradient: bool) -> Result<Windows, Error> {
        Windows::new(&self.trunk, width, height, gradient)
    }
}
