//! Output files that appear whole or not at all.

pub(crate) use super::destination::write_patiently;
use super::destination::{Destination, folder_of, is_character_device};
use super::staging::{NAMES, Named, Staged, failed, remove_leftovers, stage};
use crate::error::{Error, ErrorKind, Result};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

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
    let target = match Destination::of(path)? {
        Destination::File(target) => target,
        other => return other.check(path),
    };
    let folder = folder_of(&target);
    if !folder.is_dir() {
        return Err(Error::new(format!("the folder {} does not exist", folder.display()))
            .in_file(path)
            .remedy("create it, or write elsewhere"));
    }
    refuse_read_only(path)?;
    remove_leftovers(folder);
    stage(path, target, &[])?.named().map(drop)
}

/// Whether an output replaces a file. Others are added to what is open, or streamed.
pub(crate) fn is_replaced(path: &Path) -> bool {
    matches!(Destination::of(path), Ok(Destination::File(_)))
}

/// Removes an output, if it is there. A link that leads to it stays.
pub(crate) fn remove(path: &Path) {
    if let Ok(Destination::File(target)) = Destination::of(path) {
        let _ = std::fs::remove_file(target);
    }
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

/// Files that a run has read, as they were then: later another file may have the name, and a link may lead to them.
#[derive(Default)]
pub(crate) struct Inputs(Vec<(PathBuf, Place)>);

impl Inputs {
    pub(crate) fn new(paths: &[&Path]) -> Inputs {
        let mut inputs = Inputs::default();
        inputs.extend(paths);
        inputs
    }

    /// Adds what was read after the others.
    pub(crate) fn extend(&mut self, paths: &[impl AsRef<Path>]) {
        let paths = paths.iter().map(AsRef::as_ref);
        self.0.extend(paths.map(|path| (path.to_path_buf(), Place::of(path))));
    }

    /// Refuses outputs that would overwrite each other or one of the inputs.
    ///
    /// # Errors
    /// With the path and the remedy.
    pub(crate) fn check_distinct(&self, outputs: &[&Path]) -> Result<()> {
        let places: Vec<Place> = outputs.iter().map(|path| Place::of(path)).collect();
        for (i, output) in outputs.iter().enumerate().filter(|(_, path)| !is_character_device(path))
        {
            if let Some(other) = (0..i).find(|&other| places[other].is(&places[i])) {
                let other = outputs[other].display();
                let cause = format!("this output would overwrite another one, {other}");
                return Err(Error::new(cause)
                    .in_file(output)
                    .remedy("give each of them a name of its own"));
            }
            self.check(output, &places[i])?;
        }
        Ok(())
    }

    /// Refuses an output that would overwrite an input.
    fn check(&self, output: &Path, place: &Place) -> Result<()> {
        match self.0.iter().find(|(_, input)| input.is(place)) {
            None => Ok(()),
            Some((input, _)) => {
                Err(Error::new(format!("this output would overwrite {}", input.display()))
                    .in_file(output)
                    .remedy("give it a name of its own"))
            }
        }
    }
}

/// Where a file lies.
struct Place {
    /// Folder and name, without links. A file that is not there yet has them too.
    path: Option<PathBuf>,
    /// Hard links are one file.
    file: Option<Identity>,
}

impl Place {
    fn of(path: &Path) -> Place {
        let new = || match Destination::of(path) {
            Ok(Destination::File(target)) => Some(target),
            _ => None,
        };
        Place { path: std::fs::canonicalize(path).ok().or_else(new), file: identity(path) }
    }

    fn is(&self, other: &Place) -> bool {
        (self.path.is_some() && self.path == other.path)
            || (self.file.is_some() && self.file == other.file)
    }
}

/// A file's device and number, and when it came to be: the number of a file that is gone is given to another.
type Identity = (u64, u64, Option<SystemTime>);

#[cfg(unix)]
fn identity(path: &Path) -> Option<Identity> {
    use std::os::unix::fs::MetadataExt;
    std::fs::metadata(path).ok().map(|file| (file.dev(), file.ino(), file.created().ok()))
}

#[cfg(not(unix))]
fn identity(_: &Path) -> Option<Identity> {
    None
}

/// Writes the outputs that replace files to files without names in their folders, then the others to devices, pipes and
/// descriptors, whose readers may have had enough. Only when all are on the disk do the files get names: first
/// temporary ones, then their own. If anything fails before the last step, no existing file has changed.
///
/// # Errors
/// Whatever the system says: a full disk, a missing permission. If the last step fails for one of several
/// outputs, the error says which ones are new. An output that a link has led to one of the inputs meanwhile.
pub(crate) fn write_all(outputs: Vec<Output>, inputs: &Inputs) -> Result<()> {
    let (mut staged, mut others) = (Vec::new(), Vec::new());
    for output in &outputs {
        match Destination::of(&output.path)? {
            Destination::File(target) => staged.push(stage(&output.path, target, &output.bytes)?),
            other => others.push((output, other)),
        }
    }
    for (Output { path, bytes }, other) in others {
        match other.write(path, bytes) {
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => {}
            written => written.map_err(failed(path))?,
        }
    }
    rename_all(staged.into_iter().map(Staged::named).collect::<Result<_>>()?, inputs)
}

fn rename_all(named: Vec<Named>, inputs: &Inputs) -> Result<()> {
    // What changed while the run computed is found before anything is replaced.
    for Named { path, target, .. } in &named {
        refuse_read_only(path)?;
        inputs.check(path, &Place::of(target))?;
        if target.is_dir() {
            return Err(Error::new("this has become a folder").in_file(path));
        }
    }
    // A signal that ends the program waits until all are there.
    let _held = NAMES.hold();
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

#[cfg(test)]
mod tests {
    use super::*;

    fn write_all(outputs: Vec<Output>) -> Result<()> {
        super::write_all(outputs, &Inputs::default())
    }

    fn check_distinct(outputs: &[&Path], inputs: &[&Path]) -> Result<()> {
        Inputs::new(inputs).check_distinct(outputs)
    }

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
        let named =
            |path: &Path| stage(path, path.to_path_buf(), b"new").and_then(Staged::named).unwrap();
        let gone = named(&b);
        std::fs::remove_file(&gone.name).unwrap();
        let error = rename_all(vec![named(&a), gone], &Inputs::default()).unwrap_err().to_string();
        assert!(error.contains("a.png is new already"), "{error}");
        assert_eq!(std::fs::read(&a).unwrap(), b"new");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_that_leads_to_an_input_meanwhile_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let [input, old, link] = ["in.obj", "old.png", "out.png"].map(|n| folder.path().join(n));
        std::fs::write(&input, "v").unwrap();
        std::fs::write(&old, "old").unwrap();
        std::os::unix::fs::symlink(&old, &link).unwrap();
        let inputs = Inputs::new(&[&input]);
        inputs.check_distinct(&[&link]).unwrap();
        std::fs::remove_file(&link).unwrap();
        std::os::unix::fs::symlink(&input, &link).unwrap();
        let error = super::write_all(vec![output(&link, b"new")], &inputs).unwrap_err().to_string();
        assert!(error.contains("would overwrite"), "{error}");
        // Another file has the input's name by then.
        std::fs::rename(&input, &old).unwrap();
        assert!(super::write_all(vec![output(&old, b"new")], &inputs).is_err());
        assert_eq!(std::fs::read(&old).unwrap(), b"v");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_nothing_is_followed_and_what_it_names_is_created_and_removed() {
        let folder = tempfile::tempdir().unwrap();
        let [target, link, lost] = ["target", "link", "lost"].map(|name| folder.path().join(name));
        std::os::unix::fs::symlink("target", &link).unwrap();
        std::os::unix::fs::symlink("missing/target", &lost).unwrap();
        check_writable(&link).unwrap();
        assert!(check_distinct(&[&link, &target], &[]).is_err());
        write_all(vec![output(&link, b"new")]).unwrap();
        assert!(link.is_symlink());
        assert_eq!(std::fs::read(&target).unwrap(), b"new");
        remove(&link);
        assert!(link.is_symlink() && !target.exists());
        let error = check_writable(&lost).unwrap_err().to_string();
        assert!(error.contains("missing does not exist"), "{error}");
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
        assert!(is_character_device(Path::new("/dev/null")));
    }
}
