//! Rows of a comparison: methods, with settings of their own where wanted, or a method without each of its parts.

use std::collections::BTreeSet;
use std::fmt::Display;

use clap::{Args as _, Command, FromArgMatches as _};
use psrgs_vk::compare::{ABLATIONS, Ablation, OWN_GRAD_THRESHOLD};
use psrgs_vk::train::Settings;
use psrgs_vk::train::settings::{DepthPrior, LidarCloud, Method};

use crate::cli::asked::{Asked, Assignment, removed};
use crate::cli::exit::Failure;

/// A row of a comparison.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Row {
    /// What it is called.
    pub(super) label: String,
    /// Its method.
    pub(super) method: Method,
    /// Its options of `train`, beyond those of all rows.
    pub(super) options: Vec<String>,
}

/// The rows that are written as `METHOD[:KEY=VALUE]...`.
pub(super) fn written(texts: &[String]) -> anyhow::Result<Vec<Row>> {
    let mut rows: Vec<Row> = Vec::new();
    for text in texts {
        if rows.iter().any(|row| row.label == *text) {
            return Err(in_row(text, &"this row is given twice").into());
        }
        rows.push(one(text)?);
    }
    Ok(rows)
}

/// The error of a row.
pub(super) fn in_row(row: &str, problem: &dyn Display) -> Failure {
    Failure::Usage(format!("--methods {row}: {problem}"))
}

fn one(text: &str) -> anyhow::Result<Row> {
    let mut parts = text.split(':');
    let method: Method = parts.next().unwrap_or_default().parse().map_err(|problem: String| in_row(text, &problem))?;
    let (mut settings, mut keys, mut options) = (Settings::of_method(method), BTreeSet::new(), Vec::new());
    for part in parts {
        let Assignment { key, value } =
            part.parse().map_err(|problem| in_row(text, &format!("`{part}`: {problem}")))?;
        if let Some(instead) = removed(&key) {
            return Err(in_row(text, &format!("the key {key} is gone: {instead}")).into());
        }
        if is_of_all_rows(&key) {
            let problem =
                format!("{key} cannot be a row's own: rows share photographs and seeds, and methods come first");
            return Err(in_row(text, &problem).into());
        }
        settings.set(&key, &value).map_err(|problem| in_row(text, &problem))?;
        options.push(spelled(&key, &value));
        if !keys.insert(key.clone()) {
            return Err(in_row(text, &format!("{key} is given twice")).into());
        }
    }
    Ok(Row { label: text.to_owned(), method, options })
}

/// Whether rows with other values of a key do not compare: the photographs and how they are read, the seed. The method
/// has its own place.
fn is_of_all_rows(key: &str) -> bool {
    let of_photographs =
        |(group, known): &(&str, psrgs_vk::train::settings::Key)| *group == "photographs" && known.name == key;
    ["method", "seed"].contains(&key) || Settings::all_keys().iter().any(of_photographs)
}

/// A setting as an option of `train`, by its own name where it has one, as other commands have some of these too.
fn spelled(key: &str, value: &str) -> String {
    let command = Settings::augment_args(Command::new("train"));
    match command.get_arguments().any(|arg| arg.get_long() == Some(key)) {
        true => format!("--{key}={value}"),
        false => format!("--set={key}={value}"),
    }
}

/// Options of `train` in groups of words, each with the key that it sets.
fn by_key(options: &[String]) -> Vec<(&str, &[String])> {
    let mut starts: Vec<usize> = (0..options.len()).filter(|i| *i == 0 || options[*i].starts_with("--")).collect();
    starts.push(options.len());
    let group = |w: &[usize]| {
        let words = &options[w[0]..w[1]];
        let mut parts = words.iter().flat_map(|word| word.split('=')).map(|part| part.trim_start_matches("--"));
        let name = parts.next().unwrap_or_default();
        let key = if name == "set" { parts.next().unwrap_or_default() } else { name };
        (key.trim(), words)
    };
    starts.windows(2).map(group).collect()
}

/// Whether options set a key.
pub(super) fn sets(options: &[String], key: &str) -> bool {
    by_key(options).iter().any(|(set, _)| *set == key)
}

