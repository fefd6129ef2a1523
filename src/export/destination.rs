//! Where an output goes: to a file, which it replaces, or into something that takes bytes as they come.

use crate::error::{Error, ErrorKind, Result};
use std::ffi::OsStr;
use std::fs::{self, File, Metadata};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

/// What the path of an output leads to, through links.
pub(super) enum Destination {
    /// A file, which is replaced and need not be there yet. The links stay.
    File(PathBuf),
    /// A descriptor that this process was given, such as standard output. What is written goes to where that
    /// stands: in a file that the shell appends to, behind what is there.
    Descriptor(u32),
    /// A device or a named pipe, which is opened and written to.
    Stream,
}

/// As many links as Linux follows.
const MOST_LINKS: usize = 40;

impl Destination {
    /// # Errors
    /// A socket, a circle of links, a descriptor of another process.
    pub(super) fn of(path: &Path) -> Result<Destination> {
        let mut place = path.to_path_buf();
        for _ in 0..MOST_LINKS {
            let Some(name) = place.file_name() else { return Ok(Destination::File(place)) };
            // A folder that is not there is found out by who writes.
            let Ok(folder) = fs::canonicalize(folder_of(&place)) else {
                return Ok(Destination::File(place));
            };
            if let Some(number) = own_descriptor(&folder, name) {
                return Ok(Destination::Descriptor(number));
            }
            let file = folder.join(name);
            let Ok(target) = fs::read_link(&file) else {
                if fs::metadata(&file).is_ok_and(|file| is_socket(&file)) {
                    return Err(Error::new("this is a socket, which is no place for a file")
                        .in_file(path)
                        .remedy("give the name of a file or of a pipe"));
                }
                return Ok(if is_stream(&file) {
                    Destination::Stream
                } else {
                    Destination::File(file)
                });
            };
            // The names of what other processes have open are no paths.
            let is_open_socket = || fs::metadata(&file).is_ok_and(|file| is_socket(&file));
            if folder.starts_with("/proc") && is_stream(&file) && !is_open_socket() {
                return Ok(Destination::Stream);
            }
            if folder.starts_with("/proc") && folder.ends_with("fd") {
                return Err(Error::new("this is a file that another process has open")
                    .in_file(path)
                    .remedy("give the file's own name"));
            }
            place = folder.join(target);
        }
        Err(Error::new("this is a link that leads back to itself")
            .in_file(path)
            .remedy("delete the link"))
    }

    /// Refuses what cannot be written to, as far as that is known before.
    ///
    /// # Errors
    /// A descriptor that is not open, or only for reading; a device or a pipe without the permission.
    pub(super) fn check(&self, path: &Path) -> Result<()> {
        match self {
            Destination::Descriptor(number) => given(*number).map(drop).map_err(|error| {
                let cause = format!("the descriptor {number} cannot be written to: {error}");
                Error::new(cause)
                    .of_kind(ErrorKind::System)
                    .in_file(path)
                    .remedy("let the shell open it for writing, or name a file")
            }),
            Destination::Stream if !may_be_written(path) => {
                Err(Error::new("there is no permission to write to this")
                    .of_kind(ErrorKind::System)
                    .in_file(path)
                    .remedy("allow it, or name a file"))
            }
            _ => Ok(()),
        }
    }

    /// Writes to what is not replaced. Nothing is truncated.
    pub(super) fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut file = match self {
            Destination::Descriptor(number) => given(*number)?,
            Destination::Stream => File::options().write(true).open(path)?,
            Destination::File(_) => unreachable!("files are replaced"),
        };
        write_patiently(&mut file, bytes)
    }
}

/// Writes all bytes, also into a pipe or a terminal that another program has told not to wait until there is room.
///
/// # Errors
/// Whatever else the system says.
pub(crate) fn write_patiently(out: &mut impl Write, mut bytes: &[u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        match patiently(|| out.write(bytes))? {
            0 => return Err(io::ErrorKind::WriteZero.into()),
            count => bytes = &bytes[count..],
        }
    }
    patiently(|| out.flush())
}

fn patiently<T>(mut attempt: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    loop {
        match attempt() {
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => sleep(PAUSE),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            result => return result,
        }
    }
}

/// Between two attempts.
const PAUSE: Duration = Duration::from_millis(1);

/// Whether the system lets this process write to what is there already.
#[cfg(target_os = "linux")]
fn may_be_written(path: &Path) -> bool {
    rustix::fs::access(path, rustix::fs::Access::WRITE_OK).is_ok()
}

#[cfg(not(target_os = "linux"))]
fn may_be_written(_: &Path) -> bool {
    true
}

