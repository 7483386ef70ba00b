//! Types of single settings. Each is read and written as one word on the command line and in `settings.toml`.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

pub use super::method::Method;
pub use super::preset::Preset;
pub use crate::dataset::{Format, MaskIgnores, Split, Transfer};
pub use crate::saliency::Gate;

use crate::byte_size::{self, UNITS};

/// Reads and writes a type in serde by its `Display` and `FromStr`.
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

/// Implements `Display` and `FromStr` for an enum of words.
macro_rules! words {
    ($name:ident, $what:literal: $($variant:ident = $word:literal),+) => {
        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(match self {
                    $(Self::$variant => $word,)+
                })
            }
        }
        impl FromStr for $name {
            type Err = String;
            fn from_str(word: &str) -> Result<Self, String> {
                match word {
                    $($word => Ok(Self::$variant),)+
                    _ => Err(format!("no {} `{word}`: it is {}", $what, either(&[$($word),+]))),
                }
            }
        }
    };
}

/// `a`, `a or b`, `a, b or c`.
fn either(words: &[&str]) -> String {
    match words {
        [first @ .., last] if !first.is_empty() => format!("{} or {last}", first.join(", ")),
        _ => words.concat(),
    }
}

/// How a density change chooses the splats that grow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Growth {
    /// All splats whose gradient reaches a threshold: small ones are cloned, large ones split (3DGS).
    #[default]
    Threshold,
    /// A sample of these splats, split along their longest axis.
    Sampled,
    /// Splats are added in the places of others, drawn by opacity, where dead splats go too (3DGS-MCMC).
    Relocated,
}

words!(Growth, "growth": Threshold = "threshold", Sampled = "sampled", Relocated = "relocated");
as_word!(Growth);

/// How the width of the saliency filter is learned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SigmaLearning {
    /// The width is not learned.
    #[default]
    Off,
    /// From the errors of the model.
    Errors,
    /// From the benefit of the splats added after the low-frequency stage.
    Composite,
}

words!(SigmaLearning, "way to learn sigma": Off = "off", Errors = "errors", Composite = "composite");
as_word!(SigmaLearning);

/// Where splats begin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Start {
    /// On the dataset's points.
    #[default]
    Sfm,
    /// On the dataset's points, and on surfaces that stereo finds.
    Stereo,
}

words!(Start, "start": Sfm = "sfm", Stereo = "stereo");
as_word!(Start);

/// How splats are kept few, and steps cheap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Housekeeping {
    /// As the 3DGS reference does: opacity resets, pruning by opacity and size.
    #[default]
    Published,
    /// Pruning by weight, no resets, fading with sampled growth, steps of visible splats alone.
    Lean,
}

words!(Housekeeping, "housekeeping": Published = "published", Lean = "lean");
as_word!(Housekeeping);

/// The spacing of the splats that begin on surfaces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Spacing {
    /// Even in the photographs.
    #[default]
    Uniform,
    /// By the local frequency of the photographs, and by the mask.
    Frequency,
}

words!(Spacing, "spacing": Uniform = "uniform", Frequency = "frequency");
as_word!(Spacing);

/// What the gradient maps of the constrained set are correlated with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ConstrainedAgainst {
    /// Those of the photograph.
    #[default]
    Photograph,
    /// Those of the full render, from which both sets learn.
    Render,
}

words!(ConstrainedAgainst, "picture": Photograph = "photograph", Render = "render");
as_word!(ConstrainedAgainst);

/// The source of depths and normals for training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthPrior {
    /// No source.
    #[default]
    None,
    /// Multi-view stereo on the training photographs.
    Stereo,
    /// The cloud near which splats grow.
    Lidar,
    /// Stereo that starts from renders during training.
    Propagation,
}

words!(DepthPrior, "depth prior": None = "none", Stereo = "stereo", Lidar = "lidar", Propagation = "propagation");
as_word!(DepthPrior);

/// The point cloud near which splats grow.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LidarCloud {
    /// The surfaces of multi-view stereo on the training photographs: no laser scan.
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
            "every:1" => Err("`every:1` would hold out every photograph and leave none to train on: every:N needs an N of 2 or more, as \
                              every:8, and none is held out with `none`"
                .to_owned()),
            _ => word.strip_prefix("every:").and_then(every).ok_or_else(|| {
                format!("no split `{word}`: it is test, val, none, or every:N or every:N:FIRST (such as every:8:4)")
            }),
        }
    }
}

as_word!(Split);

/// Whether timing chooses the variants of the passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tune {
    /// By an earlier timing for this device and size, or by a timing now.
    #[default]
    Auto,
    /// By the device's capabilities.
    Off,
    /// By a timing now, regardless of earlier ones.
    Again,
}

words!(Tune, "way of tuning": Auto = "auto", Off = "off", Again = "again");
as_word!(Tune);

/// The map of colours between a render and its photograph in training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exposure {
    /// No map.
    #[default]
    Off,
    /// An affine map of colours per photograph; the mean over photographs is the identity.
    Affine,
    /// One of these, by whether exposures vary: decided from the photographs before the first step
    /// ([`crate::train::prepare::decide_exposures`]). A training that begins undecided has none.
    Auto,
}

words!(Exposure, "exposure": Off = "off", Affine = "affine", Auto = "auto");
as_word!(Exposure);

words!(MaskIgnores, "colour of masks": Black = "black", White = "white");
as_word!(Method);
as_word!(Preset);

/// The meaning of transparent pixels of photographs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Transparent {
    /// Unknown: they have no part in losses and metrics.
    #[default]
    LeftOut,
    /// They show the background.
    Background,
}

words!(Transparent, "way to take transparent pixels": LeftOut = "left-out", Background = "background");
as_word!(Transparent);

words!(Transfer, "transfer curve": Auto = "auto", Srgb = "srgb", Linear = "linear");

/// The colour behind the splats in training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Background {
    /// (0, 0, 0).
    #[default]
    Black,
    /// (1, 1, 1).
    White,
    /// A new colour in every step; black for scores.
    Random,
}

impl Background {
    /// The colour behind the splats for scores.
    pub fn evaluated(self) -> [f32; 3] {
        if self == Self::White { [1.0; 3] } else { [0.0; 3] }
    }
}

words!(Background, "background": Black = "black", White = "white", Random = "random");
as_word!(Background);

/// A number of bytes, spelled as `800M`, `6GiB` or digits. K, M, G and T are powers of 1024.
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

/// A smaller size is a number whose unit is missing.
const FEWEST_BYTES: u64 = 4096;

impl FromStr for ByteSize {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        let wrong = || format!("`{word}` is no size in bytes: write 6GiB, 800M or plain digits");
        let bytes = byte_size::parse(word).ok_or_else(wrong)?;
        // A number of gigabytes without its unit is the usual slip, and nothing works with so few bytes.
        if bytes < FEWEST_BYTES && word.ends_with(|c: char| c.is_ascii_digit()) {
            return Err(format!(
                "`{word}` is {bytes} bytes, which nothing fits into: a size needs its unit, as {word}GiB or {word}MiB"
            ));
        }
        Ok(Self(bytes))
    }
}

as_word!(ByteSize);
