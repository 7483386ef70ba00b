//! Sigma per image, learned during a training.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::features::Standard;
use super::mask::logistic;
use super::network::{Adam, Network, PARAMETERS};
use super::replay_buffer::ReplayBuffer;
use super::{Error, Features, MaskTarget, Plane, Spectrum, composite, cross_entropy, spaced};

/// How sigma is learned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LearnSettings {
    /// Sigma of every image at the beginning, in bins of 256.
    pub start: f64,
    /// Smallest sigma.
    pub lowest: f64,
    /// Largest sigma: beyond about 16 a map no longer tells places apart.
    pub highest: f64,
    /// Largest change of a mask's level, in units of the map's natural logarithm. [`SigmaLearner::learn_from_errors`]
    /// leaves the level as it is.
    pub level: f64,
    /// Learning rate.
    pub rate: f64,
    /// Weight of the prior (ln(sigma / typical))^2, which decides where the loss is flat.
    pub prior: f64,
    /// The sigma that the prior favours.
    pub typical: f64,
    /// Share of an image's pixels, those with the largest errors, that count as failures of the model.
    pub failing: f64,
    /// Standard deviation of the blur of error maps, in pixels of an image whose shorter side has 256.
    pub error_blur: f64,
    /// Price of a mask of 1 over the whole image, in units of colour from 0 to 1.
    pub price: f64,
    /// Number of further values of sigma at which an update from errors evaluates the loss, so that sigma can leave a
    /// local minimum; 0 for gradient descent alone.
    pub outlook: usize,
    /// Number of steps after an update from errors that train the network on the best sigma last found for every image;
    /// 0 for none.
    pub recall: usize,
    /// Seed of the network.
    pub seed: u64,
}

impl Default for LearnSettings {
    fn default() -> Self {
        Self {
            start: 3.0,
            lowest: 0.5,
            highest: 12.0,
            level: 0.5,
            rate: 1e-2,
            prior: 1e-3,
            typical: 3.0,
            failing: 0.25,
            error_blur: 2.0,
            price: 0.015,
            outlook: 9,
            recall: 24,
            seed: 0,
        }
    }
}

impl LearnSettings {
    /// Refuses values outside their range.
    pub fn check(&self) -> Result<(), Error> {
        let one = |name, value: f64, fits: bool, want| {
            if fits { Ok(()) } else { Err(Error::Setting { name, want, value }) }
        };
        one("lowest", self.lowest, self.lowest > 0.0 && self.lowest <= 100.0, "above 0 and at most 100")?;
        let above = self.highest > self.lowest && self.highest <= 1000.0;
        one("highest", self.highest, above, "above lowest and at most 1000")?;
        let inside = self.start > self.lowest && self.start < self.highest;
        one("start", self.start, inside, "between lowest and highest")?;
        one("level", self.level, (0.0..=10.0).contains(&self.level), "from 0 to 10")?;
        one("rate", self.rate, self.rate > 0.0 && self.rate <= 1.0, "above 0 and at most 1")?;
        one("prior", self.prior, (0.0..=1000.0).contains(&self.prior), "from 0 to 1000")?;
        one("typical", self.typical, self.typical > 0.0 && self.typical <= 1000.0, "above 0 and at most 1000")?;
        one("failing", self.failing, (0.001..=0.999).contains(&self.failing), "from 0.001 to 0.999")?;
        one("outlook", self.outlook as f64, self.outlook <= 1000, "at most 1000")?;
        one("recall", self.recall as f64, self.recall <= 1000, "at most 1000")?;
        one("error-blur", self.error_blur, (0.0..=64.0).contains(&self.error_blur), "from 0 to 64")?;
        one("price", self.price, (0.0..=1.0).contains(&self.price), "from 0 to 1")
    }
}

/// The network's choice for an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Width of the filter, in bins of 256.
    pub sigma: f64,
    /// Shift of the mask's level, in units of the map's natural logarithm.
    pub level: f64,
}

/// The values of one update.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update {
    /// Loss before the update, the prior included.
    pub loss: f64,
    /// Sigma before the update.
    pub sigma: f64,
    /// Level before the update.
    pub level: f64,
    /// Derivative of the loss with respect to sigma. Where the derivative leads away from a better sigma, the slope of
    /// the straight line to the better sigma.
    pub by_sigma: f64,
}

/// Two renders of a view and its photograph: red, green and blue per pixel from 0 to 1, at the size of the view's mask.
#[derive(Clone, Copy, Debug)]
pub struct Renders<'a> {
    /// Render of the splats that show the image without texture.
    pub low: &'a [f32],
    /// Render of all splats.
    pub full: &'a [f32],
    /// The photograph that both should match.
    pub photograph: &'a [f32],
}

