//! What asks the program to end: Ctrl-C, a batch system's SIGTERM, a terminal that is closed.
//!
//! A thread of its own waits for them. Usually it removes the temporary files and lets the signal do what it does by
//! default. While something is computed that can end with what it has, the first signal asks for that, and the
//! next one ends the program.

#[cfg(unix)]
use super::allocator;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering::SeqCst};

/// What the next signal finds: one of these, or the number of a signal that asked before.
static STATE: AtomicI32 = AtomicI32::new(ENDS);

/// A signal ends the program.
const ENDS: i32 = 0;

/// A signal asks the computation to end with what it has.
const ASKS: i32 = -1;

fn change(from: i32, to: i32) -> bool {
    STATE.compare_exchange(from, to, SeqCst, SeqCst).is_ok()
}

/// As long as it lives, the first signal lets the computation end with what it has.
pub(super) struct Patience(());

impl Patience {
    pub(super) fn begin() -> Patience {
        change(ENDS, ASKS);
        Patience(())
    }
}

impl Drop for Patience {
    fn drop(&mut self) {
        change(ASKS, ENDS);
    }
}

/// Whether the computation is, or was, to end with what it has.
pub(super) fn was_asked() -> bool {
    STATE.load(SeqCst) > 0
}

/// The exit code of a program that a signal has ended: 128 and the signal's number.
pub(super) fn exit_code() -> u8 {
    128 + STATE.load(SeqCst) as u8
}

/// Whether the computation takes this signal.
fn is_taken(signal: i32) -> bool {
    change(ASKS, signal)
}

/// Begins to wait for signals. Where they cannot be waited for they end the program, as they do by default.
#[cfg(unix)]
pub(super) fn watch() {
    use signal_hook::consts::{SIGABRT, SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    use signal_hook::{flag, low_level};
    use std::sync::Arc;

    let always = || Arc::new(AtomicBool::new(true));
    // A file that becomes larger than `ulimit -f` allows is then an error of the write.
    let _ = flag::register(SIGXFSZ, always());
    // Where the system refuses even a little memory Rust says so and aborts: that is a failure as others are, and
    // what lies in memory is of no use to anybody. Any other abort is a fault of the program.
    let on_abort = || match allocator::was_refused() || allocator::is_refused() {
        true => low_level::exit(2),
        false => drop(low_level::emulate_default_handler(SIGABRT)),
    };
    // SAFETY: An atomic is read, and all functions may be called where a signal is handled.
    let _ = unsafe { low_level::register(SIGABRT, on_abort) };
    let is_ending = Arc::new(AtomicBool::new(false));
    let signals = [SIGHUP, SIGINT, SIGTERM].into_iter().filter(|&signal| !is_ignored(signal));
    let signals: Vec<i32> = signals.collect();
    for &signal in &signals {
        // Whatever keeps the thread from ending the program, the next signal does not wait for it.
        let _ = flag::register_conditional_default(signal, is_ending.clone());
    }
    let waiting = is_ending.clone();
    let started = signal_hook::iterator::Signals::new(signals).and_then(|signals| {
        let thread = std::thread::Builder::new().name("signals".into()).stack_size(1 << 16);
        thread.spawn(move || wait(signals, &waiting))
    });
    is_ending.store(started.is_err(), SeqCst);
}

#[cfg(unix)]
fn wait(mut signals: signal_hook::iterator::Signals, is_ending: &AtomicBool) {
    for signal in signals.forever().filter(|&signal| !is_taken(signal)) {
        is_ending.store(true, SeqCst);
        let _held = crate::export::staging::remove_temporary_files();
        let _ = signal_hook::low_level::emulate_default_handler(signal);
    }
}

/// Whether who started the program wants it to go on: `nohup`, or a script that goes on beside it.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    ignored.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// Where there is nothing but Ctrl-C, it ends the program.
#[cfg(not(unix))]
pub(super) fn watch() {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_patient_computation_takes_one_signal() {
        assert!(!is_taken(15) && !was_asked());
        drop(Patience::begin());
        assert!(!is_taken(15) && !was_asked(), "what comes afterwards ends the program");
        let patience = Patience::begin();
        assert!(is_taken(15) && !is_taken(2));
        drop(patience);
        assert!(was_asked() && !is_taken(15));
        assert_eq!(exit_code(), 143);
    }
}
