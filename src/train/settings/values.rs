//! The types of single settings: each is read from and written as one word, on the command line and in `settings.toml`.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

pub use super::method::Method;
pub use super::preset::Preset;
pub use crate::dataset::{Format, MaskIgnores, Split, Transfer};
pub use crate::saliency::Gate;

use crate::byte_size::{self, UNITS};

/// Reads and writes a type in serde as the word of its `Display` and `FromStr`.
macro_rules! as_word {
    ($name:ident) => {
        impl serde::Serialize for $name {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_str(self)
            }
        }
        impl<'de> serde::Deserialize<'de> for $name {
            fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let word = String::deserialize(deserializer)?;
                word.parse().map_err(serde::de::Error::custom)
            }
        }
    };
}

/// How the splats are chosen that a density change grows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Growth {
    /// All whose gradient reaches a threshold: small ones are cloned, large ones split (3DGS).
    #[default]
    Threshold,
    /// A sample of them, split along their longest axis.
    Sampled,
}

impl fmt::Display for Growth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Threshold => "threshold",
            Self::Sampled => "sampled",
        })
    }
}

impl FromStr for Growth {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "threshold" => Ok(Self::Threshold),
            "sampled" => Ok(Self::Sampled),
            _ => Err(format!("no growth `{word}`: it is threshold or sampled")),
        }
    }
}

as_word!(Growth);

/// How the width of the saliency filter is learned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SigmaLearning {
    /// It stays what it is.
    #[default]
    Off,
    /// From where the model fails.
    Errors,
    /// From what the splats after the low-frequency stage are worth.
    Composite,
}

impl fmt::Display for SigmaLearning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Off => "off",
            Self::Errors => "errors",
            Self::Composite => "composite",
        })
    }
}

impl FromStr for SigmaLearning {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "off" => Ok(Self::Off),
            "errors" => Ok(Self::Errors),
            "composite" => Ok(Self::Composite),
            _ => Err(format!("no way to learn sigma `{word}`: it is off, errors or composite")),
        }
    }
}

as_word!(SigmaLearning);

/// Where depths and normals to train with come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthPrior {
    /// Nowhere.
    #[default]
    None,
    /// The reconstructed points, depths alone.
    Sfm,
    /// Multi-view stereo on the training photographs.
    Stereo,
    /// The cloud that growth keeps to.
    Lidar,
    /// Stereo that begins with renders while training goes on.
    Propagation,
}

impl fmt::Display for DepthPrior {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::None => "none",
            Self::Sfm => "sfm",
            Self::Stereo => "stereo",
            Self::Lidar => "lidar",
            Self::Propagation => "propagation",
        })
    }
}

impl FromStr for DepthPrior {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "none" => Ok(Self::None),
            "sfm" => Ok(Self::Sfm),
            "stereo" => Ok(Self::Stereo),
            "lidar" => Ok(Self::Lidar),
            "propagation" => Ok(Self::Propagation),
            _ => Err(format!("no depth prior `{word}`: it is none, sfm, stereo, lidar or propagation")),
        }
    }
}

as_word!(DepthPrior);

/// The cloud of points that growth keeps to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LidarCloud {
    /// Made by multi-view stereo of the training photographs: no laser scan.
    Mvs,
    /// A laser scan: PLY, LAS or LAZ.
    File(PathBuf),
}

impl fmt::Display for LidarCloud {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mvs => f.write_str("mvs"),
            Self::File(file) => write!(f, "{}", file.display()),
        }
    }
}

impl FromStr for LidarCloud {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "" => Err("no file: it is mvs or a PLY, LAS or LAZ file".to_owned()),
            "mvs" => Ok(Self::Mvs),
            file => Ok(Self::File(file.into())),
        }
    }
}

as_word!(LidarCloud);

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Test => f.write_str("test"),
            Self::Val => f.write_str("val"),
            Self::None => f.write_str("none"),
            Self::Every { every, first: 0 } => write!(f, "every:{every}"),
            Self::Every { every, first } => write!(f, "every:{every}:{first}"),
        }
    }
}

impl FromStr for Split {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        let every = |rest: &str| {
            let (every, first) = rest.split_once(':').unwrap_or((rest, "0"));
            let (every, first): (u32, u32) = (every.parse().ok()?, first.parse().ok()?);
            (every >= 2 && first < every).then_some(Self::Every { every, first })
        };
        match word {
            "test" => Ok(Self::Test),
            "val" => Ok(Self::Val),
            "none" => Ok(Self::None),
            _ => word.strip_prefix("every:").and_then(every).ok_or_else(|| {
                format!("no split `{word}`: it is test, val, none, or every:N or every:N:FIRST (such as every:8:4)")
            }),
        }
    }
}