/// The sigma network with its optimiser. Serde writes the state to checkpoints; equal updates give equal bits, with or
/// without a restore.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "State", into = "State")]
pub struct SigmaLearner {
    network: Network,
    adam: Adam,
    recall: ReplayBuffer,
    standard: Standard,
    settings: LearnSettings,
}

impl SigmaLearner {
    /// `images` holds the features of all images of a dataset: their means and deviations standardise the network's
    /// input.
    pub fn new(images: &[Features], settings: &LearnSettings) -> Result<Self, Error> {
        settings.check()?;
        let at = (settings.start - settings.lowest) / (settings.highest - settings.lowest);
        let network = Network::new([(at / (1.0 - at)).ln(), 0.0], settings.seed);
        let adam = Adam::new(PARAMETERS);
        let (recall, standard) = (ReplayBuffer::default(), Standard::of(images));
        Ok(Self { network, adam, recall, standard, settings: settings.clone() })
    }

    /// Sigma and level for an image.
    pub fn choose(&self, features: &Features) -> Choice {
        let [sigma, level] = self.network.forward(&self.standard.apply(features));
        let s = &self.settings;
        Choice { sigma: s.lowest + (s.highest - s.lowest) * logistic(sigma), level: s.level * level.tanh() }
    }

    /// Number of updates so far.
    pub fn updates(&self) -> u64 {
        self.adam.steps()
    }

    /// The settings given to [`Self::new`].
    pub fn settings(&self) -> &LearnSettings {
        &self.settings
    }

    /// One update from one image: the mask learns to predict the pixels with the model's largest errors. `None`,
    /// without an update, for an image of one colour or for errors that are equal everywhere.
    pub fn learn_from_errors(&mut self, spectrum: &Spectrum, errors: &Plane) -> Result<Option<Update>, Error> {
        let size = spectrum.size();
        let blur = self.settings.error_blur * f64::from(size.0.min(size.1)) / 256.0;
        match MaskTarget::of_errors(errors, size, blur, self.settings.failing) {
            Some(target) => self.learn_from_target(spectrum, &target),
            None => Ok(None),
        }
    }

    /// As [`SigmaLearner::learn_from_errors`], with a given target.
    pub fn learn_from_target(&mut self, spectrum: &Spectrum, target: &MaskTarget) -> Result<Option<Update>, Error> {
        if spectrum.is_flat() {
            return Ok(None);
        }
        let choice = self.choose(spectrum.features());
        let mask = spectrum.map(choice.sigma)?.mask(choice.level);
        let (loss, by_logit) = cross_entropy(mask.logits(), target.values())?;
        let [by_sigma, _] = mask.pull(&by_logit);
        let elsewhere = self.elsewhere(spectrum, choice.level, target)?;
        // The settings fix the mask's mean: a gradient of the level would only learn the target's mean.
        let update = self.update(spectrum, choice, loss, [by_sigma, 0.0], &elsewhere);
        if let Some((goal, depth)) = self.goal(&elsewhere).filter(|_| self.settings.recall > 0) {
            self.recall.keep(self.standard.apply(spectrum.features()), goal, depth);
            self.recall.teach(&mut self.network, self.settings.recall, self.settings.rate);
        }
        Ok(Some(update))
    }

    /// One update from one image: the mask learns where the splats that only the full render has are worth their price.
    /// `None`, without an update, for an image of one colour.
    pub fn learn_from_composite(
        &mut self,
        spectrum: &Spectrum,
        renders: &Renders<'_>,
    ) -> Result<Option<Update>, Error> {
        if spectrum.is_flat() {
            return Ok(None);
        }
        let choice = self.choose(spectrum.features());
        let mask = spectrum.map(choice.sigma)?.mask(choice.level);
        let Renders { low, full, photograph } = *renders;
        let (loss, by_logit) = composite(mask.logits(), low, full, photograph, self.settings.price)?;
        let gradient = mask.pull(&by_logit);
        // Level and sigma move together here: a local minimum in sigma at a fixed level need not be one in both.
        Ok(Some(self.update(spectrum, choice, loss, gradient, &[])))
    }

    /// The outlook: values of sigma over the whole range, each with the loss of its mask.
    fn elsewhere(&self, spectrum: &Spectrum, level: f64, target: &MaskTarget) -> Result<Vec<(f64, f64)>, Error> {
        let s = &self.settings;
        let at = |sigma: f64| {
            let mask = spectrum.map(sigma)?.mask(level);
            Ok((sigma, cross_entropy(mask.logits(), target.values())?.0))
        };
        spaced(s.lowest, s.highest, s.outlook).into_par_iter().map(at).collect()
    }

    /// (ln(sigma / typical))^2, weighted.
    fn prior(&self, sigma: f64) -> f64 {
        self.settings.prior * (sigma / self.settings.typical).ln().powi(2)
    }

