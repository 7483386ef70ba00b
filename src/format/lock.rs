//! A lock file, so that two processes do not write to one place.

use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

use super::Error;
use super::disk::{Disk, refuses_lock};

/// Time between two requests for a lock that another process holds.
const AGAIN: Duration = Duration::from_millis(10);

/// The answer to a request for a lock.
#[derive(Debug)]
pub enum Lock {
    /// Locked until the file is dropped or the process ends.
    Held(File),
    /// Another process has locked the file.
    Taken,
    /// The file system has no locks, so another process may be writing.
    Unsupported(io::Error),
}

impl Lock {
    /// Requests the lock of a file, which is created if missing. The file's content stays, and no link is followed.
    pub fn ask(file: &Path, disk: &impl Disk) -> Result<Self, Error> {
        let opened = open(file)?;
        match disk.try_lock(&opened) {
            Ok(()) => Ok(Self::Held(opened)),
            Err(TryLockError::WouldBlock) => Ok(Self::Taken),
            Err(TryLockError::Error(e)) if refuses_lock(&e) => Ok(Self::Unsupported(e)),
            Err(TryLockError::Error(e)) => Err(Error::io(file, "lock")(e)),
        }
    }

    /// [`Self::ask`], waiting up to `longest` for another process to release the lock.
    pub fn wait(file: &Path, disk: &impl Disk, longest: Duration) -> Result<Self, Error> {
        let begun = Instant::now();
        loop {
            match Self::ask(file, disk)? {
                Self::Taken if begun.elapsed() < longest => std::thread::sleep(AGAIN),
                answer => return Ok(answer),
            }
        }
    }
}

fn open(file: &Path) -> Result<File, Error> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false);
    #[cfg(unix)]
    {
        use rustix::fs::OFlags;
        use std::os::unix::fs::OpenOptionsExt as _;
        // A pipe in the file's place must not block the process.
        options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32);
    }
    #[cfg(windows)]
    {
        use std::os::windows::fs::OpenOptionsExt as _;
        const FILE_FLAG_OPEN_REPARSE_POINT: u32 = 0x0020_0000;
        options.custom_flags(FILE_FLAG_OPEN_REPARSE_POINT);
    }
    let refused = |problem: &str| Error::io(file, "lock")(io::Error::new(io::ErrorKind::InvalidInput, problem));
    let is_link = || file.symlink_metadata().is_ok_and(|found| found.file_type().is_symlink());
    match options.open(file) {
        Err(_) if is_link() => Err(refused("this is a link, and would be followed; remove it")),
        Err(e) => Err(Error::io(file, "open")(e)),
        Ok(_) if is_link() => Err(refused("this is a link, and would be followed; remove it")),
        Ok(opened) => match opened.metadata().map_err(Error::io(file, "open"))?.is_file() {
            true => Ok(opened),
            false => Err(refused("this is not a regular file; remove it")),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::disk::System;

    /// A disk whose locks fail with a system error.
    #[cfg(unix)]
    struct WithoutLocks(rustix::io::Errno);

    #[cfg(unix)]
    impl Disk for WithoutLocks {
        fn flush_file(&self, _: &File) -> io::Result<()> {
            Ok(())
        }
        fn flush_folder(&self, _: &Path) -> io::Result<()> {
            Ok(())
        }
        fn try_lock(&self, _: &File) -> Result<(), TryLockError> {
            Err(TryLockError::Error(self.0.into()))
        }
    }

    #[test]
    fn a_lock_keeps_the_content_of_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("lock");
        std::fs::write(&file, "notes").unwrap();
        let held = Lock::ask(&file, &System).unwrap();
        assert!(matches!(held, Lock::Held(_)));
        assert!(matches!(Lock::ask(&file, &System).unwrap(), Lock::Taken));
        assert!(matches!(Lock::wait(&file, &System, Duration::from_millis(30)).unwrap(), Lock::Taken));
        drop(held);
        assert!(matches!(Lock::ask(&file, &System).unwrap(), Lock::Held(_)));
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "notes");
    }

    #[cfg(unix)]
    #[test]
    fn a_lock_that_is_a_link_is_refused_and_its_target_kept() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let (target, missing) = (folder.path().join("thesis.txt"), folder.path().join("missing"));
        std::fs::write(&target, "years of work").unwrap();
        for (name, to) in [("a", &target), ("b", &missing)] {
            let link = folder.path().join(name);
            symlink(to, &link).unwrap();
            let error = Lock::ask(&link, &System).unwrap_err().to_string();
            assert!(error.contains("this is a link") && error.contains("remove it"), "{error}");
        }
        assert_eq!(std::fs::read_to_string(&target).unwrap(), "years of work");
        assert!(!missing.exists(), "the file that a link names was made");
        let error = Lock::ask(folder.path(), &System).unwrap_err().to_string();
        assert!(error.contains("irectory"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn a_lock_without_support_is_told_and_other_errors_remain() {
        use rustix::io::Errno;
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("lock");
        for refusal in [Errno::NOLCK, Errno::NOTSUP, Errno::OPNOTSUPP, Errno::NOSYS] {
            let answer = Lock::ask(&file, &WithoutLocks(refusal)).unwrap();
            assert!(matches!(answer, Lock::Unsupported(_)), "{refusal}: {answer:?}");
        }
        assert!(Lock::ask(&file, &WithoutLocks(Errno::IO)).is_err());
    }
}