/// Options without those that set a key of `row`, which wins.
pub(super) fn without(options: &[String], row: &[String]) -> Vec<String> {
    let kept = by_key(options).into_iter().filter(|(key, _)| !sets(row, key));
    kept.flat_map(|(_, words)| words.to_vec()).collect()
}

/// The whole method, and the method without each of its parts or with a part replaced.
pub(super) fn ablated(method: &str) -> anyhow::Result<Vec<Row>> {
    let known: Method = method.parse().map_err(|error| Failure::Usage(format!("--ablate: {error}")))?;
    let whole = Settings::of_method(known);
    let mut rows = vec![Row { label: method.to_owned(), method: known, options: Vec::new() }];
    for ablation in &ABLATIONS {
        let options = options_of(ablation, &whole);
        let changed = with(&whole, &options)?;
        if changed.in_use() != whole.in_use() && can_be_trained(&changed) {
            rows.push(Row { label: format!("{method}-{}", ablation.name), method: known, options });
        }
    }
    Ok(rows)
}

fn options_of(ablation: &Ablation, whole: &Settings) -> Vec<String> {
    let one = |option: &&str| match *option {
        OWN_GRAD_THRESHOLD => format!("--set=low-grad-threshold={}", whole.density.grad_threshold),
        option => option.to_owned(),
    };
    ablation.options.iter().map(one).collect()
}

/// Whether the method can be trained with the change. Without a filter, for example, no filter width can be learned.
fn can_be_trained(changed: &Settings) -> bool {
    let mut settings = changed.clone();
    if settings.geometry.depth_prior == DepthPrior::Lidar {
        // The cloud is chosen by the comparison.
        settings.density.lidar.get_or_insert(LidarCloud::Mvs);
    }
    settings.check().is_ok()
}

