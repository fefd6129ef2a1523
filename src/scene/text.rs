//! Model files as text: whatever the bytes are, out come numbered lines, words and finite numbers.

use std::borrow::Cow;
use std::fmt;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::memory;

/// Largest magnitude that a number of a model may have. Products of a few such numbers, as in the
/// form-factor kernel, still fit into `f32`.
pub(crate) const LARGEST: f32 = 1e12;

/// A binary file shows within this number of bytes that it is not text.
const HEAD: usize = 4096;

/// The bytes of a regular file. Directories are refused, and pipes, devices and what the kernel answers itself
/// too, since reading one of those may never end; and so is what does not fit into memory, with
/// [`io::ErrorKind::OutOfMemory`].
pub(crate) fn read_bytes(path: &Path) -> io::Result<Vec<u8>> {
    read_bytes_if(path, |_| true)
}

/// As [`read_bytes`], of a text: one whose beginning is binary is not read further, and [`decode`] refuses it.
pub(in crate::scene) fn read_text_bytes(path: &Path) -> io::Result<Vec<u8>> {
    read_bytes_if(path, |head| utf_16(head).is_some() || !is_binary(head))
}

/// As [`read_bytes`], but only the beginning where that is not plausible.
pub(crate) fn read_bytes_if(
    path: &Path,
    is_plausible: impl Fn(&[u8]) -> bool,
) -> io::Result<Vec<u8>> {
    let kind = fs::metadata(path)?;
    if kind.is_dir() {
        return Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a directory"));
    }
    if !is_ordinary(path) {
        return Err(io::Error::other("it is not a regular file"));
    }
    let (mut file, mut bytes) = (fs::File::open(path)?, Vec::new());
    file.by_ref().take(HEAD as u64).read_to_end(&mut bytes)?;
    if is_plausible(&bytes) {
        memory::check("it", kind.len(), memory::available(), "")
            .map_err(|error| io::Error::new(io::ErrorKind::OutOfMemory, error.cause()))?;
        // Less may come than was there: a file may shrink meanwhile.
        file.read_to_end(&mut bytes)?;
    }
    Ok(bytes)
}

/// That `what` cannot be read, and what to do about it.
pub(crate) fn unread(path: &Path, what: &str, error: &io::Error) -> Error {
    let unread = Error::io(path, &format!("read {what}"), error);
    match error.kind() {
        io::ErrorKind::OutOfMemory => {
            unread.of_a_file().remedy("use a smaller file, or a machine with more memory")
        }
        _ => unread.remedy("check the path and its permissions"),
    }
}

/// Whether it is a file whose bytes lie on a disk or in memory.
pub(in crate::scene) fn is_ordinary(path: &Path) -> bool {
    let by_kernel = |path: PathBuf| path.starts_with("/proc") || path.starts_with("/sys");
    fs::metadata(path).is_ok_and(|kind| kind.is_file())
        && !fs::canonicalize(path).is_ok_and(by_kernel)
}

/// What a text should be.
#[derive(Debug, Clone, Copy)]
pub(in crate::scene) enum Format {
    Obj,
    Mtl,
    Stl,
    Toml,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Format::Obj => "a Wavefront OBJ file",
            Format::Mtl => "a Wavefront MTL file",
            Format::Stl => "an STL file as text",
            Format::Toml => "a scene description in TOML",
        })
    }
}

/// The text in `bytes`.
///
/// UTF-16 is read if it begins with a byte order mark. Bytes that are not UTF-8 are Windows-1252, in which
/// old exporters wrote. Fails where the beginning is binary.
pub(in crate::scene) fn decode(bytes: Vec<u8>, path: &Path, format: Format) -> Result<String> {
    if let Some(text) = utf_16(&bytes) {
        return Ok(text);
    }
    if is_binary(&bytes[..bytes.len().min(HEAD)]) {
        return Err(Error::new(format!("this does not look like {format}"))
            .in_file(path)
            .remedy(format!("give the path of {format}, in UTF-8")));
    }
    Ok(String::from_utf8(bytes).unwrap_or_else(|error| windows_1252(error.as_bytes())))
}

/// `None` without a byte order mark of UTF-16.
fn utf_16(bytes: &[u8]) -> Option<String> {
    let (mark, rest) = bytes.split_first_chunk::<2>()?;
    let unit: fn([u8; 2]) -> u16 = match mark {
        [0xff, 0xfe] => u16::from_le_bytes,
        [0xfe, 0xff] => u16::from_be_bytes,
        _ => return None,
    };
    let units: Vec<u16> = rest.as_chunks::<2>().0.iter().map(|pair| unit(*pair)).collect();
    Some(String::from_utf16_lossy(&units))
}

