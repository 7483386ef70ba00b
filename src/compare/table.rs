//! What the metrics of finished runs say together.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::interval::paired;
use super::plan::{Run, Size};
use crate::eval::Metrics;
use crate::numbers::{fraction, signed};

/// A run with what came of it.
#[derive(Clone, Debug)]
pub struct Finished {
    /// The run.
    pub run: Run,
    /// Its metrics.
    pub metrics: Metrics,
    /// Seconds of the whole process.
    pub seconds: f64,
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
    /// PSNR, SSIM, LPIPS, GMSD, psnr_cc, psnr_hf, splats, bytes and seconds; none where no run has the number.
    pub values: Vec<Option<Spread>>,
}

/// A number of a run.
type Number = fn(&Finished) -> Option<f64>;

/// The columns of the table: name, digits after the point, the number, and what it is multiplied by.
pub(super) const COLUMNS: [(&str, usize, Number); 9] = [
    ("PSNR", 2, |f| f.metrics.psnr),
    ("SSIM", 4, |f| f.metrics.ssim),
    ("LPIPS", 4, |f| f.metrics.lpips_squeeze),
    ("GMSD", 4, |f| f.metrics.gmsd),
    ("psnr_cc", 2, |f| f.metrics.psnr_cc),
    ("psnr_hf", 2, |f| f.metrics.psnr_high_frequency),
    ("splats", 0, |f| Some(f.metrics.splats as f64)),
    ("bytes", 0, |f| Some(f.metrics.bytes as f64)),
    ("seconds", 0, |f| Some(f.seconds)),
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
            .map(|(_, _, number)| Spread::of(&all.iter().filter_map(|f| number(f)).collect::<Vec<_>>()))
            .collect(),
    };
    groups.into_iter().map(summary).collect()
}

/// The table and the mean differences as Markdown.
pub fn markdown(finished: &[Finished]) -> String {
    let mut out = String::from("| scene | method | seeds |");
    for (name, ..) in COLUMNS {
        let _ = write!(out, " {name} |");
    }
    out += "\n|---|---|---|";
    out += &"---|".repeat(COLUMNS.len());
    out.push('\n');
    for s in summaries(finished) {
        let size = if let Size::Percent(share) = s.size { format!(", {share} % of 3dgs") } else { String::new() };
        let _ = write!(out, "| {} | {}{size} | {} |", cell(&s.scene), cell(&s.label), s.seeds);
        for ((_, digits, _), value) in COLUMNS.iter().zip(&s.values) {
            let _ = write!(out, " {} |", value.map_or(String::new(), |v| v.shown(*digits, s.seeds)));
        }
        out.push('\n');
    }
    out + &differences(finished)
}

/// Every label against the first and, where it is there, against `lean`: over all scenes and seeds that both have.
fn differences(finished: &[Finished]) -> String {
    let own: Vec<&Finished> = finished.iter().filter(|f| f.run.size == Size::Own).collect();
    let mut labels: Vec<&str> = Vec::new();
    for f in &own {
        if !labels.contains(&f.run.label.as_str()) {
            labels.push(&f.run.label);
        }
    }
    let mut bases: Vec<&str> = labels.first().copied().into_iter().collect();
    if labels.contains(&"lean") && bases != ["lean"] {
        bases.push("lean");
    }
    let mut out = String::new();
    for base in bases {
        let _ = write!(
            out,
            "\nAgainst {}: {}.\n\n| method | pairs |",
            cell(base),
            match labels.iter().filter(|label| **label != base).map(|label| pairs(&own, label, base).len()).max() {
                Some(2..) => "mean of the paired differences over scenes and seeds with its 95 % interval",
                _ => "difference of one pair, which has no interval",
            }
        );
        let _ = writeln!(
            out,
            " PSNR | SSIM | LPIPS | GMSD | psnr_hf | splats, ratio | seconds, ratio \
             |\n|---|---|---|---|---|---|---|---|---|"
        );
        for label in labels.iter().filter(|label| **label != base) {
            let pairs = pairs(&own, label, base);
            let _ = write!(out, "| {} | {} |", cell(label), pairs.len());
            for (column, digits) in [(0, 2), (1, 4), (2, 4), (3, 4), (5, 2)] {
                let number = COLUMNS[column].2;
                let each: Vec<f64> = pairs.iter().filter_map(|(a, b)| Some(number(a)? - number(b)?)).collect();
                let _ = write!(out, " {} |", shown(&each, digits));
            }
            let splats = ratio(&pairs, |f| f.metrics.splats as f64);
            let seconds = ratio(&pairs, |f| f.seconds);
            let _ = writeln!(out, " {splats} | {seconds} |");
        }
    }
    out
}

