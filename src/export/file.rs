//! Output files that appear whole or not at all.

use crate::error::{Error, Result};
use std::io::Write;
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

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
    stage(path, &[]).map(drop)
}

/// Refuses outputs that would overwrite each other or one of the inputs.
///
/// # Errors
/// With the path and the remedy.
pub(crate) fn check_distinct(outputs: &[&Path], inputs: &[&Path]) -> Result<()> {
    // A file that is not there yet is known by its folder and name.
    let place = |path: &Path| {
        std::fs::canonicalize(path)
            .ok()
            .or_else(|| Some(std::fs::canonicalize(folder_of(path)).ok()?.join(path.file_name()?)))
    };
    for (i, output) in outputs.iter().enumerate() {
        let is_same = |other: &&&Path| !is_special(output) && place(other) == place(output);
        if let Some(other) = outputs[..i].iter().chain(inputs).find(is_same) {
            return Err(Error::new(format!("this output would overwrite {}", other.display()))
                .in_file(output)
                .remedy("give it a name of its own"));
        }
    }
    Ok(())
}

/// Writes every output under a temporary name beside it, then to devices and pipes, then renames
/// all. If anything fails before the first rename, no existing file has changed.
///
/// # Errors
/// Whatever the system says: a full disk, a missing permission.
pub(crate) fn write_all(outputs: Vec<Output>) -> Result<()> {
    let (special, plain): (Vec<_>, Vec<_>) = outputs.into_iter().partition(|o| is_special(&o.path));
    let staged: Vec<(NamedTempFile, PathBuf)> = plain
        .into_iter()
        .map(|output| Ok((stage(&output.path, &output.bytes)?, output.path)))
        .collect::<Result<_>>()?;
    for output in special {
        std::fs::write(&output.path, &output.bytes)
            .map_err(|e| Error::io(&output.path, "write the file", &e))?;
    }
    for (file, path) in staged {
        // A link stays a link: what it points to is replaced.
        let target = std::fs::canonicalize(&path).unwrap_or_else(|_| path.clone());
        file.persist(&target).map_err(|e| Error::io(&path, "write the file", &e.error))?;
    }
    Ok(())
}

fn stage(path: &Path, bytes: &[u8]) -> Result<NamedTempFile> {
    let failed = |e: std::io::Error| {
        Error::io(path, "write the file", &e).remedy("check the disk's space and the permissions")
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".isolux-").suffix(".part");
    let target = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // An existing file's permissions stay; of a new one the user's umask takes its part off.
        let usual = || std::fs::Permissions::from_mode(0o666);
        builder
            .permissions(std::fs::metadata(&target).map_or_else(|_| usual(), |m| m.permissions()));
    }
    let mut file = builder.tempfile_in(folder_of(&target)).map_err(failed)?;
    file.write_all(bytes).and_then(|()| file.flush()).map_err(failed)?;
    Ok(file)
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