/// Windows-1252 is Latin-1, the first 256 characters of Unicode, but for 0x80 to 0x9F. The five bytes that have
/// no meaning there stay control characters (WHATWG Encoding Standard).
fn windows_1252(bytes: &[u8]) -> String {
    const FROM_0X80: [char; 32] = [
        '€', '\u{81}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{8d}', 'Ž',
        '\u{8f}', '\u{90}', '‘', '’', '“', '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{9d}',
        'ž', 'Ÿ',
    ];
    let character = |&byte: &u8| match byte {
        0x80..=0x9f => FROM_0X80[usize::from(byte - 0x80)],
        _ => char::from(byte),
    };
    bytes.iter().map(character).collect()
}

/// The lines of `text`, each with its number from 1. A line that ends in a backslash is joined
/// with the next one and keeps its own number.
pub(in crate::scene) fn numbered_lines(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    // Classic Mac OS ended its lines with a lone carriage return.
    let ending = if text.contains('\n') { '\n' } else { '\r' };
    let mut physical = (1..).zip(text.split(ending));
    std::iter::from_fn(move || {
        let (number, first) = physical.next()?;
        let Some(beginning) = before_backslash(first) else {
            return Some((number, Cow::Borrowed(first)));
        };
        let mut joined = beginning.to_owned();
        for (_, line) in physical.by_ref() {
            joined.push(' ');
            let Some(middle) = before_backslash(line) else {
                joined.push_str(line);
                break;
            };
            joined.push_str(middle);
        }
        Some((number, Cow::Owned(joined)))
    })
}

/// Splits `line` into its first word and the trimmed rest; a comment or an empty line has the
/// first word "".
pub(in crate::scene) fn keyword_and_rest(line: &str) -> (&str, &str) {
    let line = line.trim();
    if line.starts_with('#') {
        return ("", "");
    }
    let end = line.find(char::is_whitespace).unwrap_or(line.len());
    (&line[..end], line[end..].trim_start())
}

/// The words before a comment. A `#` begins a comment only where it begins a word, so that the
/// `1.#QNAN` of some exporters is not taken for a 1.
pub(in crate::scene) fn words(rest: &str) -> impl Iterator<Item = &str> {
    rest.split_ascii_whitespace().take_while(|word| !word.starts_with('#'))
}

/// Reads a finite number. The error lacks file and line; the caller knows them.
pub(in crate::scene) fn number<T: Float>(word: &str) -> Result<T> {
    match word.parse::<T>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err(Error::new(format!("{} is not a finite number", quote(word)))
            .remedy("correct the number, or export the model again")),
        Err(_) => Err(Error::new(format!("{} is not a number", quote(word)))
            .remedy("write numbers like 1, -0.5 or 2e-3")),
    }
}

/// A floating-point number of either width.
pub(in crate::scene) trait Float: std::str::FromStr {
    fn is_finite(&self) -> bool;
}

impl Float for f32 {
    fn is_finite(&self) -> bool {
        f32::is_finite(*self)
    }
}

impl Float for f64 {
    fn is_finite(&self) -> bool {
        f64::is_finite(*self)
    }
}

/// A word of the file for a message: in backticks, without control characters, not too long.
pub(crate) fn quote(word: &str) -> String {
    const LONGEST: usize = 60;
    let shown: String = word.escape_debug().take(LONGEST).collect();
    let ellipsis = if word.chars().nth(LONGEST).is_some() { "…" } else { "" };
    format!("`{shown}{ellipsis}`")
}

fn is_binary(head: &[u8]) -> bool {
    let is_text = |byte: &u8| (b' '..=b'~').contains(byte) || byte.is_ascii_whitespace();
    let odd = head.iter().filter(|byte| !is_text(byte)).count();
    head.contains(&0) || 2 * odd > head.len()
}

