//! `psrgs-vk bench --plot`: growth of time and memory over several results.

use std::path::{Path, PathBuf};

use psrgs_vk::bench::plot::{self, Series};
use psrgs_vk::format::atomic;
use serde_json::Value;

use crate::cli::console;
use crate::cli::exit::Failure;

/// The plotted numbers of a result.
struct Scale {
    splats: f64,
    pixels: f64,
    step_ms: f64,
    mib: f64,
}

fn read(file: &Path) -> anyhow::Result<Scale> {
    let unusable =
        |why: String| Failure::Input(format!("{}: {why}; --plot wants results of `bench --json`", file.display()));
    let text = psrgs_vk::format::read_text(file).map_err(|e| unusable(format!("cannot be read: {e}")))?;
    let value: Value = serde_json::from_str(&text).map_err(|e| unusable(format!("is no JSON: {e}")))?;
    let number = |pointer: &str| {
        let number = value.pointer(pointer).and_then(Value::as_f64);
        number.ok_or_else(|| unusable(format!("has no {pointer}")))
    };
    Ok(Scale {
        splats: number("/workload/splats")?,
        pixels: number("/workload/pixels")?,
        step_ms: number("/wall_ms/median")?,
        mib: number("/peak_device_bytes")? / f64::from(1 << 20),
    })
}

pub(super) fn run(picture: &Path, results: &[PathBuf]) -> anyhow::Result<()> {
    // Without the picture's name, the first result would be overwritten.
    if !picture.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("svg")) {
        return Err(Failure::Usage(format!(
            "--plot {}: the first name is that of the picture, which ends in .svg; results follow it",
            picture.display()
        ))
        .into());
    }
    let mut read = results.iter().map(|file| read(file)).collect::<anyhow::Result<Vec<Scale>>>()?;
    let spread = |of: fn(&Scale) -> f64| {
        let (low, high) = read.iter().map(of).fold((f64::INFINITY, 0.0_f64), |(l, h), x| (l.min(x), h.max(x)));
        high / low
    };
    let by_splats = spread(|r| r.splats) >= spread(|r| r.pixels);
    let size: fn(&Scale) -> f64 = if by_splats { |r| r.splats } else { |r| r.pixels };
    let what = if by_splats { "splats" } else { "pixels of a view" };
    read.sort_by(|a, b| size(a).total_cmp(&size(b)));
    let series = |name: &str, of: fn(&Scale) -> f64| Series {
        name: name.to_owned(),
        points: read.iter().map(|r| (size(r), of(r))).collect(),
    };
    let all = [series("ms per step", |r| r.step_ms), series("device memory, MiB", |r| r.mib)];
    atomic::write(picture, |out| out.write_all(plot::svg(what, &all).as_bytes()))?;
    let mut text = format!("{what:>16} {:>14} {:>19}\n", "ms per step", "device memory, MiB");
    for r in &read {
        text += &format!("{:>16} {:>14.1} {:>19.1}\n", size(r), r.step_ms, r.mib);
    }
    for one in &all {
        let slope = plot::slope(&one.points).map_or("unknown".to_owned(), |slope| format!("{slope:.3}"));
        text += &format!("{}: slope {slope} over the last tenfold (1 is linear)\n", one.name);
    }
    console::print(&text)
}
