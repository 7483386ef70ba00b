//! Paired differences between the rows of a comparison, with the scene as the unit.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use super::interval::{holm, paired};
use super::plan::{ABLATIONS, Primary, Size};
use super::table::{Finished, Number, cell};
use crate::numbers::{counted, signed};

/// The unit that worlds are in tables of pictures.
const WORLDS: &str = "worlds";
/// A probability below this tells a difference.
const SURE: f64 = 0.05;
/// How much worse another metric may be for a part that pays: decibels, LPIPS and splats.
const ALLOWED: [(Measure, f64, &str); 3] = [(PSNR_SEEN, 0.1, "PSNR"), (LPIPS, 2.0, "LPIPS"), (SPLATS, 5.0, "splats")];

/// How two numbers are compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    /// One less the other, with so many digits.
    Plain(usize),
    /// One less the other, of shares, in points of a percent.
    Points,
    /// One divided by the other, in percent.
    Ratio,
}

/// A number of runs that rows are compared by.
#[derive(Clone, Copy)]
pub(super) struct Measure {
    name: &'static str,
    kind: Kind,
    more_is_better: bool,
    /// Whether a world is a unit of its own.
    of_geometry: bool,
    number: Number,
}

const PSNR_SEEN: Measure = Measure {
    name: "PSNR of what is seen, dB",
    kind: Kind::Plain(2),
    more_is_better: true,
    of_geometry: false,
    number: |f| f.metrics.psnr_seen,
};
const LPIPS: Measure = Measure {
    name: "LPIPS (SqueezeNet)",
    kind: Kind::Ratio,
    more_is_better: false,
    of_geometry: false,
    number: |f| f.metrics.lpips_squeeze,
};
const SPLATS: Measure = Measure {
    name: "splats",
    kind: Kind::Ratio,
    more_is_better: false,
    of_geometry: false,
    number: |f| Some(f.metrics.splats as f64),
};
const DEPTH_ERROR: Measure = Measure {
    name: "median depth error",
    kind: Kind::Ratio,
    more_is_better: false,
    of_geometry: true,
    number: |f| f.metrics.geometry.depth_median_error,
};
/// The columns of a table of differences.
const MEASURES: [Measure; 6] = [
    PSNR_SEEN,
    Measure { name: "PSNR, dB", number: |f| f.metrics.psnr, ..PSNR_SEEN },
    Measure { name: "SSIM", kind: Kind::Plain(4), number: |f| f.metrics.ssim, ..PSNR_SEEN },
    LPIPS,
    SPLATS,
    Measure { name: "seconds", number: |f| Some(f.seconds), ..SPLATS },
];

impl Primary {
    fn measure(self) -> Measure {
        match self {
            Self::PsnrSeenUp => PSNR_SEEN,
            Self::DepthErrorDown => DEPTH_ERROR,
            Self::SplatsDown => SPLATS,
            Self::LpipsDown => LPIPS,
        }
    }
}

/// All tables of differences, with a caption under each.
pub(super) fn differences(finished: &[Finished]) -> String {
    let sizes: BTreeSet<Size> = finished.iter().map(|f| f.run.size).collect();
    let mut out = String::new();
    for size in sizes {
        // 3dgs has all of its own splats.
        let whole = |f: &Finished| size == Size::Percent(100) && f.run.size == Size::Own && f.run.label == "3dgs";
        let of_size: Vec<&Finished> = finished.iter().filter(|f| f.run.size == size || whole(f)).collect();
        let labels = labels(&of_size);
        let Some(base) = labels.iter().find(|label| **label == "3dgs").or(labels.first()).copied() else { continue };
        let others: Vec<&str> = labels.into_iter().filter(|label| *label != base).collect();
        if others.is_empty() {
            continue;
        }
        let limit =
            if let Size::Percent(share) = size { format!(", {share} % of the splats of 3dgs") } else { String::new() };
        let title = format!("Against {}{limit}", cell(base));
        out += &pictures(&of_size, base, &others, &title);
        out += &geometry(&of_size, base, &others, &title);
        out += &judged(&of_size, base, &others, &title);
        if size == Size::Own {
            out += &parts(&of_size, &others);
            out += &noise(&of_size);
        }
    }
    out
}

/// Labels in the order of their first run.
fn labels<'a>(finished: &[&'a Finished]) -> Vec<&'a str> {
    let mut labels: Vec<&str> = Vec::new();
    for f in finished {
        if !labels.contains(&f.run.label.as_str()) {
            labels.push(&f.run.label);
        }
    }
    labels
}

