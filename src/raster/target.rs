//! Image buffers of the renderer.

use crate::vk::{self, Buffer, Gpu, Memory};

/// Outputs of a forward pass, which the backward pass reads.
pub struct Target {
    /// Most pixels of an image.
    pub pixels: u32,
    /// (r, g, b, transmittance) per pixel.
    pub image: Buffer,
    /// (sum w z, sum w n) per pixel; a single entry without auxiliary channels.
    pub aux: Buffer,
    /// Per pixel, the position of the last contributing splat in the tile's list.
    pub last: Buffer,
}

impl Target {
    /// Total bytes of the buffers.
    pub fn bytes(&self) -> u64 {
        self.image.size() + self.aux.size() + self.last.size()
    }

    /// Buffers for images of up to `pixels` pixels; `aux` adds the auxiliary channels. `name` begins the buffers'
    /// names.
    pub fn new(gpu: &Gpu, name: &str, pixels: u32, aux: bool) -> Result<Self, vk::Error> {
        let pixels = pixels.max(1);
        let n = u64::from(pixels);
        Ok(Self {
            pixels,
            image: gpu.buffer(&format!("{name}image"), 16 * n, Memory::Device)?,
            aux: gpu.buffer(&format!("{name}aux"), if aux { 16 * n } else { 16 }, Memory::Device)?,
            last: gpu.buffer(&format!("{name}last"), 4 * n, Memory::Device)?,
        })
    }
}
