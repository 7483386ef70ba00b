//! A benchmark as text.

use indicatif::{HumanBytes, HumanCount};
use psrgs_vk::bench::{Quartiles, Report};
use psrgs_vk::numbers::{counted, fraction};

use crate::cli::console::table;

/// Header lines, passes, stages.
pub(super) fn text(report: &Report) -> String {
    let mut text = subject(report) + &work_of_a_step(report) + &memory(report);
    let rates = &report.rates;
    text += &format!(
        "the device: copies at {} GB/s (kernel) and {} GB/s (command); {} 10^9 operations/s, {} 10^9 \
         exponentials/s\n\n",
        number(rates.copy_kernel_gb_per_s),
        number(rates.copy_buffer_gb_per_s),
        number(rates.gops_per_s),
        number(rates.gexp2_per_s),
    );
    text + &passes(report) + "\n" + &stages(report)
}

/// The measured work and the device.
fn subject(report: &Report) -> String {
    let Report { device, workload: w, .. } = report;
    let mut text = format!(
        "{} ({}), {}, Vulkan {}\n{} tiles, gradients by {}\n",
        device.name,
        device.kind,
        device.driver,
        device.api,
        word(&report.variants.tile),
        word(&report.variants.gradients),
    );
    text += &format!(
        "{}, {} visible, {}; {}x{}, {}, {} in turn, harmonics of degree {}\n",
        counted(w.splats, "splat"),
        HumanCount(w.visible.round() as u64),
        counted(w.pairs.round() as u64, "pair"),
        w.size[0],
        w.size[1],
        counted(w.tiles.round() as u64, "tile"),
        counted(w.views, "view"),
        w.sh_degree,
    );
    if let Some(p) = w.splats_per_pixel {
        text += &format!(
            "splats per pixel: forward {:.1} evaluated, {:.1} blended; backward {:.1} evaluated, {:.1} blended\n",
            p.forward_evaluated, p.forward_blended, p.backward_evaluated, p.backward_blended,
        );
    }
    text
}

/// Commands and waits of the host in a step, and the loss of the steps.
fn work_of_a_step(report: &Report) -> String {
    let Report { loss, per_step: host, .. } = report;
    let tenths = |mean: f64| (10.0 * mean).round() / 10.0;
    format!(
        "per step: {} dispatches, {} fills and copies, {} barriers ({} ranges), {} submits, {} host waits, {} pacing \
         waits\n\
         mean loss over the views: {:.5} at first, {:.5} at last\n\
         {} steps after {} to warm up; at most {} of device memory\n",
        tenths(host.dispatches),
        tenths(host.transfers),
        tenths(host.barriers),
        tenths(host.buffer_barriers),
        tenths(host.submits),
        tenths(host.host_waits),
        tenths(host.pacing_waits),
        loss.first_pass,
        loss.last_pass,
        report.steps,
        report.warm_up,
        HumanBytes(report.peak_device_bytes),
    )
}

/// Memory per splat, pair and pixel.
fn memory(report: &Report) -> String {
    let m = report.memory;
    format!(
        "memory: {:.1} B per splat + {:.1} B per pair + {:.1} B per pixel (slots: {:.1} B per pair, {:.1} B per \
         splat); {} for a density change\n\n",
        m.per_splat,
        m.per_pair,
        m.per_pixel,
        m.slots_per_pair,
        m.slots_per_splat,
        HumanBytes(report.density_peak_bytes),
    )
}

/// The passes with their times and floors.
fn passes(report: &Report) -> String {
    let heads =
        ["pass", "calls", "ms", "q1", "q3", "mean", "share", "MB", "GB/s", "bytes floor", "sums floor", "x floor"];
    let mut rows = vec![heads.map(str::to_owned).to_vec()];
    let row = |name: &str, calls: String, ms: Quartiles, share: String| {
        vec![name.to_owned(), calls, number(ms.median), number(ms.q1), number(ms.q3), number(ms.mean), share]
    };
    for pass in &report.passes {
        let mut cells = row(&pass.pass, format!("{}", pass.calls), pass.ms, percent(pass.share));
        // An empty cell would left-align its column.
        cells.push(pass.bytes.map_or("-".into(), |bytes| number(bytes * 1e-6)));
        let floors = [pass.gb_per_s, pass.floors.bytes_ms, pass.floors.arithmetic_ms, pass.over_floor];
        cells.extend(floors.map(|value| value.map_or("-".into(), number)));
        rows.push(cells);
    }
    rows.push(row("device", "-".into(), report.device_ms, percent(1.0)));
    table(&rows)
}

/// The stages of a step with their times.
fn stages(report: &Report) -> String {
    let mut rows = vec![["stage", "ms", "q1", "q3", "mean", "share"].map(str::to_owned).to_vec()];
    let row = |name: &str, ms: Quartiles, share: String| {
        vec![name.to_owned(), number(ms.median), number(ms.q1), number(ms.q3), number(ms.mean), share]
    };
    rows.extend(report.stages.iter().map(|stage| row(stage.stage, stage.ms, percent(stage.share))));
    rows.push(row("device", report.device_ms, percent(1.0)));
    rows.push(row("wall", report.wall_ms, "-".into()));
    table(&rows)
}

/// A number with at least three significant digits.
fn number(x: f64) -> String {
    match x.abs() {
        x if x >= 100.0 => format!("{x:.0}"),
        x if x >= 10.0 => format!("{x:.1}"),
        x if x >= 1.0 => format!("{x:.2}"),
        _ => fraction(x, 3),
    }
}

fn percent(share: f64) -> String {
    format!("{}%", fraction(100.0 * share, 1))
}

/// The name of a variant as in settings files.
fn word(form: &impl serde::Serialize) -> String {
    serde_json::to_value(form).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}
