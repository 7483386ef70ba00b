//! What the metrics of finished runs say together.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use super::differences::{about_lpips, differences, keys};
use super::plan::{Run, Size};
use crate::eval::Metrics;
use crate::numbers::fraction;

/// A run with what came of it.
#[derive(Clone, Debug)]
pub struct Finished {
    /// The run.
    pub run: Run,
    /// Its metrics.
    pub metrics: Metrics,
    /// Seconds of the whole process.
    pub seconds: f64,
    /// Its settings by key, as `settings.toml` has them.
    pub settings: BTreeMap<String, String>,
    /// Whether its dataset is a synthetic world. Worlds of several seeds are one scene in tables of pictures.
    pub world: bool,
}

impl Finished {
    /// Whether its training lowered distances of the features that LPIPS is made of.
    pub(super) fn lowers_lpips(&self) -> bool {
        let weight = self.settings.get("lambda-perceptual").and_then(|value| value.parse::<f64>().ok());
        weight.is_some_and(|weight| weight > 0.0)
    }
}

/// Mean and range over the seeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Lowest.
    pub low: f64,
    /// Highest.
    pub high: f64,
}

/// A scene and a label over all seeds.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Name of the scene.
    pub scene: String,
    /// Method or ablation.
    pub label: String,
    /// Splats that were allowed.
    pub size: Size,
    /// Number of seeds.
    pub seeds: usize,
    /// PSNR of what is seen, PSNR, SSIM, LPIPS, GMSD, psnr_cc, psnr_hf, PSNR and SSIM of photographs trained on, splats,
    /// first splats, bytes and seconds. `None` where no run has the number.
    pub values: Vec<Option<Spread>>,
}

/// A number of a run.
pub(super) type Number = fn(&Finished) -> Option<f64>;

/// The columns of the table: heading, name in the CSV file, digits after the point, and the number.
pub(super) const COLUMNS: [(&str, &str, usize, Number); 13] = [
    ("PSNR of what is seen", "psnr_seen", 2, |f| f.metrics.psnr_seen),
    ("PSNR", "psnr", 2, |f| f.metrics.psnr),
    ("SSIM", "ssim", 4, |f| f.metrics.ssim),
    ("LPIPS (SqueezeNet)", "lpips", 4, |f| f.metrics.lpips_squeeze),
    ("GMSD", "gmsd", 4, |f| f.metrics.gmsd),
    ("psnr_cc", "psnr_cc", 2, |f| f.metrics.psnr_cc),
    ("psnr_hf", "psnr_hf", 2, |f| f.metrics.psnr_high_frequency),
    ("PSNR, trained on", "psnr_training", 2, |f| f.metrics.psnr_training),
    ("SSIM, trained on", "ssim_training", 4, |f| f.metrics.ssim_training),
    ("splats", "splats", 0, |f| Some(f.metrics.splats as f64)),
    ("first splats", "first_splats", 0, |f| f.metrics.first_splats.map(|n| n as f64)),
    ("bytes", "bytes", 0, |f| Some(f.metrics.bytes as f64)),
    ("seconds", "seconds", 0, |f| Some(f.seconds)),
];

/// Settings that a reader of a table asks for first. What has another name, or is not there, is left out.
const TOLD: [&str; 14] = [
    "preset",
    "iterations",
    "max-side",
    "split",
    "scale-schedule",
    "exposure",
    "start",
    "housekeeping",
    "max-splats",
    "init",
    "depth-prior",
    "stereo-splats",
    "stereo-skirt",
    "lambda-perceptual",
];

impl Spread {
    fn of(values: &[f64]) -> Option<Self> {
        let n = values.len() as f64;
        (!values.is_empty()).then(|| Self {
            mean: values.iter().sum::<f64>() / n,
            low: values.iter().copied().fold(f64::INFINITY, f64::min),
            high: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        })
    }

    fn shown(&self, digits: usize, seeds: usize) -> String {
        match seeds {
            1 => fraction(self.mean, digits),
            _ => {
                let [mean, low, high] = [self.mean, self.low, self.high].map(|value| fraction(value, digits));
                format!("{mean} ({low} to {high})")
            }
        }
    }
}

