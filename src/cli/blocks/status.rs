//! `psrgs-vk blocks status`: how far the blocks of a plan are.

use std::path::{Path, PathBuf};

use psrgs_vk::blocks::{BlockState, DoneFile, GLOBAL, PlanFolder};
use psrgs_vk::format::checkpoint;
use psrgs_vk::format::disk::System;
use psrgs_vk::format::lock::Lock;
use psrgs_vk::numbers::grouped;

use crate::cli::console;
use crate::cli::run_folder::{CHECKPOINTS, LOCK};

/// Show how far the blocks of a plan are
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Folder of the plan
    #[arg(value_name = "PLAN")]
    pub(super) plan: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub(super) json: bool,
}

/// A line of the table.
#[derive(Debug, serde::Serialize)]
struct Row {
    block: String,
    /// waiting, running, stopped, done, stale or damaged.
    state: &'static str,
    /// Why a block is stale or damaged.
    #[serde(skip_serializing_if = "Option::is_none")]
    why: Option<String>,
    /// The last step that is saved.
    step: u32,
    steps: u32,
    photographs: usize,
    /// Splats of the model; of a block that is not done, as many as are expected.
    splats: u64,
    psnr: Option<f64>,
    seconds: Option<f64>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let folder = PlanFolder::open(&args.plan)?;
    let plan = &folder.plan;
    let global = (plan.global.steps, plan.global.photographs.len(), u64::from(plan.global.max_splats));
    let blocks = plan.blocks.iter();
    let blocks = blocks.map(|b| (b.id.as_str(), (b.steps, b.photographs.len(), b.predicted_splats)));
    let rows: Vec<Row> =
        [(GLOBAL, global)].into_iter().chain(blocks).map(|(id, what)| row(&folder, id, what)).collect();
    match args.json {
        true => console::print(&(serde_json::to_string_pretty(&rows)? + "\n")),
        false => console::print(&table(&rows)),
    }
}

fn row(folder: &PlanFolder, id: &str, (steps, photographs, expected): (u32, usize, u64)) -> Row {
    let place = folder.folder_of(id);
    let step = checkpoint::newest(&place.join(CHECKPOINTS)).map_or(0, |(step, _)| step as u32);
    let (state, why, done) = match folder.quick_state(id) {
        BlockState::Done(done) => ("done", None, Some(done)),
        BlockState::Stale(stale) => ("stale", Some(stale.to_string()), None),
        BlockState::Damaged(error) => ("damaged", Some(error.to_string()), None),
        _ if is_locked(&place) => ("running", None, None),
        BlockState::Begun => ("stopped", None, None),
        BlockState::Waiting => ("waiting", None, None),
    };
    let psnr = |done: &DoneFile| done.metrics.psnr.or(done.metrics.psnr_training);
    Row {
        block: id.to_owned(),
        state,
        why,
        step: done.as_ref().map_or(step, |done| done.metrics.iterations),
        steps,
        photographs,
        splats: done.as_ref().map_or(expected, |done| done.splats),
        psnr: done.as_deref().and_then(psnr),
        seconds: done.as_ref().map(|done| done.seconds),
    }
}

/// Whether a process writes into a folder, as far as the file system tells.
fn is_locked(folder: &Path) -> bool {
    let lock = folder.join(LOCK);
    lock.is_file() && matches!(Lock::ask(&lock, &System), Ok(Lock::Taken))
}

fn table(rows: &[Row]) -> String {
    let titles = ["block", "state", "step", "photographs", "splats", "PSNR, dB", "seconds", ""].map(str::to_owned);
    let mut cells = vec![titles.to_vec()];
    cells.extend(rows.iter().map(|row| {
        let about = if row.state == "done" { "" } else { "~" };
        vec![
            row.block.clone(),
            row.state.to_owned(),
            format!("{} of {}", grouped(row.step), grouped(row.steps)),
            grouped(row.photographs),
            format!("{about}{}", grouped(row.splats)),
            row.psnr.map_or_else(String::new, |psnr| format!("{psnr:.2}")),
            row.seconds.map_or_else(String::new, |seconds| format!("{seconds:.0}")),
            row.why.clone().unwrap_or_default(),
        ]
    }));
    console::table(&cells)
}
