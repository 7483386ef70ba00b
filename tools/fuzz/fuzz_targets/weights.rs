//! Weights in PyTorch's files and in `.safetensors`.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk::perceptual::{LpipsWeights, read_tensors};
use psrgs_vk_fuzz::{Scratch, begin, choice, seeds, within};

static FOLDER: LazyLock<Scratch> = LazyLock::new(Scratch::new);

fuzz_target!(init: begin(seeds::weights::arrays), |data: &[u8]| {
    let (ending, bytes) = choice(data);
    let file = FOLDER.put(["input.pth", "input.safetensors"][ending % 2], bytes);
    within(bytes.len(), 256, || {
        if let Ok(tensors) = read_tensors(&file) {
            assert!(LpipsWeights::new(tensors.clone(), tensors).is_err(), "no input is as long as a network");
        }
    });
});
