//! Readers of weights: every format gives the same numbers, and errors name file and field.

use std::path::{Path, PathBuf};

use psrgs_vk::perceptual::{Error, LpipsWeights, Tensor, read_tensors};

use super::common;
use super::weights::{Named, arrays, tensors};
use super::written::{Arrays, ncnn, old_pth, safetensors, zip_pth};

fn write(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let file = folder.join(name);
    std::fs::write(&file, bytes).unwrap();
    file
}

fn assert_equal(file: &Path, arrays: &Arrays) {
    let read = read_tensors(file).unwrap();
    for (name, tensor) in arrays {
        let values = read.get(name, &tensor.shape, "test").unwrap();
        assert!(values == tensor.values, "{}: {name}", file.display());
    }
}

#[test]
fn every_format_gives_the_same_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let (trunk, linear) = arrays();
    for (name, bytes) in
        [("old.pth", old_pth(&trunk)), ("new.pth", zip_pth(&trunk)), ("squeezenet1_1.safetensors", safetensors(&trunk))]
    {
        assert_equal(&write(folder.path(), name, &bytes), &trunk);
    }
    let (param, bin) = ncnn(&trunk);
    let param = write(folder.path(), "net.ncnn.param", param.as_bytes());
    let bin = write(folder.path(), "net.ncnn.bin", &bin);
    assert_equal(&param, &trunk);
    assert_equal(&bin, &trunk);

    // A folder with the usual names, a trunk with the linear layers beside it, and both in one file.
    let layers = write(folder.path(), "squeeze.pth", &old_pth(&linear));
    let found = LpipsWeights::find(folder.path()).unwrap();
    assert_eq!(found.files(), [folder.path().join("squeezenet1_1.safetensors"), layers.clone()]);
    assert_eq!(LpipsWeights::find(&param).unwrap().files(), [bin.clone(), layers]);
    let alone = folder.path().join("alone");
    std::fs::create_dir(&alone).unwrap();
    let both: Vec<(String, Tensor)> = trunk.into_iter().chain(linear).collect();
    let both = write(&alone, "both.safetensors", &safetensors(&both));
    assert_eq!(LpipsWeights::find(&both).unwrap().files(), [both.clone(), both]);
}

#[test]
fn published_files_are_read_to_the_last_byte() {
    let Some(linear) = common::weights("lpips_squeeze_v0.1.pth") else { return };
    let read = read_tensors(&linear).unwrap();
    let sums = [5.6901, 1.1853, 16.3266, 71.0126, 37.3707, 24.2629, 17.5906];
    for (k, (channels, sum)) in [64, 128, 256, 384, 384, 512, 512].into_iter().zip(sums).enumerate() {
        let values = read.get(&format!("lin{k}.model.1.weight"), &[1, channels, 1, 1], "test").unwrap();
        let got: f64 = values.iter().map(|v| f64::from(*v)).sum();
        assert!((got - sum).abs() < 1e-4 && values.iter().all(|v| *v >= 0.0), "layer {k}: {got}");
    }
    let Some(trunk) = common::weights("squeezenet_v1.1.ncnn.param") else { return };
    let weights = LpipsWeights::find(trunk.parent().unwrap()).unwrap();
    assert_eq!(weights.files(), [trunk.with_extension("bin"), linear]);
}

#[test]
fn another_network_is_named_with_file_and_field() {
    let (trunk, linear) = arrays();
    let fails = |change: &dyn Fn(&mut Named, &mut Named)| -> Error {
        let (mut trunk, mut linear) = (trunk.clone(), linear.clone());
        change(&mut trunk, &mut linear);
        LpipsWeights::new(tensors("trunk.pth", trunk), tensors("layers.pth", linear)).unwrap_err()
    };
    let error = fails(&|trunk, _| trunk.retain(|(name, _)| name != "features.9.expand3x3.bias"));
    assert!(matches!(&error, Error::Missing { field, .. } if field == "features.9.expand3x3.bias"), "{error}");
    assert!(error.to_string().starts_with("trunk.pth: "), "{error}");
    // SqueezeNet 1.0 begins with 96 filters of 7x7.
    let error = fails(&|trunk, _| trunk[0].1 = Tensor { shape: vec![96, 3, 7, 7], values: vec![0.0; 96 * 3 * 49] });
    assert!(error.to_string().contains("[96, 3, 7, 7], expected [64, 3, 3, 3]"), "{error}");
    let error = fails(&|trunk, _| trunk[4].1.values[7] = f32::NAN);
    assert!(matches!(error, Error::Value { .. }), "{error}");
    let error = fails(&|_, linear| linear[5].1.values[7] = -0.5);
    assert!(matches!(&error, Error::Value { field, .. } if field == "lin5.model.1.weight"), "{error}");
    // The layers of AlexNet.
    let error = fails(&|_, linear| linear[1].1 = Tensor { shape: vec![1, 192, 1, 1], values: vec![0.0; 192] });
    assert!(error.to_string().starts_with("layers.pth: 'lin1.model.1.weight'"), "{error}");
}