/// One for each scene, label and size, in the order of their first run.
pub fn summaries(finished: &[Finished]) -> Vec<Summary> {
    let mut groups: Vec<(&Run, Vec<&Finished>)> = Vec::new();
    for one in finished {
        let same = |run: &Run| (&run.scene, &run.label, run.size) == (&one.run.scene, &one.run.label, one.run.size);
        match groups.iter_mut().find(|(run, _)| same(run)) {
            Some((_, all)) => all.push(one),
            None => groups.push((&one.run, vec![one])),
        }
    }
    let summary = |(run, all): (&Run, Vec<&Finished>)| Summary {
        scene: run.scene.clone(),
        label: run.label.clone(),
        size: run.size,
        seeds: all.len(),
        values: COLUMNS
            .iter()
            .map(|(.., number)| Spread::of(&all.iter().filter_map(|f| number(f)).collect::<Vec<_>>()))
            .collect(),
    };
    groups.into_iter().map(summary).collect()
}

/// The tables as Markdown: each scene and method, and the differences, with captions.
pub fn markdown(finished: &[Finished]) -> String {
    let all: Vec<&Finished> = finished.iter().collect();
    let mut out = String::from("| scene | method | seeds |");
    for (name, ..) in COLUMNS {
        let _ = write!(out, " {name} |");
    }
    out += "\n|---|---|---|";
    out += &"---|".repeat(COLUMNS.len());
    out.push('\n');
    for s in summaries(finished) {
        let _ = write!(out, "| {} | {} | {} |", cell(&s.scene), labelled(finished, &s), s.seeds);
        for ((_, _, digits, _), value) in COLUMNS.iter().zip(&s.values) {
            let _ = write!(out, " {} |", value.map_or(String::new(), |v| v.shown(*digits, s.seeds)));
        }
        out.push('\n');
    }
    out += &format!(
        "\nOne row per scene and method: the mean over its seeds, in parentheses the lowest and the highest. {}\n{}",
        shared(&all),
        about_lpips(&all)
    );
    out + &geometry(finished) + &differences(finished)
}

/// The label of a row, with its limit of splats, and a dagger where its training lowered LPIPS by design.
fn labelled(finished: &[Finished], s: &Summary) -> String {
    let size = if let Size::Percent(share) = s.size { format!(", {share} % of 3dgs") } else { String::new() };
    let dagger = finished.iter().any(|f| f.run.label == s.label && f.lowers_lpips());
    format!("{}{size}{}", cell(&s.label), if dagger { "\u{2020}" } else { "" })
}

/// Geometry metrics of the scenes that have some.
fn geometry(finished: &[Finished]) -> String {
    let names = geometry_keys(finished);
    if names.is_empty() {
        return String::new();
    }
    let mut out = String::from("\n| scene | method | seeds |");
    names.iter().for_each(|name| out += &format!(" {} |", cell(name)));
    out += &format!("\n|---|---|---|{}\n", "---|".repeat(names.len()));
    for s in summaries(finished) {
        let same = |f: &&Finished| (&f.run.scene, &f.run.label, f.run.size) == (&s.scene, &s.label, s.size);
        let runs: Vec<BTreeMap<String, f64>> = finished.iter().filter(same).map(keys).collect();
        if runs.iter().all(BTreeMap::is_empty) {
            continue;
        }
        let _ = write!(out, "| {} | {} | {} |", cell(&s.scene), labelled(finished, &s), s.seeds);
        for name in &names {
            let spread = Spread::of(&runs.iter().filter_map(|run| run.get(name).copied()).collect::<Vec<_>>());
            let _ = write!(out, " {} |", spread.map_or(String::new(), |v| fraction(v.mean, 4)));
        }
        out.push('\n');
    }
    out + "\nGeometry against the truth, means over the seeds; depths also against reconstructed points and stereo.\n"
}

/// All geometry metrics that some run has.
fn geometry_keys(finished: &[Finished]) -> Vec<String> {
    let names: BTreeSet<String> = finished.iter().flat_map(|f| keys(f).into_keys()).collect();
    names.into_iter().collect()
}

