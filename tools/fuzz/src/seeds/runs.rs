//! Files of a training.

use psrgs_vk::format::checkpoint::Checkpoint;
use psrgs_vk::pass::counters;
use psrgs_vk::raster::PLANES;
use psrgs_vk::train::Settings;
use serde_json::json;

use crate::Scratch;

/// A training of two splats, and sections with other names.
pub fn checkpoints() -> Vec<Vec<u8>> {
    let splats = 2_usize;
    let mut whole = Checkpoint::new();
    whole.put_text("settings", &Settings::default().to_toml().expect("settings as TOML"));
    whole.put_text("variants", &json!({"tile": "column", "gradients": "atomic"}).to_string());
    whole
        .put_text("history", &json!({"loss": [0.5], "splats": [[0, 2]], "quality": [[1, 20.0, 0.5, 1.5]]}).to_string());
    whole.put_values("step", &[1_u32]);
    whole.put_values("seconds", &[1.5_f64]);
    let mut counted = vec![0_u32; counters::COUNT];
    counted[counters::SPLATS] = splats as u32;
    whole.put_values("counters", &counted);
    whole.put_values("ids", &[0_u32, 1]);
    whole.put_values("stats", &vec![0.25_f32; 4 * splats]);
    whole.put_values("scores", &vec![0.25_f32; 2 * splats]);
    for (name, row) in PLANES {
        for prefix in ["", "m_", "v_"] {
            whole.put_values(&format!("{prefix}{name}"), &vec![0.125_f32; row as usize * splats]);
        }
    }
    let mut other = Checkpoint::new();
    other.put("a", vec![1, 2, 3]);
    other.put_values("means", &[1.0_f32]);
    let scratch = Scratch::new();
    let file = scratch.path().join("seed.ckpt");
    let written = |checkpoint: &Checkpoint| {
        checkpoint.write(&file).expect("a checkpoint");
        std::fs::read(&file).expect("what was written")
    };
    vec![written(&whole), written(&other), written(&Checkpoint::new())]
}
