//! Rows of a comparison: a method without each of its parts.

use clap::{Args as _, Command, FromArgMatches as _};
use psrgs_vk::compare::{ABLATIONS, Ablation, OWN_GRAD_THRESHOLD};
use psrgs_vk::train::Settings;
use psrgs_vk::train::settings::{DepthPrior, LidarCloud, Method};

use crate::cli::asked::Asked;
use crate::cli::exit::Failure;

/// A row: label, method, options.
pub(super) type Row = (String, String, Vec<String>);

/// The whole method, and the method without each of its parts or with a part replaced.
pub(super) fn rows(method: &str) -> anyhow::Result<Vec<Row>> {
    let known: Method = method.parse().map_err(|error| Failure::Usage(format!("--ablate: {error}")))?;
    let whole = Settings::of_method(known);
    let mut rows = vec![(method.to_owned(), method.to_owned(), Vec::new())];
    for ablation in &ABLATIONS {
        let options = options_of(ablation, &whole);
        let changed = with(&whole, &options)?;
        if changed.in_use() != whole.in_use() && can_be_trained(&changed) {
            rows.push((format!("{method}-{}", ablation.name), method.to_owned(), options));
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
        rows(method).expect("rows").into_iter().map(|(label, ..)| label).collect()
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
            for (label, _, options) in rows(name).expect("rows") {
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
        assert!(rows("gsplat").expect_err("no method").to_string().contains("psrgs-paper"));
    }
}
