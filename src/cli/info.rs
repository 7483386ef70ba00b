//! `psrgs-vk info`: devices, limits, and the chosen capabilities with reasons.

use indicatif::HumanBytes;
use psrgs_vk::train::settings::DeviceChoice;
use psrgs_vk::vk::{Caps, DeviceInfo, Gpu, devices};
use serde_json::json;

use super::console::{self, Console, table};
use super::device;

/// List Vulkan devices, their limits, and which capabilities were picked and why
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    device: DeviceChoice,
}

pub(crate) fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let options = device::options(&args.device, false)?;
    let found = match devices() {
        Ok(found) => found,
        Err(error) => {
            if args.json {
                console::print(&json(&[], None)?)?;
            }
            return Err(error.into());
        }
    };
    let opened = Gpu::open(&options);
    let caps = opened.as_ref().ok().map(Gpu::caps);
    let text = if args.json { json(&found, caps)? } else { text(&found, caps) };
    console::print(&text)?;
    console.detail(format_args!("psrgs-vk {}", env!("CARGO_PKG_VERSION")));
    // The list is printed even where the chosen device cannot be used.
    opened.map(|_| ()).map_err(Into::into)
}

/// Limits by name as text.
fn limits(caps: &Caps) -> Vec<(&'static str, String)> {
    let l = &caps.limits;
    let bytes = |b: u64| HumanBytes(b).to_string();
    vec![
        ("memory that may be allocated", bytes(caps.memory_limit)),
        ("one allocation", bytes(l.allocation)),
        ("one storage buffer binding", bytes(l.storage_range)),
        ("storage buffers of a pass", l.storage_buffers.to_string()),
        ("push constants", bytes(l.push_bytes.into())),
        ("shared memory of a workgroup", bytes(l.shared_bytes.into())),
        ("threads of a workgroup", l.workgroup_size.to_string()),
        ("workgroups along an axis", l.workgroups.to_string()),
        ("timestamp", if l.timestamp_ns > 0.0 { format!("{} ns", l.timestamp_ns) } else { "none".into() }),
    ]
}

fn text(found: &[DeviceInfo], caps: Option<&Caps>) -> String {
    let mut rows = vec![["", "device", "kind", "driver", ""].map(str::to_owned).to_vec()];
    rows.extend(found.iter().enumerate().map(|(i, d)| {
        let note = d.unusable.as_ref().map(|why| format!("unusable: {why}")).unwrap_or_default();
        vec![i.to_string(), d.name.clone(), d.kind.to_string(), d.driver.clone(), note]
    }));
    let mut text = table(&rows);
    if let Some(caps) = caps {
        let (major, minor, patch) = caps.api;
        text +=
            &format!("\nin use: {} ({}), Vulkan {major}.{minor}.{patch}, {}\n", caps.device, caps.kind, caps.driver);
        let (low, high) = caps.subgroup_range;
        text += &format!("subgroup widths {low} to {high}: {}\n", caps.subgroup_operations.join(", "));
        text += "\nlimits\n";
        text += &indented(limits(caps).into_iter().map(|(name, value)| vec![name.to_owned(), value]));
        text += "\npicked\n";
        text += &indented(caps.choices.iter().map(|c| vec![c.what.to_owned(), c.picked.clone(), c.why.clone()]));
    }
    text
}

fn indented(rows: impl Iterator<Item = Vec<String>>) -> String {
    let rows: Vec<Vec<String>> = rows.collect();
    table(&rows).lines().map(|line| format!("  {line}\n")).collect()
}

fn json(found: &[DeviceInfo], caps: Option<&Caps>) -> anyhow::Result<String> {
    let devices: Vec<_> = found
        .iter()
        .enumerate()
        .map(|(i, d)| {
            json!({"index": i, "name": d.name, "kind": d.kind.to_string(), "driver": d.driver, "unusable": d.unusable})
        })
        .collect();
    let in_use = caps.map(|caps| {
        let l = &caps.limits;
        json!({
            "name": caps.device,
            "kind": caps.kind.to_string(),
            "driver": caps.driver,
            "api": [caps.api.0, caps.api.1, caps.api.2],
            "subgroup_widths": [caps.subgroup_range.0, caps.subgroup_range.1],
            "subgroup_operations": caps.subgroup_operations,
            "memory_limit": caps.memory_limit,
            "heaps": caps.heaps.iter()
                .map(|h| json!({"bytes": h.bytes, "device_local": h.device_local})).collect::<Vec<_>>(),
            "limits": {
                "allocation": l.allocation,
                "storage_range": l.storage_range,
                "storage_alignment": l.storage_alignment,
                "storage_buffers": l.storage_buffers,
                "push_bytes": l.push_bytes,
                "shared_bytes": l.shared_bytes,
                "workgroup_size": l.workgroup_size,
                "workgroups": l.workgroups,
                "timestamp_ns": l.timestamp_ns,
            },
            "picked": caps.choices.iter()
                .map(|c| json!({"what": c.what, "picked": c.picked, "why": c.why})).collect::<Vec<_>>(),
        })
    });
    let all = json!({"version": env!("CARGO_PKG_VERSION"), "devices": devices, "in_use": in_use});
    Ok(serde_json::to_string_pretty(&all)? + "\n")
}
