//! Output files that appear whole or not at all.

use crate::error::{Error, ErrorKind, Result};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// A file to be written.
pub(crate) struct Output {
    pub path: PathBuf,
    pub bytes: Vec<u8>,
}

/// Refuses an output path before any work is done for it: a folder that is not there or may not be
/// written, or a path that is itself a folder.
///
/// # Errors
/// With the path and the remedy.
pub(crate) fn check_writable(path: &Path) -> Result<()> {
    if path.is_dir() || path.file_name().is_none() {
        return Err(Error::new("this is a folder, not a file")
            .in_file(path)
            .remedy("name a file in it"));
    }
    if is_special(path) {
        return Ok(());
    }
    if path.is_symlink() && !path.exists() {
        return Err(Error::new("this is a link to nothing")
            .in_file(path)
            .remedy("delete the link, or create what it points to"));
    }
    let folder = folder_of(path);
    if !folder.is_dir() {
        return Err(Error::new(format!("the folder {} does not exist", folder.display()))
            .in_file(path)
            .remedy("create it, or write elsewhere"));
    }
    refuse_read_only(path)?;
    let target = target_of(path);
    remove_leftovers(folder_of(&target));
    stage(path, &[])?.named().map(drop)
}

/// Renaming a file over another asks for no permission to write the other.
fn refuse_read_only(path: &Path) -> Result<()> {
    match std::fs::metadata(path) {
        Ok(kind) if kind.permissions().readonly() => {
            Err(Error::new("the file is there, and may not be written")
                .of_kind(ErrorKind::System)
                .in_file(path)
                .remedy("give another name, or allow writing"))
        }
        _ => Ok(()),
    }
}

/// Refuses outputs that would overwrite each other or one of the inputs.
///
/// # Errors
/// With the path and the remedy.
pub(crate) fn check_distinct(outputs: &[&Path], inputs: &[&Path]) -> Result<()> {
    let is_same = |a: &Path, b: &Path| place_of(a) == place_of(b) || is_one_file(a, b);
    for (i, output) in outputs.iter().enumerate() {
        let mut others = outputs[..i].iter().chain(inputs);
        if let Some(other) = others.find(|other| !is_special(output) && is_same(output, other)) {
            return Err(Error::new(format!("this output would overwrite {}", other.display()))
                .in_file(output)
                .remedy("give it a name of its own"));
        }
    }
    Ok(())
}

/// A file that is not there yet is known by its folder and name.
fn place_of(path: &Path) -> Option<PathBuf> {
    let new = || Some(std::fs::canonicalize(folder_of(path)).ok()?.join(path.file_name()?));
    std::fs::canonicalize(path).ok().or_else(new)
}

/// Whether two names are of one file, as hard links are.
fn is_one_file(a: &Path, b: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let identity = |path| std::fs::metadata(path).ok().map(|m| (m.dev(), m.ino()));
        identity(a).is_some() && identity(a) == identity(b)
    }
    #[cfg(not(unix))]
    {
        let _ = (a, b);
        false
    }
}

/// Writes every output to a file without a name in its folder, then those to devices and pipes. Only when all
/// are on the disk do they get names: first temporary ones, then their own. If anything fails before the last
/// step, no existing file has changed.
///
/// # Errors
/// Whatever the system says: a full disk, a missing permission. If the last step fails for one of several
/// outputs, the error says which ones are new.
pub(crate) fn write_all(outputs: Vec<Output>) -> Result<()> {
    let (special, plain): (Vec<_>, Vec<_>) = outputs.into_iter().partition(|o| is_special(&o.path));
    let staged = plain.iter().map(|output| stage(&output.path, &output.bytes));
    let staged = staged.collect::<Result<Vec<_>>>()?;
    for output in special {
        std::fs::write(&output.path, &output.bytes)
            .map_err(|e| Error::io(&output.path, "write the file", &e))?;
    }
    rename_all(staged.into_iter().map(Staged::named).collect::<Result<_>>()?)
}

fn rename_all(named: Vec<Named>) -> Result<()> {
    // What changed while the run computed is found before anything is replaced.
    for Named { path, target, .. } in &named {
        refuse_read_only(path)?;
        if target.is_dir() {
            return Err(Error::new("this has become a folder").in_file(path));
        }
    }
    let mut new: Vec<String> = Vec::new();
    for Named { name, target, path, .. } in named {
        if let Err(e) = name.persist(&target) {
            let error = Error::io(&path, "write the file", &e.error);
            return Err(match new.is_empty() {
                true => error,
                false => error.remedy(format!(
                    "{} is new already, and the outputs from this one on are not",
                    new.join(", ")
                )),
            });
        }
        new.push(path.display().to_string());
    }
    Ok(())
}

/// An output on the disk that has no name of its own yet. As long as it has none at all, it is gone with the
/// process, however that ends.
struct Staged {
    file: File,
    /// Where the system knows no files without a name.
    name: Option<TempPath>,
    /// A link stays a link: what it points to is replaced.
    target: PathBuf,
    path: PathBuf,
}

/// An output under a temporary name. The file is locked until the end: a leftover is one that nobody locks.
struct Named {
    name: TempPath,
    target: PathBuf,
    path: PathBuf,
    _file: File,
}

