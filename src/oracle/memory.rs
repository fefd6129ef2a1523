//! How much memory Embree holds, and how much it may: the device's memory monitor.

use embree4_sys::{RTCDevice, rtcSetDeviceMemoryMonitorFunction};
use std::ffi::c_void;
use std::ptr;
use std::sync::atomic::{AtomicIsize, Ordering::Relaxed};

/// Bytes in use and allowed, for all scenes of a device. Any thread of Embree may report.
#[derive(Debug)]
pub(super) struct Memory {
    used: AtomicIsize,
    limit: AtomicIsize,
}

impl Memory {
    pub(super) fn new() -> Self {
        Memory { used: AtomicIsize::new(0), limit: AtomicIsize::new(isize::MAX) }
    }

    pub(super) fn used(&self) -> usize {
        self.used.load(Relaxed).max(0) as usize
    }

    pub(super) fn set_limit(&self, bytes: usize) {
        self.limit.store(bytes.try_into().unwrap_or(isize::MAX), Relaxed);
    }

    /// Counts `bytes` (negative: given back); false asks Embree to give up.
    ///
    /// A refused request that Embree makes beforehand is not carried out, so it is not counted;
    /// one reported afterwards (`done`) is, and Embree gives it back while it gives up.
    fn report(&self, bytes: isize, done: bool) -> bool {
        let used = self.used.fetch_add(bytes, Relaxed) + bytes;
        let refused = bytes > 0 && used > self.limit.load(Relaxed);
        if refused && !done {
            self.used.fetch_sub(bytes, Relaxed);
        }
        !refused
    }
}

unsafe extern "C" fn monitor(memory: *mut c_void, bytes: isize, done: bool) -> bool {
    // SAFETY: `watch`'s caller keeps the `Memory` alive until the device reports no more, and it
    // is only ever shared.
    let memory = unsafe { &*memory.cast::<Memory>() };
    memory.report(bytes, done)
}

/// From now on, `device` reports to `memory` and obeys its limit.
///
/// # Safety
/// `device` is live, and `memory` lives until [`unwatch`] or the device's end.
pub(super) unsafe fn watch(device: RTCDevice, memory: *const Memory) {
    // SAFETY: what this function demands; the callback reads through the pointer only.
    unsafe { rtcSetDeviceMemoryMonitorFunction(device, Some(monitor), memory.cast_mut().cast()) }
}

/// `device` reports no more, which ends what [`watch`] demands.
///
/// # Safety
/// `device` is live.
pub(super) unsafe fn unwatch(device: RTCDevice) {
    // SAFETY: what this function demands.
    unsafe { rtcSetDeviceMemoryMonitorFunction(device, None, ptr::null_mut()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refused_request_is_not_counted() {
        let memory = Memory::new();
        memory.set_limit(100);
        assert!(memory.report(60, false));
        assert!(!memory.report(60, false));
        assert_eq!(memory.used(), 60);
        assert!(memory.report(-60, true), "giving back is never refused");
        assert_eq!(memory.used(), 0);
    }
}
