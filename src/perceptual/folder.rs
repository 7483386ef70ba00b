//! Files of weights in a folder, by their usual names, and the public sources of the files.

use std::path::{Path, PathBuf};

use super::{Error, LpipsWeights};

/// Names of files of the trunk, in order of preference.
const TRUNK: [&str; 6] = [
    "squeezenet1_1-b8a52dc0.pth",
    "squeezenet1_1.pth",
    "squeezenet1_1.safetensors",
    "squeezenet1_1.ncnn.param",
    "squeezenet_v1.1.ncnn.param",
    "squeezenet_v1.1.param",
];
/// Names of files of the linear layers, in order of preference.
const LINEAR: [&str; 4] = ["squeeze.pth", "lpips_squeeze_v0.1.pth", "lpips_squeeze.pth", "lpips_squeeze.safetensors"];

/// A publicly available file of weights.
#[derive(Clone, Copy, Debug)]
pub struct PublicFile {
    /// Its name in a folder of weights.
    pub name: &'static str,
    /// Description of its content.
    pub what: &'static str,
    /// Its URL.
    pub address: &'static str,
    /// Its size in bytes, where it is known for certain.
    pub bytes: Option<u64>,
    /// The publisher's licence.
    pub licence: &'static str,
    /// SHA-256 of its content in hexadecimal.
    pub sha256: &'static str,
}

/// The files that `lpips_squeeze` needs.
pub const PUBLIC_FILES: [PublicFile; 2] = [
    PublicFile {
        name: TRUNK[0],
        what: "SqueezeNet 1.1 of torchvision, trained on ImageNet",
        address: "https://download.pytorch.org/models/squeezenet1_1-b8a52dc0.pth",
        bytes: None,
        licence: "BSD-3-Clause (torchvision)",
        sha256: "b8a52dc049b60e4b6ab68ad0df457362afab8b6304b2febdc1650a5dab4d7e7b",
    },
    PublicFile {
        name: LINEAR[0],
        what: "linear layers of LPIPS v0.1 on SqueezeNet",
        address: concat!(
            "https://raw.githubusercontent.com/richzhang/PerceptualSimilarity/master/",
            "lpips/weights/v0.1/squeeze.pth"
        ),
        bytes: Some(10_811),
        licence: "BSD-2-Clause (PerceptualSimilarity)",
        sha256: "4a5350f23600cb79923ce65bb07cbf57dca461329894153e05a1346bd531cf76",
    },
];

impl LpipsWeights {
    /// Reads the weights from `path`: a folder with files of the usual names, or a file of the trunk, with the linear
    /// layers in the same file or in a file beside it.
    pub fn find(path: &Path) -> Result<Self, Error> {
        if !path.is_file() {
            let trunk = named(path, &TRUNK, "SqueezeNet 1.1")?;
            return Self::read(&trunk, &named(path, &LINEAR, "LPIPS on SqueezeNet")?);
        }
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        match named(folder, &LINEAR, "LPIPS on SqueezeNet") {
            Ok(linear) => Self::read(path, &linear),
            Err(_) => Self::read(path, path),
        }
    }
}

/// The first file of the folder with one of the names.
fn named(folder: &Path, names: &[&str], what: &'static str) -> Result<PathBuf, Error> {
    let found = names.iter().map(|name| folder.join(name)).find(|file| file.is_file());
    found.ok_or_else(|| Error::NotFound { folder: folder.to_owned(), what, names: names.join(", ") })
}