/// Which of the settings that matter all rows share, and what the others are.
pub(super) fn shared(finished: &[&Finished]) -> String {
    let (mut same, mut different) = (Vec::new(), Vec::new());
    for key in TOLD {
        let mut values: BTreeMap<Option<&String>, Vec<&str>> = BTreeMap::new();
        for f in finished {
            // A limit of splats that the table names is none of the row's settings.
            let limited = key == "max-splats" && f.run.size != Size::Own;
            let rows = values.entry(f.settings.get(key).filter(|_| !limited)).or_default();
            if !rows.contains(&f.run.label.as_str()) {
                rows.push(&f.run.label);
            }
        }
        match values.first_key_value() {
            Some((Some(value), _)) if values.len() == 1 => same.push(format!("{key} {value}")),
            _ if values.len() > 1 => different.push(by_row(key, values)),
            _ => {}
        }
    }
    let told = |what: &str, list: String| if list.is_empty() { list } else { format!("{what}: {list}. ") };
    let text = told("All rows share", same.join(", ")) + &told("Rows differ in", different.join("; "));
    text.trim_end().to_owned()
}

/// The values of a setting with the rows that have them. What most rows have comes last, without their names.
fn by_row(key: &str, values: BTreeMap<Option<&String>, Vec<&str>>) -> String {
    let word = |value: Option<&String>| value.map_or_else(|| "none".to_owned(), Clone::clone);
    let mut values: Vec<_> = values.into_iter().rev().collect();
    values.sort_by_key(|(_, rows)| rows.len());
    let most = values.pop().map_or_else(String::new, |(value, _)| word(value));
    let named = |(value, rows): (Option<&String>, Vec<&str>)| {
        let rows: Vec<String> = rows.into_iter().map(cell).collect();
        format!("{} ({})", word(value), rows.join(", "))
    };
    let named: Vec<String> = values.into_iter().map(named).collect();
    format!("{key} {}, else {most}", named.join(", "))
}

