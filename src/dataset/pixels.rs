//! Pixels in memory, with 8 or 16 bits per channel.

use std::borrow::Cow;

/// Bits per channel of a photograph in memory, on the device and in comparisons.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
pub enum Depth {
    /// RGBA8.
    Eight,
    /// RGBA16: photographs with more than 8 bits per channel.
    Sixteen,
}

impl Depth {
    /// Bytes of a pixel in host and device memory.
    pub const fn bytes_per_pixel(self) -> u64 {
        match self {
            Self::Eight => 4,
            Self::Sixteen => 8,
        }
    }

    /// Bits of a channel.
    pub const fn bits(self) -> u32 {
        match self {
            Self::Eight => 8,
            Self::Sixteen => 16,
        }
    }
}

/// Red, green, blue and alpha of every pixel, rows from the top. The largest value of a channel is 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// Four bytes per pixel.
    Rgba8(Vec<u8>),
    /// Four 16-bit numbers per pixel.
    Rgba16(Vec<u16>),
}

impl Pixels {
    /// Bits per channel.
    pub fn depth(&self) -> Depth {
        match self {
            Self::Rgba8(_) => Depth::Eight,
            Self::Rgba16(_) => Depth::Sixteen,
        }
    }

    /// Number of pixels.
    pub fn len(&self) -> usize {
        match self {
            Self::Rgba8(values) => values.len() / 4,
            Self::Rgba16(values) => values.len() / 4,
        }
    }

    /// Whether there are no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The bytes for the device. With 16 bits, red and green are in the first word of a pixel, red in the lower half.
    pub fn bytes(&self) -> &[u8] {
        match self {
            Self::Rgba8(values) => values,
            Self::Rgba16(values) => bytemuck::cast_slice(values),
        }
    }

    /// Number of masked pixels, whose alpha is 0.
    pub fn masked(&self) -> u32 {
        match self {
            Self::Rgba8(values) => values.chunks_exact(4).filter(|p| p[3] == 0).count() as u32,
            Self::Rgba16(values) => values.chunks_exact(4).filter(|p| p[3] == 0).count() as u32,
        }
    }

    /// For each pixel, whether it is not masked.
    pub fn counting(&self) -> Vec<bool> {
        match self {
            Self::Rgba8(values) => values.chunks_exact(4).map(|p| p[3] != 0).collect(),
            Self::Rgba16(values) => values.chunks_exact(4).map(|p| p[3] != 0).collect(),
        }
    }

    /// Makes every pixel masked or opaque: masked below half opacity.
    pub fn harden_alpha(&mut self) {
        match self {
            Self::Rgba8(values) => values.chunks_exact_mut(4).for_each(|p| p[3] = if p[3] < 128 { 0 } else { 255 }),
            Self::Rgba16(values) => {
                values.chunks_exact_mut(4).for_each(|p| p[3] = if p[3] < 1 << 15 { 0 } else { u16::MAX });
            }
        }
    }

    /// RGBA with 8 bits per channel, rounded to the nearest.
    pub fn rgba8(&self) -> Cow<'_, [u8]> {
        match self {
            Self::Rgba8(values) => Cow::Borrowed(values),
            Self::Rgba16(values) => Cow::Owned(values.iter().map(|v| narrowed(*v)).collect()),
        }
    }

    /// [`Self::rgba8`] without alpha.
    pub fn rgb8(&self) -> Vec<u8> {
        match self {
            Self::Rgba8(values) => values.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect(),
            Self::Rgba16(values) => values.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]].map(narrowed)).collect(),
        }
    }
}

/// 16 bits to 8: 65535 = 255 * 257.
fn narrowed(value: u16) -> u8 {
    ((u32::from(value) + 128) / 257) as u8
}

/// A channel's value.
pub(super) trait ChannelValue: Copy + Default + Send + Sync + 'static {
    /// The value that stands for 1.
    const WHITE: f32;
    /// As a float from 0 to [`Self::WHITE`].
    fn number(self) -> f32;
    /// The nearest value.
    fn rounded(value: f32) -> Self;
}

impl ChannelValue for u8 {
    const WHITE: f32 = 255.0;
    fn number(self) -> f32 {
        f32::from(self)
    }
    fn rounded(value: f32) -> Self {
        value.round().clamp(0.0, 255.0) as u8
    }
}

impl ChannelValue for u16 {
    const WHITE: f32 = 65535.0;
    fn number(self) -> f32 {
        f32::from(self)
    }
    fn rounded(value: f32) -> Self {
        value.round().clamp(0.0, 65535.0) as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_bits_widened_come_back_and_halves_round_up() {
        for value in 0..=255_u16 {
            assert_eq!(narrowed(257 * value), value as u8);
        }
        for value in 0..=u16::MAX {
            assert_eq!(narrowed(value), (f64::from(value) / 257.0).round() as u8, "{value}");
        }
    }

    #[test]
    fn both_depths_agree_on_what_is_masked() {
        let eight = vec![1, 2, 3, 0, 4, 5, 6, 127, 7, 8, 9, 128, 10, 11, 12, 255];
        let sixteen: Vec<u16> = eight.iter().map(|v| 257 * u16::from(*v)).collect();
        for mut pixels in [Pixels::Rgba8(eight.clone()), Pixels::Rgba16(sixteen)] {
            assert_eq!((pixels.len(), pixels.masked()), (4, 1));
            assert_eq!(pixels.rgba8(), eight);
            pixels.harden_alpha();
            assert_eq!(pixels.counting(), [false, false, true, true]);
            assert_eq!(pixels.rgb8(), [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
            assert_eq!(pixels.bytes().len() as u64, 4 * pixels.depth().bytes_per_pixel());
        }
    }
}
