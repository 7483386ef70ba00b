//! `cameras.txt`, `images.txt` and `points3D.txt`.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use psrgs_vk_fuzz::datasets::Colmap;
use psrgs_vk_fuzz::{begin, choice, seeds, within};

static COLMAP: LazyLock<Colmap> = LazyLock::new(|| Colmap::new(true));

fuzz_target!(init: begin(|| seeds::folders::colmap(true)), |data: &[u8]| {
    let (file, bytes) = choice(data);
    within(bytes.len(), 64, || COLMAP.load_with(file, bytes));
});
