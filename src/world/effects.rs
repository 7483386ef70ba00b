//! Effects that make a world hard to reconstruct, each with its own switch.

use serde::{Deserialize, Serialize};

use super::WorldError;

/// Effects on photographs and sparse points, and objects that are hard to reconstruct. A value of zero or `false` turns
/// an effect off. Everything else stays in place: pixels that the effect does not touch keep their values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Effects {
    /// Quality of the JPEG files, 1 to 100; 0 writes PNG.
    pub jpeg_quality: u8,
    /// Standard deviation of sparse observations in pixels; the points are triangulated from them.
    pub observation_noise: f64,
    /// Share of the sparse points that are wrong matches: at a wrong depth, with observations that fit the wrong depth.
    pub outliers: f64,
    /// Error of the sparse model's poses: standard deviation per axis, in pixels, of the surface point at the
    /// photograph's centre. Half of the variance comes from the rotation, half from the position.
    pub pose_noise: f64,
    /// Largest relative change of a photograph's exposure. The geometric mean of all exposures is 1.
    pub exposure: f64,
    /// Standard deviation of the sensor's noise in 8-bit steps.
    pub sensor_noise: f64,
    /// Shadows of the sun.
    pub shadows: bool,
    /// Windows, paint and water that reflect the sky, so that their colour depends on the view.
    pub reflections: bool,
    /// Trees, bushes and hedges, which hide what is behind them.
    pub vegetation: bool,
    /// Cars.
    pub vehicles: bool,
    /// Thin lamp posts, poles of a power line, an antenna mast.
    pub masts: bool,
    /// Wires between the poles and guys of the mast, a fraction of a pixel wide.
    pub wires: bool,
    /// Lettering from 5 cm to 1 m on boards, walls and a plaza, and a resolution star.
    pub text: bool,
    /// Identical houses in a terrace and identical windows in flats; otherwise each looks different.
    pub repeats: bool,
    /// Fields, a meadow and roofs with hardly any texture; otherwise they are textured.
    pub plain: bool,
    /// A pond; otherwise a lawn in its place.
    pub water: bool,
}

/// The name of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, clap::ValueEnum)]
pub enum Effect {
    /// [`Effects::jpeg_quality`].
    Jpeg,
    /// [`Effects::observation_noise`].
    ObservationNoise,
    /// [`Effects::outliers`].
    Outliers,
    /// [`Effects::pose_noise`].
    PoseNoise,
    /// [`Effects::exposure`].
    Exposure,
    /// [`Effects::sensor_noise`].
    SensorNoise,
    /// [`Effects::shadows`].
    Shadows,
    /// [`Effects::reflections`].
    Reflections,
    /// [`Effects::vegetation`].
    Vegetation,
    /// [`Effects::vehicles`].
    Vehicles,
    /// [`Effects::masts`].
    Masts,
    /// [`Effects::wires`].
    Wires,
    /// [`Effects::text`].
    Text,
    /// [`Effects::repeats`].
    Repeats,
    /// [`Effects::plain`].
    Plain,
    /// [`Effects::water`].
    Water,
}

impl Effect {
    /// All effects, in the order of the fields of [`Effects`].
    pub const ALL: [Self; 16] = [
        Self::Jpeg,
        Self::ObservationNoise,
        Self::Outliers,
        Self::PoseNoise,
        Self::Exposure,
        Self::SensorNoise,
        Self::Shadows,
        Self::Reflections,
        Self::Vegetation,
        Self::Vehicles,
        Self::Masts,
        Self::Wires,
        Self::Text,
        Self::Repeats,
        Self::Plain,
        Self::Water,
    ];
}

impl Default for Effects {
    fn default() -> Self {
        Self {
            jpeg_quality: 92,
            observation_noise: 0.3,
            outliers: 0.02,
            pose_noise: 0.2,
            exposure: 0.1,
            sensor_noise: 1.5,
            shadows: true,
            reflections: true,
            vegetation: true,
            vehicles: true,
            masts: true,
            wires: true,
            text: true,
            repeats: true,
            plain: true,
            water: true,
        }
    }
}

impl Effects {
    /// Every effect off.
    pub fn none() -> Self {
        Self {
            jpeg_quality: 0,
            observation_noise: 0.0,
            outliers: 0.0,
            pose_noise: 0.0,
            exposure: 0.0,
            sensor_noise: 0.0,
            shadows: false,
            reflections: false,
            vegetation: false,
            vehicles: false,
            masts: false,
            wires: false,
            text: false,
            repeats: false,
            plain: false,
            water: false,
        }
    }

    /// Copies one effect from `from`: [`Effects::none`] turns the effect off, the default turns it on.
    pub fn take(&mut self, effect: Effect, from: &Self) {
        match effect {
            Effect::Jpeg => self.jpeg_quality = from.jpeg_quality,
            Effect::ObservationNoise => self.observation_noise = from.observation_noise,
            Effect::Outliers => self.outliers = from.outliers,
            Effect::PoseNoise => self.pose_noise = from.pose_noise,
            Effect::Exposure => self.exposure = from.exposure,
            Effect::SensorNoise => self.sensor_noise = from.sensor_noise,
            Effect::Shadows => self.shadows = from.shadows,
            Effect::Reflections => self.reflections = from.reflections,
            Effect::Vegetation => self.vegetation = from.vegetation,
            Effect::Vehicles => self.vehicles = from.vehicles,
            Effect::Masts => self.masts = from.masts,
            Effect::Wires => self.wires = from.wires,
            Effect::Text => self.text = from.text,
            Effect::Repeats => self.repeats = from.repeats,
            Effect::Plain => self.plain = from.plain,
            Effect::Water => self.water = from.water,
        }
    }

    pub(super) fn validate(&self) -> Result<(), WorldError> {
        let within = super::params::within;
        within("effects.jpeg_quality", f64::from(self.jpeg_quality), 0.0, 100.0)?;
        within("effects.observation_noise", self.observation_noise, 0.0, 10.0)?;
        within("effects.outliers", self.outliers, 0.0, 1.0)?;
        within("effects.pose_noise", self.pose_noise, 0.0, 10.0)?;
        within("effects.exposure", self.exposure, 0.0, 0.9)?;
        within("effects.sensor_noise", self.sensor_noise, 0.0, 100.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_effect_can_be_turned_on_alone_and_off_alone() {
        let (all, none) = (Effects::default(), Effects::none());
        let (mut on, mut off) = (none.clone(), all.clone());
        for effect in Effect::ALL {
            let (mut alone, mut without) = (none.clone(), all.clone());
            alone.take(effect, &all);
            without.take(effect, &none);
            assert!(alone != none && without != all, "{effect:?}");
            on.take(effect, &all);
            off.take(effect, &none);
        }
        assert_eq!((on, off), (all, none));
    }
}