/// Differences of what held-out photographs show, and of cost.
fn pictures(finished: &[&Finished], base: &str, others: &[&str], title: &str) -> String {
    let mut out = format!("\n{title}:\n\n| method |");
    MEASURES.iter().for_each(|measure| out += &format!(" {} |", measure.name));
    out += &format!("\n|---|{}\n", "---|".repeat(MEASURES.len()));
    for label in others {
        out += &format!("| {} |", marked(finished, label));
        for measure in &MEASURES {
            out += &format!(" {} |", shown(&by_unit(finished, label, base, measure, measure.number), measure));
        }
        out.push('\n');
    }
    let worlds = scenes(finished, |f| f.world);
    let mut all = scenes(finished, |f| !f.world);
    if !worlds.is_empty() {
        all.push(WORLDS);
    }
    let mut units = format!("The unit is the scene: n = {}", all.len());
    if worlds.len() > 1 {
        let _ = write!(units, ", of which {} are one", counted(worlds.len(), "world"));
    }
    out + &caption(&units, base, finished) + &about_lpips(finished)
}

/// Differences of the geometry metrics that all runs of scenes with a ground truth have.
fn geometry(finished: &[&Finished], base: &str, others: &[&str], title: &str) -> String {
    let against_truth = |f: &Finished| -> Vec<String> { keys(f).into_keys().filter(|name| !is_judged(name)).collect() };
    let known = scenes(finished, |f| !against_truth(f).is_empty());
    let units = format!("The unit is the scene with a known geometry, each world for itself: n = {}", known.len());
    let of_units: Vec<&Finished> = finished.iter().copied().filter(|f| known.contains(&f.run.scene.as_str())).collect();
    geometry_of(&of_units, against_truth, [base, &format!("{title}, geometry"), &units], others)
}

/// Differences of the depths of real scenes as reconstructed points and stereo judge them.
fn judged(finished: &[&Finished], base: &str, others: &[&str], title: &str) -> String {
    let by_judges = |f: &Finished| -> Vec<String> { keys(f).into_keys().filter(|name| is_judged(name)).collect() };
    let known = scenes(finished, |f| !f.world && !by_judges(f).is_empty());
    let of_units: Vec<&Finished> = finished.iter().copied().filter(|f| known.contains(&f.run.scene.as_str())).collect();
    let table = format!("{title}, depths by reconstructed points and by stereo of the held-out photographs");
    let units = format!("The unit is the scene that is no world: n = {}", known.len());
    geometry_of(&of_units, by_judges, [base, &table, &units], others)
}

/// Whether points or stereo judge a depth, which says nothing of the truth.
fn is_judged(name: &str) -> bool {
    name.starts_with("depth_points") || name.starts_with("depth_stereo")
}

/// Differences of the metrics that all runs have. `texts`: the base, the title of the table, and what its unit is.
fn geometry_of(
    finished: &[&Finished],
    names: impl Fn(&Finished) -> Vec<String>,
    [base, title, units]: [&str; 3],
    others: &[&str],
) -> String {
    let mut names = finished.first().map(|f| names(f)).unwrap_or_default();
    names.retain(|name| finished.iter().all(|f| keys(f).contains_key(name)));
    if names.is_empty() {
        return String::new();
    }
    let mut out = format!("\n{title}:\n\n| method |");
    names.iter().for_each(|name| out += &format!(" {} |", cell(name)));
    out += &format!("\n|---|{}\n", "---|".repeat(names.len()));
    for label in others {
        out += &format!("| {} |", marked(finished, label));
        for name in &names {
            let measure = of_geometry(name);
            let each = by_unit(finished, label, base, &measure, |f| keys(f).get(name).copied());
            out += &format!(" {} |", shown(&each, &measure));
        }
        out.push('\n');
    }
    out + &caption(units, base, finished) + "Pairs of which one number is 0 have no ratio and are left out.\n"
}

/// How a geometry metric of this name is compared.
fn of_geometry(name: &str) -> Measure {
    let share = name.contains("within") || name.contains("coverage");
    let kind = match (name.starts_with("psnr"), share) {
        (true, _) => Kind::Plain(2),
        (_, true) => Kind::Points,
        _ => Kind::Ratio,
    };
    Measure { kind, more_is_better: kind != Kind::Ratio, ..DEPTH_ERROR }
}

/// The geometry metrics of a run by their keys.
pub(super) fn keys(f: &Finished) -> BTreeMap<String, f64> {
    let written = serde_json::to_value(f.metrics.geometry).unwrap_or_default();
    let number = |(key, value): (&String, &serde_json::Value)| Some((key.clone(), value.as_f64()?));
    written.as_object().into_iter().flatten().filter_map(number).collect()
}