as_word!(Split);

/// Whether the forms of the passes are chosen by timing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tune {
    /// By an earlier timing on this device for this size, or by one now.
    #[default]
    Auto,
    /// By the device's capabilities.
    Off,
    /// By a timing now, whatever an earlier one said.
    Again,
}

impl fmt::Display for Tune {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Auto => "auto",
            Self::Off => "off",
            Self::Again => "again",
        })
    }
}

impl FromStr for Tune {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "auto" => Ok(Self::Auto),
            "off" => Ok(Self::Off),
            "again" => Ok(Self::Again),
            _ => Err(format!("no way of tuning `{word}`: it is auto, off or again")),
        }
    }
}

as_word!(Tune);

/// What stands between the render and a photograph in training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exposure {
    /// Nothing.
    #[default]
    Off,
    /// An affine map of colours for each photograph, the identity in the mean over them.
    Affine,
}

impl fmt::Display for Exposure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Off => "off",
            Self::Affine => "affine",
        })
    }
}

impl FromStr for Exposure {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "off" => Ok(Self::Off),
            "affine" => Ok(Self::Affine),
            _ => Err(format!("no exposure `{word}`: it is off or affine")),
        }
    }
}

as_word!(Exposure);

impl fmt::Display for MaskIgnores {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Black => "black",
            Self::White => "white",
        })
    }
}

impl FromStr for MaskIgnores {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "black" => Ok(Self::Black),
            "white" => Ok(Self::White),
            _ => Err(format!("no colour `{word}` of masks: it is black or white")),
        }
    }
}

as_word!(Method);

as_word!(Preset);

/// What transparent pixels of photographs are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Transparent {
    /// Pixels of which nothing is known: they have no part in losses and metrics.
    #[default]
    LeftOut,
    /// Places where the background is seen.
    Background,
}

impl fmt::Display for Transparent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::LeftOut => "left-out",
            Self::Background => "background",
        })
    }
}

impl FromStr for Transparent {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "left-out" => Ok(Self::LeftOut),
            "background" => Ok(Self::Background),
            _ => Err(format!("no way `{word}` to take transparent pixels: it is left-out or background")),
        }
    }
}

as_word!(Transparent);

impl fmt::Display for Transfer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Auto => "auto",
            Self::Srgb => "srgb",
            Self::Linear => "linear",
        })
    }
}

impl FromStr for Transfer {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "auto" => Ok(Self::Auto),
            "srgb" => Ok(Self::Srgb),
            "linear" => Ok(Self::Linear),
            _ => Err(format!("no transfer curve `{word}`: it is auto, srgb or linear")),
        }
    }
}

/// What is behind the splats in training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Background {
    /// (0, 0, 0).
    #[default]
    Black,
    /// (1, 1, 1).
    White,
    /// A new colour in every step; black where a model is scored.
    Random,
}

impl Background {
    /// The colour behind the splats where a model is scored.
    pub fn evaluated(self) -> [f32; 3] {
        if self == Self::White { [1.0; 3] } else { [0.0; 3] }
    }
}

impl fmt::Display for Background {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Black => "black",
            Self::White => "white",
            Self::Random => "random",
        })
    }
}

impl FromStr for Background {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "black" => Ok(Self::Black),
            "white" => Ok(Self::White),
            "random" => Ok(Self::Random),
            _ => Err(format!("no background `{word}`: it is black, white or random")),
        }
    }
}

as_word!(Background);

/// A number of bytes, written as `800M`, `6GiB` or plain digits. K, M, G and T are powers of 1024.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ByteSize(pub u64);

impl fmt::Display for ByteSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let whole = UNITS.iter().find(|(_, shift)| self.0 != 0 && self.0.trailing_zeros() >= *shift);
        match whole {
            Some((unit, shift)) => write!(f, "{}{unit}iB", self.0 >> shift),
            None => write!(f, "{}", self.0),
        }
    }
}

impl FromStr for ByteSize {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        let wrong = || format!("`{word}` is no size in bytes: write 6GiB, 800M or plain digits");
        byte_size::parse(word).map(Self).ok_or_else(wrong)
    }
}

as_word!(ByteSize);