/// The part of a continued line before its backslash. Comments are never continued:
/// they like to end in the name of a Windows folder.
fn before_backslash(line: &str) -> Option<&str> {
    let beginning = line.trim_end().strip_suffix('\\')?;
    (!beginning.trim_start().starts_with('#')).then_some(beginning)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str) -> Vec<(usize, String)> {
        numbered_lines(text).map(|(number, line)| (number, line.trim().to_owned())).collect()
    }

    #[test]
    fn a_continued_line_keeps_the_number_of_its_beginning() {
        let expected = vec![(1, "a  b c".into()), (3, "d".into()), (4, "".into())];
        assert_eq!(lines("a \\\nb c\nd\n"), expected);
        assert_eq!(lines("a \\\r\nb c\r\nd\r\n"), expected);
    }

    #[test]
    fn a_comment_that_ends_in_a_backslash_does_not_swallow_the_next_line() {
        assert_eq!(lines("# C:\\\nv 1"), vec![(1, "# C:\\".into()), (2, "v 1".into())]);
    }

    #[test]
    fn a_backslash_at_the_end_of_the_file_continues_into_nothing() {
        assert_eq!(lines("f 1 \\"), vec![(1, "f 1".into())]);
    }

    #[test]
    fn byte_order_mark_and_lone_carriage_returns_are_understood() {
        assert_eq!(lines("\u{feff}a\rb"), vec![(1, "a".into()), (2, "b".into())]);
    }

    #[test]
    fn a_comment_begins_only_at_the_beginning_of_a_word() {
        assert_eq!(words("1 2 # three").collect::<Vec<_>>(), ["1", "2"]);
        assert_eq!(words("1 1.#QNAN").collect::<Vec<_>>(), ["1", "1.#QNAN"]);
    }

    #[test]
    fn infinite_overflowing_and_undefined_numbers_are_refused() {
        for word in ["inf", "-infinity", "NaN", "1e39", "1,5", "1.#QNAN", "", "0x10"] {
            assert!(number::<f32>(word).is_err(), "{word}");
        }
        assert_eq!(number("-.5e1"), Ok(-5.0));
    }

    #[test]
    fn a_quoted_word_is_short_and_has_no_control_characters() {
        assert_eq!(quote("a\u{1b}[31m"), "`a\\u{1b}[31m`");
        assert_eq!(quote(&"x".repeat(1000)).chars().count(), 63);
        assert_eq!(quote("1.0"), "`1.0`");
    }

    #[test]
    fn binary_is_refused_and_a_latin_1_comment_is_not() {
        let path = Path::new("a.obj");
        assert!(decode(b"v 1\0".to_vec(), path, Format::Obj).is_err());
        assert!(decode(vec![0x80; 100], path, Format::Obj).is_err());
        let text =
            decode(b"# caf\xe9 \x80\x9f\x81\nv 1 2 3\n".to_vec(), path, Format::Obj).unwrap();
        assert_eq!(text, "# café €Ÿ\u{81}\nv 1 2 3\n");
        let text = decode(b"W\xc3\xa4nde".to_vec(), path, Format::Obj).unwrap();
        assert_eq!(text, "Wände");
        for utf_16 in [&b"\xff\xfev\0 \x001\0"[..], b"\xfe\xff\0v\0 \x001"] {
            assert_eq!(decode(utf_16.to_vec(), path, Format::Obj).unwrap(), "v 1");
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_the_kernel_answers_is_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("a.obj");
        std::os::unix::fs::symlink("/proc/self/status", &link).unwrap();
        for path in [&link, Path::new("/proc/self/status"), Path::new("/dev/null")] {
            assert!(read_bytes(path).unwrap_err().to_string().contains("not a regular file"));
        }
    }

    #[test]
    fn what_is_no_text_is_refused_by_the_name_of_what_it_should_be() {
        for (format, name) in [
            (Format::Obj, "a Wavefront OBJ file"),
            (Format::Mtl, "a Wavefront MTL file"),
            (Format::Stl, "an STL file as text"),
            (Format::Toml, "a scene description in TOML"),
        ] {
            let said = decode(vec![0], Path::new("a"), format).unwrap_err().to_string();
            let expected =
                format!("a: this does not look like {name}\n  help: give the path of {name}, ");
            assert!(said.starts_with(&expected), "{said}");
        }
    }

    #[test]
    fn a_file_that_shrinks_after_its_beginning_was_read_ends_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        for left in [0, 100, 2 * HEAD as u64] {
            fs::write(&path, vec![b'x'; 3 * HEAD]).unwrap();
            let cut = |_: &[u8]| {
                fs::File::options().write(true).open(&path).unwrap().set_len(left).unwrap();
                true
            };
            let read = read_bytes_if(&path, cut).unwrap();
            assert_eq!(read.len(), HEAD.max(left as usize));
        }
    }

    #[test]
    fn a_directory_is_no_model() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(read_bytes(folder.path()).unwrap_err().kind(), io::ErrorKind::IsADirectory);
    }
}
