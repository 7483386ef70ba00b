//! Windows of images with masked pixels, and the way back of gradients.

use psrgs_vk::pass::crop::{GRADIENT, GradientPush, PAIR, Push};
use psrgs_vk::scene::random::Random;
use psrgs_vk::vk::Gpu;

use super::harness::{self, Outcome, Words, bytes};

const SIZE: (u32, u32) = (23, 17);

fn close(what: &str, outcome: &Outcome, buffer: usize) {
    let (device, twin) = (outcome.device::<f32>(buffer), outcome.twin::<f32>(buffer));
    for (i, (d, t)) in device.iter().zip(&twin).enumerate() {
        assert!((d - t).abs() <= 3e-7, "{what}, float {i}: device {d}, twin {t}");
    }
}

pub fn run(gpu: &Gpu) {
    for cropped in [false, true] {
        of(gpu, cropped);
    }
}

fn of(gpu: &Gpu, cropped: bool) {
    let mut random = Random::new(9);
    let pixels = (SIZE.0 * SIZE.1) as usize;
    let image: Vec<f32> = (0..4 * pixels).map(|_| random.between(0.0, 1.2)).collect();
    let target: Vec<u32> =
        (0..pixels).map(|k| if k % 5 == 0 { random.word() >> 8 } else { random.word() | 1 << 24 }).collect();
    let (left, top, width, height) = (6, 3, 13, 9);
    let inside = (width * height) as usize;

    let push = Push { image_width: SIZE.0, left, top, width, height, cropped: u32::from(cropped) };
    let zeros = vec![0.0f32; 8 * inside + 4];
    let buffers = [bytes(&image), bytes(&target), bytes(&zeros)];
    let outcome = harness::run(gpu, &PAIR, &[], &buffers, &push, inside.div_ceil(64) as u32);
    close("pair", &outcome, 2);
    let pair = outcome.device::<[f32; 4]>(2);
    for k in 0..inside {
        let at = (top as usize + k / 13) * SIZE.0 as usize + left as usize + k % 13;
        let red = (target[at] & 255) as f32 / 255.0;
        assert!((pair[inside + k][0] - red).abs() < 1e-6, "photograph at {k}");
        let shown = if target[at] >> 24 == 0 { red } else { image[4 * if cropped { k } else { at }] };
        assert!((pair[k][0] - shown).abs() < 1e-6, "render at {k}");
        assert_eq!((pair[k][3], pair[inside + k][3]), (0.0, 0.0));
    }

    let push = GradientPush { image_width: SIZE.0, left, top, width, height, weight: 0.3, cropped: u32::from(cropped) };
    let blocks: Vec<f32> = (0..16 * 7 * 5).map(|_| random.between(-1.0, 1.0)).collect();
    let buffers = [bytes(&blocks), bytes(&target), bytes(&image)];
    let outcome = harness::run(gpu, &GRADIENT, &[], &buffers, &push, inside.div_ceil(64) as u32);
    let after = outcome.device::<f32>(2);
    for at in 0..pixels {
        let (x, y) = if cropped {
            (at as u32 % width, at as u32 / width)
        } else {
            ((at as u32 % SIZE.0).wrapping_sub(left), (at as u32 / SIZE.0).wrapping_sub(top))
        };
        let shown = (y < height).then(|| ((top + y) * SIZE.0 + left + x.min(width)) as usize);
        for c in 0..4 {
            let block = 4 * (4 * (y / 2).min(4) * 7 + 4 * (x / 2).min(6) + 2 * (y % 2) + x % 2) as usize;
            let gets = x < width && shown.is_some_and(|k| target[k] >> 24 != 0) && c < 3;
            let want = image[4 * at + c] + if gets { 0.3 * blocks[block + c] } else { 0.0 };
            let got = after[4 * at + c];
            assert!((got - want).abs() <= 3e-7, "pixel {at}, channel {c}: {got} instead of {want}");
            assert!(gets || got.to_bits() == image[4 * at + c].to_bits(), "pixel {at}, channel {c} was touched");
        }
    }
    close("gradient", &outcome, 2);
}