/// Runs of one label with those of another of the same scene and seed.
fn pairs<'a>(own: &[&'a Finished], label: &str, base: &str) -> Vec<(&'a Finished, &'a Finished)> {
    let of = |label: &str| -> BTreeMap<(&'a str, u64), &'a Finished> {
        own.iter().filter(|f| f.run.label == label).map(|f| ((f.run.scene.as_str(), f.run.seed), *f)).collect()
    };
    let others = of(base);
    of(label).into_iter().filter_map(|(key, a)| Some((a, *others.get(&key)?))).collect()
}

fn shown(differences: &[f64], digits: usize) -> String {
    match paired(differences) {
        None => String::new(),
        Some(d) if d.half.is_infinite() => signed(d.mean, digits),
        Some(d) if d.is_real() => format!("{} ± {:.digits$}", signed(d.mean, digits), d.half),
        Some(d) => format!("no difference ({} ± {:.digits$})", signed(d.mean, digits), d.half),
    }
}

/// The geometric mean of the quotients.
fn ratio(pairs: &[(&Finished, &Finished)], number: impl Fn(&Finished) -> f64) -> String {
    let logs: Vec<f64> = pairs.iter().map(|(a, b)| (number(a) / number(b)).ln()).filter(|r| r.is_finite()).collect();
    if logs.is_empty() {
        return String::new();
    }
    format!("{:.2}", (logs.iter().sum::<f64>() / logs.len() as f64).exp())
}

/// A name as text in a cell of a Markdown table: nothing in it is markup, and it stays in its line.
fn cell(name: &str) -> String {
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
    let mut out = String::from("scene,method,percent_of_3dgs,seed");
    for (name, ..) in COLUMNS {
        let _ = write!(out, ",{}", name.to_lowercase());
    }
    out.push('\n');
    for f in finished {
        let percent = if let Size::Percent(share) = f.run.size { share.to_string() } else { String::new() };
        let (scene, label) = (quoted(&f.run.scene), quoted(&f.run.label));
        let _ = write!(out, "{scene},{label},{percent},{}", f.run.seed);
        for (_, _, number) in COLUMNS {
            let _ = write!(out, ",{}", number(f).map_or(String::new(), |v| v.to_string()));
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
            method: label.into(),
            options: Vec::new(),
            seed,
            size: Size::Own,
        };
        let text = format!(
            r#"{{"method": "{label}", "iterations": 1, "scene": "{scene}", "train_images": 1, "test_images": 1, "width": 8, "height": 8,
                "seed": {seed}, "device": "none", "psnr": {psnr}, "ssim": 0.5, "splats": {splats}, "bytes": 1, "seconds": 2.0,
                "seconds_per_iteration": 0.1, "peak_device_bytes": 1, "peak_host_bytes": null, "images": []}}"#
        );
        Finished { run, metrics: serde_json::from_str(&text).unwrap(), seconds: 3.0 }
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
    fn one_pair_has_no_interval() {
        let all = [finished("a", "3dgs", 0, 20.0, 100), finished("a", "lean", 0, 21.0, 50)];
        let text = markdown(&all);
        assert!(text.contains("| lean | 1 | +1.00 |") && !text.contains("95 %"), "{text}");
    }

    #[test]
    fn pairs_are_of_the_same_scene_and_seed() {
        let all = [
            finished("a", "3dgs", 0, 20.0, 100),
            finished("a", "3dgs", 1, 21.0, 100),
            finished("b", "3dgs", 0, 30.0, 400),
            finished("a", "lean", 0, 21.0, 50),
            finished("a", "lean", 1, 22.0, 50),
            finished("b", "lean", 0, 31.0, 200),
            finished("b", "lean", 7, 99.0, 1),
        ];
        let text = markdown(&all);
        assert!(text.contains("| a | 3dgs | 2 | 20.50 (20.00 to 21.00) |"), "{text}");
        // Three pairs, each 1 dB apart, at half the splats; what has no partner is left out.
        assert!(text.contains("| lean | 3 | +1.00 ± 0.00 |"), "{text}");
        assert!(text.contains("| 0.50 | 1.00 |"), "{text}");
        assert!(text.contains("no difference (+0.0000 ± 0.0000)"), "equal SSIM: {text}");
        assert_eq!(csv(&all).lines().count(), 8);
        assert_eq!(summaries(&all).len(), 4);
    }
}
