//! Photographs, masks and depth maps.

use std::io::Cursor;

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, LineOrder,
    Vec2, WritableImage, f16,
};
use image::{DynamicImage, ImageFormat, Rgb32FImage, RgbaImage};

/// Sizes of the pictures: that of the other seeds' cameras, and one long enough for decoding at a fraction.
const SMALL: (u32, u32) = (24, 16);
const LONG: (u32, u32) = (3072, 8);

fn shaded((width, height): (u32, u32)) -> DynamicImage {
    let pixel = |x: u32, y: u32| image::Rgba([(x * 9) as u8, (y * 13) as u8, (x * y) as u8, 255 - (x % 2) as u8 * 255]);
    RgbaImage::from_fn(width, height, pixel).into()
}

fn encoded(picture: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    picture.write_to(&mut out, format).expect("an encoded picture");
    out.into_inner()
}

/// PNG in every kind that can be written, JPEG in colour and grey, OpenEXR.
pub fn photographs() -> Vec<Vec<u8>> {
    let whole = shaded(SMALL);
    let float: Rgb32FImage = whole.to_rgb32f();
    let mut seeds: Vec<Vec<u8>> = [
        whole.clone(),
        whole.to_rgb8().into(),
        whole.to_luma8().into(),
        whole.to_luma_alpha8().into(),
        whole.to_rgb16().into(),
        whole.to_rgba16().into(),
        whole.to_luma16().into(),
    ]
    .iter()
    .map(|picture| encoded(picture, ImageFormat::Png))
    .collect();
    seeds.push(bilevel());
    seeds.push(encoded(&whole.to_rgb8().into(), ImageFormat::Jpeg));
    seeds.push(encoded(&whole.to_luma8().into(), ImageFormat::Jpeg));
    seeds.push(encoded(&shaded(LONG).to_luma8().into(), ImageFormat::Jpeg));
    seeds.push(encoded(&float.into(), ImageFormat::OpenExr));
    seeds.push(encoded(&whole.to_rgba32f().into(), ImageFormat::OpenExr));
    seeds
}

/// A PNG with one bit per pixel and uncompressed data.
fn bilevel() -> Vec<u8> {
    let (width, height) = SMALL;
    let raw: Vec<u8> = (0..height).flat_map(|y| [0, 0xf0, y as u8, 0x0f]).collect();
    let adler = raw.iter().fold((1_u32, 0_u32), |(a, b), v| {
        let a = (a + u32::from(*v)) % 65_521;
        (a, (b + a) % 65_521)
    });
    let length = raw.len() as u16;
    let data = [
        &[0x78, 0x01, 1][..],
        &length.to_le_bytes(),
        &(!length).to_le_bytes(),
        &raw,
        &(adler.1 << 16 | adler.0).to_be_bytes(),
    ]
    .concat();
    let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[1, 0, 0, 0, 0]].concat();
    let mut out = b"\x89PNG\r\n\x1a\n".to_vec();
    for (kind, content) in [(b"IHDR", header), (b"IDAT", data), (b"IEND", Vec::new())] {
        out.extend((content.len() as u32).to_be_bytes());
        let checked = [&kind[..], &content].concat();
        out.extend(&checked);
        out.extend(crc32fast::hash(&checked).to_be_bytes());
    }
    out
}

/// OpenEXR files with one and three channels, in every compression, as lines and as tiles.
pub fn maps() -> Vec<Vec<u8>> {
    let size = (5, 40);
    let kinds = [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP1,
        Compression::ZIP16,
        Compression::PIZ,
        Compression::PXR24,
        Compression::B44,
    ];
    let write = |compression, blocks, names: &[&str], half: bool| {
        let values = |k: usize| (0..size.0 * size.1).map(move |i| (i * (k + 1)) as f32 * 0.37);
        let samples = |k| match half {
            false => FlatSamples::F32(values(k).collect()),
            true => FlatSamples::F16(values(k).map(f16::from_f32).collect()),
        };
        let channel = |(k, name): (usize, &&str)| AnyChannel::new(*name, samples(k));
        let channels = AnyChannels::sort(names.iter().enumerate().map(channel).collect());
        let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
        let picture = Image::from_layer(Layer::new(size, LayerAttributes::default(), encoding, channels));
        let mut out = Cursor::new(Vec::new());
        picture.write().non_parallel().to_buffered(&mut out).expect("an OpenEXR file");
        out.into_inner()
    };
    let lines = kinds.iter().map(|kind| write(*kind, Blocks::ScanLines, &["Z"], false));
    let halves = [Compression::PIZ, Compression::B44].map(|kind| write(kind, Blocks::ScanLines, &["Z"], true));
    let tiles = write(Compression::ZIP16, Blocks::Tiles(Vec2(4, 8)), &["N.X", "N.Y", "N.Z"], false);
    lines.chain(halves).chain([tiles]).collect()
}
