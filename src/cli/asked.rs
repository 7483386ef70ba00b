//! Settings from the options of a command line, and which keys were named.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::str::FromStr;

use clap::parser::ValueSource;
use clap::{ArgMatches, Args as _, Command};
use psrgs_vk::train::Settings;

use super::exit::Failure;

/// `KEY=VALUE`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Assignment {
    /// The key.
    pub(crate) key: String,
    /// Its value as it is spelled.
    pub(crate) value: String,
}

impl FromStr for Assignment {
    type Err = String;
    fn from_str(word: &str) -> Result<Self, String> {
        match word.split_once('=') {
            Some((key, value)) if !key.trim().is_empty() => {
                Ok(Self { key: key.trim().to_owned(), value: value.trim().to_owned() })
            }
            _ => Err("it must be KEY=VALUE, such as sample-rate=0.3; `psrgs-vk options` lists the keys".to_owned()),
        }
    }
}

/// The settings of a training, as options and as keys.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct Asked {
    /// Set any key of settings.toml, such as --set sample-rate=0.3; may be repeated. `psrgs-vk options` lists the keys
    #[arg(long = "set", value_name = "KEY=VALUE", help_heading = "Run")]
    set: Vec<Assignment>,
    #[command(flatten)]
    settings: Settings,
}

impl Asked {
    /// The settings with the values of `--set`, and the keys named by options or by `--set`.
    pub(crate) fn settings<'a>(&self, matches: &'a ArgMatches) -> anyhow::Result<(Settings, Named<'a>)> {
        let mut settings = self.settings.clone();
        let mut keys = BTreeSet::new();
        for Assignment { key, value } in &self.set {
            // The environment is no repetition: the command line wins over it.
            if source(matches, key) == Some(ValueSource::CommandLine) || !keys.insert(key.clone()) {
                return Err(Failure::Usage(format!("--set {key}: this key is given twice")).into());
            }
            if let Some(instead) = removed(key) {
                return Err(Failure::Usage(format!("--set {key}: this key is gone: {instead}")).into());
            }
            settings.set(key, value)?;
        }
        Ok((settings, Named { matches, keys }))
    }
}

/// The keys named on the command line or in the environment.
pub(crate) struct Named<'a> {
    matches: &'a ArgMatches,
    keys: BTreeSet<String>,
}

impl Named<'_> {
    /// Whether the value of `key` was named. Methods, presets and files do not change a named value.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.keys.contains(key) || named(self.matches, key)
    }

    /// Whether the key was named as an option on the command line.
    pub(crate) fn is_option(&self, key: &str) -> bool {
        self.keys.contains(key) || source(self.matches, key) == Some(ValueSource::CommandLine)
    }
}

/// Whether an option was given by name on the command line or in the environment.
pub(crate) fn named(matches: &ArgMatches, key: &str) -> bool {
    matches!(source(matches, key), Some(ValueSource::CommandLine | ValueSource::EnvVariable))
}

/// Where an option's value comes from.
fn source(matches: &ArgMatches, key: &str) -> Option<ValueSource> {
    let id = key.replace('-', "_");
    // A command may lack the option.
    if matches.try_contains_id(&id).is_ok() { matches.value_source(&id) } else { None }
}

/// A text of the library with its settings spelled for the command line: `key` becomes `--key`, or `--set key` where no
/// option has that name.
pub(crate) fn as_options(text: &str) -> Cow<'_, str> {
    if !text.contains('`') {
        return Cow::Borrowed(text);
    }
    let command = Settings::augment_args(Command::new("train"));
    let mut spelled = text.to_owned();
    for option in OF_OTHER_COMMANDS {
        spelled = spelled.replace(&format!("`{option}`"), &format!("--{option}"));
    }
    for (_, key) in Settings::all_keys() {
        let option = command.get_arguments().any(|arg| arg.get_long() == Some(key.name.as_str()));
        let by = if option { "--" } else { "--set " };
        spelled = spelled.replace(&format!("`{}`", key.name), &format!("{by}{}", key.name));
    }
    Cow::Owned(spelled)
}

/// Words between backticks in the library's texts that are options but no settings of a training: `resume`, and
/// settings of `eval`, `stereo` and `blocks`.
const OF_OTHER_COMMANDS: [&str; 9] =
    ["resume", "margin", "width", "height", "downscale", "agree", "checks", "window", "least-ncc"];

/// A message for an option that a command lacks: the option was removed, or is a key of the settings and the command
/// has `--set`.
pub(crate) fn no_option(name: &str, has_set: bool) -> Option<String> {
    let key = name.trim_start_matches('-').split('=').next().unwrap_or_default();
    if let Some(instead) = removed(key) {
        return Some(format!("--{key} is no option any more: {instead}"));
    }
    let known = has_set && Settings::all_keys().into_iter().any(|(_, known)| known.name == key);
    known.then(|| format!("--{key} is no option but a key of the settings: --set {key}=VALUE"))
}

