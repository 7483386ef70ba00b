//! Sigma by image, learned beside a training.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::adam::Adam;
use super::features::Standard;
use super::mask::logistic;
use super::network::{Network, PARAMETERS};
use super::replay_buffer::Recall;
use super::{Error, Features, Plane, Spectrum, Target, composite, cross_entropy, spaced};

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
    /// Largest change of a mask's level, in units of the map's natural logarithm. Errors alone do not change it.
    pub level: f64,
    /// Learning rate.
    pub rate: f64,
    /// Weight of (ln(sigma / typical))^2, which decides where a loss does not.
    pub prior: f64,
    /// The sigma that the prior draws to.
    pub typical: f64,
    /// Share of the pixels in which a model is said to fail.
    pub failing: f64,
    /// Blur of error maps in pixels of an image whose shorter side has 256.
    pub error_blur: f64,
    /// Price of a mask over all of an image, in units of colour.
    pub price: f64,
    /// Widths at which an update from errors looks at the loss beside its own, so that a hill between it and a better
    /// one does not hold it up; 0 for none: then it goes downhill from where it is.
    pub outlook: usize,
    /// Steps after an update from errors that recall what the outlooks of all images have found,
    /// each image's last one; 0 for none.
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

/// What the network says of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Width of the filter, in bins of 256.
    pub sigma: f64,
    /// By how much the level of the mask is moved.
    pub level: f64,
}

/// What an update knew and did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update {
    /// Loss before it, the prior included.
    pub loss: f64,
    /// Sigma before it.
    pub sigma: f64,
    /// Level before it.
    pub level: f64,
    /// Derivative of the loss with respect to sigma; where that leads away from a better one,
    /// the slope of the straight line to it.
    pub by_sigma: f64,
}

/// Two renders of a view and its photograph: red, green and blue per pixel from 0 to 1, at the size of the view's mask.
#[derive(Clone, Copy, Debug)]
pub struct Renders<'a> {
    /// Of the splats that the image has without texture.
    pub low: &'a [f32],
    /// Of all splats.
    pub full: &'a [f32],
    /// What both should be.
    pub photograph: &'a [f32],
}

/// The network with its optimiser. Its state goes into checkpoints through serde;
/// equal updates give equal bits, restored or not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "State", into = "State")]
pub struct SigmaLearner {
    network: Network,
    adam: Adam,
    recall: Recall,
    standard: Standard,
    settings: LearnSettings,
}

impl SigmaLearner {
    /// For images of these features: all of a data set, so that values mean the same for each.
    pub fn new(images: &[Features], settings: &LearnSettings) -> Result<Self, Error> {
        settings.check()?;
        let at = (settings.start - settings.lowest) / (settings.highest - settings.lowest);
        let network = Network::new([(at / (1.0 - at)).ln(), 0.0], settings.seed);
        let adam = Adam::new(PARAMETERS);
        let (recall, standard) = (Recall::default(), Standard::of(images));
        Ok(Self { network, adam, recall, standard, settings: settings.clone() })
    }

    /// Sigma and level for an image.
    pub fn choose(&self, features: &Features) -> Choice {
        let [sigma, level] = self.network.forward(&self.standard.apply(features));
        let s = &self.settings;
        Choice { sigma: s.lowest + (s.highest - s.lowest) * logistic(sigma), level: s.level * level.tanh() }
    }

    /// How many updates there were.
    pub fn updates(&self) -> u64 {
        self.adam.steps()
    }

    /// The settings it was made with.
    pub fn settings(&self) -> &LearnSettings {
        &self.settings
    }

    /// One update of one image: its mask is to tell where the model has its largest errors. None, and nothing is
    /// learned, where there is nothing to tell: an image of one colour, or errors that are the same everywhere.
    pub fn learn_from_errors(&mut self, spectrum: &Spectrum, errors: &Plane) -> Result<Option<Update>, Error> {
        let size = spectrum.size();
        let blur = self.settings.error_blur * f64::from(size.0.min(size.1)) / 256.0;
        match Target::of_errors(errors, size, blur, self.settings.failing) {
            Some(target) => self.learn_from_target(spectrum, &target),
            None => Ok(None),
        }
    }

    /// As [`SigmaLearner::learn_from_errors`], of a target that is known.
    pub fn learn_from_target(&mut self, spectrum: &Spectrum, target: &Target) -> Result<Option<Update>, Error> {
        if spectrum.is_flat() {
            return Ok(None);
        }
        let choice = self.choose(spectrum.features());
        let mask = spectrum.map(choice.sigma)?.mask(choice.level);
        let (loss, by_logit) = cross_entropy(mask.logits(), target.values())?;
        let [by_sigma, _] = mask.pull(&by_logit);
        let elsewhere = self.elsewhere(spectrum, choice.level, target)?;
        // The share of the mask is given: moving the level would only learn the share of the target.
        let update = self.update(spectrum, choice, loss, [by_sigma, 0.0], &elsewhere);
        if let Some((goal, depth)) = self.goal(&elsewhere).filter(|_| self.settings.recall > 0) {
            self.recall.keep(self.standard.apply(spectrum.features()), goal, depth);
            self.recall.teach(&mut self.network, self.settings.recall, self.settings.rate);
        }
        Ok(Some(update))
    }

    /// One update of one image: the mask is to be where the splats that only the full render has are worth their price.
    /// None for an image of one colour.
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
        // Level and sigma move together here: a hill in sigma at one level is none for the two.
        Ok(Some(self.update(spectrum, choice, loss, gradient, &[])))
    }

    /// Widths all over the range with the loss of their masks.
    fn elsewhere(&self, spectrum: &Spectrum, level: f64, target: &Target) -> Result<Vec<(f64, f64)>, Error> {
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

    /// The output that gives the best width of an outlook, by a parabola through it and its neighbours in the
    /// logarithm; and by how much the loss changes over the outlook. `None` for an outlook of fewer than three widths.
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
        // The ends of the range are at infinity.
        let share = ((sigma - s.lowest) / (s.highest - s.lowest)).clamp(0.01, 0.99);
        Some(((share / (1.0 - share)).ln(), most - least))
    }

    /// The loss with the prior, and where sigma is to go by it: downhill; but straight to the best width elsewhere,
    /// over the hill, where downhill leads away from it.
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

/// What stands in a checkpoint.
#[derive(Clone, Serialize, Deserialize)]
struct State {
    version: u32,
    network: Network,
    adam: Adam,
    /// Empty in what earlier versions kept.
    #[serde(default)]
    recall: Recall,
    standard: Standard,
    settings: LearnSettings,
}

/// Of the layout of [`State`].
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
            return Err(Error::State(format!("its version is {version}, and {VERSION} is known")));
        }
        settings.check()?;
        if !(network.is_sound() && adam.is_sound(PARAMETERS) && recall.is_sound() && standard.is_finite()) {
            return Err(Error::State(format!("it does not hold {PARAMETERS} finite parameters with their moments")));
        }
        Ok(Self { network, adam, recall, standard, settings })
    }
}
