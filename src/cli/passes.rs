//! `psrgs-vk passes`: the registered GPU passes.

mod statistics;

use psrgs_vk::pass::{ALL, Pass};
use psrgs_vk::vk::Access;
use serde_json::{Value, json};

use super::console;

/// List the GPU passes: what each computes, its buffers and how it is dispatched
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Print JSON with the layouts of bindings, push constants and specialization constants
    #[arg(long)]
    json: bool,
    /// Print instead what the driver tells of the passes of a training: registers, spills, instructions, shared memory
    #[arg(long)]
    statistics: bool,
    /// Ask this Vulkan device: its index in `psrgs-vk info`, or a part of its name
    /// [default: discrete, integrated, then CPU]
    #[arg(long, value_name = "DEVICE", requires = "statistics")]
    device: Option<String>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    if args.statistics {
        return statistics::run(args.device.as_deref(), args.json);
    }
    let text = if args.json {
        let passes: Vec<Value> = ALL.iter().map(|pass| describe(pass)).collect();
        serde_json::to_string_pretty(&passes)? + "\n"
    } else {
        listing()
    };
    console::print(&text)
}

fn listing() -> String {
    let mut text = String::new();
    for pass in ALL {
        let buffers: Vec<String> = pass
            .kernel
            .bindings
            .iter()
            .map(|b| match b.access {
                Access::Read => b.name.to_owned(),
                Access::Write => format!("{}<", b.name),
                Access::ReadWrite => format!("{}<>", b.name),
            })
            .collect();
        text += &format!(
            "{}\n    {}\n    dispatch: {}\n    buffers: {}\n",
            pass.kernel.name,
            pass.doc,
            pass.dispatch,
            buffers.join(" ")
        );
    }
    text + &format!("{} passes; < is written, <> is read and written\n", ALL.len())
}

fn describe(pass: &Pass) -> Value {
    let kernel = &pass.kernel;
    let access = |a: Access| match a {
        Access::Read => "read",
        Access::Write => "write",
        Access::ReadWrite => "read_write",
    };
    json!({
        "name": kernel.name,
        "doc": pass.doc,
        "dispatch": pass.dispatch,
        "local_size": kernel.local_size,
        "spirv_bytes": kernel.spirv.descriptors.len(),
        "bindings": kernel.bindings.iter().enumerate()
            .map(|(i, b)| json!({"binding": i, "name": b.name, "access": access(b.access)})).collect::<Vec<_>>(),
        "push_bytes": kernel.push_bytes,
        "push": pass.push.iter()
            .map(|f| json!({"name": f.name, "offset": f.offset, "bytes": f.bytes})).collect::<Vec<_>>(),
        "constants": kernel.constants.iter()
            .map(|c| json!({"id": c.id, "name": c.name, "default": c.default})).collect::<Vec<_>>(),
    })
}
