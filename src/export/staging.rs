//! Temporary files, which become outputs.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tempfile::TempPath;

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

fn failed(path: &Path) -> impl Fn(std::io::Error) -> Error {
    |e| {
        let remedy = match e.kind() {
            ErrorKind::FileTooLarge => "raise the limit of what a file may take (`ulimit -f`)",
            _ => "check the disk's space and the permissions",
        };
        Error::io(path, "write the file", &e).remedy(remedy)
    }
}

/// Writes a file that has no name yet, and waits until it is on the disk.
///
/// # Errors
/// Whatever the system says.
pub(super) fn stage(path: &Path, bytes: &[u8]) -> Result<Staged> {
    let target = target_of(path);
    let folder = folder_of(&target);
    let (mut file, name) = match unnamed(folder) {
        Some(file) => (file, None),
        None => {
            let make = || part().tempfile_in(folder).map_err(failed(path));
            let (file, name) = NAMES.note(make, |made| made.path())?.into_parts();
            (file, Some(name))
        }
    };
    let _ = file.try_lock();
    // An existing file's permissions stay.
    if let Ok(existing) = std::fs::metadata(&target) {
        file.set_permissions(existing.permissions()).map_err(failed(path))?;
    }
    file.write_all(bytes).and_then(|()| file.sync_all()).map_err(failed(path))?;
    Ok(Staged { file, name, target, path: path.to_path_buf() })
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
const SUFFIX: &str = ".part";

/// Makes temporary names.
fn part() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX).suffix(SUFFIX);
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
        let name = entry.file_name();
        let is_part = name.to_str().is_some_and(|n| n.starts_with(PREFIX) && n.ends_with(SUFFIX));
        if is_part && entry.file_type().is_ok_and(|kind| kind.is_file()) {
            let file = File::open(entry.path());
            if file.is_ok_and(|file| file.try_lock().is_ok()) {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

/// The file that is replaced: a link stays, and what it points to is.
pub(super) fn target_of(path: &Path) -> PathBuf {
    std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf())
}

pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_run_removes_what_a_killed_one_left_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let [left, held, foreign] = [".isolux-aaaaaa.part", ".isolux-bbbbbb.part", "a.part"]
            .map(|name| folder.path().join(name));
        [&left, &held, &foreign].iter().for_each(|path| std::fs::write(path, "x").unwrap());
        let holder = File::open(&held).unwrap();
        holder.lock().unwrap();
        remove_leftovers(folder.path());
        assert!(!left.exists() && held.exists() && foreign.exists());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_is_staged_has_no_name_that_could_outlive_the_process() {
        let folder = tempfile::tempdir().unwrap();
        let staged = stage(&folder.path().join("a.png"), b"new").unwrap();
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
