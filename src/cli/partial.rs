//! What a long run has done so far, kept beside its output so that it can be gone on with.

use super::warn;
pub(super) use crate::begun::ANEW;
use crate::error::{Error, Result, Warning};
use crate::export::file::{self, Inputs, Output, write_all};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// At most this much work is lost, unless writing takes long.
const EVERY: Duration = Duration::from_secs(60);

/// The file FILE.partial of an output FILE.
pub(super) struct Partial {
    path: PathBuf,
    /// When it was tried the last time.
    kept: Instant,
    every: Duration,
    has_failed: bool,
}

impl Partial {
    pub(super) fn of(output: &Path) -> Partial {
        let mut path = output.as_os_str().to_owned();
        path.push(".partial");
        Partial { path: path.into(), kept: Instant::now(), every: EVERY, has_failed: false }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Refuses to replace what another run left, or somebody else's file.
    ///
    /// # Errors
    /// With the remedy.
    pub(super) fn check_absent(&self) -> Result<()> {
        if self.path.exists() {
            return Err(Error::new("this file is where the run would keep what is done")
                .in_file(&self.path)
                .remedy("go on with it by --resume if a run that was cut off left it, else move or delete it"));
        }
        Ok(())
    }

    /// Whether there is something to go on with.
    ///
    /// # Errors
    /// A link: where it leads may lie what somebody wants to keep, and in the end this file is removed.
    pub(super) fn is_begun(&self) -> Result<bool> {
        if self.path.exists() && self.path.is_symlink() {
            return Err(Error::new(
                "this is a link, and a run deletes the file that it went on from",
            )
            .in_file(&self.path)
            .remedy("put a copy of the file in its place"));
        }
        Ok(self.path.exists())
    }

    /// What was kept, by one of `Part::load` and `Begun::load`; `None` if nothing was.
    ///
    /// # Errors
    /// See these and [`is_begun`](Self::is_begun).
    pub(super) fn load<T>(&self, load: impl FnOnce(&Path) -> Result<T>) -> Result<Option<T>> {
        let load = || load(&self.path).map_err(|error| error.remedy(ANEW));
        self.is_begun()?.then(load).transpose()
    }

    /// Keeps what is done. Where that fails, for example since the disk is full, the run goes on without: a warning
    /// says so the first time.
    pub(super) fn keep(&mut self, bytes: Vec<u8>, inputs: &Inputs) {
        self.keep_if(Ok(bytes), inputs);
    }

    /// As [`keep`](Self::keep), where there may be no bytes to keep.
    pub(super) fn keep_if(&mut self, bytes: Result<Vec<u8>>, inputs: &Inputs) {
        let began = Instant::now();
        let output = |bytes| Output { path: self.path.clone(), bytes };
        let kept = bytes.and_then(|bytes| write_all(vec![output(bytes)], inputs));
        self.kept = Instant::now();
        // What takes long to write is written less often.
        self.every = EVERY.max(began.elapsed() * 20);
        match kept {
            Ok(()) => self.has_failed = false,
            Err(_) if self.has_failed => {}
            Err(error) => {
                self.has_failed = true;
                let text =
                    format!("{}; the run goes on, and what it has done is not kept", error.cause());
                warn(&[Warning::in_file(&self.path, None, text)]);
            }
        }
    }

    /// Whether what was to be kept the last time is not.
    pub(super) fn has_failed(&self) -> bool {
        self.has_failed
    }

    pub(super) fn is_due(&self) -> bool {
        Instant::now() >= self.due()
    }

    /// When something is to be kept again.
    pub(super) fn due(&self) -> Instant {
        self.kept + self.every
    }

    /// Once the output is there, nothing is left to go on with.
    pub(super) fn remove(&self) {
        file::remove(&self.path);
    }
}
