//! What is found when it is first asked for, and then known.

use std::sync::OnceLock;

/// What a lock holds, or what `find` finds, outside the lock: a thread that waits in it for other threads may be given
/// work that asks for the same. Threads that ask at once all find it, and the first answer counts.
pub(crate) fn known<T>(lock: &OnceLock<T>, find: impl FnOnce() -> T) -> &T {
    match lock.get() {
        Some(known) => known,
        None => {
            let found = find();
            lock.get_or_init(|| found)
        }
    }
}
