//! Rounds of samples, until a picture is good enough or time is up.

use super::filter::Light;
use super::picture::{MOST_SAMPLES, Picture};
use crate::paths::Paths;
use crate::progress::{Progress, Stage};
use crate::render::samples::Eye;
use crate::render::{Frame, Image};
use crate::sampling::QUARTERS;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// The relative error of a pixel that a quick picture aims at.
const QUICK: f32 = 0.02;
/// Rounds of a quick picture.
const QUICK_ROUNDS: u32 = 3;
/// Rounds of a picture with a goal, or until time is up.
const MOST_ROUNDS: u32 = 6;
const MOST_TIMED_ROUNDS: u32 = 30;
/// No sample takes longer.
const SLOWEST: Duration = Duration::from_secs(1 << 16);
/// When fewer samples are wanted, as a share of those that there are, a picture is good enough.
const FEW: f64 = 0.01;

/// A picture that is sampled round by round, each where the error was largest after the last. It can be left at any
/// row and gone on with later: a sample depends on its pixel and its number alone.
#[derive(Serialize, Deserialize)]
pub(crate) struct Rounds {
    picture: Picture,
    /// The samples of each pixel at the end of this round, or of a step of the first.
    wanted: Vec<u32>,
    /// From 1.
    round: u32,
    /// The relative error at which this round aims.
    goal: f32,
    is_finished: bool,
    /// Rays traced so far.
    pub(super) rays: u64,
    /// The time that a sample took in the last round.
    per_sample: Duration,
    /// Of the picture as it is.
    #[serde(skip)]
    soft: Option<Vec<Light>>,
    /// How long soft light was averaged the last time.
    #[serde(skip)]
    averaging: Duration,
    /// This round's, as far as it was sampled since it was begun or gone on with.
    #[serde(skip)]
    spent: Spent,
}

#[derive(Default)]
struct Spent {
    is_shown: bool,
    sampling: Duration,
    samples: f64,
}

impl Rounds {
    pub(super) fn new(frame: &Frame) -> Rounds {
        Rounds {
            picture: Picture::new(frame),
            wanted: vec![fewest(frame); frame.width as usize * frame.height as usize],
            round: 1,
            goal: frame.error.unwrap_or(QUICK),
            is_finished: false,
            rays: 0,
            per_sample: Duration::ZERO,
            soft: None,
            averaging: Duration::ZERO,
            spent: Spent::default(),
        }
    }

    /// Whether this can be of a frame: what was read from a file need not be.
    pub(super) fn is_of(&self, frame: &Frame) -> bool {
        let most = MOST_SAMPLES.max(fewest(frame));
        self.picture.is_of(frame, &self.wanted)
            && self.wanted.iter().all(|wanted| (fewest(frame)..=most).contains(wanted))
            && (1..=MOST_TIMED_ROUNDS).contains(&self.round)
            && (f32::MIN_POSITIVE..=f32::MAX).contains(&self.goal)
            && self.per_sample <= SLOWEST
            && self.rays <= u64::MAX / 2
            && (self.picture.is_whole() || !self.is_finished)
    }

    /// Fits what another run left into this one's time.
    pub(super) fn take_up(&mut self, frame: &Frame) {
        if frame.deadline.is_some() && self.picture.is_whole() {
            self.wanted = self.picture.counts();
        }
    }

    /// Samples until `until`, or to the end. Returns whether that is reached, or `progress` wants no more. Where that
    /// wish comes before there is a picture, what there is can be kept at once: the next call goes on to a picture.
    pub(super) fn go_on(
        &mut self,
        eye: &Eye,
        paths: &Paths,
        until: Option<Instant>,
        progress: &dyn Progress,
    ) -> bool {
        let is_over = |rounds: &Rounds| {
            let is_enough = progress.is_enough() && rounds.picture.is_whole();
            rounds.is_finished || progress.is_stopped() || is_enough
        };
        let is_new = !progress.is_enough();
        while !is_over(self) {
            if self.sample(eye, paths, (until, is_new), progress) {
                self.decide(eye.frame, progress);
            } else if !is_over(self) {
                return false;
            }
        }
        if std::mem::take(&mut self.spent.is_shown) {
            progress.end();
        }
        true
    }

