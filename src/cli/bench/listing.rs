//! The commands of a step as text.

use psrgs_vk::vk::{Described, Wait};

use crate::cli::console::table;

/// A line per command: its number, whether a barrier precedes it, and what it waits for. Buffers last used by the same
/// earlier command are grouped.
pub(super) fn text(commands: &[Described]) -> String {
    let mut rows = vec![["#", "command", "barrier", "waits for"].map(str::to_owned).to_vec()];
    for (i, command) in commands.iter().enumerate() {
        let barrier = if command.barrier { "yes" } else { "-" };
        rows.push(vec![i.to_string(), command.command.clone(), barrier.to_owned(), reasons(commands, &command.waits)]);
    }
    let barriers = commands.iter().filter(|c| c.barrier).count();
    let dispatches =
        commands.iter().filter(|c| !["clear", "copy", "upload", "read by the host"].contains(&c.command.as_str()));
    table(&rows) + &format!("{} dispatches, {barriers} barriers\n", dispatches.count())
}

fn reasons(commands: &[Described], waits: &[Wait]) -> String {
    let mut sources: Vec<Option<usize>> = waits.iter().map(|wait| wait.after).collect();
    sources.sort_unstable_by(|a, b| b.cmp(a));
    sources.dedup();
    let of = |source: Option<usize>| {
        let buffers: Vec<&str> =
            waits.iter().filter(|wait| wait.after == source).map(|wait| wait.buffer.as_str()).collect();
        let command = source.and_then(|i| commands.get(i).map(|command| format!("{i} {}", command.command)));
        format!("{} ({})", command.unwrap_or_else(|| "the step before".into()), buffers.join(" "))
    };
    if waits.is_empty() { "-".into() } else { sources.into_iter().map(of).collect::<Vec<_>>().join("; ") }
}
