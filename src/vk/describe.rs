//! Description of a recording: its commands with their buffers, and the waits of each command.

use super::Gpu;
use super::barrier::Barrier;
use super::error::Result;
use super::kernel::Access;
use super::recorder::{Command, Recorder};
use super::submit::{infer, steps};

/// A command of a recording.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Described {
    /// Name of the kernel, or `clear`, `copy`, `upload`. The last entry, `read by the host`, stands for the host's
    /// reads.
    pub command: String,
    /// Names of the buffers that the command reads, including indirect workgroup counts.
    pub reads: Vec<String>,
    /// Names of the buffers that the command writes.
    pub writes: Vec<String>,
    /// What the command has to wait for.
    pub waits: Vec<Wait>,
    /// Whether a barrier stands in front of the command. A command that waits needs none when an earlier barrier
    /// suffices.
    pub barrier: bool,
}

/// A reason for a barrier.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Wait {
    /// Name of the buffer.
    pub buffer: String,
    /// Index in the recording of the last command to wait for; `None` for a command of an earlier recording.
    pub after: Option<usize>,
}

impl Gpu {
    /// The commands of a recording as they would be submitted now, and the waits of each command.
    pub fn describe(&self, recorder: &Recorder) -> Result<Vec<Described>> {
        recorder.of(self.device())?;
        let steps = steps(recorder);
        let (needed, placed, first) = {
            let state = self.state();
            let (mut one, mut other) = (state.tracker(), state.tracker());
            let first = one.commands() + 1;
            let needed: Vec<Vec<Barrier>> = steps.iter().map(|(_, uses)| one.step(uses)).collect();
            (needed, infer(&mut other, &steps), first)
        };
        let name = |id: u64| {
            let mut buffers = recorder.commands.iter().flat_map(Command::buffers);
            buffers.find(|b| b.inner.id == id).map_or_else(|| "?".to_owned(), |b| b.name().to_owned())
        };
        let mut out = Vec::with_capacity(steps.len());
        for (i, (command, uses)) in steps.iter().enumerate() {
            let of = |wanted: fn(Access) -> bool| {
                let mut names: Vec<String> = Vec::new();
                for used in uses.iter().filter(|used| wanted(used.kind.as_access())) {
                    let name = name(used.buffer);
                    if !names.contains(&name) {
                        names.push(name);
                    }
                }
                names
            };
            let mut waits: Vec<Wait> = Vec::new();
            for barrier in &needed[i] {
                let after = barrier.after.checked_sub(first).map(|n| n as usize);
                let wait = Wait { buffer: name(barrier.buffer), after };
                if !waits.contains(&wait) {
                    waits.push(wait);
                }
            }
            out.push(Described {
                command: command.clone(),
                reads: of(|access| access != Access::Write),
                writes: of(|access| access != Access::Read),
                waits,
                barrier: !placed[i].is_empty(),
            });
        }
        Ok(out)
    }
}
