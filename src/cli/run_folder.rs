//! The folder of a training run: one run at a time, earlier results are replaced only on request, settings lie beside
//! the results.

mod ours;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use psrgs_vk::format::disk::{Disk, System};
use psrgs_vk::format::lock::Lock;
use psrgs_vk::format::{atomic, checkpoint};
use psrgs_vk::train::Settings;

use super::exit::{self, Failure, Remedy};
use super::train::RunPlan;

/// File name of the settings.
pub(crate) const SETTINGS: &str = "settings.toml";
/// File name of the model.
pub(crate) const MODEL: &str = "point_cloud.ply";
/// File name of the scores.
pub(crate) const METRICS: &str = "metrics.json";
/// File name of the report.
pub(crate) const REPORT: &str = "report.html";
/// Folder name of the checkpoints.
pub(crate) const CHECKPOINTS: &str = "checkpoints";
/// Folder name of the held-out renders.
pub(crate) const RENDERS: &str = "renders";
/// Locked while a run writes into the folder.
pub(crate) const LOCK: &str = ".lock";

/// A run's folder. Until it is dropped, only this process writes into it.
#[derive(Debug)]
pub(crate) struct RunFolder {
    path: PathBuf,
    /// Results of an earlier run that are to be replaced.
    old: Vec<PathBuf>,
    /// Warnings about the folder.
    warnings: Vec<String>,
    /// The command that goes on with the run.
    again: String,
    /// Ends with this value, and also when the process is killed.
    _lock: Lock,
}

impl RunFolder {
    /// Creates and locks the folder. Without an earlier run it also writes the settings, so that a run killed before
    /// its first step can be resumed.
    pub(crate) fn open(plan: &RunPlan) -> anyhow::Result<Self> {
        Self::open_on(plan, &System)
    }

    fn open_on(plan: &RunPlan, disk: &impl Disk) -> anyhow::Result<Self> {
        let path = plan.out.clone();
        not_of_others(&path, plan)?;
        let checkpoints = path.join(CHECKPOINTS);
        // A resumed run cannot choose another folder.
        let remedy = if plan.resume { "" } else { "; choose another --out" };
        let elsewhere = |e: &io::Error| Failure::Output(format!("{}: {e}{remedy}", checkpoints.display()));
        fs::create_dir_all(&checkpoints).map_err(|e| elsewhere(&e))?;
        let mut warnings = Vec::new();
        let lock = take(&path, plan.resume || plan.part.is_some(), disk, &mut warnings)?;
        if let Some(refusal) = atomic::unflushed(&path, disk) {
            warnings.push(format!(
                "{}: the file system does not flush folders to the disk ({refusal}): after a loss of power the newest \
                 files may be missing or have their former content",
                path.display()
            ));
        }
        let old = if plan.resume { Vec::new() } else { results(&path)? };
        if let Some(left) = old.first().filter(|_| !plan.overwrite) {
            return Err(Failure::Usage(format!(
                "{0}: holds {1} of an earlier run; go on with it by --resume {0}, replace it with --overwrite, or \
                 choose another --out",
                path.display(),
                left.strip_prefix(&path).unwrap_or(left).display()
            ))
            .into());
        }
        if old.iter().any(|file| file.starts_with(&checkpoints)) {
            not_through_a_link(&checkpoints)?;
        }
        let folder = Self { path, old, warnings, again: plan.again(), _lock: lock };
        if !plan.resume && folder.old.is_empty() {
            folder.write_settings(&plan.settings)?;
        }
        Ok(folder)
    }

    /// Warnings about the folder, for the user to see before long work.
    pub(crate) fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Removes the earlier run. Call this function when all inputs of the training are ready, so that failures before
    /// it cost nothing. All results are removed because a mixture of two runs would look like one run. The settings are
    /// removed first: without them the old run cannot be resumed.
    pub(crate) fn begin(&self, settings: &Settings) -> anyhow::Result<()> {
        let before = if self.old.is_empty() { None } else { Some(self.file(SETTINGS)) };
        for file in before.iter().chain(&self.old) {
            atomic::remove(file)?;
        }
        for folder in [self.path.clone(), self.file(RENDERS)] {
            atomic::remove_unfinished(&folder);
        }
        self.write_settings(settings)
    }

