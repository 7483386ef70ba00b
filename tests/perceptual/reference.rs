//! LPIPS on SqueezeNet 1.1 in double precision, channel after channel, from the definition.

use psrgs_vk::perceptual::Tensors;

/// Planes of numbers.
#[derive(Clone)]
struct Planes {
    channels: usize,
    height: usize,
    width: usize,
    values: Vec<f64>,
}

impl Planes {
    fn at(&self, c: usize, y: usize, x: usize) -> f64 {
        self.values[(c * self.height + y) * self.width + x]
    }
}

struct Net<'a> {
    trunk: &'a Tensors,
    linear: &'a Tensors,
}

impl Net<'_> {
    fn convolution(&self, x: &Planes, name: &str, outputs: usize, size: usize, stride: usize, pad: usize) -> Planes {
        let weights = self.trunk.get(&format!("{name}.weight"), &[outputs, x.channels, size, size], "test").unwrap();
        let biases = self.trunk.get(&format!("{name}.bias"), &[outputs], "test").unwrap();
        let [height, width] = [x.height, x.width].map(|side| (side + 2 * pad - size) / stride + 1);
        let mut values = Vec::with_capacity(outputs * height * width);
        for o in 0..outputs {
            let mut plane = vec![f64::from(biases[o]); height * width];
            for c in 0..x.channels {
                for ky in 0..size {
                    for kx in 0..size {
                        let w = f64::from(weights[((o * x.channels + c) * size + ky) * size + kx]);
                        for y in 0..height {
                            let Some(sy) = (y * stride + ky).checked_sub(pad).filter(|sy| *sy < x.height) else {
                                continue;
                            };
                            for column in 0..width {
                                let sx = (column * stride + kx).wrapping_sub(pad);
                                if sx < x.width {
                                    plane[y * width + column] += w * x.at(c, sy, sx);
                                }
                            }
                        }
                    }
                }
            }
            values.extend(plane.into_iter().map(|v| v.max(0.0)));
        }
        Planes { channels: outputs, height, width, values }
    }

    fn fire(&self, x: &Planes, at: usize, squeezed: usize, expanded: usize) -> Planes {
        let squeeze = self.convolution(x, &format!("features.{at}.squeeze"), squeezed, 1, 1, 0);
        let mut one = self.convolution(&squeeze, &format!("features.{at}.expand1x1"), expanded, 1, 1, 0);
        let three = self.convolution(&squeeze, &format!("features.{at}.expand3x3"), expanded, 3, 1, 1);
        one.channels += three.channels;
        one.values.extend(three.values);
        one
    }

    fn features(&self, image: &[[f64; 3]], width: usize) -> Vec<Planes> {
        let (shift, scale) = ([-0.030, -0.088, -0.188], [0.458, 0.448, 0.450]);
        let channel = |c: usize| image.iter().map(move |p| (2.0 * p[c] - 1.0 - shift[c]) / scale[c]);
        let values = (0..3).flat_map(channel).collect();
        let x = Planes { channels: 3, height: image.len() / width, width, values };
        let x = self.convolution(&x, "features.0", 64, 3, 2, 0);
        let mut taps = vec![x.clone()];
        let x = self.fire(&pool(&x), 3, 16, 64);
        let x = self.fire(&x, 4, 16, 64);
        taps.push(x.clone());
        let x = self.fire(&pool(&x), 6, 32, 128);
        let x = self.fire(&x, 7, 32, 128);
        taps.push(x.clone());
        let mut x = pool(&x);
        for (at, squeezed, expanded) in [(9, 48, 192), (10, 48, 192), (11, 64, 256), (12, 64, 256)] {
            x = self.fire(&x, at, squeezed, expanded);
            taps.push(x.clone());
        }
        taps
    }
}

/// 3x3, stride 2; the last window may hang over when a part of it is inside.
fn pool(x: &Planes) -> Planes {
    // PyTorch: (side - size + stride - 1) / stride + 1.
    let [height, width] = [x.height, x.width].map(|side| (side + 1 - 3) / 2 + 1);
    let mut values = Vec::new();
    for c in 0..x.channels {
        for y in 0..height {
            for column in 0..width {
                let ys = 2 * y..(2 * y + 3).min(x.height);
                let over = ys.flat_map(|sy| (2 * column..(2 * column + 3).min(x.width)).map(move |sx| (sy, sx)));
                values.push(over.map(|(sy, sx)| x.at(c, sy, sx)).fold(f64::NEG_INFINITY, f64::max));
            }
        }
    }
    Planes { channels: x.channels, height, width, values }
}

/// The reference picture of a comparison.
pub struct Reference<'a> {
    net: Net<'a>,
    width: usize,
    features: Vec<Planes>,
}

impl<'a> Reference<'a> {
    /// A reference picture, row by row, with the network.
    pub fn new(trunk: &'a Tensors, linear: &'a Tensors, picture: &[[f64; 3]], width: usize) -> Self {
        let net = Net { trunk, linear };
        let features = net.features(picture, width);
        Self { net, width, features }
    }

    /// The distance of each layer.
    pub fn layers(&self, picture: &[[f64; 3]]) -> Vec<f64> {
        let layer = |(k, (f, g)): (usize, (Planes, &Planes))| {
            let name = format!("lin{k}.model.1.weight");
            let weights = self.net.linear.get(&name, &[1, f.channels, 1, 1], "test").unwrap();
            let pixels = f.height * f.width;
            let sum: f64 = (0..pixels)
                .map(|p| {
                    let length =
                        |x: &Planes| (0..x.channels).map(|c| x.values[c * pixels + p].powi(2)).sum::<f64>().sqrt();
                    let (n, m) = (length(&f) + 1e-10, length(g) + 1e-10);
                    let one = |c: usize| (f.values[c * pixels + p] / n - g.values[c * pixels + p] / m).powi(2);
                    (0..f.channels).map(|c| f64::from(weights[c]) * one(c)).sum::<f64>()
                })
                .sum();
            sum / pixels as f64
        };
        self.net.features(picture, self.width).into_iter().zip(&self.features).enumerate().map(layer).collect()
    }

    /// The distance.
    pub fn distance(&self, picture: &[[f64; 3]]) -> f64 {
        self.layers(picture).iter().sum()
    }
}
