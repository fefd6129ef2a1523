//! Failures, reported so that the reader can fix them: where, why, and what to do.

use std::fmt;
use std::path::{Path, PathBuf};

/// A failure of the user's input or surroundings: `file:line: cause`, then the remedy.
///
/// A miss of a ray is `None` and a bug is a panic; only what a user can fix becomes an `Error`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct Error {
    kind: ErrorKind,
    file: Option<PathBuf>,
    line: Option<usize>,
    cause: String,
    remedy: Option<String>,
}

/// The kind of failure that an [`Error`] is, for programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ErrorKind {
    /// A file or a value that has no meaning.
    Input,
    /// A refusal by the operating system.
    System,
    /// More patches than can be numbered.
    Patches,
    /// More memory than there is.
    Memory,
    /// Nothing in the scene emits light.
    Dark,
    /// Light that does not converge.
    Divergence,
    /// [`Progress::is_stopped`](crate::progress::Progress::is_stopped) said so.
    Stopped,
}

pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// A failure that concerns no file in particular.
    pub fn new(cause: impl Into<String>) -> Self {
        let kind = ErrorKind::Input;
        Error { kind, file: None, line: None, cause: cause.into(), remedy: None }
    }

    /// An operating system's refusal to read or write `file`.
    pub fn io(file: &Path, doing: &str, error: &std::io::Error) -> Self {
        Error::new(format!("cannot {doing}: {error}")).of_kind(ErrorKind::System).in_file(file)
    }

    /// The end of a computation that was asked to stop.
    pub fn stopped() -> Self {
        Error::new("stopped before the end").of_kind(ErrorKind::Stopped)
    }

    pub fn kind(&self) -> ErrorKind {
        self.kind
    }

    pub fn of_kind(mut self, kind: ErrorKind) -> Self {
        self.kind = kind;
        self
    }

    pub fn in_file(mut self, file: &Path) -> Self {
        self.file = Some(file.to_path_buf());
        self
    }

    /// Says which input the failure concerns, where nothing more exact is known.
    pub fn in_file_if_none(self, file: &Path) -> Self {
        if self.file.is_some() { self } else { self.in_file(file) }
    }

    /// `line` counts from 1.
    pub fn at_line(mut self, line: usize) -> Self {
        self.line = Some(line);
        self
    }

    /// Says what the user can do about it, as an imperative sentence without a full stop.
    pub fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = Some(remedy.into());
        self
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_place(f, self.file.as_deref(), self.line)?;
        f.write_str(&self.cause)?;
        match &self.remedy {
            Some(remedy) => write!(f, "\n  help: {remedy}"),
            None => Ok(()),
        }
    }
}

/// Something that was put right by a stated default: reported, never fatal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Warning {
    pub file: Option<PathBuf>,
    pub line: Option<usize>,
    pub text: String,
}

impl Warning {
    pub fn new(text: impl Into<String>) -> Self {
        Warning { file: None, line: None, text: text.into() }
    }

    pub fn in_file(file: &Path, line: Option<usize>, text: impl Into<String>) -> Self {
        Warning { file: Some(file.to_path_buf()), line, text: text.into() }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_place(f, self.file.as_deref(), self.line)?;
        f.write_str(&self.text)
    }
}

fn write_place(
    f: &mut fmt::Formatter<'_>,
    file: Option<&Path>,
    line: Option<usize>,
) -> fmt::Result {
    match (file, line) {
        (Some(file), Some(line)) => write!(f, "{}:{line}: ", file.display()),
        (Some(file), None) => write!(f, "{}: ", file.display()),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_reads_place_cause_remedy() {
        let error = Error::new("a face needs 3 vertices, this one has 2")
            .in_file(Path::new("room.obj"))
            .at_line(7)
            .remedy("delete the line or complete the face");
        assert_eq!(
            error.to_string(),
            "room.obj:7: a face needs 3 vertices, this one has 2\n  \
             help: delete the line or complete the face"
        );
    }
}
