//! `lpips_squeeze` of held-out views, where its weights are available.

use std::path::PathBuf;
use std::sync::Arc;

use psrgs_vk::perceptual::{Distance, LpipsWeights, Metric};
use psrgs_vk::train::View;
use psrgs_vk::train::settings::Scoring;
use psrgs_vk::vk::Gpu;

use super::console::Console;

/// The metric, or nothing where its weights are missing.
pub(crate) struct Lpips {
    weights: Option<Arc<LpipsWeights>>,
    metric: Option<Metric>,
}

impl Lpips {
    /// Reads and checks the weights from the options or from the user's folder. Prints why weights are missing.
    pub(crate) fn find(scoring: &Scoring, console: &Console) -> anyhow::Result<Self> {
        let none = Self { weights: None, metric: None };
        let weights = match (&scoring.perceptual_weights, folder().filter(|f| f.is_dir())) {
            (Some(named), _) => LpipsWeights::find(named)?,
            (None, Some(usual)) => match LpipsWeights::find(&usual) {
                Ok(weights) => weights,
                // The user did not ask for these weights: half a download must not stop a training.
                Err(problem) => {
                    console.warn(format_args!(
                        "lpips_squeeze is not measured: {problem}; `psrgs-vk weights --fetch` puts there what is \
                         missing or damaged"
                    ));
                    return Ok(none);
                }
            },
            (None, None) => {
                console.say(
                    "lpips_squeeze is not measured: there are no weights (`psrgs-vk weights` says where to get them)",
                );
                return Ok(none);
            }
        };
        let [trunk, linear] = weights.files().map(|f| f.display().to_string());
        console.detail(format_args!("weights of lpips_squeeze: {trunk}, {linear}"));
        Ok(Self { weights: Some(Arc::new(weights)), metric: None })
    }

    /// The weights, for a perceptual loss.
    pub(crate) fn weights(&self) -> Option<Arc<LpipsWeights>> {
        self.weights.clone()
    }

    /// The distance of a render (RGB8) from its photograph. Where the device cannot compute the distance, the number is
    /// left out with a warning.
    pub(crate) fn measure(&mut self, gpu: &Gpu, view: &View, rgb: &[u8], console: &Console) -> Option<f64> {
        match self.distance(gpu, view, rgb)? {
            Ok(value) => Some(value),
            Err(problem) => {
                console.warn(format_args!("{}: lpips_squeeze is not measured: {problem}", view.name));
                None
            }
        }
    }

    fn distance(&mut self, gpu: &Gpu, view: &View, rgb: &[u8]) -> Option<anyhow::Result<f64>> {
        let weights = self.weights.as_ref()?;
        Some(Self::distance_by(&mut self.metric, weights, gpu, view, rgb))
    }

    fn distance_by(
        metric: &mut Option<Metric>,
        weights: &LpipsWeights,
        gpu: &Gpu,
        view: &View,
        rgb: &[u8],
    ) -> anyhow::Result<f64> {
        let ready = match metric.take() {
            Some(ready) => ready,
            None => Metric::new(gpu, Distance::lpips(gpu, weights)?),
        };
        let metric = metric.insert(ready);
        let photograph = view.photograph.pixels()?;
        let (truth, counting) = (photograph.rgb8(), photograph.counting());
        let alpha = counting.iter().map(|counts| if *counts { 255 } else { 0 });
        let rgba: Vec<u8> = truth.chunks_exact(3).zip(alpha).flat_map(|(p, a)| [p[0], p[1], p[2], a]).collect();
        Ok(f64::from(metric.distance(rgb, &rgba, view.camera.width, view.camera.height)?))
    }
}

/// `psrgs-vk/weights` in the user's data folder, by the XDG base directory specification.
pub(crate) fn folder() -> Option<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = absolute("XDG_DATA_HOME").or_else(|| absolute("HOME").map(|home| home.join(".local/share")));
    base.map(|base| base.join("psrgs-vk").join("weights"))
}