/// The settings with some options of `train` changed. The environment is ignored: it is the same for every row.
fn with(whole: &Settings, options: &[String]) -> anyhow::Result<Settings> {
    let command = Asked::augment_args(Command::new("train").no_binary_name(true));
    let matches = command.try_get_matches_from(options)?;
    let (asked, named) = Asked::from_arg_matches(&matches)?.settings(&matches)?;
    Ok(asked.over(whole, |key| named.is_option(key))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(method: &str) -> Vec<String> {
        ablated(method).expect("rows").into_iter().map(|row| row.label).collect()
    }

    /// A change is left out only where the part needs another part that the method lacks.
    #[test]
    fn rows_are_left_out_for_a_reason() {
        let left_out = |method: Method| -> Vec<&str> {
            let whole = Settings::of_method(method);
            let rows = names(method.name());
            let changed = |ablation: &&Ablation| {
                with(&whole, &options_of(ablation, &whole)).expect("settings").in_use() != whole.in_use()
                    && !rows.contains(&format!("{}-{}", method.name(), ablation.name))
            };
            ABLATIONS.iter().filter(changed).map(|ablation| ablation.name).collect()
        };
        assert_eq!(left_out(Method::Psrgs), [""; 0]);
        assert_eq!(left_out(Method::PsrgsPaper), [""; 0]);
    }

    #[test]
    fn every_row_can_be_trained() {
        for (method, name) in Method::ALL {
            for Row { label, options, .. } in ablated(name).expect("rows") {
                let mut whole = Settings::of_method(method);
                if method == Method::Rsgs {
                    whole.density.lidar = Some(LidarCloud::Mvs);
                }
                with(&whole, &options).expect(&label).check().unwrap_or_else(|error| panic!("{label}: {error}"));
            }
        }
    }

    #[test]
    fn one_threshold_is_that_of_high_frequencies() {
        let one = ABLATIONS.iter().find(|ablation| ablation.name == "one-threshold").expect("a row");
        let paper = Settings::of_method(Method::PsrgsPaper);
        let density = with(&paper, &options_of(one, &paper)).expect("settings").density;
        assert_eq!(density.low_grad_threshold, density.grad_threshold);
    }

    #[test]
    fn what_a_method_does_not_have_is_no_row() {
        let plain = names("3dgs");
        assert_eq!(plain[0], "3dgs");
        assert_eq!(plain, ["3dgs", "3dgs-coarse-steps"], "it has none of the parts");
        let lean = names("lean");
        let parts =
            ["free-harmonics", "along-gradient", "no-coarse-steps", "no-pruning", "steps-of-all", "no-early-cutoff"];
        assert_eq!(lean[1..], parts.map(|part| format!("lean-{part}")), "{lean:?}");
        let (psrgs, paper) = (names("psrgs"), names("psrgs-paper"));
        for ablation in &ABLATIONS {
            let row = |method: &str| format!("{method}-{}", ablation.name);
            let has = [(&psrgs, "psrgs"), (&paper, "psrgs-paper"), (&lean, "lean")];
            let has = has.iter().any(|(rows, method)| rows.contains(&row(method)));
            assert!(has, "no method has the part of {}", ablation.name);
        }
        for of_psrgs in ["start-sfm", "uniform-spacing", "no-lone-splats", "steps-of-all"] {
            assert!(psrgs.contains(&format!("psrgs-{of_psrgs}")), "{psrgs:?}");
            assert!(!paper.contains(&format!("psrgs-paper-{of_psrgs}")), "{paper:?}");
        }
        assert!(ablated("gsplat").expect_err("no method").to_string().contains("psrgs-paper"));
    }
    fn written_as(rows: &[&str]) -> Result<Vec<Row>, String> {
        let rows: Vec<String> = rows.iter().map(|row| (*row).to_owned()).collect();
        written(&rows).map_err(|error| error.to_string())
    }

    #[test]
    fn rows_have_settings_of_their_own() {
        let rows = written_as(&["3dgs", "3dgs:start=stereo:housekeeping=lean", "psrgs:low-stage=0"]).expect("rows");
        assert_eq!(rows[0].options, [""; 0]);
        assert_eq!(
            (rows[1].label.as_str(), rows[1].method),
            ("3dgs:start=stereo:housekeeping=lean", Method::Reference3dgs)
        );
        assert_eq!(rows[1].options, ["--start=stereo", "--housekeeping=lean"]);
        assert_eq!(rows[2].options, ["--set=low-stage=0"]);
        let refused = |rows: &[&str], words: &[&str]| {
            let error = written_as(rows).expect_err("a mistake");
            assert!(words.iter().all(|word| error.contains(word)), "{error}");
        };
        refused(&["lean", "3dgs:start=sfm", "lean"], &["--methods lean", "twice"]);
        refused(&["3dgs:start=sfm:start=stereo"], &["--methods 3dgs:start=sfm:start=stereo", "start", "twice"]);
        refused(&["3dgs:lean"], &["--methods 3dgs:lean", "`lean`", "KEY=VALUE"]);
        refused(&["psrgs:low-stag=0"], &["--methods psrgs:low-stag=0", "low-stag", "low-stage"]);
        refused(&["psrgs:start=moon"], &["--methods psrgs:start=moon", "start", "moon"]);
        refused(&["psrgs:stereo-density=1"], &["--methods psrgs:stereo-density=1", "gone", "stereo-splats"]);
        refused(&["psrgs:max-side=64"], &["--methods psrgs:max-side=64", "max-side", "row's own"]);
        refused(&["psrgs:method=lean"], &["method", "row's own"]);
        refused(&["psrg:start=sfm"], &["--methods psrg:start=sfm", "psrgs-paper"]);
    }

    #[test]
    fn what_a_row_sets_wins_over_the_options_of_all_rows() {
        let words = |text: &str| -> Vec<String> { text.split(' ').map(str::to_owned).collect() };
        let all =
            words("--exposure off --scale-schedule --set low-stage=0.1 --set=lambda-sh=1 --lr-means=-1 --gate off");
        let left = without(&all, &words("--set=low-stage=0 --exposure=auto --lambda-sh 2 --lr-means 3"));
        assert_eq!(left, words("--scale-schedule --gate off"));
        assert!(sets(&all, "low-stage") && !sets(&all, "set") && !sets(&all, "off"));
        assert_eq!(without(&all, &[]), all);
    }
}
