//! Temporary files, which become outputs.

use super::destination::folder_of;
use crate::error::{Error, Result};
use std::fs::{File, TryLockError};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tempfile::{NamedTempFile, TempPath};

/// The temporary names that a process has given. Some of them may be taken back already.
pub(super) struct Names(Mutex<Vec<PathBuf>>);

/// Those of this process.
pub(super) static NAMES: Names = Names(Mutex::new(Vec::new()));

impl Names {
    /// As long as the answer lives, no thread gives a file a name or removes names. Outputs that replace their
    /// files meanwhile do so together.
    pub(super) fn hold(&self) -> MutexGuard<'_, Vec<PathBuf>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes the name that `make` gives.
    fn note<T>(&self, make: impl FnOnce() -> Result<T>, name: impl Fn(&T) -> &Path) -> Result<T> {
        let mut names = self.hold();
        names.retain(|name| name.exists());
        let made = make()?;
        names.push(name(&made).to_path_buf());
        Ok(made)
    }

    /// Removes all files under temporary names. As long as the answer lives, no file gets a name and none is
    /// replaced.
    fn remove_all(&self) -> MutexGuard<'_, Vec<PathBuf>> {
        let names = self.hold();
        for name in names.iter() {
            let _ = std::fs::remove_file(name);
        }
        names
    }
}

/// Removes this process's temporary files, just before it ends. As long as the answer lives, no output is written
/// to its end.
pub(crate) fn remove_temporary_files() -> MutexGuard<'static, Vec<PathBuf>> {
    NAMES.remove_all()
}

/// An output on the disk that has no name of its own yet. As long as it has none at all, it is gone with the
/// process, however that ends.
pub(super) struct Staged {
    file: File,
    /// Where the system knows no files without a name.
    name: Option<TempPath>,
    target: PathBuf,
    path: PathBuf,
}

/// An output under a temporary name. The file is locked until the end: a leftover is one that nobody locks.
pub(super) struct Named {
    pub(super) name: TempPath,
    pub(super) target: PathBuf,
    pub(super) path: PathBuf,
    _file: File,
}

pub(super) fn failed(path: &Path) -> impl Fn(std::io::Error) -> Error {
    |e| {
        let remedy = match e.kind() {
            ErrorKind::FileTooLarge => "raise the limit of what a file may take (`ulimit -f`)",
            _ => "check the disk's space and the permissions",
        };
        Error::io(path, "write the file", &e).remedy(remedy)
    }
}

/// Writes a file that has no name yet and will replace `target`, and waits until it is on the disk. Errors name the
/// `path` that was given for it.
///
/// # Errors
/// Whatever the system says.
pub(super) fn stage(path: &Path, target: PathBuf, bytes: &[u8]) -> Result<Staged> {
    let unnamed = unnamed(folder_of(&target));
    stage_in(unnamed, path, target, bytes)
}

fn stage_in(unnamed: Option<File>, path: &Path, target: PathBuf, bytes: &[u8]) -> Result<Staged> {
    let (mut file, name) = match unnamed {
        Some(file) => {
            let _ = file.try_lock();
            (file, None)
        }
        None => {
            let make = || part().tempfile_in(folder_of(&target)).map_err(failed(path));
            let (file, name) = locked(make)?.into_parts();
            (file, Some(name))
        }
    };
    // An existing file's permissions stay.
    if let Ok(existing) = std::fs::metadata(&target) {
        file.set_permissions(existing.permissions()).map_err(failed(path))?;
    }
    file.write_all(bytes).and_then(|()| file.sync_all()).map_err(failed(path))?;
    Ok(Staged { file, name, target, path: path.to_path_buf() })
}

/// A locked file under a temporary name. In the moment before it is locked another run may take it for a leftover;
/// then another one is made.
fn locked(mut make: impl FnMut() -> Result<NamedTempFile>) -> Result<NamedTempFile> {
    loop {
        let made = NAMES.note(&mut make, |made| made.path())?;
        // Where the system knows no locks nobody can lock it to remove it either.
        let is_held = matches!(made.as_file().try_lock(), Err(TryLockError::WouldBlock));
        if !is_held && made.path().exists() {
            return Ok(made);
        }
    }
}

impl Staged {
    /// # Errors
    /// Whatever the system says.
    pub(super) fn named(self) -> Result<Named> {
        let Staged { file, name, target, path } = self;
        let linked = || {
            let linked = part().make_in(folder_of(&target), |name| link(&file, name));
            linked.map_err(failed(&path))
        };
        let name = match name {
            Some(name) => name,
            None => NAMES.note(linked, |linked| linked.path())?.into_temp_path(),
        };
        Ok(Named { name, target, path, _file: file })
    }
}

const PREFIX: &str = ".isolux-";
/// No output of this program ends so.
const SUFFIX: &str = ".tmp";
/// This many random letters and digits stand between them.
const RANDOM: usize = 12;

/// Makes temporary names.
fn part() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX).suffix(SUFFIX).rand_bytes(RANDOM);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // The user's umask takes its part off.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder
}

/// A file without a name; `None` where the system or the folder's file system knows none.
#[cfg(target_os = "linux")]
fn unnamed(folder: &Path) -> Option<File> {
    use std::os::unix::fs::OpenOptionsExt;
    let flags = rustix::fs::OFlags::TMPFILE.bits() as i32;
    // The link below goes by /proc.
    let options = Path::new("/proc/self/fd").is_dir().then(|| {
        let mut options = File::options();
        options.write(true).mode(0o666).custom_flags(flags);
        options
    });
    options?.open(folder).ok()
}

