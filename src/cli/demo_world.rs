//! The options of `psrgs-vk demo` that decide its scene.

use std::path::PathBuf;

use anyhow::Context as _;
use psrgs_vk::world::{CameraKind, Effect, Effects, WorldParams};

use super::exit::Failure;

/// Default number of photographs.
const IMAGES: u32 = 64;

/// Parameters of a world by name. Parameters that are not given come from `--world`, else from the defaults.
#[derive(clap::Args)]
#[command(next_help_heading = "Scene")]
pub(super) struct WorldArgs {
    /// Begin with the parameters of this world.toml
    #[arg(long, value_name = "FILE")]
    world: Option<PathBuf>,
    /// Photographs [default: 64]
    #[arg(long, value_name = "N")]
    images: Option<u32>,
    /// Longer side of a photograph in pixels [default: 320]
    #[arg(long, value_name = "PX")]
    max_side: Option<u32>,
    /// Side of the square site in metres [default: 80]
    #[arg(long, value_name = "M")]
    extent: Option<f64>,
    /// Lens: pinhole, or opencv with distortion; the undistorted pictures are the same [default: pinhole]
    #[arg(long, value_enum, value_name = "LENS")]
    camera: Option<CameraKind>,
    /// Seed of the scene and of training [default: 0]
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Views from elsewhere, to score on [default: 8]
    #[arg(long, value_name = "N")]
    offpath: Option<u32>,
    /// Laser pulses per square metre [default: 8]
    #[arg(long, value_name = "N")]
    lidar_density: Option<f64>,
    /// Pixels of a photograph per sparse point, at least [default: 200]
    #[arg(long, value_name = "PX")]
    pixels_per_point: Option<u32>,
    /// Effects that are on: all, none, or some by name [default: all]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    effects: Vec<String>,
    /// Effects that are off
    #[arg(long, value_enum, value_name = "LIST", value_delimiter = ',', hide_possible_values = true)]
    without: Vec<Effect>,
    /// Standard deviation of the poses in pixels [default: 0.2]
    #[arg(long, value_name = "PX")]
    pose_noise: Option<f64>,
    /// Largest change of the exposure [default: 0.1]
    #[arg(long, value_name = "SHARE")]
    exposure: Option<f64>,
    /// Standard deviation of the sensor's noise in 8-bit steps [default: 1.5]
    #[arg(long, value_name = "STEPS")]
    sensor_noise: Option<f64>,
    /// Share of wrong sparse points [default: 0.02]
    #[arg(long, value_name = "SHARE")]
    outliers: Option<f64>,
    /// Standard deviation of sparse observations in pixels [default: 0.3]
    #[arg(long, value_name = "PX")]
    observation_noise: Option<f64>,
    /// Quality of the JPEG files, 0 for PNG [default: 92]
    #[arg(long, value_name = "Q")]
    jpeg_quality: Option<u8>,
}

impl WorldArgs {
    /// The parameters: first those of the file, then the list of effects, then the numbers by name.
    pub(super) fn params(&self) -> anyhow::Result<WorldParams> {
        let mut p = match &self.world {
            Some(file) => {
                let failed = || Failure::Usage(format!("{}: no parameters of a world", file.display()));
                let text = psrgs_vk::format::read_text(file).with_context(failed)?;
                toml::from_str(&text).with_context(failed)?
            }
            None => WorldParams { images: IMAGES, ..WorldParams::default() },
        };
        if !self.effects.is_empty() {
            p.effects = chosen(&self.effects)?;
        }
        self.without.iter().for_each(|effect| p.effects.take(*effect, &Effects::none()));
        set(&mut p.images, self.images);
        set(&mut p.max_side, self.max_side);
        set(&mut p.extent, self.extent);
        set(&mut p.camera, self.camera);
        set(&mut p.seed, self.seed);
        set(&mut p.offpath, self.offpath);
        set(&mut p.lidar.density, self.lidar_density);
        set(&mut p.pixels_per_point, self.pixels_per_point);
        set(&mut p.effects.pose_noise, self.pose_noise);
        set(&mut p.effects.exposure, self.exposure);
        set(&mut p.effects.sensor_noise, self.sensor_noise);
        set(&mut p.effects.outliers, self.outliers);
        set(&mut p.effects.observation_noise, self.observation_noise);
        set(&mut p.effects.jpeg_quality, self.jpeg_quality);
        p.validate()?;
        Ok(p)
    }
}

fn set<T: Copy>(to: &mut T, from: Option<T>) {
    if let Some(value) = from {
        *to = value;
    }
}

fn chosen(names: &[String]) -> Result<Effects, Failure> {
    if let [one] = names {
        match one.as_str() {
            "all" => return Ok(Effects::default()),
            "none" => return Ok(Effects::none()),
            _ => {}
        }
    }
    let mut effects = Effects::none();
    for name in names {
        let effect = <Effect as clap::ValueEnum>::from_str(name, false)
            .map_err(|_| Failure::Usage(format!("--effects: '{name}' is not an effect; --help lists them")))?;
        effects.take(effect, &Effects::default());
    }
    Ok(effects)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        world: WorldArgs,
    }

    fn params(line: &str) -> anyhow::Result<WorldParams> {
        Command::try_parse_from(line.split_whitespace())?.world.params()
    }

    #[test]
    fn effects_by_list_and_by_number() {
        assert_eq!(params("demo").unwrap(), WorldParams { images: 64, ..WorldParams::default() });
        assert_eq!(params("demo --effects none").unwrap().effects, Effects::none());
        let two = params("demo --effects exposure,wires --exposure 0.05").unwrap().effects;
        assert_eq!(two, Effects { exposure: 0.05, wires: true, ..Effects::none() });
        let but = params("demo --without jpeg,water").unwrap().effects;
        assert_eq!(but, Effects { jpeg_quality: 0, water: false, ..Effects::default() });
        for (line, problem) in [
            ("demo --effects wire", "'wire' is not an effect"),
            ("demo --without wire", "wire"),
            ("demo --exposure 2", "effects.exposure"),
            ("demo --world nowhere.toml", "nowhere.toml"),
        ] {
            let error = params(line).unwrap_err();
            assert!(format!("{error:#}").contains(problem), "{line}: {error:#}");
        }
    }

    #[test]
    fn a_written_world_can_be_begun_with() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("world.toml");
        let written = WorldParams { images: 7, seed: 3, effects: Effects::none(), ..WorldParams::default() };
        std::fs::write(&file, toml::to_string_pretty(&written).unwrap()).unwrap();
        let got = params(&format!("demo --world {} --seed 4", file.display())).unwrap();
        assert_eq!(got, WorldParams { seed: 4, ..written });
    }
}
