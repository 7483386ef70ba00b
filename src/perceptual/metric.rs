//! The distance as a score of finished renders.

use super::Error;
use super::distance::Distance;
use super::window::{ImagePair, Windows};
use crate::vk::{Buffer, Gpu, Memory};

/// Scores renders of any size. Keeps its device memory while the size stays the same.
pub struct Metric {
    gpu: Gpu,
    distance: Distance,
    room: Option<(Windows, Buffer, Buffer)>,
}

impl Metric {
    /// Scores by `distance`, which must be on the same device.
    pub fn new(gpu: &Gpu, distance: Distance) -> Self {
        Self { gpu: gpu.clone(), distance, room: None }
    }

    /// Distance of a render (RGB8) from a photograph of equal size (RGBA8, masked where alpha is 0). Waits for the
    /// device.
    pub fn distance(&mut self, rgb: &[u8], reference: &[u8], width: u32, height: u32) -> Result<f32, Error> {
        let pixels = width as usize * height as usize;
        for (found, expected) in [(rgb.len(), 3 * pixels), (reference.len(), 4 * pixels)] {
            if found != expected {
                return Err(Error::Pixels { found, expected });
            }
        }
        let room = match self.room.take() {
            Some(room) if room.0.size() == (width, height) => room,
            _ => {
                let windows = self.distance.windows(width, height, false)?;
                let image = self.gpu.buffer("perceptual image", 16 * pixels as u64, Memory::Device)?;
                let photograph = self.gpu.buffer("perceptual photograph", 4 * pixels as u64, Memory::Device)?;
                (windows, image, photograph)
            }
        };
        let (windows, image, photograph) = self.room.insert(room);
        let (windows, image, photograph) = (&*windows, &*image, &*photograph);
        let value = |byte: u8| f32::from(byte) / 255.0;
        let colours: Vec<[f32; 4]> =
            rgb.chunks_exact(3).map(|p| [value(p[0]), value(p[1]), value(p[2]), 0.0]).collect();
        self.gpu.write(image, &colours)?;
        self.gpu.write(photograph, reference)?;
        let mut recorder = self.gpu.recorder("perceptual distance")?;
        windows.record(
            &mut recorder,
            &ImagePair { image, photograph, size: (width, height), at: (0, 0), cropped: false },
            None,
        )?;
        recorder.submit()?;
        let sums: Vec<f32> = self.gpu.read(windows.result())?;
        Ok(sums.last().copied().unwrap_or(f32::NAN))
    }
}
