//! `settings.toml`: written beside every result, and read by `train --config`.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

use super::Settings;
use crate::format::read_text;

/// An error of settings.
#[derive(Debug, thiserror::Error)]
pub enum SettingsError {
    /// The file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// The file is no settings file: invalid TOML, an unknown key, a value of the wrong kind.
    #[error("{}:{line}: {message}", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// The problem, with the key.
        message: String,
    },
    /// A value is outside its range.
    #[error("{key} must be {want}")]
    Value {
        /// The key.
        key: String,
        /// The values that it takes, worded to follow "must be".
        want: &'static str,
    },
    /// No setting has this name.
    #[error("no setting `{key}`{}", nearest.as_ref().map_or(String::new(), |nearest| format!("; the nearest name is `{nearest}`")))]
    UnknownKey {
        /// The name.
        key: String,
        /// The setting with the most similar name.
        nearest: Option<String>,
    },
    /// A value has the wrong kind.
    #[error("{key} cannot be `{value}`: {message}")]
    BadValue {
        /// The key.
        key: String,
        /// The value.
        value: String,
        /// The values that the key takes.
        message: String,
    },
    /// The settings cannot be written as TOML.
    #[error("settings cannot be written as TOML: {0}")]
    Write(#[from] toml::ser::Error),
}

/// An f64 represents every smaller whole number exactly.
const WHOLE: f64 = 9_007_199_254_740_992.0;

impl Settings {
    /// The text of a `settings.toml` with every value.
    pub fn to_toml(&self) -> Result<String, SettingsError> {
        let text = toml::to_string_pretty(self)?;
        Ok(format!("# Reproduces this run: psrgs-vk train --config settings.toml --out DIR\n{text}"))
    }

    /// Reads the text of a settings file. Missing keys keep their defaults. `path` is used in errors only.
    ///
    /// Whole numbers may have floating-point notation.
    pub fn from_toml(text: &str, path: &Path) -> Result<Self, SettingsError> {
        toml::from_str(text).or_else(|error| with_whole_numbers(text).ok_or_else(|| parse_error(&error, text, path)))
    }

    /// Reads a settings file.
    pub fn read(path: &Path) -> Result<Self, SettingsError> {
        let text = read_text(path).map_err(|source| SettingsError::Io { path: path.to_owned(), source })?;
        Self::from_toml(&text, path)
    }

    /// The keys in a settings file, in all groups.
    pub fn keys(path: &Path) -> Result<Vec<String>, SettingsError> {
        let text = read_text(path).map_err(|source| SettingsError::Io { path: path.to_owned(), source })?;
        let table: toml::Table = toml::from_str(&text).map_err(|error| parse_error(&error, &text, path))?;
        let keys = |(key, value): (&String, &toml::Value)| match value {
            toml::Value::Table(group) => group.keys().cloned().collect(),
            _ => vec![key.clone()],
        };
        Ok(table.iter().flat_map(keys).collect())
    }

    /// Settings that differ from `other`: key, value here, value there, in the file's spelling, `-` for none.
    pub fn differences(&self, other: &Self) -> Result<Vec<(String, String, String)>, SettingsError> {
        let [mine, theirs] = [flat(self)?, flat(other)?];
        let keys: BTreeSet<&String> = mine.keys().chain(theirs.keys()).collect();
        let word = |value: Option<&toml::Value>| value.map_or("-".to_owned(), toml::Value::to_string);
        let differs = keys.into_iter().filter(|key| mine.get(*key) != theirs.get(*key));
        Ok(differs.map(|key| (key.clone(), word(mine.get(key)), word(theirs.get(key)))).collect())
    }

    /// Merges with the settings of a file: keys for which `given` is true keep their values here, all others get those
    /// of `file`. Keys have the file's spelling (`max-side`).
    pub fn over(&self, file: &Self, given: impl Fn(&str) -> bool) -> Result<Self, SettingsError> {
        let mut merged = toml::Table::try_from(file)?;
        overlay(&mut merged, toml::Table::try_from(self)?, &given);
        // Both tables come from `Settings`, so this can only be a failure to write TOML.
        merged.try_into().map_err(|e: toml::de::Error| SettingsError::Write(serde::ser::Error::custom(e)))
    }
}

/// The values of all groups by key. Keys are unique across groups, like command-line options.
fn flat(settings: &Settings) -> Result<BTreeMap<String, toml::Value>, SettingsError> {
    let values = |(key, value)| match value {
        toml::Value::Table(group) => group.into_iter().collect(),
        value => vec![(key, value)],
    };
    Ok(toml::Table::try_from(settings)?.into_iter().flat_map(values).collect())
}

fn overlay(base: &mut toml::Table, top: toml::Table, given: &impl Fn(&str) -> bool) {
    for (key, value) in top {
        match (value, base.get_mut(&key)) {
            (toml::Value::Table(inner), Some(toml::Value::Table(below))) => overlay(below, inner, given),
            (value, _) if given(&key) => {
                base.insert(key, value);
            }
            _ => {}
        }
    }
}

/// The settings of a text in which whole numbers have floating-point notation, if the text has no other fault.
fn with_whole_numbers(text: &str) -> Option<Settings> {
    fn whole(value: &mut toml::Value) {
        match value {
            toml::Value::Float(number) if number.fract() == 0.0 && number.abs() < WHOLE => {
                *value = toml::Value::Integer(*number as i64);
            }
            toml::Value::Table(group) => group.iter_mut().for_each(|(_, value)| whole(value)),
            _ => {}
        }
    }
    let mut table: toml::Table = toml::from_str(text).ok()?;
    table.iter_mut().for_each(|(_, value)| whole(value));
    table.try_into().ok()
}

