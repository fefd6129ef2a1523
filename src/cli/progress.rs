//! Progress with the time left on a terminal, silence elsewhere.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// A bar for one stage of the work. Drawn on standard error only if that is a terminal.
pub fn bar(stage: &'static str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(10));
    let style = ProgressStyle::with_template("{msg:>14} {wide_bar} {percent:>3} % {eta} left");
    bar.set_style(style.expect("the template is well formed"));
    bar.set_message(stage);
    bar
}

/// What suits a stage of the pipeline.
pub fn stage(stage: &'static str) -> ProgressBar {
    match stage {
        "solve" | "shots" => spinner(stage),
        _ => bar(stage),
    }
}

/// A count for a stage whose end nobody knows.
pub fn spinner(stage: &'static str) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(10));
    let style = ProgressStyle::with_template("{msg:>14} {pos} in {elapsed}");
    bar.set_style(style.expect("the template is well formed"));
    bar.set_message(stage);
    bar
}
