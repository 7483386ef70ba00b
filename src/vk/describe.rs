//! What a recording would be on the device: its commands with their buffers, and what each waits for.

use super::Gpu;
use super::barrier::Barrier;
use super::error::Result;
use super::kernel::Access;
use super::recorder::{Command, Recorder};
use super::submit::{infer, steps};

/// A command of a recording.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Described {
    /// Name of the kernel, or `clear`, `copy`, `upload`; last, for what the host reads, `read by the host`.
    pub command: String,
    /// Buffers it reads, workgroup numbers included.
    pub reads: Vec<String>,
    /// Buffers it writes.
    pub writes: Vec<String>,
    /// What it has to wait for.
    pub waits: Vec<Wait>,
    /// Whether there is a barrier in front of it: it may be that an earlier one does all it needs.
    pub barrier: bool,
}

/// A reason for a barrier.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Wait {
    /// The buffer.
    pub buffer: String,
    /// Place in the recording of the last command that has to be over; none for one of an earlier recording.
    pub after: Option<usize>,
}

impl Gpu {
    /// The commands of a recording as they would be submitted at this moment, and what each waits for.
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
