//! The folder of a training run: one run at a time, no earlier result replaced unasked, settings beside the results.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use psrgs_vk::format::{atomic, checkpoint};
use psrgs_vk::train::Settings;

use super::exit::{self, Failure, Remedy};
use super::train::Plan;

/// Name of the settings file.
pub(crate) const SETTINGS: &str = "settings.toml";
/// Name of the model.
pub(crate) const MODEL: &str = "point_cloud.ply";
/// Name of the file with the scores.
pub(crate) const METRICS: &str = "metrics.json";
/// Name of the report.
pub(crate) const REPORT: &str = "report.html";
/// Name of the folder of checkpoints.
pub(crate) const CHECKPOINTS: &str = "checkpoints";
/// Name of the folder of held-out renders.
pub(crate) const RENDERS: &str = "renders";
/// Held while a run writes here.
const LOCK: &str = ".lock";

/// A folder that this process alone writes a run into, until it is dropped.
#[derive(Debug)]
pub(crate) struct RunFolder {
    path: PathBuf,
    /// What an earlier run has left, where it is to be replaced.
    old: Vec<PathBuf>,
    /// The lock ends with the file: also when the process is killed.
    _lock: File,
}

impl RunFolder {
    /// Makes the folder and takes it. Settings are written where no earlier run is there, so that what is killed before it begins can be
    /// gone on with too.
    pub(crate) fn open(plan: &Plan) -> anyhow::Result<Self> {
        let path = plan.out.clone();
        if !plan.resume && !plan.overwrite {
            not_of_others(&path)?;
        }
        let checkpoints = path.join(CHECKPOINTS);
        // Who goes on with a run has not chosen the folder.
        let remedy = if plan.resume { "" } else { "; choose another --out" };
        let elsewhere = |e: &io::Error| Failure::Output(format!("{}: {e}{remedy}", checkpoints.display()));
        fs::create_dir_all(&checkpoints).map_err(|e| elsewhere(&e))?;
        let lock_file = path.join(LOCK);
        let lock = File::create(&lock_file).map_err(|e| unwritable(&lock_file, &e))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let remedy = if plan.resume { "wait for its end, or stop it" } else { "choose another --out" };
                let text = format!("{}: another run is writing here; {remedy}", path.display());
                return Err(Failure::Usage(text).into());
            }
            Err(TryLockError::Error(e)) if e.kind() == io::ErrorKind::Unsupported => {}
            Err(TryLockError::Error(e)) => return Err(unwritable(&lock_file, &e)),
        }
        let old = if plan.resume { Vec::new() } else { results(&path)? };
        if let Some(left) = old.first().filter(|_| !plan.overwrite) {
            return Err(Failure::Usage(format!(
                "{0}: holds {1} of an earlier run; go on with it by --resume {0}, replace it with --overwrite, or choose another --out",
                path.display(),
                left.strip_prefix(&path).unwrap_or(left).display()
            ))
            .into());
        }
        let folder = Self { path, old, _lock: lock };
        if !plan.resume && folder.old.is_empty() {
            folder.write_settings(&plan.settings)?;
        }
        Ok(folder)
    }

    /// To be called when all that training needs is there: what could fail before has cost an earlier run nothing. Its results go all at
    /// once, because a mixture of two runs would be taken for one, and its settings first, without which nobody goes on with it.
    pub(crate) fn begin(&self, settings: &Settings) -> anyhow::Result<()> {
        let before = if self.old.is_empty() { None } else { Some(self.file(SETTINGS)) };
        for file in before.iter().chain(&self.old) {
            match fs::remove_file(file) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(unwritable(file, &e)),
                _ => {}
            }
        }
        for folder in [self.path.clone(), self.file(RENDERS)] {
            atomic::remove_unfinished(&folder, "");
        }
        self.write_settings(settings)
    }

    /// Adds to an error that ends a training how to go on, unless it says so itself.
    pub(crate) fn with_way_on(&self, error: anyhow::Error) -> anyhow::Error {
        if exit::message(&error).contains("--resume") {
            return error;
        }
        let remedy = match checkpoint::newest(&self.checkpoints()) {
            Some((step, file)) => format!(
                "saved up to step {step}, in {}; without the cause it goes on: psrgs-vk train --resume {}",
                file.display(),
                self.path.display()
            ),
            None => "there is no checkpoint to go on from: the same command begins anew".to_owned(),
        };
        error.context(Remedy(remedy))
    }

    /// Writes `settings.toml`.
    pub(crate) fn write_settings(&self, settings: &Settings) -> anyhow::Result<()> {
        let text = settings.to_toml()?;
        atomic::write(&self.file(SETTINGS), |out| out.write_all(text.as_bytes()))
            .with_context(|| format!("{}", self.path.display()))
    }

    /// A file of the run.
    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// The folder of its checkpoints.
    pub(crate) fn checkpoints(&self) -> PathBuf {
        self.file(CHECKPOINTS)
    }
}

/// Refuses a folder, before anything is made in it, that has files named as results and no settings: they are not of a run that could be
/// gone on with, and would be replaced.
fn not_of_others(folder: &Path) -> Result<(), Failure> {
    if folder.join(SETTINGS).exists() {
        return Ok(());
    }
    // What cannot be listed is told when the folder is made.
    let found = results(folder).unwrap_or_default();
    let Some(first) = found.first() else { return Ok(()) };
    Err(Failure::Usage(format!(
        "{}: holds {}, which would be replaced, and no {SETTINGS} of a run that could be gone on with; choose another --out, or replace \
         it with --overwrite",
        folder.display(),
        first.strip_prefix(folder).unwrap_or(first).display()
    )))
}