/// What leaving out or replacing a part does to the metric that was named for it beforehand, after Holm's correction.
fn parts(finished: &[&Finished], labels: &[&str]) -> String {
    let part = |label: &&str| {
        let run = &finished.iter().find(|f| f.run.label == **label)?.run;
        let name = label.strip_prefix(run.method.as_str())?.strip_prefix('-')?;
        let primary = ABLATIONS.iter().find(|ablation| ablation.name == name)?.primary;
        let measure = primary.measure();
        let each = by_unit(finished, label, &run.method, &measure, measure.number);
        Some((label.to_string(), run.method.clone(), measure, each))
    };
    let rows: Vec<_> = labels.iter().filter_map(part).collect();
    if rows.is_empty() {
        return String::new();
    }
    let p: Vec<f64> = rows.iter().map(|(.., each)| paired(each).map_or(1.0, |d| d.p)).collect();
    let mut out = String::from(
        "\nParts, each by the metric that was named for it beforehand:\n\n| without the part | metric | difference | p | \
         p after Holm | verdict |\n|---|---|---|---|---|---|\n",
    );
    for (((label, method, measure, each), p), corrected) in rows.iter().zip(&p).zip(holm(&p)) {
        let direction = if measure.more_is_better { "higher" } else { "lower" };
        let mean = paired(each).map_or(0.0, |d| d.mean);
        let worse_without = (mean < 0.0) == measure.more_is_better;
        let costs = costs(finished, label, method, measure);
        let verdict = match (corrected < SURE, worse_without) {
            (false, _) => "not told".to_owned(),
            (true, false) => "better without".to_owned(),
            (true, true) if costs.is_empty() => "pays".to_owned(),
            (true, true) => format!("pays, but costs {}", costs.join(", ")),
        };
        let _ = writeln!(
            out,
            "| {} | {}, {direction} is better | {} | {p:.3} | {corrected:.3} | {verdict} |",
            cell(label),
            measure.name,
            shown(each, measure)
        );
    }
    out + "\nDifferences are those of the row without the part, or with another in its place, from the whole method. A \
           part pays where the metric is worse without, and p after Holm's correction over all rows of this table is \
           below 0.05. A cost is more than 0.1 dB of PSNR of what is seen, 2 % of LPIPS or 5 % of splats by which the row \
           without is better in the mean. Brackets, stars, units and what rows share are those of the tables above.\n"
}

/// What is better without a part by more than is allowed.
fn costs(finished: &[&Finished], label: &str, method: &str, primary: &Measure) -> Vec<String> {
    let cost = |(measure, allowed, name): &(Measure, f64, &str)| {
        let mean = paired(&by_unit(finished, label, method, measure, measure.number))?.mean;
        let (cost, unit) = match measure.kind {
            Kind::Ratio => (100.0 * ((-mean).exp() - 1.0), "%"),
            _ => (mean, "dB"),
        };
        let sought = measure.name != primary.name && cost > *allowed;
        sought.then(|| format!("{cost:.*} {unit} of {name}", if unit == "dB" { 2 } else { 0 }))
    };
    ALLOWED.iter().filter_map(cost).collect()
}

/// How far seeds of one scene and method lie apart.
fn noise(finished: &[&Finished]) -> String {
    let mut groups: BTreeMap<(&str, &str), Vec<&Finished>> = BTreeMap::new();
    for f in finished {
        groups.entry((&f.run.scene, &f.run.label)).or_default().push(f);
    }
    groups.retain(|_, runs| runs.len() > 1);
    let spread = |measure: &Measure| {
        let (mut squares, mut degrees) = (0.0, 0_usize);
        for runs in groups.values() {
            let number = |f: &&Finished| (measure.number)(f).map(|v| scaled(v, measure)).filter(|v| v.is_finite());
            let values: Vec<f64> = runs.iter().filter_map(number).collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            squares += values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
            degrees += values.len().saturating_sub(1);
        }
        let deviation = (degrees > 0).then(|| (squares / degrees as f64).sqrt())?;
        Some(match measure.kind {
            Kind::Ratio => format!("{:.1} % of {}", 100.0 * deviation, measure.name),
            Kind::Plain(digits) => format!("{deviation:.digits$} of {}", measure.name),
            Kind::Points => format!("{:.1} points of {}", 100.0 * deviation, measure.name),
        })
    };
    let told: Vec<String> = MEASURES.iter().filter_map(spread).collect();
    if groups.is_empty() || told.is_empty() {
        return String::new();
    }
    format!(
        "\nSeeds tell noise alone. Standard deviation over the seeds of one scene and method, of {}: {}.\n",
        counted(groups.len(), "row"),
        told.join("; ")
    )
}

