//! Damage that makes a decoder of another project panic: the readers turn the panic into an error.

use std::fs;
use std::io::Cursor;

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, LineOrder,
    WritableImage, f16,
};
use psrgs_vk::format::image_out;

use super::names_the_place;

/// Differences that lead below zero: the `exr` crate subtracts them unchecked, which panics in builds with overflow
/// checks.
#[test]
fn differences_of_a_b44_block_that_lead_below_zero() {
    let root = tempfile::tempdir().expect("temporary folder");
    let file = root.path().join("depth.exr");
    let values = FlatSamples::F16((0..16).map(|i| f16::from_f32(1.0 + 0.01 * i as f32)).collect());
    let encoding =
        Encoding { compression: Compression::B44, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let channels = AnyChannels::sort(vec![AnyChannel::new("Z", values)].into());
    let image = Image::from_layer(Layer::new((4, 4), LayerAttributes::default(), encoding, channels));
    let mut out = Cursor::new(Vec::new());
    image.write().non_parallel().to_buffered(&mut out).expect("an OpenEXR file");
    let mut bytes = out.into_inner();
    fs::write(&file, &bytes).expect("written");
    assert_eq!(image_out::read_depth(&file).expect("a map").values.len(), 16);
    // The only block: 14 bytes, the last of the file.
    let block = bytes.len() - 14;
    assert_eq!(bytes[block - 4..block], 14_i32.to_le_bytes(), "the length of the block");
    bytes[block..].fill(0);
    fs::write(&file, &bytes).expect("written");
    match image_out::read_depth(&file) {
        Ok(map) => assert_eq!(map.values.len(), 16),
        Err(error) => {
            let message = error.to_string();
            assert!(message.contains("gave up") && names_the_place(&message, &file), "{message}");
        }
    }
}