    /// Samples this round's rows. Returns whether all are done. `is_new`: nobody has wanted the end before.
    fn sample(
        &mut self,
        eye: &Eye,
        paths: &Paths,
        (until, is_new): (Option<Instant>, bool),
        progress: &dyn Progress,
    ) -> bool {
        let began = Instant::now();
        if !self.spent.is_shown {
            progress.begin(Stage::Render, Some(eye.frame.height as u64));
            progress.advance(self.picture.rows_with(&self.wanted));
            self.spent.is_shown = true;
        }
        let is_whole = self.picture.is_whole();
        // However little time there is, one row is sampled, so that the picture comes to its end.
        let is_first = AtomicBool::new(true);
        let is_late = || until.is_some_and(|until| Instant::now() >= until);
        let is_enough = || {
            (is_whole || is_new) && progress.is_enough()
                || !is_first.swap(false, Relaxed) && is_late()
        };
        self.soft = None;
        let taken = self.picture.sample(eye, paths, &self.wanted, progress, &is_enough);
        self.spent.samples += taken;
        self.spent.sampling += began.elapsed();
        let is_done = self.picture.rows_with(&self.wanted) == eye.frame.height as u64;
        if is_done {
            progress.end();
            self.spent.is_shown = false;
        }
        is_done
    }

    /// Decides what the next round samples, if there is one.
    fn decide(&mut self, frame: &Frame, progress: &dyn Progress) {
        let spent = std::mem::take(&mut self.spent);
        if spent.samples > 0.0 {
            self.per_sample = spent.sampling.div_f64(spent.samples);
        }
        let first = if frame.deadline.is_some() { 0 } else { least(frame, self.goal) };
        if self.round == 1 && self.wanted.first().is_some_and(|&wanted| wanted < first) {
            // In steps, so that there is a picture soon. The samples do not depend on these.
            self.estimate(frame, progress);
            self.wanted.iter_mut().for_each(|n| *n = n.saturating_mul(STEP).min(first).max(*n));
            return;
        }
        let is_quick = frame.error.is_none() && frame.deadline.is_none();
        let most = most_rounds(frame);
        // A quick picture takes soft light as it comes, and in little time rather samples are taken than averaged.
        let is_worth_it = frame.deadline.is_none() || spent.sampling > self.averaging * SELDOM;
        if (!is_quick && is_worth_it) || self.round >= most {
            self.estimate(frame, progress);
        }
        if self.round >= most {
            self.is_finished = true;
            return;
        }
        if frame.error.is_none() && !is_quick {
            self.goal *= BETTER;
        }
        let least = least(frame, self.goal);
        let mut wanted = self.picture.wanted(self.goal, least, self.soft.as_deref());
        if let Some(deadline) = frame.deadline {
            // The last round's soft light takes as long as this one's.
            let left = deadline.saturating_duration_since(Instant::now() + self.averaging);
            fit(&self.wanted, &mut wanted, left, self.per_sample);
        }
        self.is_finished = is_done(&self.wanted, &wanted);
        if !self.is_finished {
            self.wanted = wanted;
            self.round += 1;
        }
    }

    /// Averages the soft light, and says how large the error is.
    fn estimate(&mut self, frame: &Frame, progress: &dyn Progress) {
        let began = Instant::now();
        let soft = self.picture.soft();
        if let Some(error) = self.picture.compose(frame, &soft).relative_error() {
            progress.estimate(error);
        }
        self.soft = Some(soft);
        self.averaging = began.elapsed();
    }

    /// The picture as it is; `None` before each pixel has samples.
    pub(super) fn image(&self, frame: &Frame) -> Option<Image> {
        if !self.picture.is_whole() {
            return None;
        }
        let image = match &self.soft {
            Some(soft) => self.picture.compose(frame, soft),
            None => self.picture.compose(frame, &self.picture.soft()),
        };
        Some(Image { rays: self.rays, ..image })
    }
}

