//! The program's allocator: the system's, which notes when memory was refused.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

static WAS_REFUSED: AtomicBool = AtomicBool::new(false);

/// Whether the system has refused memory so far. If the program aborts then, this is most likely why: Rust reports it
/// in no other way.
#[cfg(any(unix, test))]
pub(super) fn was_refused() -> bool {
    WAS_REFUSED.load(Relaxed)
}

/// Whether the system refuses a little memory now, so that a thread may not have got its stack, say, which no allocator
/// is asked for. May be called where a signal is handled.
#[cfg(target_os = "linux")]
pub(super) fn is_refused() -> bool {
    use rustix::mm::{MapFlags, ProtFlags, mmap_anonymous, munmap};
    const LITTLE: usize = 16 << 20;
    let (access, flags) = (ProtFlags::READ | ProtFlags::WRITE, MapFlags::PRIVATE);
    // SAFETY: Nothing is mapped over, and nobody knows of what is mapped.
    unsafe {
        match mmap_anonymous(std::ptr::null_mut(), LITTLE, access, flags) {
            Ok(memory) => munmap(memory, LITTLE).is_err(),
            Err(_) => true,
        }
    }
}

#[cfg(all(unix, not(target_os = "linux")))]
pub(super) fn is_refused() -> bool {
    false
}

/// Has blocks of 2 MiB or more given back to the system as soon as they are freed. The GNU allocator would raise that
/// size with every such block that is freed, and keep those below it: a fifth of the memory at the peak of a large
/// scene. How much it keeps of small ones is not adjusted any more either.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub(super) fn give_back_large_blocks() {
    const LARGE: i32 = 2 << 20;
    // SAFETY: This says where blocks come from in the future; it fails without harm.
    unsafe { libc::mallopt(libc::M_MMAP_THRESHOLD, LARGE) };
}

#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(super) fn give_back_large_blocks() {}

/// The system's allocator with a note of what it refuses.
pub struct Allocator;

fn noted(memory: *mut u8) -> *mut u8 {
    if memory.is_null() {
        WAS_REFUSED.store(true, Relaxed);
    }
    memory
}

// SAFETY: All is done by the system's allocator, and the answers are its own.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: The caller keeps the contract.
        noted(unsafe { System.alloc(layout) })
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: The caller keeps the contract.
        noted(unsafe { System.alloc_zeroed(layout) })
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: The caller keeps the contract.
        noted(unsafe { System.realloc(memory, layout, size) })
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: The caller keeps the contract.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::hint::black_box;

    #[test]
    fn what_is_refused_is_noted() {
        let layout = |bytes| Layout::from_size_align(bytes, 8).unwrap();
        // SAFETY: No size is 0, and what is given is given back.
        unsafe {
            assert!(!is_refused());
            let memory = black_box(Allocator.alloc(layout(64)));
            assert!(!memory.is_null() && !was_refused());
            let larger = black_box(Allocator.realloc(memory, layout(64), 1 << 62));
            assert!(larger.is_null() && was_refused());
            Allocator.dealloc(memory, layout(64));
        }
    }
}
