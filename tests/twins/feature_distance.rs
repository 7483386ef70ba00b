//! The distance of features and its gradient against the definition in double precision, also for zero features, and
//! the sums.

use psrgs_vk::pass::feature_distance::{FLAG_GATE, FLAG_GRADIENT, PASS, Push, SUM, SumPush};
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::feature_distance::distance;
use psrgs_vk::vk::Gpu;

use super::common::guards::Guards;
use super::harness::{self, Words, bytes, garbage};

fn case(gpu: &Gpu, pixels: usize, channels: usize, eps: f32, flags: u32) {
    let mut random = Random::new((pixels + channels) as u64);
    let mut features: Vec<f32> = (0..2 * pixels * channels).map(|_| random.between(-1.0, 2.0).max(0.0)).collect();
    // Zero features in the first image, the second, and both; and equal features.
    features[channels..2 * channels].fill(0.0);
    features[(pixels + 2) * channels..(pixels + 3) * channels].fill(0.0);
    for image in 0..2 {
        features[(image * pixels + 3) * channels..(image * pixels + 4) * channels].fill(0.0);
    }
    features.copy_within(4 * channels..5 * channels, (pixels + 4) * channels);
    let weights: Vec<f32> = (0..4 * 3 + channels).map(|_| random.between(0.0, 1.0)).collect();
    let push = Push { pixels: pixels as u32, quads: (channels / 4) as u32, weight_row: 3, part_first: 7, eps, flags };
    let buffers = [bytes(&features), bytes(&weights), garbage(pixels + 9), garbage(pixels * channels + 5)];
    let outcome = harness::run(gpu, &PASS, &[], &buffers, &push, pixels.div_ceil(64) as u32);

    let wide = |values: &[f32]| -> Vec<f64> { values.iter().map(|v| f64::from(*v)).collect() };
    let (mut parts, mut grads) = (Vec::new(), Vec::new());
    for (f, g) in features.chunks(channels).zip(features[pixels * channels..].chunks(channels)) {
        let (value, grad) = distance(&wide(f), &wide(g), &wide(&weights[12..]), f64::from(eps));
        parts.push(value / pixels as f64);
        let open = |f: f32| flags & FLAG_GATE == 0 || f > 0.0;
        grads.extend(f.iter().zip(grad).map(|(f, g)| if open(*f) { g / pixels as f64 } else { 0.0 }));
    }
    for (who, all) in [("device", &outcome.device), ("twin", &outcome.twin)] {
        let floats = |i: usize| -> Vec<f32> { bytemuck::pod_collect_to_vec(&all[i]) };
        Guards::of(8e-6).check(&format!("{who}: distances"), pixels, &floats(2)[7..7 + pixels], &parts);
        assert_eq!(floats(2)[7 + 4], 0.0, "{who}: equal features are at no distance");
        let words = |i: usize| -> Vec<u32> { bytemuck::pod_collect_to_vec(&all[i]) };
        let before: Vec<u32> = bytemuck::pod_collect_to_vec(&buffers[2]);
        assert_eq!([&words(2)[..7], &words(2)[7 + pixels..]], [&before[..7], &before[7 + pixels..]], "{who}");
        if flags & FLAG_GRADIENT == 0 {
            assert_eq!(all[3], buffers[3], "{who}: no gradient was asked for");
        } else {
            Guards::of(8e-6).check(&format!("{who}: gradients"), channels, &floats(3)[..pixels * channels], &grads);
        }
    }
}

pub fn run(gpu: &Gpu) {
    case(gpu, 70, 16, 1e-10, FLAG_GRADIENT | FLAG_GATE);
    case(gpu, 33, 8, 0.05, FLAG_GRADIENT);
    case(gpu, 9, 64, 1e-10, 0);

    let mut random = Random::new(5);
    let ends = [130, 131, 131, 200, 0, 0, 0, 0];
    let parts: Vec<f32> = (0..220).map(|_| random.between(0.0, 1.0)).collect();
    let push = SumPush { ends, layers: 4 };
    let outcome = harness::run(gpu, &SUM, &[], &[bytes(&parts), garbage(6)], &push, 1);
    let sum = |range: std::ops::Range<usize>| parts[range].iter().map(|v| f64::from(*v)).sum::<f64>();
    let want = [sum(0..130), sum(130..131), 0.0, sum(131..200), sum(0..200)];
    for (who, got) in [("device", outcome.device::<f32>(1)), ("twin", outcome.twin::<f32>(1))] {
        for (layer, want) in want.iter().enumerate() {
            let error = (f64::from(got[layer]) - want).abs();
            assert!(error <= 2e-6 * want, "{who}: layer {layer}: {} instead of {want}", got[layer]);
        }
    }
}
