//! How much memory there is, and how much was used.

use crate::error::{Error, ErrorKind, Result};

/// Memory that can be had without swapping, in bytes; `None` where the system does not report it.
pub(crate) fn available() -> Option<u64> {
    let mut system = sysinfo::System::new().ok()?;
    system.refresh_memory();
    let free = system.available_memory();
    let allowed = system.cgroup_limits().map_or(u64::MAX, |limits| limits.free_memory);
    let limit = limited().unwrap_or(u64::MAX);
    (free > 0 || limit < u64::MAX).then_some(match free {
        0 => limit,
        _ => free.min(allowed).min(limit),
    })
}

/// Bytes that are left for what is too small to be counted, where the system limits a process.
const KEPT_BACK: u64 = 16 << 20;

/// What `ulimit -v` and `ulimit -d` leave, in bytes; `None` without a limit, and except on Linux.
fn limited() -> Option<u64> {
    let limits = std::fs::read_to_string("/proc/self/limits").ok()?;
    let left = |(limit, used)| {
        let line = limits.lines().find_map(|line| line.strip_prefix(limit))?;
        let limit: u64 = line.split_whitespace().next()?.parse().ok()?;
        Some(limit.saturating_sub(status(used)? + KEPT_BACK))
    };
    [("Max address space", "VmSize:"), ("Max data size", "VmData:")]
        .into_iter()
        .filter_map(left)
        .min()
}

/// An amount of memory in this process's status, in bytes; `None` except on Linux.
fn status(name: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name))?;
    let kibibytes: u64 = line.trim().strip_suffix(" kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

/// The most memory that this process has held so far, in bytes. `None` except on Linux.
pub(crate) fn peak() -> Option<u64> {
    status("VmHWM:")
}

/// Refuses `what` if it needs more than `limit` bytes, or more than the system gives, whatever it says.
///
/// # Errors
/// An error of kind [`ErrorKind::Memory`], with both numbers and the caller's remedy.
pub(crate) fn check(what: &str, bytes: u64, limit: Option<u64>, remedy: &str) -> Result<()> {
    let may_be_used = match limit {
        Some(0) if bytes > 0 => "no more memory may be used".into(),
        Some(limit) if bytes > limit => format!("{} may be used", indicatif::BinaryBytes(limit)),
        _ if can_be_had(bytes) => return Ok(()),
        _ => "the system does not give that much".into(),
    };
    let needed = indicatif::BinaryBytes(bytes);
    let error = Error::new(format!("{what} needs {needed}, and {may_be_used}"));
    Err(error.of_kind(ErrorKind::Memory).remedy(remedy))
}

/// Asks for memory and gives it back untouched.
fn can_be_had(bytes: u64) -> bool {
    let mut memory = Vec::<u8>::new();
    // The compiler must not see that nothing is done with it.
    usize::try_from(bytes)
        .is_ok_and(|bytes| std::hint::black_box(&mut memory).try_reserve_exact(bytes).is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_fits_is_allowed_and_what_does_not_names_both_sizes() {
        assert!(check("a matrix", 100, Some(100), "").is_ok());
        assert!(check("a matrix", 100, None, "").is_ok());
        let error = check("a matrix", 3 << 30, Some(1 << 30), "use less").unwrap_err().to_string();
        assert!(error.contains("3.00 GiB") && error.contains("1.00 GiB"), "{error}");
        assert!(error.contains("use less"));
        let error = check("a matrix", 409, Some(0), "").unwrap_err();
        assert_eq!(error.cause(), "a matrix needs 409 B, and no more memory may be used");
        let error = check("a matrix", 1 << 62, None, "").unwrap_err().to_string();
        assert!(error.contains("does not give that much"), "{error}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn linux_tells_the_peak() {
        let before = peak().expect("VmHWM");
        let block = std::hint::black_box(vec![1u8; 64 << 20]);
        assert!(peak().expect("VmHWM") >= before.max(block.len() as u64));
    }
}