#[cfg(not(target_os = "linux"))]
fn unnamed(_: &Path) -> Option<File> {
    None
}

/// Gives a file without a name one that no file has.
#[cfg(target_os = "linux")]
fn link(file: &File, name: &Path) -> std::io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};
    use std::os::fd::AsRawFd;
    let from = format!("/proc/self/fd/{}", file.as_raw_fd());
    Ok(linkat(CWD, from, CWD, name, AtFlags::SYMLINK_FOLLOW)?)
}

#[cfg(not(target_os = "linux"))]
fn link(_: &File, _: &Path) -> std::io::Result<()> {
    Err(std::io::ErrorKind::Unsupported.into())
}

/// Removes what runs that were killed have left in a folder. Files that another run writes are locked.
pub(super) fn remove_leftovers(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let is_part = entry.file_name().to_str().is_some_and(is_temporary);
        if !is_part || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        let Ok(file) = File::open(entry.path()) else { continue };
        // Locked until the name is gone, so that the run that has just made it sees that it is taken.
        if file.try_lock().is_ok() {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Whether [`part`] makes such names. Others are the user's.
fn is_temporary(name: &str) -> bool {
    let random = name.strip_prefix(PREFIX).and_then(|rest| rest.strip_suffix(SUFFIX));
    random.is_some_and(|r| r.len() == RANDOM && r.bytes().all(|b| b.is_ascii_alphanumeric()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_run_removes_what_a_killed_one_left_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let [left, held] = [".isolux-aB0123456789.tmp", ".isolux-bbbbbbbbbbbb.tmp"].map(at);
        let foreign = [
            "a.tmp",
            ".isolux-room.tmp",
            ".isolux-my_one_room1.tmp",
            ".isolux-tmp",
            ".isolux-aB0123456789.part",
            ".isolux-abcdefghijklm.tmp",
        ]
        .map(at);
        [&left, &held]
            .into_iter()
            .chain(&foreign)
            .for_each(|path| std::fs::write(path, "x").unwrap());
        let holder = File::open(&held).unwrap();
        holder.lock().unwrap();
        remove_leftovers(folder.path());
        assert!(!left.exists() && held.exists() && foreign.iter().all(|path| path.exists()));
    }

    #[test]
    fn the_names_that_are_made_are_known_again() {
        let folder = tempfile::tempdir().unwrap();
        for _ in 0..100 {
            let made = part().tempfile_in(folder.path()).unwrap();
            assert!(is_temporary(made.path().file_name().unwrap().to_str().unwrap()));
        }
    }

    #[test]
    fn a_new_file_that_another_run_takes_for_a_leftover_is_made_anew() {
        let folder = tempfile::tempdir().unwrap();
        let (mut made, mut remover) = (0, None);
        let make = || {
            let file = part().tempfile_in(folder.path()).map_err(failed(folder.path()))?;
            made += 1;
            match made {
                1 => remove_leftovers(folder.path()),
                // Another run is about to remove it.
                2 => remover = File::open(file.path()).ok().filter(|file| file.try_lock().is_ok()),
                _ => {}
            }
            Ok(file)
        };
        let file = locked(make).unwrap();
        assert!(remover.is_some());
        assert_eq!(made, 3);
        remove_leftovers(folder.path());
        assert!(file.path().exists());
    }

    #[test]
    fn without_files_that_have_no_name_runs_in_one_folder_leave_each_other_alone() {
        let folder = tempfile::tempdir().unwrap();
        let is_over = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !is_over.load(std::sync::atomic::Ordering::SeqCst) {
                    remove_leftovers(folder.path());
                }
            });
            for k in 0..200 {
                let target = folder.path().join(format!("{k}.png"));
                let written =
                    stage_in(None, &target, target.clone(), b"new").and_then(Staged::named);
                let is_there = written.is_ok_and(|named| named.name.persist(&named.target).is_ok());
                assert!(
                    is_there || {
                        is_over.store(true, std::sync::atomic::Ordering::SeqCst);
                        false
                    },
                    "{k}"
                );
            }
            is_over.store(true, std::sync::atomic::Ordering::SeqCst);
        });
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_is_staged_has_no_name_that_could_outlive_the_process() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let staged = stage(&path, path.clone(), b"new").unwrap();
        let names = || std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(names(), staged.name.is_some() as usize);
        let named = staged.named().unwrap();
        assert_eq!(names(), 1);
        drop(named);
        assert_eq!(names(), 0);
    }

    #[test]
    fn who_removes_all_names_keeps_others_from_giving_new_ones() {
        let folder = tempfile::tempdir().unwrap();
        let names = Names(Mutex::new(Vec::new()));
        let make = || part().tempfile_in(folder.path()).map_err(failed(folder.path()));
        let gone = names.note(make, |made| made.path()).unwrap();
        drop(gone);
        let made = names.note(make, |made| made.path()).unwrap();
        assert_eq!(*names.hold(), [made.path()], "what is gone is forgotten");
        let held = names.remove_all();
        assert!(!made.path().exists() && names.0.try_lock().is_err());
        drop(held);
    }
}
