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
    /// When this run had samples with `first` as error, or none.
    since: Instant,
    first: Option<f32>,
    /// Whether another run has left samples, of which nobody knows how long they took.
    is_resumed: bool,
    error: Option<f32>,
    left: Option<Duration>,
}

impl Estimate {
    fn new(is_resumed: bool) -> Estimate {
        Estimate { since: Instant::now(), first: None, is_resumed, error: None, left: None }
    }

    fn update(&mut self, error: f32, goal: Option<f32>) {
        if self.is_resumed && self.error.is_none() {
            (self.since, self.first) = (Instant::now(), Some(error));
        } else {
            let elapsed = self.since.elapsed();
            self.left = goal.and_then(|goal| time_left(self.first, error, goal, elapsed));
        }
        self.error = Some(error);
    }
}

/// The time until the error is `goal`, where it has fallen to `error` in the time `elapsed`: from `first`, or from
/// the beginning.
fn time_left(first: Option<f32>, error: f32, goal: f32, elapsed: Duration) -> Option<Duration> {
    // The error falls about as N^(−3/4).
    let samples = |error: f32| f64::from(error).powf(-4.0 / 3.0);
    let done = samples(error) - first.map_or(0.0, samples);
    let more = (samples(goal) - samples(error)).max(0.0);
    (done > 0.0).then(|| elapsed.mul_f64((more / done).min(1e6)))
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

    /// The next picture begins. `is_resumed`: with samples of another run.
    pub(super) fn begin_picture(&self, is_resumed: bool) {
        *self.estimate.write().expect("no thread panics while it draws") =
            Some(Estimate::new(is_resumed));
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
        // Single pixels may be off where the whole is good enough.
        let left = left.filter(|left| left.as_secs() > 0);
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
        if let Some(estimate) = estimate.as_mut() {
            estimate.update(error, self.goal);
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_is_that_of_the_samples_that_are_missing() {
        let ten = Duration::from_secs(10);
        // Half the error takes 2^(4/3) times the samples: 15 s more. Of these 10 s, some were spent before.
        let left = |first, error, goal| {
            time_left(first, error, goal, ten).map(|left| left.as_secs_f64().round())
        };
        assert_eq!(left(None, 0.02, 0.01), Some(15.0));
        assert_eq!(left(Some(0.04), 0.02, 0.01), Some(25.0));
        assert_eq!(left(None, 0.01, 0.02), Some(0.0));
        assert_eq!(left(Some(0.02), 0.02, 0.01), None, "nothing has become better");
        assert_eq!(left(None, 0.0, 0.01), Some(0.0));
    }

    #[test]
    fn what_another_run_has_left_says_nothing_of_the_time() {
        let mut estimate = Estimate::new(true);
        estimate.update(0.02, Some(0.01));
        assert_eq!((estimate.error, estimate.left), (Some(0.02), None));
        estimate.update(0.019, Some(0.01));
        assert!(estimate.left.is_some());
        let mut anew = Estimate::new(false);
        anew.update(0.02, Some(0.01));
        assert!(anew.left.is_some());
    }
}