/// A name as text in a cell of a Markdown table: nothing in it is markup, and it stays in its line.
pub(super) fn cell(name: &str) -> String {
    let mut out = String::with_capacity(name.len());
    for c in name.chars() {
        match c {
            '|' | '`' | '*' | '_' | '\\' | '[' | ']' | '<' | '>' => out.extend(['\\', c]),
            c if c.is_control() || matches!(c, '\u{2028}' | '\u{2029}') => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// A name as a field of a CSV file (RFC 4180).
fn quoted(name: &str) -> String {
    match name.contains(['"', ',', '\n', '\r']) {
        true => format!("\"{}\"", name.replace('"', "\"\"")),
        false => name.to_owned(),
    }
}

/// A line per run.
pub fn csv(finished: &[Finished]) -> String {
    let geometry = geometry_keys(finished);
    let mut out = String::from("scene,method,percent_of_3dgs,seed");
    for name in COLUMNS.iter().map(|(_, name, ..)| *name).chain(geometry.iter().map(String::as_str)) {
        let _ = write!(out, ",{name}");
    }
    out.push('\n');
    for f in finished {
        let percent = if let Size::Percent(share) = f.run.size { share.to_string() } else { String::new() };
        let (scene, label) = (quoted(&f.run.scene), quoted(&f.run.label));
        let _ = write!(out, "{scene},{label},{percent},{}", f.run.seed);
        let known = keys(f);
        let numbers = COLUMNS.iter().map(|(.., number)| number(f));
        for number in numbers.chain(geometry.iter().map(|name| known.get(name).copied())) {
            let _ = write!(out, ",{}", number.map_or(String::new(), |v| v.to_string()));
        }
        out.push('\n');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finished(scene: &str, label: &str, seed: u64, psnr: f64, splats: usize) -> Finished {
        let run = Run {
            scene: scene.into(),
            data: scene.into(),
            label: label.into(),
            row: label.into(),
            method: label.split("-no-").next().unwrap().into(),
            options: Vec::new(),
            seed,
            size: Size::Own,
        };
        let text = format!(
            r#"{{"method": "{label}", "iterations": 1, "scene": "{scene}", "train_images": 1, "test_images": 1, "width": 8, "height": 8,
                "seed": {seed}, "device": "none", "psnr": {psnr}, "psnr_seen": {psnr}, "ssim": 0.5, "splats": {splats}, "bytes": 1,
                "seconds": 2.0, "seconds_per_iteration": 0.1, "peak_device_bytes": 1, "peak_host_bytes": null, "images": []}}"#
        );
        let settings = BTreeMap::from([("iterations".to_owned(), "1".to_owned())]);
        Finished { run, metrics: serde_json::from_str(&text).unwrap(), seconds: 3.0, settings, world: false }
    }

    #[test]
    fn names_stay_in_their_cells() {
        let mut all = [finished("a", "3dgs", 0, 20.0, 1), finished("a", "lean", 0, 20.0, 1)];
        all[0].run.scene = "a|b\n`c`".into();
        all[1].run.scene = "a, \"b\"\nc".into();
        let text = markdown(&all);
        assert!(text.contains("| a\\|b \\`c\\` | 3dgs | 1 |"), "{text}");
        let csv = csv(&all);
        assert!(csv.contains("\n\"a|b\n`c`\",3dgs,") && csv.contains("\n\"a, \"\"b\"\"\nc\",lean,"), "{csv}");
    }

    #[test]
    fn one_scene_has_no_interval() {
        let all = [finished("a", "3dgs", 0, 20.0, 100), finished("a", "lean", 0, 21.0, 50)];
        let text = markdown(&all);
        assert!(text.contains("| lean | +1.00 | +1.00 | +0.0000 |  | -50.0 % | +0.0 % |"), "{text}");
        assert!(text.contains("n = 1.") && text.contains("All rows share: iterations 1."), "{text}");
    }

    /// Scene a is 1 dB better, the mean of its seeds, and scene b 3: mean 2, half-width 12.706 x 1. Splats are a half
    /// and a quarter: the geometric mean is 1 / sqrt 8.
    #[test]
    fn the_scene_is_the_unit_and_its_seeds_are_averaged() {
        let all = [
            finished("a", "3dgs", 0, 20.0, 100),
            finished("a", "3dgs", 1, 21.0, 100),
            finished("b", "3dgs", 0, 30.0, 400),
            finished("a", "lean", 0, 20.5, 50),
            finished("a", "lean", 1, 22.5, 50),
            finished("b", "lean", 0, 33.0, 100),
            finished("b", "lean", 7, 99.0, 1),
        ];
        let text = markdown(&all);
        assert!(text.contains("| a | 3dgs | 2 | 20.50 (20.00 to 21.00) |"), "{text}");
        let cell = "| lean | +2.00 [-10.71, +14.71]; 2 of 2 |";
        assert!(text.contains(cell), "{text}");
        let half = 12.706_204_736 * 0.5 * 2.0_f64.ln();
        let of = |sign: f64| 100.0 * (sign.mul_add(half, -1.5 * 2.0_f64.ln()).exp() - 1.0);
        let splats = format!("| -64.6 [{:+.1}, {:+.1}] %; 2 of 2 |", of(-1.0), of(1.0));
        assert!(text.contains(&splats), "{splats} in {text}");
        assert!(text.contains("| +0.0000 [+0.0000, +0.0000]; 0 of 2 |"), "equal SSIM: {text}");
        // Seeds of a: deviations 0.5 of 3dgs twice, 1 of lean twice; of b with lean 33 and 99 33 each.
        let deviation = ((2.0 * 0.25 + 2.0 + 2.0 * 33.0_f64.powi(2)) / 3.0).sqrt();
        assert!(text.contains(&format!("of 3 rows: {deviation:.2} of PSNR of what is seen")), "{text}");
        assert_eq!(csv(&all).lines().count(), 8);
        assert_eq!(summaries(&all).len(), 4);
    }

    /// Two worlds that are 1 and 3 dB better are one unit of 2, beside a scene of 2; of depth they are two units.
    #[test]
    fn worlds_are_one_unit_of_pictures_and_several_of_geometry() {
        let mut all = Vec::new();
        for (scene, better, world) in [("world", 1.0, true), ("world-1", 3.0, true), ("fox", 2.0, false)] {
            for (label, psnr, error) in [("psrgs", 20.0 + better, 0.01), ("3dgs", 20.0, 0.02)] {
                let mut one = finished(scene, label, 0, psnr, 10);
                one.world = world;
                one.metrics.geometry.depth_median_error = world.then_some(error);
                one.metrics.geometry.floaters = (scene == "world").then_some(0.1);
                all.push(one);
            }
        }
        let text = markdown(&all);
        assert!(text.contains("Against 3dgs:"), "the base is 3dgs, first or not: {text}");
        assert!(text.contains("| psrgs | +2.00 [+2.00, +2.00] *; 2 of 2 |"), "{text}");
        assert!(text.contains("n = 2, of which 2 worlds are one."), "{text}");
        let geometry = "| method | depth\\_median\\_error |\n|---|---|\n| psrgs | -50.0 [-50.0, -50.0] % *; 2 of 2 |\n";
        assert!(text.contains(geometry), "what only some have is left out: {text}");
        assert!(text.contains("each world for itself: n = 2."), "{text}");
        let csv = csv(&all);
        assert!(csv.lines().next().is_some_and(|line| line.ends_with(",seconds,depth_median_error,floaters")), "{csv}");
    }

    /// Depths by points of a world and of two scenes: the scenes alone are units.
    #[test]
    fn judged_depths_are_compared_over_real_scenes() {
        let mut all = Vec::new();
        for (scene, world) in [("world", true), ("fox", false), ("copr", false)] {
            for (label, error) in [("psrgs", 0.01), ("3dgs", 0.02)] {
                let mut one = finished(scene, label, 0, 20.0, 10);
                one.world = world;
                one.metrics.geometry.depth_points_error = Some(if world { 0.3 } else { error });
                one.metrics.geometry.depth_median_error = world.then_some(error);
                all.push(one);
            }
        }
        let text = markdown(&all);
        let points = "| method | depth\\_points\\_error |\n|---|---|\n| psrgs | -50.0 [-50.0, -50.0] % *; 2 of 2 |\n";
        assert!(text.contains(points) && text.contains("no world: n = 2."), "{text}");
        let truth = "| method | depth\\_median\\_error |\n|---|---|\n| psrgs | -50.0 % |\n";
        assert!(text.contains(truth) && text.contains("each world for itself: n = 1."), "{text}");
    }

    #[test]
    fn rows_trained_on_what_lpips_measures_are_marked() {
        let mut all = [finished("a", "3dgs", 0, 20.0, 100), finished("a", "psrgs", 0, 21.0, 50)];
        assert!(!markdown(&all).contains('\u{2020}') && !markdown(&all).contains("VGG"));
        all[0].settings.insert("lambda-perceptual".into(), "0.0".into());
        all[1].settings.insert("lambda-perceptual".into(), "0.03".into());
        all.iter_mut().for_each(|f| f.metrics.lpips_squeeze = Some(0.1));
        let text = markdown(&all);
        assert!(text.contains("| a | psrgs\u{2020} | 1 |") && text.contains("\n| psrgs\u{2020} | +1.00 |"), "{text}");
        assert!(text.contains("\u{2020} Training lowered") && text.contains("VGG"), "{text}");
        assert!(
            text.contains("Rows differ in: lambda-perceptual 0.03 (psrgs), else 0.0.")
                && !text.contains("3dgs\u{2020}"),
            "{text}"
        );
    }

    /// Three scenes. Without smoothness the depth error is larger by factors e^0.9, e^1 and e^1.1: t is 1 / (0.1 / sqrt
    /// 3), and p = 1 - t / sqrt(2 + t^2) = 0.0033. Without flattening by e^0.5, e^1 and e^1.5: p = 0.0742. Holm's
    /// correction over two gives 0.0066 and 0.0742.
    #[test]
    fn a_part_pays_where_its_own_metric_tells_so_after_holm() {
        let mut all = Vec::new();
        for (scene, smooth, flat) in [("a", 0.9, 0.5), ("b", 1.0, 1.0), ("c", 1.1, 1.5_f64)] {
            for (label, log) in [("psrgs", 0.0), ("psrgs-no-smoothness", smooth), ("psrgs-no-flattening", flat)] {
                let mut one = finished(scene, label, 0, 20.0, 100);
                one.metrics.geometry.depth_median_error = Some(0.01 * f64::exp(log));
                all.push(one);
            }
        }
        let text = markdown(&all);
        let row =
            |name: &str| text.lines().filter(|l| l.contains(name)).find(|l| l.contains("lower is better")).unwrap();
        assert!(row("smoothness").ends_with("| 0.003 | 0.007 | pays |"), "{text}");
        assert!(row("flattening").ends_with("| 0.074 | 0.074 | not told |"), "{text}");
        // Fewer splats without the part are a cost, and a lower error is no reason for it.
        all.iter_mut().filter(|f| f.run.label.ends_with("smoothness")).for_each(|f| f.metrics.splats = 80);
        let costly = markdown(&all);
        assert!(costly.contains("| 0.007 | pays, but costs 25 % of splats |"), "{costly}");
        for f in all.iter_mut().filter(|f| f.run.label.ends_with("smoothness")) {
            f.metrics.geometry.depth_median_error = f.metrics.geometry.depth_median_error.map(|e| 0.0001 / e);
        }
        assert!(markdown(&all).contains("| 0.007 | better without |"));
    }
}