    /// The network output that gives the best sigma of an outlook, refined by a parabola through its neighbours in the
    /// logarithm, and the range of the loss over the outlook. `None` for an outlook of fewer than three values of
    /// sigma.
    fn goal(&self, outlook: &[(f64, f64)]) -> Option<(f64, f64)> {
        let losses: Vec<f64> = outlook.iter().map(|(sigma, loss)| loss + self.prior(*sigma)).collect();
        if losses.len() < 3 || !losses.iter().all(|loss| loss.is_finite()) {
            return None;
        }
        let (best, least) = losses.iter().copied().enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let most = losses.iter().copied().fold(least, f64::max);
        let bend = |below: f64, above: f64| {
            let curvature = below + above - 2.0 * least;
            if curvature > 0.0 { (0.5 * (below - above) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
        };
        let aside = match (best.checked_sub(1).and_then(|k| losses.get(k)), losses.get(best + 1)) {
            (Some(below), Some(above)) => bend(*below, *above),
            _ => 0.0,
        };
        let s = &self.settings;
        let step = (s.highest / s.lowest).ln() / (losses.len() - 1) as f64;
        let sigma = outlook.get(best)?.0 * (aside * step).exp();
        // The network reaches the ends of the range only with infinite outputs.
        let share = ((sigma - s.lowest) / (s.highest - s.lowest)).clamp(0.01, 0.99);
        Some(((share / (1.0 - share)).ln(), most - least))
    }

    /// The loss with the prior, and its derivative with respect to sigma. Where the derivative leads away from a better
    /// sigma elsewhere, the slope of the straight line to the better sigma instead.
    fn slope(&self, sigma: f64, [loss, by_sigma]: [f64; 2], elsewhere: &[(f64, f64)]) -> [f64; 2] {
        let s = &self.settings;
        let with_prior = |sigma: f64, loss: f64| loss + self.prior(sigma);
        let here = with_prior(sigma, loss);
        let nearest = 0.5 * (s.highest / s.lowest).ln() / elsewhere.len().saturating_sub(1).max(1) as f64;
        let far = elsewhere.iter().filter(|(other, _)| (other / sigma).ln().abs() > nearest);
        let best = elsewhere.iter().map(|(other, loss)| with_prior(*other, *loss)).fold(here, f64::min);
        let better = far.map(|(other, loss)| (*other, with_prior(*other, *loss))).find(|(_, loss)| *loss <= best);
        let downhill = by_sigma + 2.0 * s.prior * (sigma / s.typical).ln() / sigma;
        match better {
            Some((other, loss)) if loss < here && downhill * (sigma - other) <= 0.0 => {
                [here, (here - loss) / (sigma - other)]
            }
            _ => [here, downhill],
        }
    }

    fn update(
        &mut self,
        spectrum: &Spectrum,
        choice: Choice,
        loss: f64,
        [by_sigma, by_level]: [f64; 2],
        elsewhere: &[(f64, f64)],
    ) -> Update {
        let [loss, by_sigma] = self.slope(choice.sigma, [loss, by_sigma], elsewhere);
        let s = &self.settings;
        let input = self.standard.apply(spectrum.features());
        let [sigma, level] = self.network.forward(&input);
        let (open, turn) = (logistic(sigma), level.tanh());
        let by_output =
            [by_sigma * (s.highest - s.lowest) * open * (1.0 - open), by_level * s.level * (1.0 - turn * turn)];
        let gradient = self.network.backward(&input, by_output);
        self.adam.step(self.network.parameters_mut(), &gradient, s.rate);
        Update { loss, sigma: choice.sigma, level: choice.level, by_sigma }
    }
}

/// The learner's state in a checkpoint.
#[derive(Clone, Serialize, Deserialize)]
struct State {
    version: u32,
    network: Network,
    adam: Adam,
    /// Missing in older checkpoints, and empty then.
    #[serde(default)]
    recall: ReplayBuffer,
    standard: Standard,
    settings: LearnSettings,
}

/// Version of the layout of [`State`].
const VERSION: u32 = 1;

impl From<SigmaLearner> for State {
    fn from(learner: SigmaLearner) -> Self {
        let SigmaLearner { network, adam, recall, standard, settings } = learner;
        Self { version: VERSION, network, adam, recall, standard, settings }
    }
}

impl TryFrom<State> for SigmaLearner {
    type Error = Error;

    fn try_from(state: State) -> Result<Self, Error> {
        let State { version, network, adam, recall, standard, settings } = state;
        if version != VERSION {
            return Err(Error::State(format!("version {version} is unknown, expected {VERSION}")));
        }
        settings.check()?;
        if !(network.is_sound() && adam.is_sound(PARAMETERS) && recall.is_sound() && standard.is_finite()) {
            return Err(Error::State(format!("expected {PARAMETERS} finite parameters with their moments")));
        }
        Ok(Self { network, adam, recall, standard, settings })
    }
}
