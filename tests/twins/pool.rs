//! Pooling bit for bit, with ties and windows over the edge, and its gradient against the definition.

use psrgs_vk::pass::pool::{BACKWARD, BackwardPush, FLAG_ADD, FLAG_GATE, FORWARD, Push, pooled};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::pool::backward;
use psrgs_vk::vk::Gpu;

use super::common::guards::Guards;
use super::harness::{self, Words, bytes, garbage};

fn rows(random: &mut Random, count: u32, steps: f32) -> Vec<[f32; 4]> {
    // Few different values, so that many are equal.
    (0..count).map(|_| std::array::from_fn(|_| (random.between(-1.0, 1.0) * steps).round() / steps)).collect()
}

fn case(gpu: &Gpu, width: u32, height: u32, quads: u32, flags: u32) {
    let mut random = Random::new(u64::from(100 * width + height));
    let (out_width, out_height) = (pooled(width), pooled(height));
    let push = Push { in_width: width, in_height: height, out_width, out_height, quads, images: 2 };
    let source = rows(&mut random, 2 * width * height * quads, 3.0);
    let outputs = 2 * out_width * out_height * quads;
    let buffers = [bytes(&source), garbage(4 * outputs as usize + 3), garbage(outputs as usize + 3)];
    let outcome = harness::run(gpu, &FORWARD, &[], &buffers, &push, outputs.div_ceil(64));
    outcome.assert_same_bits(&format!("pool of {width}x{height}"));

    let push = BackwardPush { in_width: width, in_height: height, out_width, out_height, quads, flags };
    let inputs = width * height * quads;
    let grad_out = rows(&mut random, outputs / 2, 1000.0);
    let grad_in = rows(&mut random, inputs, 1000.0);
    let buffers = [bytes(&grad_out), outcome.device[2].clone(), bytes(&source), bytes(&grad_in)];
    let outcome = harness::run(gpu, &BACKWARD, &[], &buffers, &push, inputs.div_ceil(64));
    let wide = |rows: &[[f32; 4]]| -> Vec<[f64; 4]> { rows.iter().map(|row| row.map(f64::from)).collect() };
    let winners: Vec<[u8; 4]> = bytemuck::pod_collect_to_vec(&buffers[1][..2 * outputs as usize]);
    let mut want = wide(&grad_in);
    backward(&push, &wide(&grad_out), &winners, &wide(&source), &mut want);
    let want: Vec<f64> = want.into_iter().flatten().collect();
    let name = format!("gradient of the pool of {width}x{height}");
    Guards::of(1e-6).check(&name, 4 * quads as usize, &outcome.device::<f32>(3), &want);
    Guards::of(1e-6).check(&format!("{name}, twin"), 4 * quads as usize, &outcome.twin::<f32>(3), &want);
}

pub fn run(gpu: &Gpu) {
    case(gpu, 11, 9, 3, FLAG_ADD | FLAG_GATE);
    case(gpu, 12, 7, 2, FLAG_ADD);
    case(gpu, 4, 6, 1, FLAG_GATE);
    case(gpu, 2, 3, 5, 0);
}
