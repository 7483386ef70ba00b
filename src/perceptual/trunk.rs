//! The network, its numbers and its pipelines on a device.

use super::network::Network;
use super::rows::Placed;
use crate::vk::{Buffer, Gpu, Pipeline};

/// What all windows share.
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
    /// Of each layer that is compared.
    pub(super) weight_rows: Vec<u32>,
    /// Of each step that is a convolution.
    pub(super) forward: Vec<Option<Placed>>,
    /// Of each step that is a convolution.
    pub(super) backward: Vec<Option<Placed>>,
    /// Bound where nothing is read or written.
    pub(super) nothing: Buffer,
}
