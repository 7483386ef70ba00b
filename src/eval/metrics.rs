//! The numbers of a run, as they stand in `metrics.json`.

use crate::numbers::{mean, mean_if_all};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::TrainingPhotograph;
use super::geometry::Geometry;
use crate::format::{atomic, read_text};

/// Waits that are told one by one; `metrics.json` has all of them.
const TOLD_WAITS: usize = 20;

/// Quality of one held-out view. Values are taken after rounding the render to 8 bits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageScore {
    /// Name of the photograph.
    pub name: String,
    /// Peak signal-to-noise ratio over all pixels and channels, decibels. Infinite for equal images, `null` in JSON.
    #[serde(serialize_with = "finite_or_null", deserialize_with = "null_is_infinite")]
    pub psnr: f64,
    /// The same over the pixels that at least one photograph to train on sees ([`super::SeenPixels`]); nothing where
    /// there is no such pixel, or which these are was not asked.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        serialize_with = "known_or_null",
        deserialize_with = "null_is_known_infinite"
    )]
    pub psnr_seen: Option<f64>,
    /// The share of these pixels, from 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen: Option<f64>,
    /// PSNR over all pixels after an affine fit of the render's colours to the photograph's ([`super::psnr_cc`]). NaN
    /// where a file does not have it.
    #[serde(default = "not_known", serialize_with = "finite_or_null", deserialize_with = "null_is_infinite")]
    pub psnr_cc: f64,
    /// Structural similarity.
    pub ssim: f64,
    /// LPIPS on SqueezeNet, 0 for equal images; nothing where there are no weights for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lpips_squeeze: Option<f64>,
    /// Gradient magnitude similarity deviation ([`super::gmsd`]), 0 for equal images.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gmsd: Option<f64>,
    /// PSNR where the photograph has high frequencies ([`super::psnr_high_frequency`]).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_high_frequency: Option<f64>,
}

/// Means over held-out views, and each view.
#[derive(Clone, Debug, PartialEq)]
pub struct Quality {
    /// Mean PSNR in decibels; NaN without views.
    pub psnr: f64,
    /// Mean SSIM; NaN without views.
    pub ssim: f64,
    /// Each view.
    pub images: Vec<ImageScore>,
}

impl Quality {
    /// The means over `images`.
    pub fn of(images: Vec<ImageScore>) -> Self {
        let psnr = mean(images.iter().map(|i| i.psnr)).unwrap_or(f64::NAN);
        let ssim = mean(images.iter().map(|i| i.ssim)).unwrap_or(f64::NAN);
        Self { psnr, ssim, images }
    }
}

