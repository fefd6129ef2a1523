//! Progress with the time left on a terminal, silence elsewhere.

use super::signals::{self, Patience};
use crate::progress::{Progress, Stage};
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::sync::RwLock;
use std::time::{Duration, Instant};

/// Bars on standard error, one after the other; drawn only if that is a terminal.
#[derive(Default)]
pub(super) struct Bars {
    bar: RwLock<Option<ProgressBar>>,
    on_signal: OnSignal,
    _patience: Option<Patience>,
    /// Of a picture: the error that it should have, and when it should be done.
    goal: Option<f32>,
    deadline: Option<Instant>,
    estimate: RwLock<Option<Estimate>>,
}

/// What a signal does that asks the program to end.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum OnSignal {
    /// End it at once.
    #[default]
    Die,
    /// Stop the computation, which keeps what is done.
    Stop,
    /// End a picture with what there is.
    Finish,
}

/// What is known of a picture on its way.
struct Estimate {
    began: Instant,
    error: Option<f32>,
    left: Option<Duration>,
}

impl Bars {
    pub(super) fn new() -> Bars {
        Bars::default()
    }

    /// Bars of pictures that should have an error of `goal`, or be done by `deadline`.
    pub(super) fn towards(goal: Option<f32>, deadline: Option<Instant>) -> Bars {
        Bars { goal, deadline, ..Bars::default() }
    }

    /// As long as the bars are there the first Ctrl-C or SIGTERM does this. A second one ends the program.
    pub(super) fn on_signal(self, on_signal: OnSignal) -> Bars {
        let patience = (on_signal != OnSignal::Die).then(Patience::begin);
        Bars { on_signal, _patience: patience, ..self }
    }

    pub(super) fn was_interrupted(&self) -> bool {
        self.on_signal != OnSignal::Die && signals::was_asked()
    }

    fn bar(&self) -> Option<ProgressBar> {
        self.bar.read().expect("no thread panics while it draws").clone()
    }

    /// The error that there is and the one that is wanted, and the time left.
    fn state(&self) -> String {
        let estimate = self.estimate.read().expect("no thread panics while it draws");
        let mut words = vec![name(Stage::Render).to_string()];
        let per_cent = |share: f32| format!("{:.2} %", 100.0 * share);
        words.extend(
            estimate.as_ref().and_then(|e| e.error).map(|e| format!("error {}", per_cent(e))),
        );
        words.extend(self.goal.map(|goal| format!("goal {}", per_cent(goal))));
        let until_deadline = self.deadline.map(|d| d.saturating_duration_since(Instant::now()));
        let left = until_deadline.or(estimate.as_ref().and_then(|estimate| estimate.left));
        words.extend(left.map(|left| format!("about {} left", HumanDuration(left))));
        words.join(", ")
    }
}

impl Progress for Bars {
    fn begin(&self, stage: Stage, amount: Option<u64>) {
        let bar = ProgressBar::with_draw_target(amount, ProgressDrawTarget::stderr_with_hz(10));
        let is_picture = stage == Stage::Render && (self.goal.is_some() || self.deadline.is_some());
        let template = match amount {
            Some(_) if is_picture => "{msg:>14} {wide_bar} {percent:>3} %",
            Some(_) => "{msg:>14} {wide_bar} {percent:>3} % {eta} left",
            // Nobody knows where the end is.
            None => "{msg:>14} {pos} in {elapsed}",
        };
        bar.set_style(ProgressStyle::with_template(template).expect("it is well formed"));
        if is_picture {
            let mut estimate = self.estimate.write().expect("no thread panics while it draws");
            estimate.get_or_insert(Estimate { began: Instant::now(), error: None, left: None });
            drop(estimate);
            bar.set_message(self.state());
        } else {
            bar.set_message(name(stage));
        }
        *self.bar.write().expect("no thread panics while it draws") = Some(bar);
    }

    fn advance(&self, amount: u64) {
        let Some(bar) = self.bar() else { return };
        if self.deadline.is_some() {
            bar.set_message(self.state());
        }
        bar.inc(amount);
    }

    fn end(&self) {
        if let Some(bar) = self.bar() {
            bar.finish_and_clear();
        }
    }

    fn estimate(&self, error: f32) {
        let mut estimate = self.estimate.write().expect("no thread panics while it draws");
        let Some(estimate) = estimate.as_mut() else { return };
        estimate.error = Some(error);
        estimate.left = self.goal.map(|goal| {
            // The error falls about as N^(−3/4).
            let more = f64::from(error / goal).max(1.0).powf(4.0 / 3.0) - 1.0;
            estimate.began.elapsed().mul_f64(more.min(1e6))
        });
    }

    fn is_stopped(&self) -> bool {
        self.on_signal == OnSignal::Stop && signals::was_asked()
    }

    fn is_enough(&self) -> bool {
        self.on_signal == OnSignal::Finish && signals::was_asked()
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
        Stage::Certificate => "certificate",
        Stage::Render => "render",
        Stage::Verify => "verify",
        Stage::Bench => "bench",
    }
}
