//! Files of weights.

use psrgs_vk::perceptual::Tensor;

// The tests' own module, of which only a part is used here.
#[allow(dead_code)]
#[path = "../../../../tests/perceptual/written.rs"]
mod written;

use crate::chosen;

/// PyTorch's files in both forms (0) and a `.safetensors` (1), with two small arrays.
pub fn arrays() -> Vec<Vec<u8>> {
    let array = |shape: &[usize]| {
        let count = shape.iter().product::<usize>();
        Tensor { shape: shape.to_vec(), values: (0..count).map(|i| i as f32 * 0.25).collect() }
    };
    let arrays = [("features.0.weight".to_owned(), array(&[2, 3, 1, 1])), ("features.0.bias".to_owned(), array(&[2]))];
    vec![
        chosen(0, written::old_pth(&arrays)),
        chosen(0, written::zip_pth(&arrays)),
        chosen(1, written::safetensors(&arrays)),
    ]
}

/// A network with the right layers and one number each. The first two bytes are the length of the `.param`, which
/// precedes the `.bin`.
pub fn ncnn() -> Vec<Vec<u8>> {
    let (mut param, mut bin) = ("7767517\n40 50\nInput in0 0 1 in0\n".to_owned(), Vec::new());
    let mut layer = |name: &str, half: bool| {
        param += &format!("Convolution {name} 1 1 x {name}_out 0=1 1=1 11=1 5=1 6=1 9=1\n");
        let tag: u32 = if half { 0x0130_6B47 } else { 0 };
        bin.extend(tag.to_le_bytes());
        bin.extend([0x00, 0x3c, 0, 0]);
        bin.extend(0.5_f32.to_le_bytes());
        if let Some(fire) = name.strip_suffix(".expand3x3") {
            param += &format!("Concat cat 2 1 {fire}.expand1x1_out {name}_out joined 0=0\n");
        }
    };
    layer("features.0", true);
    for fire in [3, 4, 6, 7, 9, 10, 11, 12] {
        for part in ["squeeze", "expand1x1", "expand3x3"] {
            layer(&format!("features.{fire}.{part}"), fire % 2 == 0);
        }
    }
    layer("classifier.1", true);
    vec![[&(param.len() as u16).to_le_bytes(), param.as_bytes(), &bin].concat()]
}
