//! Writing a training to a checkpoint and reading it back.

use super::History;
use crate::format::checkpoint::Checkpoint;
use crate::pass::counters;
use crate::raster::{PLANES, Variants};
use crate::train::Error;
use crate::train::input::TrainedOn;
use crate::train::settings::{Exposure, Settings};
use crate::train::state::State;

/// Prefixes of the sections of moments, before the planes' names. Packed moments use the first prefix alone.
const MOMENTS: [&str; 2] = ["m_", "v_"];
/// Section of the scores of sampled growth; absent without scores.
const SCORES: &str = "scores";
/// Section of the exposures; absent without exposures.
const EXPOSURES: &str = "exposures";
/// Section of the learned widths of the saliency filter; absent if no width is learned.
const SIGMA: &str = "sigma";
/// Section of propagated depths and normals; absent if no depths are propagated.
const PRIORS: &str = "priors";
/// Section of the training photographs; absent in older checkpoints.
const VIEWS: &str = "views";

/// What a resumed training begins with.
#[derive(Clone)]
pub struct Restart {
    /// Last step that is done.
    pub step: u32,
    /// Seconds spent so far.
    pub seconds: f64,
    /// Everything the device holds between steps.
    pub state: State,
    /// The variants of the passes: a run goes on with those it began with.
    pub variants: Variants,
    /// The curves so far.
    pub history: History,
    /// The training photographs; `None` for older checkpoints.
    pub trained_on: Option<TrainedOn>,
}

impl Restart {
    /// What was decided about exposures where that was left to the photographs.
    pub(in crate::train) fn exposure(&self, asked: Exposure) -> Exposure {
        match asked {
            Exposure::Auto if self.state.exposures.is_empty() => Exposure::Off,
            Exposure::Auto => Exposure::Affine,
            decided => decided,
        }
    }
}

/// Contents of a checkpoint of a training.
pub struct Checkpointed {
    /// What the resumed training begins with.
    pub restart: Restart,
    /// The settings of the run, as `settings.toml` has them.
    pub settings: String,
}

impl Checkpointed {
    /// The contents for `restart`, with `settings` as text.
    pub fn new(restart: Restart, settings: &Settings) -> Result<Self, Error> {
        Ok(Self { restart, settings: settings.to_toml()? })
    }

    /// The sections of the file.
    pub fn to_checkpoint(&self) -> Result<Checkpoint, Error> {
        let mut out = Checkpoint::new();
        let state = &self.restart.state;
        out.put_text("settings", &self.settings);
        out.put_text("variants", &serde_json::to_string(&self.restart.variants)?);
        out.put_text("history", &serde_json::to_string(&self.restart.history)?);
        if let Some(trained_on) = &self.restart.trained_on {
            out.put_text(VIEWS, &serde_json::to_string(trained_on)?);
        }
        out.put_values("step", &[self.restart.step]);
        out.put_values("seconds", &[self.restart.seconds]);
        out.put_values("counters", &state.counters);
        out.put_values("ids", &state.ids);
        out.put_values("stats", &state.stats);
        if !state.scores.is_empty() {
            out.put_values(SCORES, &state.scores);
        }
        if !state.exposures.is_empty() {
            out.put_values(EXPOSURES, &state.exposures);
        }
        if !state.sigma.is_empty() {
            out.put_text(SIGMA, &state.sigma);
        }
        if !state.priors.is_empty() {
            out.put_values(PRIORS, &state.priors);
        }
        for (k, (name, _)) in PLANES.into_iter().enumerate() {
            out.put_values(name, &state.params[k]);
            for (prefix, planes) in MOMENTS.into_iter().zip(&state.moments) {
                out.put_values(&format!("{prefix}{name}"), &planes[k]);
            }
        }
        Ok(out)
    }

    /// Reads the sections. Returns an error that names the section if sizes do not fit together.
    pub fn from_checkpoint(file: &Checkpoint) -> Result<Self, Error> {
        let ids: Vec<u32> = file.values("ids")?;
        let rows = |name: &str, row: u32| -> Result<Vec<f32>, Error> {
            let values: Vec<f32> = file.values(name)?;
            let expected = row as usize * ids.len();
            if values.len() == expected {
                Ok(values)
            } else {
                Err(Error::Checkpoint { section: name.to_owned(), found: values.len(), expected })
            }
        };
        let planes = |prefix: &str| -> Result<[Vec<f32>; 8], Error> {
            let mut out: [Vec<f32>; 8] = Default::default();
            for (plane, (name, row)) in out.iter_mut().zip(PLANES) {
                *plane = rows(&format!("{prefix}{name}"), row)?;
            }
            Ok(out)
        };
        let counters: Vec<u32> = file.values("counters")?;
        if counters.len() != counters::COUNT || counters[counters::SPLATS] as usize != ids.len() {
            return Err(Error::Checkpoint {
                section: "counters".to_owned(),
                found: counters.get(counters::SPLATS).copied().unwrap_or(0) as usize,
                expected: ids.len(),
            });
        }
        let history: History = serde_json::from_str(file.text("history")?)?;
        let variants: Variants = serde_json::from_str(file.text("variants")?)?;
        let kept = |prefix: &&str| file.names().any(|name| name.starts_with(*prefix));
        let moments = MOMENTS.into_iter().filter(kept).map(planes).collect::<Result<_, _>>()?;
        let has = |section: &str| file.names().any(|name| name == section);
        let scores = if has(SCORES) { rows(SCORES, 2)? } else { Vec::new() };
        let exposures = if has(EXPOSURES) { file.values(EXPOSURES)? } else { Vec::new() };
        let sigma = if has(SIGMA) { file.text(SIGMA)?.to_owned() } else { String::new() };
        let priors = if has(PRIORS) { file.values(PRIORS)? } else { Vec::new() };
        let trained_on = if has(VIEWS) { Some(serde_json::from_str(file.text(VIEWS)?)?) } else { None };
        let (params, stats) = (planes("")?, rows("stats", 4)?);
        let state = State { params, moments, stats, scores, counters, ids, exposures, sigma, priors };
        Ok(Self {
            restart: Restart {
                step: file.value("step")?,
                seconds: file.value("seconds")?,
                state,
                variants,
                history,
                trained_on,
            },
            settings: file.text("settings")?.to_owned(),
        })
    }
}