fn most_rounds(frame: &Frame) -> u32 {
    match (frame.error, frame.deadline) {
        (None, None) if frame.in_one_round => 1,
        (None, None) => QUICK_ROUNDS,
        (Some(_), None) => MOST_ROUNDS,
        (_, Some(_)) => MOST_TIMED_ROUNDS,
    }
}

/// Steps of the first round make this many times as many samples.
const STEP: u32 = 4;

/// Until time is up, the goal of a round is smaller than the last one's by this factor, so that each takes about
/// three times as many samples.
const BETTER: f32 = 0.6;

/// Until time is up, soft light is averaged in rounds whose samples took longer than that by this factor.
const SELDOM: u32 = 3;

/// Without a sample in each quarter nothing is known of the error.
fn fewest(frame: &Frame) -> u32 {
    frame.samples.max(QUARTERS as u32)
}

/// The samples of every pixel. What averaging over neighbours smooths away shows in no estimate of an error, and
/// becomes less with the rays alone.
fn least(frame: &Frame, goal: f32) -> u32 {
    let more = (AVERAGED / goal).max(1.0).powi(2);
    ((frame.samples as f32 * more) as u32).min(MOST_SAMPLES).max(fewest(frame))
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

#[cfg(test)]
mod tests {
    use super::super::Gathered;
    use super::*;
    use crate::bvh::Tracer;
    use crate::color::Rgb;
    use crate::export::sealed::forge;
    use crate::geometry::shapes::{cube, inside_out};
    use crate::patches::{PatchMesh, Subdivision};
    use crate::scene::{Camera, Material, MaterialId, Scene};
    use glam::{DVec3, Vec3};
    use std::sync::Arc;

    /// Takes up mutations of what a picture keeps on its way: each is refused, or comes to a picture.
    #[test]
    fn whatever_was_kept_a_picture_comes_to_its_end() {
        let lamp = Material { radiance: Rgb::ONE, ..Material::fallback() };
        let room = inside_out(cube(Vec3::ZERO, 1.0));
        let scene = Scene::new(room, vec![MaterialId(0); 12], vec![lamp]);
        let mesh = Arc::new(PatchMesh::subdivide(&scene, Subdivision::Levels(0)).unwrap());
        let (irradiance, uncovered) = (vec![Rgb::ONE; mesh.len()], vec![1.0; mesh.len()]);
        let light = Gathered::new(&mesh, &irradiance, &uncovered);
        let caster = Tracer::build(&scene);
        let camera = Camera::new(DVec3::splat(0.4), DVec3::ONE, Vec3::Y, 60.0, 0.0).unwrap();
        let frame = Frame { samples: 4, ..Frame::new(4, 6) };
        let begin = || light.begin(&caster, camera.placed(DVec3::ZERO), &frame);

        let mut kept: Vec<Vec<u8>> = Vec::new();
        let mut drawing = begin();
        while !drawing.go_on(Some(Instant::now()), &()) {
            kept.push(postcard::to_stdvec(drawing.rounds()).unwrap());
        }
        assert!(kept.len() > 2, "it was left on its way");
        let whole = drawing.image().unwrap().pixels;
        let (mut random, mut taken_up) = (fastrand::Rng::with_seed(1), 0);
        for number in 0..400 {
            let mut bytes = kept[number % kept.len()].clone();
            // The first are as they were kept.
            if number >= kept.len() {
                for _ in 0..random.usize(1..4) {
                    forge(&mut bytes, &mut random);
                }
            }
            let Ok(rounds) = postcard::from_bytes::<Rounds>(&bytes) else { continue };
            let mut drawing = begin();
            if drawing.take_up(rounds) {
                taken_up += 1;
                assert!(drawing.go_on(None, &()));
                let pixels = drawing.image().unwrap().pixels;
                assert_eq!(pixels.len(), whole.len());
                assert!(number >= kept.len() || pixels == whole);
            }
        }
        assert!((kept.len() + 5..390).contains(&taken_up), "{taken_up} were taken up");
    }
}
