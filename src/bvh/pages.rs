//! Memory that the processor finds with fewer look-ups.
//!
//! A walk through a large hierarchy jumps from page to page, and where a page lies is itself looked up in
//! memory. Pages of 2 MiB instead of 4 KiB are so few that the processor remembers them all.

/// An empty vector with room for `count` elements, in large pages if the system has them to give.
pub(super) fn with_room<T>(count: usize) -> Vec<T> {
    let mut memory: Vec<T> = Vec::with_capacity(count);
    let room = memory.spare_capacity_mut();
    ask_for_large_pages(room.as_mut_ptr().cast(), size_of_val(room));
    memory
}

/// For memory that nobody has written to yet. A system that cannot gives ordinary pages.
#[cfg(target_os = "linux")]
fn ask_for_large_pages(start: *mut u8, bytes: usize) {
    use rustix::mm::{Advice, madvise};
    use rustix::param::page_size;
    let page = page_size();
    let skipped = start.align_offset(page);
    let whole = bytes.saturating_sub(skipped) / page * page;
    if whole > 0 {
        // SAFETY: the range lies in the allocation, and the advice changes no byte of it.
        let _ =
            unsafe { madvise(start.wrapping_add(skipped).cast(), whole, Advice::LinuxHugepage) };
    }
}

#[cfg(not(target_os = "linux"))]
fn ask_for_large_pages(_: *mut u8, _: usize) {}