fn parse_error(error: &toml::de::Error, text: &str, path: &Path) -> SettingsError {
    let start = error.span().map_or(0, |span| span.start.min(text.len()));
    let line = text.as_bytes()[..start].iter().filter(|&&b| b == b'\n').count() + 1;
    // toml's message names an unknown key, but for a bad value only the expected kind: add the line itself.
    let source = text.lines().nth(line - 1).unwrap_or_default().trim();
    SettingsError::Parse { path: path.to_owned(), line, message: format!("{} (in `{source}`)", error.message()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::settings::{Background, ByteSize, Exposure, Split, Transparent};

    fn unusual() -> Settings {
        let mut s = Settings { data: Some("some where/fox".into()), ..Settings::default() };
        s.run.iterations = 1500;
        s.run.scale_schedule = true;
        s.run.init = Some("start.ply".into());
        s.photographs.split = Split::Val;
        s.photographs.images = Some("images_4".into());
        s.photographs.transparent = Transparent::Background;
        s.model.background = Background::Random;
        s.optimiser.lr_means = 1.0 / 3.0;
        s.optimiser.exposure = Exposure::Affine;
        s.density.max_splats = Some(70_000);
        s.device.device = Some("llvmpipe".into());
        s.device.max_device_memory = Some(ByteSize(6 << 30));
        s
    }

    fn parse(text: &str) -> Result<Settings, SettingsError> {
        Settings::from_toml(text, Path::new("my.toml"))
    }

    #[test]
    fn settings_survive_the_file() {
        for settings in [Settings::default(), unusual()] {
            let text = settings.to_toml().unwrap();
            assert_eq!(parse(&text).unwrap(), settings, "{text}");
        }
    }

    #[test]
    fn missing_keys_keep_their_defaults() {
        let s = parse("[run]\niterations = 7\n").unwrap();
        assert_eq!(s.run.iterations, 7);
        assert_eq!(s.density, Settings::default().density);
    }

    #[test]
    fn whole_numbers_of_settings_may_have_a_decimal_point() {
        let s = parse("[run]\niterations = 700.0\nseed = 3e0\n[optimiser]\nlr-means = 1.0\n").unwrap();
        assert_eq!((s.run.iterations, s.run.seed, s.optimiser.lr_means), (700, 3, 1.0));
        let message = parse("[run]\niterations = 700.5\n").unwrap_err().to_string();
        assert!(message.starts_with("my.toml:2: ") && message.contains("iterations"), "{message}");
    }

    #[test]
    fn options_given_by_name_win_over_the_file() {
        let mut cli = Settings::default();
        cli.run.iterations = 30_000;
        cli.photographs.max_side = 320;
        let merged = cli.over(&unusual(), |key| key == "iterations").unwrap();
        let mut want = unusual();
        want.run.iterations = 30_000;
        assert_eq!(merged, want, "named with its default value, and nothing else taken");
    }

    #[test]
    fn an_option_that_the_file_does_not_have_is_added() {
        let mut cli = Settings::default();
        cli.density.max_splats = Some(5);
        let merged = cli.over(&Settings::default(), |key| key == "max-splats").unwrap();
        assert_eq!(merged.density.max_splats, Some(5));
    }

    #[test]
    fn errors_name_file_line_and_key() {
        for (text, line, key) in [
            ("[run]\niterations = 5\nitertions = 6\n", 3, "itertions"),
            ("[run]\niterations = -5\n", 2, "iterations"),
            ("\n[run]\nmethod = \"gsplat\"\n", 3, "gsplat"),
            ("[rum]\n", 1, "rum"),
            ("[run]\nseed = 1\nseed = 2\n", 3, "seed"),
            ("[device]\nmax-device-memory = \"6GX\"\n", 2, "6GX"),
            ("[photographs]\nsplit = 3", 2, "split"),
            ("[run", 1, "[run"),
        ] {
            let message = parse(text).unwrap_err().to_string();
            assert!(message.starts_with(&format!("my.toml:{line}: ")) && message.contains(key), "{text:?}: {message}");
        }
    }

    #[test]
    fn values_out_of_range_are_named() {
        let mut s = Settings::default();
        s.model.sh_degree = 4;
        assert_eq!(s.check().unwrap_err().to_string(), "sh-degree must be 0, 1, 2 or 3");
        let mut s = Settings::default();
        s.optimiser.lr_means = f64::NAN;
        assert!(s.check().unwrap_err().to_string().starts_with("lr-means must"));
    }

    #[test]
    fn sizes_are_read_in_every_usual_spelling() {
        for (word, bytes) in [
            ("6GiB", 6 << 30),
            ("800M", 800 << 20),
            ("1.5g", 3 << 29),
            ("2 kb", 2048),
            ("123456", 123_456),
            ("1TB", 1 << 40),
        ] {
            assert_eq!(word.parse::<ByteSize>().unwrap().0, bytes, "{word}");
            assert_eq!(ByteSize(bytes).to_string().parse::<ByteSize>().unwrap().0, bytes, "{word}");
        }
        for word in ["", "G", "-1", "0", "1e9", "6GX", "9999999999T"] {
            assert!(word.parse::<ByteSize>().is_err(), "{word:?}");
        }
    }
}
