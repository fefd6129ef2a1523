//! Rounds of samples, until a picture is good enough or time is up.

use super::filter::Light;
use super::picture::{MOST_SAMPLES, Picture};
use crate::paths::Paths;
use crate::progress::{Progress, Stage};
use crate::render::Frame;
use crate::render::samples::Eye;
use crate::sampling::QUARTERS;
use std::time::{Duration, Instant};

/// The relative error of a pixel that a quick picture aims at.
const QUICK: f32 = 0.02;
/// Rounds of a quick picture.
const QUICK_ROUNDS: u32 = 3;
/// Rounds of a picture with a goal, or until time is up.
const MOST_ROUNDS: u32 = 6;
const MOST_TIMED_ROUNDS: u32 = 30;
/// When fewer samples are wanted, as a share of those that there are, a picture is good enough.
const FEW: f64 = 0.01;

/// Samples a picture, round by round, each where the error was largest after the last. Returns it with its soft
/// light; `None` if `progress` asked to stop.
pub(super) fn sample(
    eye: &Eye,
    paths: &Paths,
    progress: &dyn Progress,
) -> Option<(Picture, Vec<Light>)> {
    let frame = eye.frame;
    let is_quick = frame.error.is_none() && frame.deadline.is_none();
    let most = match (frame.error, frame.deadline) {
        (None, None) => QUICK_ROUNDS,
        (Some(_), None) => MOST_ROUNDS,
        (_, Some(_)) => MOST_TIMED_ROUNDS,
    };
    let mut picture = Picture::new(frame);
    let mut counts = vec![0; (frame.width as usize) * (frame.height as usize)];
    let mut goal = frame.error.unwrap_or(QUICK);
    // Before time is up there is a picture at all.
    let fewest = frame.samples.max(QUARTERS as u32);
    let first = if frame.deadline.is_some() { fewest } else { least(frame, goal) };
    let mut wanted = vec![first; counts.len()];
    let mut averaging = Duration::ZERO;
    for round in 1.. {
        let began = Instant::now();
        progress.begin(Stage::Render, Some(frame.height as u64));
        // What was interrupted in the first round is no picture.
        let is_enough = || round > 1 && progress.is_enough();
        picture.sample(eye, paths, |pixel| counts[pixel]..wanted[pixel], progress, &is_enough);
        progress.end();
        if progress.is_stopped() {
            return None;
        }
        let taken = difference(&counts, &wanted);
        counts = wanted;
        let sampling = began.elapsed();
        if progress.is_enough() {
            let soft = picture.soft();
            return Some((picture, soft));
        }
        // A quick picture takes soft light as it comes, and in little time rather samples are taken than averaged.
        let is_worth_it = frame.deadline.is_none() || sampling > averaging * SELDOM;
        let soft = ((!is_quick && is_worth_it) || round == most).then(|| picture.soft());
        if soft.is_some() {
            averaging = began.elapsed() - sampling;
        }
        if round == most {
            return soft.map(|soft| (picture, soft));
        }
        if frame.error.is_none() && !is_quick {
            goal *= BETTER;
        }
        wanted = picture.wanted(goal, least(frame, goal), soft.as_deref());
        if let Some(deadline) = frame.deadline {
            // The last round's soft light takes as long as this one's.
            let left = deadline.saturating_duration_since(Instant::now() + averaging);
            fit(&counts, &mut wanted, left, sampling.div_f64(taken.max(1.0)));
        }
        if is_done(&counts, &wanted) {
            let soft = soft.unwrap_or_else(|| picture.soft());
            return Some((picture, soft));
        }
    }
    None
}

/// Until time is up, the goal of a round is smaller than the last one's by this factor, so that each takes about
/// three times as many samples.
const BETTER: f32 = 0.6;

/// Until time is up, soft light is averaged in rounds whose samples took longer than that by this factor.
const SELDOM: u32 = 3;

/// The samples of every pixel: without one in each quarter nothing is known of the error. What averaging over neighbours smooths away shows in no estimate of an error, and
/// becomes less with the rays alone.
fn least(frame: &Frame, goal: f32) -> u32 {
    let more = (AVERAGED / goal).max(1.0).powi(2);
    ((frame.samples as f32 * more) as u32).min(MOST_SAMPLES).max(frame.samples).max(QUARTERS as u32)
}

/// The relative error down to which averaging over neighbours does no visible harm.
const AVERAGED: f32 = 0.02;

/// How many samples are wanted beyond those that there are.
fn difference(counts: &[u32], wanted: &[u32]) -> f64 {
    counts.iter().zip(wanted).map(|(count, wanted)| f64::from(wanted - count)).sum()
}

fn is_done(counts: &[u32], wanted: &[u32]) -> bool {
    let there_are: f64 = counts.iter().map(|&count| f64::from(count)).sum();
    difference(counts, wanted) <= FEW * there_are
}

/// Wants no more samples than there is time for.
fn fit(counts: &[u32], wanted: &mut [u32], left: Duration, per_sample: Duration) {
    let needed = per_sample.mul_f64(difference(counts, wanted));
    if needed <= left {
        return;
    }
    let share = left.as_secs_f64() / needed.as_secs_f64();
    for (count, wanted) in counts.iter().zip(wanted) {
        *wanted = count + (f64::from(*wanted - count) * share) as u32;
    }
}