/// Adds to an error of the dataset of a run that is gone on with what to do where it has moved.
pub(crate) fn with_way_back(run: &Path, error: anyhow::Error) -> anyhow::Error {
    error.context(Remedy(format!("if the dataset has moved: psrgs-vk train DATA --resume {}", run.display())))
}

/// What an earlier run has left that would be lost or mistaken for the new run's.
fn results(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut found: Vec<PathBuf> =
        [MODEL, METRICS, REPORT].iter().map(|name| folder.join(name)).filter(|file| file.exists()).collect();
    let checkpoints = folder.join(CHECKPOINTS);
    let entries = match fs::read_dir(&checkpoints) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(found),
        entries => entries.map_err(|e| unwritable(&checkpoints, &e))?,
    };
    for entry in entries {
        let file = entry.map_err(|e| unwritable(&checkpoints, &e))?.path();
        if file.extension().is_some_and(|e| e == "ckpt") {
            found.push(file);
        }
    }
    Ok(found)
}

fn unwritable(path: &Path, error: &io::Error) -> anyhow::Error {
    Failure::Output(format!("{}: {error}", path.display())).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::exit;
    use psrgs_vk::train::Settings;

    fn plan(out: &Path) -> Plan {
        let (settings, out) = (Settings::default(), out.to_owned());
        Plan { settings, out, resume: false, former: None, overwrite: false, preset: None, lose_device_at: None }
    }

    fn refused(plan: &Plan) -> (u8, String) {
        let error = RunFolder::open(plan).unwrap_err();
        (exit::code(&error), exit::message(&error))
    }

    #[test]
    fn a_second_run_is_kept_out_until_the_first_is_over() {
        let folder = tempfile::tempdir().unwrap();
        let first = RunFolder::open(&plan(folder.path())).unwrap();
        let (code, text) = refused(&Plan { overwrite: true, ..plan(folder.path()) });
        assert!(code == 2 && text.contains("another run"), "{code} {text}");
        drop(first);
        RunFolder::open(&plan(folder.path())).unwrap();
    }

    #[test]
    fn an_earlier_run_is_replaced_whole_and_only_when_asked() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::open(&plan(folder.path())).unwrap();
        let (model, checkpoint) = (run.file(MODEL), run.checkpoints().join("checkpoint-000100.ckpt"));
        let own = run.file("notes.txt");
        [&model, &checkpoint, &own].iter().for_each(|file| fs::write(file, "x").unwrap());
        drop(run);
        let (code, text) = refused(&plan(folder.path()));
        assert!(code == 2 && text.contains("--overwrite") && text.contains("--resume"), "{code} {text}");
        assert!(text.contains("holds point_cloud.ply"), "{text}");
        assert!(model.exists() && checkpoint.exists());

        drop(RunFolder::open(&Plan { resume: true, ..plan(folder.path()) }).unwrap());
        assert!(model.exists() && checkpoint.exists(), "resuming removes nothing");

        let run = RunFolder::open(&Plan { overwrite: true, ..plan(folder.path()) }).unwrap();
        assert!(model.exists() && checkpoint.exists(), "nothing is lost before it begins");
        run.begin(&Settings::default()).unwrap();
        assert!(!model.exists() && !checkpoint.exists() && own.exists() && run.file(SETTINGS).exists());
    }

    /// A report of something else, say, or what a run has left whose settings are gone.
    #[test]
    fn what_is_of_no_run_is_not_called_one_and_left_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let report = folder.path().join(REPORT);
        fs::write(&report, "x").unwrap();
        let (code, text) = refused(&plan(folder.path()));
        assert!(code == 2 && text.contains("holds report.html") && text.contains("another --out"), "{code} {text}");
        assert!(!text.contains("--resume") && !text.contains("earlier run"), "{text}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing was made");
        drop(RunFolder::open(&Plan { overwrite: true, ..plan(folder.path()) }).unwrap());
        assert!(report.exists(), "nothing is lost before it begins");
    }

    #[test]
    fn who_goes_on_is_not_sent_elsewhere() {
        let folder = tempfile::tempdir().unwrap();
        let first = RunFolder::open(&plan(folder.path())).unwrap();
        let (code, text) = refused(&Plan { resume: true, ..plan(folder.path()) });
        assert!(code == 2 && text.contains("another run") && text.contains("wait for its end"), "{code} {text}");
        assert!(!text.contains("--out"), "{text}");
        drop(first);
    }

    #[test]
    fn settings_are_there_from_the_beginning() {
        let folder = tempfile::tempdir().unwrap();
        let mut settings = Settings::default();
        settings.run.seed = 9;
        let run = RunFolder::open(&Plan { settings: settings.clone(), ..plan(folder.path()) }).unwrap();
        assert_eq!(Settings::read(&run.file(SETTINGS)).unwrap(), settings);
        settings.run.seed = 10;
        run.begin(&settings).unwrap();
        assert_eq!(Settings::read(&run.file(SETTINGS)).unwrap(), settings);
    }

    #[test]
    fn the_way_on_is_told_once() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::open(&plan(folder.path())).unwrap();
        let told = |text: &str| exit::remedies(&run.with_way_on(anyhow::anyhow!(text.to_owned()))).join("\n");
        assert!(told("disk full").contains("no checkpoint"));
        fs::write(run.checkpoints().join("checkpoint-000100.ckpt"), "x").unwrap();
        let way_on = told("disk full");
        assert!(way_on.contains("step 100") && way_on.contains("--resume"), "{way_on}");
        assert_eq!(told("stopped; go on with --resume"), "");
    }

    #[test]
    fn a_place_that_cannot_be_written_is_an_output_error() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let (code, text) = refused(&plan(&file.join("run")));
        assert!(code == 8 && text.contains("cannot write"), "{code} {text}");
    }
}
