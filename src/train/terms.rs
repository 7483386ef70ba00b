//! Terms of the loss beside that of colours. Each adds its gradient to what the colours' left.

mod geometry;
mod gradient_maps;
mod perceptual;

pub(super) use geometry::{Geometry, GeometryTurn};
pub(super) use gradient_maps::GradientMaps;
pub(super) use perceptual::Perceptual;

use super::photographs::Shown;
use crate::scene::Camera;
use crate::vk::{Buffer, BufferSlice};

/// What a term compares.
#[derive(Clone, Copy)]
pub(super) struct Compared<'a> {
    pub(super) camera: &'a Camera,
    /// The render as the photograph would show it.
    pub(super) image: &'a Buffer,
    pub(super) photograph: &'a Shown<'a>,
    /// The view's mask of reduced size, with its width and height, where there are masks.
    pub(super) mask: Option<(BufferSlice<'a>, [u32; 2])>,
    /// dL/d(image), added to.
    pub(super) grad_image: &'a Buffer,
}

impl Compared<'_> {
    fn size(&self) -> (u32, u32) {
        (self.camera.width, self.camera.height)
    }

    /// Width and height of the mask; 1 where there is none.
    fn mask_size(&self) -> [u32; 2] {
        self.mask.map_or([1; 2], |(_, size)| size)
    }
}
