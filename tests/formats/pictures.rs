//! PNG and EXR.

use psrgs_vk::format::image_out;

#[test]
fn png_rounds_to_the_nearest_of_8_bits() {
    for (value, want) in [
        (0.0, 0),
        (1.0, 255),
        (0.5 / 255.0, 1),
        (0.499 / 255.0, 0),
        (254.5 / 255.0, 255),
        (-3.0, 0),
        (7.0, 255),
        (f32::NAN, 0),
        (f32::INFINITY, 255),
        (100.4 / 255.0, 100),
        (100.6 / 255.0, 101),
    ] {
        assert_eq!(image_out::to_u8(value), want, "{value}");
    }
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("a.png");
    let rgb = image_out::to_rgb8(&[0.0, 0.5, 1.0, 0.25, 1.0, 0.1, 0.2, 9.0], 4);
    image_out::write_png(&file, 1, 2, &rgb).expect("written");
    let read = image::open(&file).expect("read").into_rgb8();
    assert_eq!((read.dimensions(), read.into_raw()), ((1, 2), vec![0, 128, 255, 255, 26, 51]));
    assert!(image_out::write_png(&file, 2, 2, &rgb).expect_err("a size").to_string().contains("2 pixels are not 2x2"));
}

#[test]
fn exr_keeps_depths_and_normals_bit_for_bit() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("depth.exr");
    let depths: Vec<f32> = (0..37 * 23).map(|i| 1.0 / (i as f32 - 300.5) * 1e4).collect();
    image_out::write_depth(&file, 37, 23, &depths).expect("written");
    let read = image_out::read_depth(&file).expect("read");
    assert_eq!((read.width, read.height), (37, 23));
    assert!(read.values.iter().zip(&depths).all(|(a, b)| a.to_bits() == b.to_bits()));

    let normals: Vec<[f32; 3]> = depths.iter().map(|d| [d.sin(), d.cos(), -0.0]).collect();
    image_out::write_normals(&file, 37, 23, &normals).expect("written");
    let error = image_out::read_depth(&file).expect_err("no depth").to_string();
    assert!(error.contains("no channel 'Z' among N.X, N.Y, N.Z"), "{error}");
    let image = exr::prelude::read_first_flat_layer_from_file(&file).expect("read");
    for (k, channel) in image.layer_data.channel_data.list.iter().enumerate() {
        assert!(channel.sample_data.values_as_f32().zip(&normals).all(|(a, n)| a.to_bits() == n[k].to_bits()));
    }
}
