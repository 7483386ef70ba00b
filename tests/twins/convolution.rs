//! The convolution against its definition in double precision: strides, padding, slices of channels, and operations on
//! the result.

use psrgs_vk::pass::convolution::{FLAG_ADD, FLAG_GATE, FLAG_RELU, PASS, Push};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::convolution::{Buffers, convolution};
use psrgs_vk::vk::Gpu;

use super::common::guards::Guards;
use super::harness::{self, Words, bytes};

fn rows(random: &mut Random, count: u32) -> Vec<[f32; 4]> {
    (0..count).map(|_| std::array::from_fn(|_| random.between(-1.0, 1.0))).collect()
}

fn wide(rows: &[[f32; 4]]) -> Vec<[f64; 4]> {
    rows.iter().map(|row| row.map(f64::from)).collect()
}

fn case(gpu: &Gpu, name: &str, push: Push) {
    let mut random = Random::new(u64::from(push.in_width * 31 + push.flags));
    let pixels = push.in_width * push.in_height * push.images;
    let mut source = rows(&mut random, (pixels + 1) * push.in_row);
    source[(pixels * push.in_row) as usize..].fill([0.0; 4]);
    let push = Push { zero_pixel: pixels, ..push };
    let taps = push.size * push.size;
    let filters = rows(&mut random, push.filter_row + push.groups * taps * push.in_quads * 8);
    let biases = rows(&mut random, push.bias_row + 2 * push.groups);
    let out_rows = push.out_width * push.out_height * push.images * push.out_row;
    let (gate, result) = (rows(&mut random, out_rows), rows(&mut random, out_rows));
    let buffers = [bytes(&source), bytes(&filters), bytes(&biases), bytes(&gate), bytes(&result)];
    let groups = push.threads().div_ceil(64) as u32;
    let outcome = harness::run(gpu, &PASS, &[], &buffers, &push, groups);

    let mut want = wide(&result);
    let (source, filters, biases, gate) = (wide(&source), wide(&filters), wide(&biases), wide(&gate));
    let all = Buffers { source: &source, filters: &filters, biases: &biases, gate: &gate, result: &mut want };
    convolution(&push, all);
    let want: Vec<f64> = want.into_iter().flatten().collect();
    let row = 4 * push.out_row as usize;
    Guards::of(4e-6).check(name, row, &outcome.device::<f32>(4), &want);
    Guards::of(4e-6).check(&format!("{name}, twin"), row, &outcome.twin::<f32>(4), &want);
}

pub fn run(gpu: &Gpu) {
    let plain = Push {
        in_row: 3,
        in_first: 1,
        in_quads: 2,
        out_row: 7,
        out_first: 2,
        groups: 2,
        images: 2,
        stride: 1,
        filter_row: 5,
        bias_row: 3,
        ..Push::default()
    };
    let sized = |size: u32, pad: u32, input: (u32, u32), output: (u32, u32)| Push {
        in_width: input.0,
        in_height: input.1,
        out_width: output.0,
        out_height: output.1,
        size,
        pad,
        ..plain
    };
    case(gpu, "1x1", Push { flags: FLAG_RELU, ..sized(1, 0, (9, 5), (9, 5)) });
    case(gpu, "3x3, padded", Push { flags: FLAG_RELU, ..sized(3, 1, (11, 7), (11, 7)) });
    case(gpu, "3x3, every second pixel", Push { stride: 2, ..sized(3, 0, (13, 12), (6, 5)) });
    case(gpu, "3x3, added and gated", Push { flags: FLAG_ADD | FLAG_GATE, images: 1, ..sized(3, 1, (10, 6), (10, 6)) });
    case(gpu, "2x2, larger than its source", Push { images: 1, ..sized(2, 1, (6, 5), (7, 6)) });
    case(gpu, "a single pixel", Push { flags: FLAG_ADD, images: 1, ..sized(3, 1, (1, 1), (1, 1)) });
}
