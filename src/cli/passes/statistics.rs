//! `psrgs-vk passes --statistics`: what the driver tells of the passes of a training.

use psrgs_vk::bench;
use psrgs_vk::vk::{Gpu, OpenOptions, PipelineStatistics};
use serde_json::{Map, Value, json};

use crate::cli::console::{self, table};

/// Columns of the table with the names that drivers give them, in small letters.
const COLUMNS: [(&str, &[&str]); 6] = [
    ("registers", &["register count", "number of gprs", "vgprs", "grf registers"]),
    ("subgroups", &["max warps/sm", "subgroups per simd"]),
    ("spills", &["spills to memory", "spilled vgprs", "spill count"]),
    ("instructions", &["instruction count", "instructions"]),
    ("code, bytes", &["binary size", "code size"]),
    ("shared, bytes", &["shared memory size", "lds size", "workgroup memory size"]),
];

pub(super) fn run(device: Option<&str>, json: bool) -> anyhow::Result<()> {
    let mut options = OpenOptions::from_env()?;
    if let Some(device) = device {
        options.device = Some(device.to_owned());
    }
    options.statistics = true;
    // Pipelines of the cache were compiled without statistics.
    options.pipeline_cache = None;
    let gpu = Gpu::open(&options)?;
    let passes = bench::statistics(&gpu)?;
    let caps = gpu.caps();
    if json {
        let passes: Vec<Value> = passes.iter().map(described).collect();
        let all = json!({"device": caps.device, "driver": caps.driver, "passes": passes});
        return console::print(&(serde_json::to_string_pretty(&all)? + "\n"));
    }
    console::print(&format!("{}, {}\n{}", caps.device, caps.driver, listing(&passes)))
}

fn described(pass: &PipelineStatistics) -> Value {
    let constants: Map<String, Value> = pass.constants.iter().map(|(name, v)| ((*name).to_owned(), json!(v))).collect();
    let told: Map<String, Value> = pass.values.iter().map(|(name, v)| (name.clone(), json!(v))).collect();
    json!({"name": pass.kernel, "binding": pass.binding, "constants": constants, "subgroup": pass.subgroup, "statistics": told})
}

/// A row per pipeline, with the columns that the driver has a number for.
fn listing(passes: &[PipelineStatistics]) -> String {
    let columns: Vec<_> =
        COLUMNS.iter().filter(|(_, names)| passes.iter().any(|pass| value(pass, names).is_some())).collect();
    let mut rows = vec![vec!["pass".to_owned()]];
    rows[0].extend(columns.iter().map(|(title, _)| (*title).to_owned()));
    rows[0].push("constants".into());
    for pass in passes {
        let mut row = vec![pass.kernel.to_owned()];
        row.extend(columns.iter().map(|(_, names)| value(pass, names).map_or("-".into(), |v| v.to_string())));
        row.push(pass.constants.iter().map(|(name, value)| format!("{name}={value}")).collect::<Vec<_>>().join(" "));
        rows.push(row);
    }
    table(&rows)
}

fn value(pass: &PipelineStatistics, names: &[&str]) -> Option<f64> {
    pass.values.iter().find(|(name, _)| names.contains(&name.to_lowercase().as_str())).map(|(_, value)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_the_names_of_each_driver() {
        let pass = |kernel, values: &[(&str, f64)]| PipelineStatistics {
            kernel,
            binding: "descriptors",
            constants: vec![("BLOCK", 32)],
            subgroup: 32,
            values: values.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect(),
        };
        let text =
            listing(&[pass("a", &[("Register Count", 40.0), ("Binary Size", 512.0)]), pass("b", &[("VGPRs", 7.0)])]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[0].split_whitespace().collect::<Vec<_>>(),
            ["pass", "registers", "code,", "bytes", "constants"]
        );
        assert_eq!(lines[1].split_whitespace().collect::<Vec<_>>(), ["a", "40", "512", "BLOCK=32"]);
        assert_eq!(lines[2].split_whitespace().collect::<Vec<_>>(), ["b", "7", "-", "BLOCK=32"]);
    }
}
