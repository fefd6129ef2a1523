//! Progress with the time left on a terminal, silence elsewhere.

use crate::progress::{Progress, Stage};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use signal_hook::consts::SIGINT;
use signal_hook::flag;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, RwLock};

/// Bars on standard error, one after the other; drawn only if that is a terminal.
pub(super) struct Bars {
    bar: RwLock<ProgressBar>,
    interrupted: Arc<AtomicBool>,
}

impl Bars {
    pub(super) fn new() -> Bars {
        let bar = RwLock::new(ProgressBar::hidden());
        Bars { bar, interrupted: Arc::default() }
    }

    /// From now on Ctrl-C ends a picture with what there is. A second one ends the program.
    pub(super) fn watch_for_interrupts(&self) {
        let code = 128 + SIGINT;
        let flag = || self.interrupted.clone();
        // In this order, so that the first does not see its own mark. Where a signal cannot be caught it ends
        // the program, as before.
        let _ = flag::register_conditional_shutdown(SIGINT, code, flag())
            .and_then(|_| flag::register(SIGINT, flag()));
    }

    pub(super) fn was_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    fn bar(&self) -> ProgressBar {
        self.bar.read().expect("no thread panics while it draws").clone()
    }
}

impl Progress for Bars {
    fn begin(&self, stage: Stage, amount: Option<u64>) {
        let bar = ProgressBar::with_draw_target(amount, ProgressDrawTarget::stderr_with_hz(10));
        let template = match amount {
            Some(_) => "{msg:>14} {wide_bar} {percent:>3} % {eta} left",
            // Nobody knows where the end is.
            None => "{msg:>14} {pos} in {elapsed}",
        };
        bar.set_style(ProgressStyle::with_template(template).expect("it is well formed"));
        bar.set_message(name(stage));
        *self.bar.write().expect("no thread panics while it draws") = bar;
    }

    fn advance(&self, amount: u64) {
        self.bar().inc(amount);
    }

    fn end(&self) {
        self.bar().finish_and_clear();
    }

    fn is_enough(&self) -> bool {
        self.was_interrupted()
    }
}

fn name(stage: Stage) -> &'static str {
    match stage {
        Stage::DirectLight => "direct light",
        Stage::FormFactors => "form factors",
        Stage::Solve => "solve",
        Stage::Shots => "shots",
        Stage::Coverage => "coverage",
        Stage::Patches => "patches",
        Stage::Render => "render",
        Stage::Verify => "verify",
        Stage::Bench => "bench",
    }
}