/// The numbers of a run. The field names are the keys of `metrics.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Training method.
    pub method: String,
    /// Training steps.
    pub iterations: u32,
    /// Name of the dataset.
    pub scene: String,
    /// Photographs trained on.
    pub train_images: usize,
    /// Photographs held out.
    pub test_images: usize,
    /// Width of the first held-out view in pixels (of the first training view when none is held out).
    pub width: u32,
    /// Height of the same view.
    pub height: u32,
    /// Seed of the run.
    pub seed: u64,
    /// Name of the device.
    pub device: String,
    /// Forms of the GPU passes that trained it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub forms: Option<String>,
    /// Mean of the views' PSNR; `null` without held-out views (or when a render equals its photograph).
    pub psnr: Option<f64>,
    /// Mean of the views' PSNR over the pixels that at least one photograph to train on sees, of the views that have
    /// such pixels; absent where it was not asked which these are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_seen: Option<f64>,
    /// Mean of the views' shares of these pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen: Option<f64>,
    /// Mean of the views' PSNR after a colour fit for each, beside `psnr` and not in its place.
    #[serde(default)]
    pub psnr_cc: Option<f64>,
    /// Mean of the views' SSIM; `null` without held-out views.
    pub ssim: Option<f64>,
    /// Mean of the views' LPIPS on SqueezeNet; absent where there are no weights for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lpips_squeeze: Option<f64>,
    /// Mean of the views' gradient magnitude similarity deviation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gmsd: Option<f64>,
    /// Mean of the views' PSNR where their photographs have high frequencies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_high_frequency: Option<f64>,
    /// Mean PSNR of the final model on photographs that it was trained on: all, or 32 that are evenly spaced in the
    /// order of their names. What it is above `psnr` is fitted by heart. Absent where a model was only scored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_training: Option<f64>,
    /// Mean SSIM on the same photographs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ssim_training: Option<f64>,
    /// Gaussians that the training began with; absent where nothing was trained.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first_splats: Option<usize>,
    /// Gaussians of the final model.
    pub splats: usize,
    /// Size of `point_cloud.ply` in bytes.
    pub bytes: u64,
    /// Seconds from the start of the process to the final model.
    pub seconds: f64,
    /// Of them, seconds of what comes before the first step, where it takes any: multi-view stereo ...
    #[serde(default)]
    pub seconds_stereo: f64,
    /// ... and the masks of the photographs.
    #[serde(default)]
    pub seconds_saliency: f64,
    /// Mean seconds of a training step.
    pub seconds_per_iteration: f64,
    /// Largest amount of device memory allocated at once.
    pub peak_device_bytes: u64,
    /// Largest resident set of the process; `null` where the system does not tell.
    pub peak_host_bytes: Option<u64>,
    /// How photographs came to their steps; absent where all lay on the device.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub streaming: Option<Streaming>,
    /// How exposures had a part in the scores; absent where none were learned,
    /// and the model is scored in its own colours.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposures: Option<ExposureScores>,
    /// How well the geometry agrees with a known one.
    #[serde(flatten)]
    pub geometry: Geometry,
    /// Each held-out view.
    pub images: Vec<ImageScore>,
    /// Each photograph to train on, the one that is fitted worst first; nothing where a model was only scored.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub training_photographs: Vec<TrainingPhotograph>,
}

/// Scores of renders that are exposed as is expected of their photographs ([`super::Exposures`]),
/// and of those that are not.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExposureScores {
    /// How far a photograph's exposure follows those before and after it, from 0 to 1 ([`super::Follows`]) ...
    pub follows_order: f64,
    /// ... and those of photographs taken nearby.
    pub follows_place: f64,
    /// Mean of the views' PSNR in the model's own colours, which are those of the mean photograph; what a viewer that
    /// knows of no exposures shows.
    pub psnr_own_colours: Option<f64>,
}

/// How photographs came to the steps of a training that does not hold all of them on its device.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Streaming {
    /// Photographs that steps were given.
    pub asked: u64,
    /// Of those, how many still lay where an earlier step was given them.
    pub reused: u64,
    /// Photographs decoded.
    pub decoded: u64,
    /// The steps that had to wait for theirs.
    pub waits: Vec<PhotographWait>,
}

/// A step that had to wait until its photograph was decoded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotographWait {
    /// The step.
    pub step: u32,
    /// How long the host waited.
    pub seconds: f64,
    /// Whether the device had done by then all that was submitted before.
    pub device_idle: bool,
}

impl std::fmt::Display for Streaming {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { asked, reused, decoded, waits } = self;
        write!(f, "{asked} uploaded in their steps, {reused} of them still there from before; {decoded} decoded; ")?;
        if waits.is_empty() {
            return f.write_str("none waited for");
        }
        write!(f, "{} waited for:", waits.len())?;
        for (i, wait) in waits.iter().take(TOLD_WAITS).enumerate() {
            let comma = if i == 0 { "" } else { "," };
            let idle = if wait.device_idle { " with the device idle" } else { "" };
            write!(f, "{comma} {:.3} s at step {}{idle}", wait.seconds, wait.step)?;
        }
        if waits.len() > TOLD_WAITS { f.write_str(", ...") } else { Ok(()) }
    }
}

