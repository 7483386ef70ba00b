//! The network, its weights and its pipelines on a device.

use super::network::Network;
use super::rows::DeviceConvolution;
use crate::vk::{Buffer, Gpu, Pipeline};

/// The parts of a distance that all windows share.
pub(super) struct Trunk {
    pub(super) gpu: Gpu,
    pub(super) network: Network,
    pub(super) pair: Pipeline,
    pub(super) convolution: Pipeline,
    pub(super) pool: Pipeline,
    pub(super) feature_distance: Pipeline,
    pub(super) sum: Pipeline,
    pub(super) filters: Buffer,
    pub(super) biases: Buffer,
    pub(super) channel_weights: Buffer,
    /// First row of the channel weights of each compared layer.
    pub(super) weight_rows: Vec<u32>,
    /// The convolution of each step; `None` for steps that pool.
    pub(super) forward: Vec<Option<DeviceConvolution>>,
    /// The gradient's convolution of each step; `None` for steps that pool.
    pub(super) backward: Vec<Option<DeviceConvolution>>,
    /// A buffer to bind where a pass neither reads nor writes.
    pub(super) nothing: Buffer,
}
