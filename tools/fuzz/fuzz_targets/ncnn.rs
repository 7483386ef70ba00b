//! Weights in ncnn's `.param` and `.bin`: two bytes for the length of `.param`, then both files.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::perceptual::{LpipsWeights, read_tensors};
use psrgs_vk_fuzz::{Scratch, begin, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(Scratch::new);

fuzz_target!(init: begin(seeds::weights::ncnn), |data: &[u8]| {
    let [low, high, rest @ ..] = data else { return };
    let (param, bin) = rest.split_at(rest.len().min(usize::from(u16::from_le_bytes([*low, *high]))));
    let file = FOLDER.put("input.param", param);
    FOLDER.put("input.bin", bin);
    within(data.len(), 256, || {
        if let Ok(tensors) = read_tensors(&file) {
            assert!(LpipsWeights::new(tensors.clone(), tensors).is_err(), "no input is as long as a network");
        }
    });
});