/// Errors of reading and writing metrics.
#[derive(Debug, thiserror::Error)]
pub enum MetricsError {
    /// The file could not be written.
    #[error(transparent)]
    Write(#[from] crate::format::Error),
    /// The file could not be read.
    #[error("cannot read {path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// The file is not what was expected.
    #[error("{path} holds no metrics: {source}")]
    Json {
        /// The file.
        path: PathBuf,
        /// The cause, with line and column.
        source: serde_json::Error,
    },
}

impl Metrics {
    /// Sets the views, their number, and the means over them.
    pub fn with_images(mut self, images: Vec<ImageScore>) -> Self {
        self.test_images = images.len();
        self.psnr = mean(images.iter().map(|i| i.psnr));
        self.psnr_seen = mean_seen(&images);
        self.seen = mean_if_all(images.iter().map(|i| i.seen));
        self.psnr_cc = mean(images.iter().map(|i| i.psnr_cc));
        self.ssim = mean(images.iter().map(|i| i.ssim));
        self.lpips_squeeze = mean_if_all(images.iter().map(|i| i.lpips_squeeze));
        self.gmsd = mean_if_all(images.iter().map(|i| i.gmsd));
        self.psnr_high_frequency = mean_if_all(images.iter().map(|i| i.psnr_high_frequency));
        self.images = images;
        self
    }

    /// Sets the scores of photographs that were trained on.
    pub fn with_training(mut self, scores: super::TrainingScores) -> Self {
        (self.psnr_training, self.ssim_training) = (scores.psnr, scores.ssim);
        self
    }

    /// Decibels that photographs trained on are rendered better than held-out ones.
    pub fn fitted_by_heart(&self) -> Option<f64> {
        Some(self.psnr_training? - self.psnr?)
    }

    /// Writes `metrics.json`.
    pub fn write(&self, path: &Path) -> Result<(), MetricsError> {
        let json = |source| MetricsError::Json { path: path.to_owned(), source };
        let mut text = serde_json::to_string_pretty(self).map_err(json)?;
        text.push('\n');
        Ok(atomic::write(path, |out| out.write_all(text.as_bytes()))?)
    }

    /// Reads `metrics.json`.
    pub fn read(path: &Path) -> Result<Self, MetricsError> {
        let text = read_text(path).map_err(|source| MetricsError::File { path: path.to_owned(), source })?;
        serde_json::from_str(&text).map_err(|source| MetricsError::Json { path: path.to_owned(), source })
    }
}

/// The mean of PSNR over what is seen, of the views of which something is.
pub fn mean_seen(images: &[ImageScore]) -> Option<f64> {
    mean(images.iter().filter_map(|i| i.psnr_seen))
}

/// The largest resident set of this process so far, in bytes, where the system tells (`VmHWM` of Linux).
pub fn peak_host_bytes() -> Option<u64> {
    parse_peak(&std::fs::read_to_string("/proc/self/status").ok()?)
}

fn parse_peak(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}

fn finite_or_null<S: Serializer>(value: &f64, s: S) -> Result<S::Ok, S::Error> {
    if value.is_finite() { s.serialize_f64(*value) } else { s.serialize_none() }
}

fn known_or_null<S: Serializer>(value: &Option<f64>, s: S) -> Result<S::Ok, S::Error> {
    finite_or_null(&value.unwrap_or(f64::NAN), s)
}

fn null_is_known_infinite<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    null_is_infinite(d).map(Some)
}

fn null_is_infinite<'de, D: Deserializer<'de>>(d: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(d)?.unwrap_or(f64::INFINITY))
}

fn not_known() -> f64 {
    f64::NAN
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peak_memory_in_bytes() {
        assert_eq!(parse_peak("Name:\tx\nVmHWM:\t  123456 kB\nVmRSS:\t1 kB\n"), Some(123_456 * 1024));
        assert_eq!(parse_peak("VmRSS: 1 kB\n"), None);
        assert_eq!(parse_peak("VmHWM: many kB\n"), None);
    }

    #[test]
    fn means_of_nothing_and_of_infinity_are_absent() {
        assert_eq!(mean([1.0, 4.0].into_iter()), Some(2.5));
        assert_eq!(mean([].into_iter()), None);
        assert_eq!(mean([1.0, f64::INFINITY].into_iter()), None);
        assert_eq!(mean_if_all([Some(1.0), Some(4.0)].into_iter()), Some(2.5));
        assert_eq!(mean_if_all([Some(1.0), None].into_iter()), None);
    }
}
