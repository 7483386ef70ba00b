//! Composites photographs with transparent parts over a colour.

use image::{DynamicImage, ImageBuffer};

use super::pixels::ChannelValue;

/// The image in front of a colour (red, green, blue from 0 to 1). Mixes encoded values, as viewers and other trainers
/// do: `alpha * colour of the pixel + (1 - alpha) * colour behind`. The result keeps the bits per channel, 8 or 16.
pub(super) fn laid_over(image: DynamicImage, behind: [f32; 3]) -> DynamicImage {
    let (width, height) = (image.width(), image.height());
    match image {
        DynamicImage::ImageRgba8(_) | DynamicImage::ImageLumaA8(_) => {
            let rgb = ImageBuffer::from_raw(width, height, mixed(&image.into_rgba8(), behind));
            DynamicImage::ImageRgb8(rgb.unwrap_or_default())
        }
        DynamicImage::ImageRgba16(_) | DynamicImage::ImageLumaA16(_) => {
            let rgb = ImageBuffer::from_raw(width, height, mixed(&image.into_rgba16(), behind));
            DynamicImage::ImageRgb16(rgb.unwrap_or_default())
        }
        opaque => opaque,
    }
}

/// Number of pixels that are less than half opaque.
pub(super) fn mostly_clear(image: &DynamicImage) -> u64 {
    match image {
        DynamicImage::ImageRgba8(p) => p.pixels().filter(|p| p.0[3] < 1 << 7).count() as u64,
        DynamicImage::ImageLumaA8(p) => p.pixels().filter(|p| p.0[1] < 1 << 7).count() as u64,
        DynamicImage::ImageRgba16(p) => p.pixels().filter(|p| p.0[3] < 1 << 15).count() as u64,
        DynamicImage::ImageLumaA16(p) => p.pixels().filter(|p| p.0[1] < 1 << 15).count() as u64,
        _ => 0,
    }
}

fn mixed<T: ChannelValue>(rgba: &[T], behind: [f32; 3]) -> Vec<T> {
    let mut rgb = Vec::with_capacity(rgba.len() / 4 * 3);
    for pixel in rgba.chunks_exact(4) {
        let share = pixel[3].number() / T::WHITE;
        rgb.extend((0..3).map(|c| T::rounded(share * pixel[c].number() + (1.0 - share) * behind[c] * T::WHITE)));
    }
    rgb
}

#[cfg(test)]
mod tests {
    use image::{LumaA, Rgb, Rgba};

    use super::*;

    #[test]
    fn what_is_opaque_stays_and_what_is_clear_is_the_colour_behind() {
        let of = |pixel: [u8; 4], behind| {
            let picture = ImageBuffer::from_pixel(1, 1, Rgba(pixel));
            laid_over(DynamicImage::ImageRgba8(picture), behind).into_rgb8().get_pixel(0, 0).0
        };
        assert_eq!(of([7, 77, 177, 255], [1.0; 3]), [7, 77, 177]);
        assert_eq!(of([7, 77, 177, 0], [1.0, 0.5, 0.0]), [255, 128, 0]);
        // 100 * 51/255 + 255 * 204/255
        assert_eq!(of([100, 0, 0, 51], [1.0; 3]), [224, 204, 204]);
    }

    #[test]
    fn bits_are_kept() {
        let deep = ImageBuffer::from_pixel(1, 1, Rgba([65535_u16, 1, 0, 32768]));
        let deep = laid_over(DynamicImage::ImageRgba16(deep), [0.0, 0.0, 1.0]);
        assert_eq!(deep.as_rgb16().map(|p| p.get_pixel(0, 0).0), Some([32768, 1, 32767]));
        let grey = ImageBuffer::from_pixel(1, 1, LumaA([200_u8, 0]));
        let grey = laid_over(DynamicImage::ImageLumaA8(grey), [0.0; 3]);
        assert_eq!(grey.as_rgb8().map(|p| p.get_pixel(0, 0).0), Some([0; 3]));
        let clear = DynamicImage::ImageLumaA16(ImageBuffer::from_pixel(2, 1, LumaA([9_u16, 32767])));
        assert_eq!((mostly_clear(&clear), mostly_clear(&laid_over(clear.clone(), [0.0; 3]))), (2, 0));
        let opaque = DynamicImage::ImageRgb8(ImageBuffer::from_pixel(1, 1, Rgb([1, 2, 3])));
        assert_eq!(laid_over(opaque.clone(), [1.0; 3]), opaque);
    }
}
