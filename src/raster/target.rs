//! Buffers of the size of an image.

use crate::vk::{self, Buffer, Gpu, Memory};

/// What a forward pass leaves and a backward pass reads, for images of up to a given number of pixels.
pub struct Target {
    /// Pixels that fit.
    pub pixels: u32,
    /// (r, g, b, transmittance) per pixel.
    pub image: Buffer,
    /// (sum w z, sum w n) per pixel; a single entry when the auxiliary channels are off.
    pub aux: Buffer,
    /// Position of the last contributor in the tile's list.
    pub last: Buffer,
}

impl Target {
    /// Bytes of all of them.
    pub fn bytes(&self) -> u64 {
        self.image.size() + self.aux.size() + self.last.size()
    }

    /// Room for `pixels` pixels.
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