/// The number of a descriptor of this process, if `name` in `folder`, which is without links, is one.
fn own_descriptor(folder: &Path, name: &OsStr) -> Option<u32> {
    let own = || fs::canonicalize("/proc/self").is_ok_and(|own| folder.starts_with(own));
    let is_own = folder.ends_with("fd") && (folder == Path::new("/dev/fd") || own());
    let number: u32 = name.to_str().filter(|_| is_own)?.parse().ok()?;
    (name == number.to_string().as_str()).then_some(number)
}

/// A copy of a descriptor that the program was given open for writing. Both have one position.
#[cfg(target_os = "linux")]
fn given(number: u32) -> io::Result<File> {
    use rustix::fs::{OFlags, fcntl_getfl};
    use rustix::io::{Errno, FdFlags, fcntl_getfd};
    use std::os::fd::BorrowedFd;

    let number = i32::try_from(number).map_err(|_| Errno::BADF)?;
    // SAFETY: Nobody closes it meanwhile: what the program opens itself is refused, and the rest is never closed. If
    // it is not open, the system says so.
    let descriptor = unsafe { BorrowedFd::borrow_raw(number) };
    // What the program opens itself does not outlive an `exec`, and what it was given has.
    let is_ours = fcntl_getfd(descriptor)?.contains(FdFlags::CLOEXEC);
    let mode = fcntl_getfl(descriptor)?;
    let is_for_reading = mode & OFlags::RWMODE == OFlags::RDONLY || mode.contains(OFlags::PATH);
    if is_ours || is_for_reading {
        return Err(Errno::BADF.into());
    }
    Ok(descriptor.try_clone_to_owned()?.into())
}

/// Elsewhere a descriptor that is opened by its name is copied.
#[cfg(not(target_os = "linux"))]
fn given(number: u32) -> io::Result<File> {
    File::options().write(true).open(format!("/dev/fd/{number}"))
}

/// Whether it takes bytes as they come: a device, a pipe.
pub(super) fn is_stream(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|file| !file.is_file() && !file.is_dir())
}

/// Whether it takes any number of outputs, one after the other: a terminal, /dev/null.
#[cfg(unix)]
pub(super) fn is_character_device(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt;
    fs::metadata(path).is_ok_and(|file| file.file_type().is_char_device())
}

#[cfg(not(unix))]
pub(super) fn is_character_device(path: &Path) -> bool {
    is_stream(path)
}

#[cfg(unix)]
fn is_socket(file: &Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    file.file_type().is_socket()
}

#[cfg(not(unix))]
fn is_socket(_: &Metadata) -> bool {
    false
}

pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn links_are_followed_to_descriptors_streams_and_files_that_need_not_be_there() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        symlink("/dev/stdout", at("out")).unwrap();
        symlink("out", at("again")).unwrap();
        symlink("missing", at("dangling")).unwrap();
        symlink("/dev/null", at("null")).unwrap();
        for path in [&at("again"), Path::new("/proc/self/fd/1"), Path::new("/dev/fd/1")] {
            assert!(matches!(Destination::of(path), Ok(Destination::Descriptor(1))), "{path:?}");
        }
        for path in [&at("null"), Path::new("/dev/full")] {
            assert!(matches!(Destination::of(path), Ok(Destination::Stream)), "{path:?}");
        }
        let folder = fs::canonicalize(folder.path()).unwrap();
        for name in ["dangling", "missing"] {
            let Ok(Destination::File(file)) = Destination::of(&at(name)) else { panic!("{name}") };
            assert_eq!(file, folder.join("missing"));
        }
    }

    #[test]
    fn circles_sockets_and_descriptors_that_were_not_given_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        symlink("b", at("a")).unwrap();
        symlink("a", at("b")).unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        for (name, cause) in [("a", "leads back to itself"), ("socket", "this is a socket")] {
            let Err(error) = Destination::of(&at(name)) else { panic!("{name}") };
            assert!(error.to_string().contains(cause), "{error}");
        }
        // A file that this process has opened itself.
        let own = File::create(at("own")).unwrap();
        let number = std::os::fd::AsRawFd::as_raw_fd(&own) as u32;
        for number in [number, 100_000, u32::MAX] {
            let error = Destination::Descriptor(number).check(Path::new("x")).unwrap_err();
            assert!(error.cause().contains("cannot be written to"), "{error}");
        }
    }

    #[test]
    fn a_pipe_that_does_not_wait_gets_every_byte() {
        use std::io::Read;
        let (mut reader, mut writer) = io::pipe().unwrap();
        rustix::io::ioctl_fionbio(&writer, true).unwrap();
        let bytes: Vec<u8> = (0..1_000_000u32).map(|k| k as u8).collect();
        let read = std::thread::spawn(move || {
            let mut read = Vec::new();
            sleep(Duration::from_millis(20));
            reader.read_to_end(&mut read).map(|_| read)
        });
        write_patiently(&mut writer, &bytes).unwrap();
        drop(writer);
        assert!(read.join().unwrap().unwrap() == bytes);
    }
}