fn failed(path: &Path) -> impl Fn(std::io::Error) -> Error {
    |e| Error::io(path, "write the file", &e).remedy("check the disk's space and the permissions")
}

fn stage(path: &Path, bytes: &[u8]) -> Result<Staged> {
    let target = target_of(path);
    let folder = folder_of(&target);
    let (mut file, name) = match unnamed(folder) {
        Some(file) => (file, None),
        None => {
            let (file, name) = part().tempfile_in(folder).map_err(failed(path))?.into_parts();
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
    fn named(self) -> Result<Named> {
        let Staged { file, name, target, path } = self;
        let linked = || part().make_in(folder_of(&target), |name| link(&file, name));
        let name = match name {
            Some(name) => name,
            None => linked().map_err(failed(&path))?.into_temp_path(),
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
fn remove_leftovers(folder: &Path) {
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

fn target_of(path: &Path) -> PathBuf {
    std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf())
}

/// A device or a pipe, which is written to and never replaced.
fn is_special(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir())
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn output(path: &Path, bytes: &[u8]) -> Output {
        Output { path: path.to_path_buf(), bytes: bytes.to_vec() }
    }

    #[test]
    fn a_failure_changes_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let good = folder.path().join("good.png");
        std::fs::write(&good, "old").unwrap();
        let bad = folder.path().join("missing/bad.png");
        assert!(write_all(vec![output(&good, b"new"), output(&bad, b"new")]).is_err());
        assert_eq!(std::fs::read(&good).unwrap(), b"old");
        let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
        assert_eq!(left.len(), 1, "no temporary file stays");
        write_all(vec![output(&good, b"new")]).unwrap();
        assert_eq!(std::fs::read(&good).unwrap(), b"new");
    }

    #[test]
    fn folders_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        assert!(check_writable(folder.path()).is_err());
        assert!(check_writable(&folder.path().join("missing/a.png")).is_err());
        assert!(check_writable(&folder.path().join("a.png")).is_ok());
        assert!(check_writable(Path::new("")).is_err());
    }

    #[test]
    fn outputs_must_differ_from_each_other_and_from_the_inputs() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
        let dotted = folder.path().join("./a");
        assert!(check_distinct(&[&a, &b], &[]).is_ok());
        assert!(check_distinct(&[&a, &dotted], &[]).is_err());
        assert!(check_distinct(&[&a], &[&b, &dotted]).is_err());
        assert!(check_distinct(&[Path::new("/dev/null"); 2], &[]).is_ok());
    }

    #[cfg(unix)]
    #[test]
    fn a_hard_link_to_an_input_is_that_input() {
        let folder = tempfile::tempdir().unwrap();
        let [input, link] = ["in.mtl", "out.png"].map(|name| folder.path().join(name));
        std::fs::write(&input, "newmtl a").unwrap();
        std::fs::hard_link(&input, &link).unwrap();
        assert!(check_distinct(&[&link], &[&input]).is_err());
    }

    #[test]
    fn a_file_that_may_not_be_written_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("kept.png");
        std::fs::write(&path, "old").unwrap();
        let mut permissions = std::fs::metadata(&path).unwrap().permissions();
        permissions.set_readonly(true);
        std::fs::set_permissions(&path, permissions).unwrap();
        assert!(check_writable(&path).is_err());
        assert!(write_all(vec![output(&path, b"new")]).is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn outputs_appear_together_or_the_error_says_which_are_new() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a.png", "b.json"].map(|name| folder.path().join(name));
        std::fs::write(&a, "old").unwrap();
        // One becomes a folder during the run.
        std::fs::create_dir(&b).unwrap();
        assert!(write_all(vec![output(&a, b"new"), output(&b, b"new")]).is_err());
        assert_eq!(std::fs::read(&a).unwrap(), b"old");
        std::fs::remove_dir(&b).unwrap();
        let named = |path: &Path| stage(path, b"new").and_then(Staged::named).unwrap();
        let gone = named(&b);
        std::fs::remove_file(&gone.name).unwrap();
        let error = rename_all(vec![named(&a), gone]).unwrap_err().to_string();
        assert!(error.contains("a.png is new already"), "{error}");
        assert_eq!(std::fs::read(&a).unwrap(), b"new");
    }

    #[test]
    fn the_next_run_removes_what_a_killed_one_left_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let [left, held, foreign, path] =
            [".isolux-aaaaaa.part", ".isolux-bbbbbb.part", "a.part", "a.png"]
                .map(|name| folder.path().join(name));
        [&left, &held, &foreign].iter().for_each(|path| std::fs::write(path, "x").unwrap());
        let holder = File::open(&held).unwrap();
        holder.lock().unwrap();
        check_writable(&path).unwrap();
        assert!(!left.exists() && held.exists() && foreign.exists() && !path.exists());
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

    #[cfg(unix)]
    #[test]
    fn a_link_is_followed_and_a_device_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let (target, link) = (folder.path().join("target"), folder.path().join("link"));
        std::fs::write(&target, "old").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        write_all(vec![output(&link, b"new")]).unwrap();
        assert_eq!(std::fs::read(&target).unwrap(), b"new");
        assert!(link.is_symlink());
        write_all(vec![output(Path::new("/dev/null"), b"new")]).unwrap();
        assert!(is_special(Path::new("/dev/null")));
    }
}
