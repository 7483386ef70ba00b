//! Made-up weights of the right shapes.

use std::path::Path;

use psrgs_vk::perceptual::{LpipsWeights, Tensor, Tensors};
use psrgs_vk::scene::random::Random;

/// Name, outputs, inputs, taps along a side of every convolution.
pub fn convolutions() -> Vec<(String, usize, usize, usize)> {
    let mut all = vec![("features.0".to_owned(), 64, 3, 3)];
    for (at, inputs, squeezed, expanded) in [
        (3, 64, 16, 64),
        (4, 128, 16, 64),
        (6, 128, 32, 128),
        (7, 256, 32, 128),
        (9, 256, 48, 192),
        (10, 384, 48, 192),
        (11, 384, 64, 256),
        (12, 512, 64, 256),
    ] {
        all.push((format!("features.{at}.squeeze"), squeezed, inputs, 1));
        all.push((format!("features.{at}.expand1x1"), expanded, squeezed, 1));
        all.push((format!("features.{at}.expand3x3"), expanded, squeezed, 3));
    }
    all
}

/// Channels of the compared layers.
pub const LAYERS: [usize; 7] = [64, 128, 256, 384, 384, 512, 512];

/// Arrays by name.
pub type Named = Vec<(String, Tensor)>;

/// Random arrays of the trunk and of the linear layers. Numbers are multiples of 2^-10, so that 16 bits hold them.
pub fn arrays() -> (Named, Named) {
    let mut random = Random::new(11);
    let coarse = |v: f64| ((v * 1024.0).round() / 1024.0) as f32;
    let mut trunk = Vec::new();
    for (name, outputs, inputs, size) in convolutions() {
        let spread = (6.0 / (inputs * size * size) as f64).sqrt();
        let values = (0..outputs * inputs * size * size).map(|_| coarse(random.range(-spread, spread))).collect();
        trunk.push((format!("{name}.weight"), Tensor { shape: vec![outputs, inputs, size, size], values }));
        let values = (0..outputs).map(|_| coarse(random.range(-0.1, 0.2))).collect();
        trunk.push((format!("{name}.bias"), Tensor { shape: vec![outputs], values }));
    }
    let linear = LAYERS.iter().enumerate().map(|(k, &channels)| {
        let values = (0..channels).map(|_| coarse(random.range(0.0, 2.0))).collect();
        (format!("lin{k}.model.1.weight"), Tensor { shape: vec![1, channels, 1, 1], values })
    });
    let linear = linear.collect();
    (trunk, linear)
}

/// Arrays in the form of a file's content.
pub fn tensors(file: &str, arrays: Named) -> Tensors {
    let mut tensors = Tensors::new(Path::new(file));
    arrays.into_iter().for_each(|(name, tensor)| tensors.insert(name, tensor));
    tensors
}

/// The whole network with random numbers.
pub fn random() -> (LpipsWeights, Tensors, Tensors) {
    let (trunk, linear) = arrays();
    let (trunk, linear) = (tensors("random trunk", trunk), tensors("random layers", linear));
    (LpipsWeights::new(trunk.clone(), linear.clone()).unwrap(), trunk, linear)
}