/// Files of every format, cut at any byte or with any byte changed, are read or refused, with no more memory than a
/// file justifies.
#[test]
fn damaged_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let few = |arrays: Vec<(String, Tensor)>| {
        arrays.into_iter().filter(|(name, _)| name.starts_with("lin0")).collect::<Vec<_>>()
    };
    let small = few(arrays().1);
    for (name, bytes) in
        [("old.pth", old_pth(&small)), ("new.pth", zip_pth(&small)), ("a.safetensors", safetensors(&small))]
    {
        for end in 0..bytes.len() {
            let file = write(folder.path(), name, &bytes[..end]);
            let error = read_tensors(&file).expect_err(&format!("{name}, {end} of {} bytes", bytes.len()));
            assert!(error.to_string().contains(name), "{error}");
        }
        for at in 0..bytes.len() {
            for flip in [0x01, 0x80, 0xff] {
                let mut broken = bytes.clone();
                broken[at] ^= flip;
                // No panic, and no allocation beyond the size of the file.
                let _ = read_tensors(&write(folder.path(), name, &broken));
            }
        }
    }
    let error = read_tensors(&write(folder.path(), "some.dat", b"neither this nor that")).unwrap_err();
    assert!(matches!(error, Error::UnknownFormat { .. }), "{error}");
    let error = LpipsWeights::find(folder.path()).unwrap_err();
    assert!(matches!(error, Error::NotFound { .. }), "{error}");
    let error = read_tensors(&folder.path().join("none.pth")).unwrap_err();
    assert!(matches!(error, Error::File(_)), "{error}");
}

#[test]
fn damaged_ncnn_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (param, bin) = ncnn(&arrays().0);
    let reads = |param: &str, bin: &[u8]| {
        write(folder.path(), "net.bin", bin);
        read_tensors(&write(folder.path(), "net.param", param.as_bytes())).map(|_| ())
    };
    reads(&param, &bin).unwrap();
    let says = |param: &str, bin: &[u8], what: &str| {
        let error = reads(param, bin).expect_err(what).to_string();
        assert!(error.contains(what) && error.contains("net."), "{error}");
    };
    for end in [0, 3, 4, 5, 3000, bin.len() - 1] {
        says(&param, &bin[..end], "needs");
    }
    says(&param, &[bin.as_slice(), &[0; 4]].concat(), "4 bytes follow");
    let mut tag = bin.clone();
    tag[0] = 9;
    says(&param, &tag, "tag of features.0.weight");
    says(&param.replacen("7767517", "7767518", 1), &bin, "first line");
    says(&param.replacen("0=64", "0=sixty", 1), &bin, "0=sixty");
    says(&param.replacen("0=64", "0=0", 1), &bin, "no outputs");
    says(&param.replacen("6=1728", "6=18446744073709551615", 1), &bin, "needs");
    let first = "features.3.expand1x1.weight_out features.3.expand3x3.weight_out joined";
    let swapped = "features.3.expand3x3.weight_out features.3.expand1x1.weight_out joined";
    assert!(param.contains(first));
    says(&param.replacen(first, swapped, 1), &bin, "Concat");
    let fewer: String = param.lines().take(20).map(|l| format!("{l}\n")).collect();
    says(&fewer, &bin, "convolutions of SqueezeNet 1.1");
}