/// What to use instead of a removed option or key.
pub(crate) fn removed(key: &str) -> Option<&'static str> {
    REMOVED.iter().find(|(removed, _)| *removed == key).map(|(_, instead)| *instead)
}

/// Options and keys of earlier versions, and what to use instead.
const REMOVED: [(&str, &str); 15] = [
    (
        "alpha-cutoff",
        "leave it out: --set early-steps=SHARE --set early-cutoff=N cuts alphas off at 1/N in the first steps of a \
         training",
    ),
    ("backward", "leave it out: threads own pixels in every variant"),
    ("beta2-scaling", "leave it out: Adam forgets squared gradients as published in runs of any length"),
    ("coarse-spectrum", "leave it out: --set coarse-steps=SHARE is the share of coarse steps"),
    ("culling", "leave it out: pixel tiles always leave out what does not show in a block, with the same picture"),
    ("exponential", "leave it out: blending takes the exact exponential"),
    ("fast", "--moment-bits 16 saves as much memory"),
    ("sh-every", "leave it out: view-dependent colours take every step"),
    ("sh-rate", "leave it out: --lr-sh-rest RATE is the learning rate of view-dependent colours"),
    ("prune-distance", "leave it out: --prune-weight W drops splats of little weight"),
    (
        "stereo-density",
        "leave it out: `stereo-splats` is the number of splats on surfaces, by local frequency where it is 0",
    ),
    (
        "stereo-densest",
        "leave it out: `stereo-splats` is the number of splats on surfaces, by local frequency where it is 0",
    ),
    ("stereo-splats-for", "leave it out: larger photographs begin with more splats"),
    ("splat-order", "leave it out: splats always lie along Morton's curve, and the result is the same"),
    ("transmittance-cutoff", "leave it out: a pixel always ends at a transmittance of 1/10000"),
];

#[cfg(test)]
mod tests {
    use super::*;
    use clap::FromArgMatches as _;

    fn asked(options: &[&str]) -> anyhow::Result<(Settings, Vec<bool>)> {
        let matches = Asked::augment_args(Command::new("train").no_binary_name(true)).try_get_matches_from(options)?;
        let (settings, named) = Asked::from_arg_matches(&matches)?.settings(&matches)?;
        Ok((settings, ["sample-rate", "iterations", "seed"].map(|key| named.has(key)).to_vec()))
    }

    #[test]
    fn a_key_that_is_set_counts_as_named() {
        let (settings, named) = asked(&["--set", "sample-rate=0.3", "--iterations", "7"]).unwrap();
        assert_eq!((settings.density.sample_rate, settings.run.iterations), (0.3, 7));
        assert_eq!(named, [true, true, false]);
    }

    #[test]
    fn a_key_given_twice_is_refused() {
        for options in [["--set", "seed=1", "--seed=2"].as_slice(), &["--set", "seed=1", "--set", "seed=2"]] {
            let message = asked(options).unwrap_err().to_string();
            assert!(message.contains("seed") && message.contains("twice"), "{message}");
        }
        assert!(asked(&["--set", "seed"]).unwrap_err().to_string().contains("KEY=VALUE"));
        assert!(asked(&["--set", "sede=1"]).unwrap_err().to_string().contains("seed"));
    }

    #[test]
    fn a_former_option_names_what_to_use() {
        assert!(no_option("--sample-rate", true).unwrap().contains("--set sample-rate=VALUE"));
        assert!(no_option("--stereo-side=80", true).unwrap().contains("--set stereo-side=VALUE"));
        assert!(no_option("--fast", false).unwrap().contains("moment-bits"));
        assert_eq!(no_option("--nonsense", true), None);
        assert_eq!(no_option("--sample-rate", false), None, "a command without --set");
    }

    #[test]
    fn settings_in_texts_of_the_library_are_spelled_as_options() {
        assert_eq!(as_options("lower `max-side` or `stereo-side`"), "lower --max-side or --set stereo-side");
        assert_eq!(as_options("`psrgs-vk weights` of `a`"), "`psrgs-vk weights` of `a`");
    }

    #[test]
    fn what_the_environment_says_is_no_option() {
        // Every environment has a PATH.
        let command = || Command::new("train").no_binary_name(true).arg(clap::Arg::new("a_b").long("a-b").env("PATH"));
        let of = |options: &[&str]| {
            Named { matches: &command().get_matches_from(options), keys: BTreeSet::new() }.is_option("a-b")
        };
        assert!(!of(&[]) && of(&["--a-b", "value"]));
    }
}
