//! An image in two by its mask.

use super::plane::of_pixels;
use super::{Error, Plane};
use crate::dataset::Pixels;

/// The parts of a photograph that are not texture and that are, red, green and blue from 0 to 1 per pixel: `(1 - M) I`
/// and `M I`. Their sum is the photograph. The mask may have another size.
pub fn split(width: u32, height: u32, pixels: &Pixels, mask: &Plane) -> Result<[Vec<f32>; 2], Error> {
    Error::check("the photograph", pixels.len(), width as usize * height as usize)?;
    let mask = mask.resized(width, height);
    let colours = of_pixels(pixels, |[r, g, b, _]| [r as f32, g as f32, b as f32]);
    let part = |share: &dyn Fn(f32) -> f32| -> Vec<f32> {
        colours.iter().zip(mask.values()).flat_map(|(c, m)| c.map(|v| share(*m) * v)).collect()
    };
    Ok([part(&|m| 1.0 - m), part(&|m| m)])
}
