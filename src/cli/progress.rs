//! Progress with the time left on a terminal, silence elsewhere.

use crate::progress::{Progress, Stage};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::sync::RwLock;

/// Bars on standard error, one after the other; drawn only if that is a terminal.
pub(super) struct Bars(RwLock<ProgressBar>);

impl Bars {
    pub(super) fn new() -> Bars {
        Bars(RwLock::new(ProgressBar::hidden()))
    }

    fn bar(&self) -> ProgressBar {
        self.0.read().expect("no thread panics while it draws").clone()
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
        *self.0.write().expect("no thread panics while it draws") = bar;
    }

    fn advance(&self, amount: u64) {
        self.bar().inc(amount);
    }

    fn end(&self) {
        self.bar().finish_and_clear();
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
