//! Settings, and the small JSON files beside a model.

use psrgs_vk::format::FrameFile;
use psrgs_vk::geodesy::Georeference;
use psrgs_vk::scene::{Coordinates, Frame, Geodetic};
use psrgs_vk::train::Settings;
use psrgs_vk::train::settings::{Background, ByteSize, Exposure, Split};
use serde_json::json;

use crate::chosen;

/// Default settings, other settings, and single groups.
pub fn settings() -> Vec<Vec<u8>> {
    let mut other = Settings { data: Some("some where/scene".into()), ..Settings::default() };
    other.run.init = Some("start.ply".into());
    other.photographs.split = Split::Every { every: 8, first: 4 };
    other.photographs.white_level = Some(4095.0);
    other.model.background = Background::Random;
    other.optimiser.exposure = Exposure::Affine;
    other.density.max_splats = Some(70_000);
    other.device.max_device_memory = Some(ByteSize(6 << 30));
    let written = |s: &Settings| s.to_toml().expect("settings as TOML").into_bytes();
    let mut seeds = vec![written(&Settings::default()), written(&other)];
    // One group each: small enough to mutate well.
    let text = String::from_utf8_lossy(&seeds[1]).into_owned();
    seeds.extend(text.split("\n\n").map(|group| group.as_bytes().to_vec()));
    seeds
}

/// `frame.json`, transforms, exposures, metrics and the parameters of a world. The first byte chooses.
pub fn beside_models() -> Vec<Vec<u8>> {
    let frame = FrameFile::new(Frame { offset: [5e5, 4.6e6, 100.0], scale: 0.25 }, None);
    let origin = Geodetic { latitude: 47.65, longitude: 10.3, altitude: 740.0 };
    let coordinates = Coordinates::EastNorthUp { origin };
    let map = Georeference::of_coordinates(&coordinates, None).expect("a zone").record([1.0, 2.0, 3.0]);
    let placed = FrameFile::new(Frame::IDENTITY, Some(coordinates)).with_map(map);
    let rows = json!([[0.0, -2.0, 0.0, 5.0], [2.0, 0.0, 0.0, -1.0], [0.0, 0.0, 2.0, 0.5], [0.0, 0.0, 0.0, 1.0]]);
    let score = json!({"name": "a.png", "psnr": 20.5, "ssim": 0.75, "gmsd": null});
    let metrics = json!({
        "method": "3dgs", "iterations": 100, "scene": "s", "train_images": 3, "test_images": 1, "width": 24, "height": 16,
        "seed": 0, "device": "d", "psnr": null, "ssim": 0.5, "splats": 9, "bytes": 100, "seconds": 1.5,
        "seconds_per_iteration": 0.015, "peak_device_bytes": 5, "peak_host_bytes": null, "images": [score],
    });
    vec![
        chosen(0, serde_json::to_vec(&frame).expect("a frame as JSON")),
        chosen(0, serde_json::to_vec(&placed).expect("a frame as JSON")),
        chosen(1, rows.to_string()),
        chosen(1, json!({"transform": rows, "scale": 0.5}).to_string()),
        chosen(2, json!({"a.png": [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]}).to_string()),
        chosen(3, metrics.to_string()),
        chosen(4, toml::to_string(&psrgs_vk::world::WorldParams::default()).expect("a world as TOML")),
    ]
}
