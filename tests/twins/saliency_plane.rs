//! `saliency_plane` against its twin in f64: smaller and larger than the mask, whole images and bands of rows.

use psrgs_vk::pass::saliency_plane::{PASS, Push};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::place::ByteMask;
use psrgs_vk::vk::Gpu;

use super::harness::{self, Words, bytes, garbage};

pub fn run(gpu: &Gpu) {
    let mut random = Random::new(23);
    for mask_size in [[1_u32, 1], [4, 3], [13, 7]] {
        for (size, [top, height]) in [
            ([1, 1], [0, 1]),
            ([4, 3], [0, 3]),
            ([13, 7], [0, 7]),
            ([39, 21], [0, 21]),
            ([6, 30], [0, 30]),
            ([39, 21], [0, 9]),
            ([39, 21], [9, 12]),
            ([6, 30], [29, 1]),
        ] {
            let [mask_width, mask_height] = mask_size;
            let [width, of_height] = size;
            let words = random.words((mask_width * mask_height).div_ceil(4) as usize + 3);
            let push = Push { width, height, top, of_height, mask_width, mask_height };
            let pixels = (width * height) as usize;
            let buffers = [bytes(&words), garbage(pixels + 4)];
            let outcome = harness::run(gpu, &PASS, &[], &buffers, &push, pixels.div_ceil(64) as u32);
            let mask = ByteMask { bytes: &buffers[0], size: mask_size.map(|v| v as usize) };
            let size = size.map(|v| v as usize);
            for (got, who) in [(outcome.device::<f32>(1), "device"), (outcome.twin::<f32>(1), "twin")] {
                for (k, v) in got[..pixels].iter().enumerate() {
                    let want: f64 = mask.at([k % size[0], top as usize + k / size[0]], size);
                    assert!(
                        (f64::from(*v) - want).abs() < 2e-6,
                        "{who}, pixel {k} of {width}x{height} from row {top} of {of_height}: {v} for {want}"
                    );
                }
                assert_eq!(bytes(&got[pixels..]), buffers[1][4 * pixels..], "{who}: words behind the image changed");
            }
        }
    }
}