    /// Adds to an error how to resume the training, unless the error says so itself.
    pub(crate) fn with_resume_hint(&self, error: anyhow::Error) -> anyhow::Error {
        if exit::message(&error).contains("--resume") {
            return error;
        }
        let remedy = match checkpoint::newest(&self.checkpoints()) {
            Some((step, file)) => {
                format!("saved up to step {step}, in {}; without the cause it goes on: {}", file.display(), self.again)
            }
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

    /// The folder of the checkpoints.
    pub(crate) fn checkpoints(&self) -> PathBuf {
        self.file(CHECKPOINTS)
    }
}

/// Locks a run's folder. A file system without locks costs a warning.
fn take(path: &Path, resume: bool, disk: &impl Disk, warnings: &mut Vec<String>) -> anyhow::Result<Lock> {
    let lock = Lock::ask(&path.join(LOCK), disk)
        .map_err(|e| anyhow::Error::new(e).context(Failure::Output(path.display().to_string())))?;
    match &lock {
        Lock::Held(_) => {}
        Lock::Taken => {
            let remedy = if resume { "wait for its end, or stop it" } else { "choose another --out" };
            let text = format!("{}: another run is writing here; {remedy}", path.display());
            return Err(Failure::Usage(text).into());
        }
        Lock::Unsupported(refusal) => warnings.push(format!(
            "{}: the file system has no locks ({refusal}): make sure that no other run writes here",
            path.display()
        )),
    }
    Ok(lock)
}

/// Refuses, before anything is created, a folder with files that a run would replace and this program did not write.
/// Without `--overwrite` also refuses a folder that has results but no settings: those results belong to no run that
/// can be resumed.
fn not_of_others(folder: &Path, plan: &RunPlan) -> Result<(), Failure> {
    let stray = || ours::first_stray(folder).filter(|_| !plan.resume);
    if let Some(file) = ours::first_foreign(folder).or_else(stray) {
        return Err(Failure::Usage(format!(
            "{}: holds {}, which psrgs-vk did not write and which would be replaced; move that file elsewhere{}",
            folder.display(),
            file.strip_prefix(folder).unwrap_or(&file).display(),
            if plan.resume || plan.part.is_some() { "" } else { ", or choose another --out" }
        )));
    }
    if plan.resume || plan.overwrite || folder.join(SETTINGS).exists() {
        return Ok(());
    }
    // An unreadable folder is reported when the folder is created.
    let found = results(folder).unwrap_or_default();
    let Some(first) = found.first() else { return Ok(()) };
    Err(Failure::Usage(format!(
        "{}: holds {}, which would be replaced, and no {SETTINGS} of a run that could be gone on with; choose another \
         --out, or replace it with --overwrite",
        folder.display(),
        first.strip_prefix(folder).unwrap_or(first).display()
    )))
}

/// Refuses a link as the folder of checkpoints: its target may belong to another run.
fn not_through_a_link(checkpoints: &Path) -> Result<(), Failure> {
    if !checkpoints.is_symlink() {
        return Ok(());
    }
    let to = fs::read_link(checkpoints).unwrap_or_default();
    Err(Failure::Usage(format!(
        "{}: a link to {}, which holds checkpoints; nothing is removed through a link: remove the link, or choose \
         another --out",
        checkpoints.display(),
        to.display()
    )))
}

/// Adds to an error of a resumed run's dataset the remedy for a moved dataset.
pub(crate) fn with_dataset_hint(run: &Path, error: anyhow::Error) -> anyhow::Error {
    error.context(Remedy(format!("if the dataset has moved: psrgs-vk train DATA --resume {}", run.display())))
}

/// Results of an earlier run that would be lost or mistaken for those of the new run.
fn results(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let files = [MODEL, METRICS, REPORT].iter().map(|name| folder.join(name));
    let mut found: Vec<PathBuf> = files.filter(|file| ours::is_ours(file)).collect();
    let checkpoints = folder.join(CHECKPOINTS);
    if checkpoints.exists() {
        found.extend(checkpoint::told_apart(&checkpoints)?.0);
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::exit;
    use psrgs_vk::train::Settings;

    fn plan(out: &Path) -> RunPlan {
        let (settings, out) = (Settings::default(), out.to_owned());
        RunPlan {
            settings,
            out,
            resume: false,
            overwrite: false,
            preset: None,
            view: None,
            part: None,
            lose_device_at: None,
            keep_no_photographs: false,
        }
    }

    fn refused(plan: &RunPlan) -> (u8, String) {
        let error = RunFolder::open(plan).unwrap_err();
        (exit::code(&error), exit::message(&error))
    }

    #[test]
    fn a_second_run_is_kept_out_until_the_first_is_over() {
        let folder = tempfile::tempdir().unwrap();
        let first = RunFolder::open(&plan(folder.path())).unwrap();
        let (code, text) = refused(&RunPlan { overwrite: true, ..plan(folder.path()) });
        assert!(code == 2 && text.contains("another run"), "{code} {text}");
        drop(first);
        RunFolder::open(&plan(folder.path())).unwrap();
    }

    #[test]
    fn an_earlier_run_is_replaced_whole_and_only_when_asked() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::open(&plan(folder.path())).unwrap();
        let (model, checkpoint) = (run.file(MODEL), run.checkpoints().join("checkpoint-000100.ckpt"));
        let own = ["notes.txt", ".notes.tmp", "checkpoints/other.ckpt", "renders/.x.tmp"].map(|name| run.file(name));
        fs::create_dir(run.file(RENDERS)).unwrap();
        own.iter().for_each(|file| fs::write(file, "x").unwrap());
        [&model, &checkpoint].iter().for_each(|file| write_result(file));
        drop(run);
        let (code, text) = refused(&plan(folder.path()));
        assert!(code == 2 && text.contains("--overwrite") && text.contains("--resume"), "{code} {text}");
        assert!(text.contains("holds point_cloud.ply"), "{text}");
        assert!(model.exists() && checkpoint.exists());

        drop(RunFolder::open(&RunPlan { resume: true, ..plan(folder.path()) }).unwrap());
        assert!(model.exists() && checkpoint.exists(), "resuming removes nothing");

        let run = RunFolder::open(&RunPlan { overwrite: true, ..plan(folder.path()) }).unwrap();
        assert!(model.exists() && checkpoint.exists(), "nothing is lost before it begins");
        run.begin(&Settings::default()).unwrap();
        assert!(!model.exists() && !checkpoint.exists() && run.file(SETTINGS).exists());
        assert!(own.iter().all(|file| file.exists()), "a file of the user is gone");
    }

    /// Writes a file with just enough content to be recognised as this program's.
    fn write_result(file: &Path) {
        let text = match file.extension().and_then(|e| e.to_str()) {
            Some("ply") => "ply\nformat ascii 1.0\ncomment psrgs-vk version 0.1.0\nelement vertex 0\nend_header\n",
            Some("ckpt") => "PSRGS-VK and more",
            Some("json") => r#"{"method": "3dgs", "iterations": 1, "splats": 1, "seconds_per_iteration": 1}"#,
            _ => r#"<html><meta name="generator" content="psrgs-vk"></html>"#,
        };
        fs::write(file, text).unwrap();
    }

    /// Results of a run without its settings.
    #[test]
    fn what_is_of_no_run_is_not_called_one_and_left_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let report = folder.path().join(REPORT);
        write_result(&report);
        let (code, text) = refused(&plan(folder.path()));
        assert!(code == 2 && text.contains("holds report.html") && text.contains("another --out"), "{code} {text}");
        assert!(!text.contains("--resume") && !text.contains("earlier run"), "{text}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing was made");
        drop(RunFolder::open(&RunPlan { overwrite: true, ..plan(folder.path()) }).unwrap());
        assert!(report.exists(), "nothing is lost before it begins");
    }

    #[test]
    fn a_foreign_file_named_as_a_result_is_never_replaced() {
        let names = [
            "point_cloud.ply",
            "metrics.json",
            "report.html",
            "frame.json",
            "exposures.json",
            "sigma.json",
            "settings.toml",
        ];
        let strays = ["checkpoints/checkpoint-000100.ckpt", "renders/holiday.png"];
        for name in names.iter().chain(&strays) {
            let folder = tempfile::tempdir().unwrap();
            let file = folder.path().join(name);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(&file, "theirs").unwrap();
            for overwrite in [false, true] {
                let (code, text) = refused(&RunPlan { overwrite, ..plan(folder.path()) });
                assert!(code == 2 && text.contains(name) && text.contains("did not write"), "{code} {text}");
                assert!(text.contains("another --out"), "{text}");
            }
            if names.contains(name) {
                let (code, text) = refused(&RunPlan { resume: true, ..plan(folder.path()) });
                assert!(code == 2 && text.contains("move that file") && !text.contains("--out"), "{code} {text}");
            }
            assert_eq!(fs::read(&file).unwrap(), b"theirs");
        }
    }

    #[cfg(unix)]
    #[test]
    fn nothing_is_removed_or_emptied_through_a_link() {
        use std::os::unix::fs::symlink;
        let (folder, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let theirs = other.path().join("checkpoint-000100.ckpt");
        write_result(&theirs);
        let link = folder.path().join(CHECKPOINTS);
        symlink(other.path(), &link).unwrap();
        let again = RunPlan { overwrite: true, ..plan(folder.path()) };
        let (code, text) = refused(&again);
        assert!(code == 2 && text.contains("remove the link") && theirs.exists(), "{code} {text}");
        // A link to an empty folder for checkpoints is allowed.
        fs::remove_file(&theirs).unwrap();
        drop(RunFolder::open(&again).unwrap());

        let lock = folder.path().join(LOCK);
        fs::remove_file(&lock).unwrap();
        let thesis = other.path().join("thesis.txt");
        fs::write(&thesis, "years of work").unwrap();
        symlink(&thesis, &lock).unwrap();
        let (code, text) = refused(&again);
        assert!(code == 8 && text.contains(".lock") && text.contains("a link"), "{code} {text}");
        assert_eq!(fs::read(&thesis).unwrap(), b"years of work");
    }

    /// Behaves like a network file system.
    #[cfg(unix)]
    #[test]
    fn a_file_system_without_locks_and_flushes_costs_warnings() {
        struct Network;
        impl Disk for Network {
            fn flush_file(&self, _: &fs::File) -> io::Result<()> {
                Ok(())
            }
            fn flush_folder(&self, _: &Path) -> io::Result<()> {
                Err(io::Error::from_raw_os_error(rustix::io::Errno::INVAL.raw_os_error()))
            }
            fn try_lock(&self, _: &fs::File) -> Result<(), fs::TryLockError> {
                Err(fs::TryLockError::Error(rustix::io::Errno::NOLCK.into()))
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::open_on(&plan(folder.path()), &Network).unwrap();
        let [lock, flush] = run.warnings() else { panic!("{:?}", run.warnings()) };
        assert!(lock.contains("no locks") && flush.contains("does not flush"), "{lock} {flush}");
        assert!(RunFolder::open(&plan(folder.path())).unwrap().warnings().is_empty());
    }

    #[test]
    fn who_goes_on_is_not_sent_elsewhere() {
        let folder = tempfile::tempdir().unwrap();
        let first = RunFolder::open(&plan(folder.path())).unwrap();
        let (code, text) = refused(&RunPlan { resume: true, ..plan(folder.path()) });
        assert!(code == 2 && text.contains("another run") && text.contains("wait for its end"), "{code} {text}");
        assert!(!text.contains("--out"), "{text}");
        drop(first);
    }

    #[test]
    fn settings_are_there_from_the_beginning() {
        let folder = tempfile::tempdir().unwrap();
        let mut settings = Settings::default();
        settings.run.seed = 9;
        let run = RunFolder::open(&RunPlan { settings: settings.clone(), ..plan(folder.path()) }).unwrap();
        assert_eq!(Settings::read(&run.file(SETTINGS)).unwrap(), settings);
        settings.run.seed = 10;
        run.begin(&settings).unwrap();
        assert_eq!(Settings::read(&run.file(SETTINGS)).unwrap(), settings);
    }

    #[test]
    fn the_way_on_is_told_once() {
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::open(&plan(folder.path())).unwrap();
        let told = |text: &str| exit::remedies(&run.with_resume_hint(anyhow::anyhow!(text.to_owned()))).join("\n");
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