/// The number as it is averaged.
fn scaled(value: f64, measure: &Measure) -> f64 {
    if measure.kind == Kind::Ratio { value.ln() } else { value }
}

/// For each unit the mean difference of one label from another: over the seeds of a scene that both have, then over the
/// scenes of the unit.
fn by_unit(
    finished: &[&Finished],
    label: &str,
    base: &str,
    measure: &Measure,
    number: impl Fn(&Finished) -> Option<f64>,
) -> Vec<f64> {
    let mut units: Vec<(&str, Vec<f64>)> = Vec::new();
    for scene in scenes(finished, |_| true) {
        let of = |label: &str| -> BTreeMap<u64, f64> {
            let of_label = finished.iter().filter(|f| f.run.scene == scene && f.run.label == label);
            of_label.filter_map(|f| Some((f.run.seed, scaled(number(f)?, measure)))).collect()
        };
        let others = of(base);
        let pairs = of(label).into_iter().filter_map(|(seed, value)| Some(value - others.get(&seed)?));
        let pairs: Vec<f64> = pairs.filter(|d| d.is_finite()).collect();
        if pairs.is_empty() {
            continue;
        }
        let mean = pairs.iter().sum::<f64>() / pairs.len() as f64;
        let is_world = finished.iter().any(|f| f.run.scene == scene && f.world);
        let unit = if is_world && !measure.of_geometry { WORLDS } else { scene };
        match units.iter_mut().find(|(name, _)| *name == unit) {
            Some((_, scenes)) => scenes.push(mean),
            None => units.push((unit, vec![mean])),
        }
    }
    units.into_iter().map(|(_, scenes)| scenes.iter().sum::<f64>() / scenes.len() as f64).collect()
}

/// Scenes in the order of their first run.
fn scenes<'a>(finished: &[&'a Finished], wanted: impl Fn(&Finished) -> bool) -> Vec<&'a str> {
    let mut scenes: Vec<&str> = Vec::new();
    for f in finished.iter().filter(|f| wanted(f)) {
        if !scenes.contains(&f.run.scene.as_str()) {
            scenes.push(&f.run.scene);
        }
    }
    scenes
}

/// The mean with its interval, and on how many units it is better.
fn shown(differences: &[f64], measure: &Measure) -> String {
    let Some(d) = paired(differences) else { return String::new() };
    let number = |v: f64| match measure.kind {
        Kind::Plain(digits) => signed(v, digits),
        Kind::Points => signed(100.0 * v, 1),
        Kind::Ratio => signed(100.0 * (v.exp() - 1.0), 1),
    };
    let unit = match measure.kind {
        Kind::Plain(_) => "",
        Kind::Points => " points",
        Kind::Ratio => " %",
    };
    if d.pairs == 1 {
        return format!("{}{unit}", number(d.mean));
    }
    let better = differences.iter().filter(|v| (**v > 0.0) == measure.more_is_better && **v != 0.0).count();
    format!(
        "{} [{}, {}]{unit}{}; {better} of {}",
        number(d.mean),
        number(d.mean - d.half),
        number(d.mean + d.half),
        if d.is_real() { " *" } else { "" },
        d.pairs
    )
}

/// A label, with a dagger where trainings lowered distances of SqueezeNet's features.
fn marked(finished: &[&Finished], label: &str) -> String {
    let dagger = if finished.iter().any(|f| f.run.label == label && f.lowers_lpips()) { "\u{2020}" } else { "" };
    format!("{}{dagger}", cell(label))
}

/// What is under a table.
fn caption(units: &str, base: &str, finished: &[&Finished]) -> String {
    format!(
        "\n{units}. Seeds of a scene are averaged first. Numbers are means of the paired differences from {}, in brackets \
         their 95 % intervals by Student's t over the units, with a star where 0 is outside; \u{201c}k of n\u{201d}: better on k \
         of n units. Differences in percent are ratios, averaged as logarithms. {}\n",
        cell(base),
        super::table::shared(finished)
    )
}

/// What is to be said of LPIPS under a table that has it.
pub(super) fn about_lpips(finished: &[&Finished]) -> String {
    let mut out = String::new();
    if finished.iter().any(|f| f.metrics.lpips_squeeze.is_some()) {
        out += "LPIPS (SqueezeNet) does not compare with published figures, which are of VGG or AlexNet.\n";
    }
    if finished.iter().any(|f| f.lowers_lpips()) {
        out += "\u{2020} Training lowered distances of SqueezeNet's features, which LPIPS (SqueezeNet) is made of.\n";
    }
    out
}
