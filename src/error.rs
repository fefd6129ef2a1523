//! Failures, reported so that the reader can fix them: where, why, and what to do.

use std::fmt::{self, Write};
use std::path::{Path, PathBuf};

/// A failure of the user's input or surroundings: `file:line: cause`, then the remedy. Where a file has
/// several, the first is the one, and the others follow it, a line each.
///
/// A miss of a ray is `None` and a bug is a panic; only what a user can fix becomes an `Error`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct Error {
    kind: ErrorKind,
    file: Option<PathBuf>,
    line: Option<usize>,
    cause: String,
    remedy: Option<String>,
    /// Whether a file is to blame, whatever else is asked for.
    is_of_a_file: bool,
    /// Further failures of one file, as they are shown.
    others: Vec<String>,
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
        Error {
            kind,
            file: None,
            line: None,
            cause: cause.into(),
            remedy: None,
            is_of_a_file: false,
            others: Vec::new(),
        }
    }

    /// An operating system's refusal to read or write `file`.
    pub fn io(file: &Path, doing: &str, error: &std::io::Error) -> Self {
        let kind = match error.kind() {
            std::io::ErrorKind::OutOfMemory => ErrorKind::Memory,
            _ => ErrorKind::System,
        };
        Error::new(format!("cannot {doing}: {error}")).of_kind(kind).in_file(file)
    }

    /// The end of a computation that was asked to stop.
    pub fn stopped() -> Self {
        Error::new("stopped before the end").of_kind(ErrorKind::Stopped)
    }

    pub fn kind(&self) -> ErrorKind {
        self.kind
    }

    /// Why, without the place and the remedy.
    pub fn cause(&self) -> &str {
        &self.cause
    }

    /// Counts from 1.
    pub(crate) fn line(&self) -> Option<usize> {
        self.line
    }

    pub fn of_kind(mut self, kind: ErrorKind) -> Self {
        self.kind = kind;
        self
    }

    pub fn in_file(mut self, file: &Path) -> Self {
        self.file = Some(file.to_path_buf());
        self
    }

    /// Says that a file asks for too much: what is asked for besides makes no difference.
    pub(crate) fn of_a_file(mut self) -> Self {
        self.is_of_a_file = true;
        self
    }

    pub(crate) fn is_of_a_file(&self) -> bool {
        self.is_of_a_file
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

    /// One error of several; `None` of none. Those beyond the first twenty are only counted.
    pub(crate) fn all(errors: Vec<Error>) -> Option<Error> {
        const SHOWN: usize = 20;
        let count = errors.len();
        let mut errors = errors.into_iter();
        let mut first = errors.next()?;
        let in_one_line = |error: Error| Error { remedy: None, ..error }.to_string();
        first.others = errors.take(SHOWN - 1).map(in_one_line).collect();
        if count > SHOWN {
            first.others.push(format!("and {} more", count - SHOWN));
        }
        Some(first)
    }

    /// Says what the user can do about it, as an imperative sentence without a full stop.
    pub fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = Some(remedy.into());
        self
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let f = &mut Escaped(f);
        write_place(f, self.file.as_deref(), self.line)?;
        f.write_str(&self.cause)?;
        if let Some(remedy) = &self.remedy {
            write!(f, "\n  help: {remedy}")?;
        }
        self.others.iter().try_for_each(|other| write!(f, "\n{other}"))
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
        let f = &mut Escaped(f);
        write_place(f, self.file.as_deref(), self.line)?;
        f.write_str(&self.text)
    }
}

/// Text without what would speak to a terminal: control characters, and those that turn the direction of
/// writing, are escaped. Lines stay lines.
pub(crate) fn printable(text: &str) -> String {
    let mut printable = String::with_capacity(text.len());
    let _ = Escaped(&mut printable).write_str(text);
    printable
}

/// As [`printable`], of a path, a title or a word, which must not begin a line of its own either.
pub(crate) fn in_one_line(text: &str) -> String {
    printable(text).replace('\n', "\\n")
}

/// Paths, names and words of a file are part of messages: their control characters must not reach a terminal.
struct Escaped<W>(W);

impl<W: Write> Write for Escaped<W> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        text.chars().try_for_each(|c| match c {
            '\n' => self.0.write_char(c),
            '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => {
                write!(self.0, "{}", c.escape_unicode())
            }
            _ if c.is_control() => write!(self.0, "{}", c.escape_default()),
            _ => self.0.write_char(c),
        })
    }
}

fn write_place(f: &mut impl Write, file: Option<&Path>, line: Option<usize>) -> fmt::Result {
    let file = file.map(|file| in_one_line(&file.to_string_lossy()));
    match (file, line) {
        (Some(file), Some(line)) => write!(f, "{file}:{line}: "),
        (Some(file), None) => write!(f, "{file}: "),
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

    #[test]
    fn no_message_speaks_to_the_terminal() {
        let place = Path::new("ä\u{1b}[31m\\b.obj");
        let error = Error::new("no `\u{7}`").in_file(place).remedy("do\r this");
        assert_eq!(error.to_string(), "ä\\u{1b}[31m\\b.obj: no `\\u{7}`\n  help: do\\r this");
        let warning = Warning::in_file(place, Some(3), "\u{9b}");
        assert_eq!(warning.to_string(), "ä\\u{1b}[31m\\b.obj:3: \\u{9b}");
        let lines = Error::new("no").in_file(Path::new("a\nerror: \u{202e}b"));
        assert_eq!(lines.to_string(), "a\\nerror: \\u{202e}b: no");
    }

    #[test]
    fn several_errors_are_told_in_one_and_the_rest_counted() {
        assert_eq!(Error::all(vec![]), None);
        let at =
            |line| Error::new("bad").in_file(Path::new("a.obj")).at_line(line).remedy("fix it");
        let two = Error::all(vec![at(1), at(2)]).expect("two").to_string();
        assert_eq!(two, "a.obj:1: bad\n  help: fix it\na.obj:2: bad");
        let many = Error::all((1..=25).map(at).collect()).expect("many").to_string();
        assert_eq!(many.lines().count(), 22);
        assert!(many.ends_with("a.obj:20: bad\nand 5 more"), "{many}");
    }
}
