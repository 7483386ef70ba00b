//! Pictures as files for the page.

use image::codecs::jpeg::JpegEncoder;
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};

use super::ask::{Channel, FrameAsk};
use super::scene_info::Shot;
use crate::eval::colormap::Colormap;
use crate::eval::{DepthMap, painted_depth};
use crate::raster::Picture;

/// JPEG quality of pictures that stay, and of those that others follow at once.
const QUALITY: [u8; 2] = [92, 75];

/// Differences from this many 8-bit steps on are drawn alike.
const MOST_ERROR: f32 = 64.0;

/// A picture as a JPEG file.
pub(super) struct Encoded {
    pub(super) jpeg: Vec<u8>,
    /// The range of the colours where they mean a quantity.
    pub(super) range: Option<(f32, f32)>,
}

/// Encodes a picture as its channel asks.
pub(super) fn encode(picture: &Picture, ask: &FrameAsk, shot: Option<&Shot>) -> Result<Encoded, String> {
    let (image, range) = match ask.channel {
        Channel::Colour | Channel::Outlines => (colours(picture)?, None),
        Channel::Depth => {
            let values = picture.depth().ok_or("the picture has no depth")?;
            let map = DepthMap { width: picture.width, height: picture.height, values };
            let (image, range) = painted_depth(&map);
            (image, Some(range))
        }
        Channel::Normals => (normals(picture)?, None),
        Channel::Error => {
            let shot = shot.ok_or("there is no photograph here")?;
            (error(&colours(picture)?, &pixels(shot)?), Some((0.0, MOST_ERROR)))
        }
    };
    Ok(Encoded { jpeg: jpeg(&image, QUALITY[usize::from(ask.moving)])?, range })
}

/// A photograph as a JPEG file of at most `side` pixels on its longer side.
pub(super) fn photograph(shot: &Shot, side: u32) -> Result<Vec<u8>, String> {
    let image = pixels(shot)?;
    let longest = image.width().max(image.height());
    if longest <= side {
        return jpeg(&image, QUALITY[0]);
    }
    let scaled = |v: u32| (u64::from(v) * u64::from(side) / u64::from(longest)).max(1) as u32;
    jpeg(&imageops::resize(&image, scaled(image.width()), scaled(image.height()), FilterType::Triangle), QUALITY[0])
}

fn pixels(shot: &Shot) -> Result<RgbImage, String> {
    let source = shot.photograph.as_ref().ok_or("there is no photograph here")?;
    let (width, height) = (shot.camera.width, shot.camera.height);
    RgbImage::from_raw(width, height, source.pixels()?).ok_or_else(|| "the photograph has another size".to_owned())
}

fn colours(picture: &Picture) -> Result<RgbImage, String> {
    RgbImage::from_raw(picture.width, picture.height, picture.rgb8()).ok_or_else(|| "the picture is empty".to_owned())
}

/// Normals as colours: x right, y up and z towards the viewer are red, green and blue. Grey where there is none.
fn normals(picture: &Picture) -> Result<RgbImage, String> {
    let normals = picture.normals().ok_or("the picture has no normals")?;
    let byte = |v: f32| (127.5 + 127.5 * v).round() as u8;
    Ok(RgbImage::from_fn(picture.width, picture.height, |x, y| {
        let [a, b, c] = normals[(y * picture.width + x) as usize];
        Rgb([byte(a), byte(-b), byte(-c)])
    }))
}

/// Mean absolute difference of the channels, as colours. The photograph is resampled to the size of the picture.
fn error(render: &RgbImage, photograph: &RgbImage) -> RgbImage {
    let (width, height) = render.dimensions();
    let truth = imageops::resize(photograph, width, height, FilterType::Triangle);
    let map = Colormap::error();
    RgbImage::from_fn(width, height, |x, y| {
        let (a, b) = (render.get_pixel(x, y).0, truth.get_pixel(x, y).0);
        let sum: f32 = a.iter().zip(b).map(|(p, q)| f32::from(p.abs_diff(q))).sum();
        Rgb(map.colour(sum / 3.0 / MOST_ERROR))
    })
}

fn jpeg(image: &RgbImage, quality: u8) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    image.write_with_encoder(JpegEncoder::new_with_quality(&mut out, quality)).map_err(|error| error.to_string())?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_towards_the_viewer_are_blue_and_errors_rise() {
        let picture = Picture {
            width: 2,
            height: 1,
            rgbt: vec![0.0; 8],
            aux: Some(vec![1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0]),
        };
        let image = normals(&picture).expect("normals");
        assert_eq!(image.get_pixel(0, 0).0, [128, 128, 255]);
        assert_eq!(image.get_pixel(1, 0).0, [128; 3]);
        let (dark, bright) = (RgbImage::from_pixel(2, 2, Rgb([10; 3])), RgbImage::from_pixel(4, 4, Rgb([74; 3])));
        assert_eq!(error(&dark, &bright).get_pixel(0, 0).0, Colormap::error().colour(1.0));
        assert_eq!(error(&dark, &dark).get_pixel(1, 1).0, Colormap::error().colour(0.0));
    }
}
