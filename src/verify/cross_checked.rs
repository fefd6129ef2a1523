//! Two ray tracers asked at once.

use super::tally::Tally;
use super::verdict::{Grade, Judge, Judgement};
use crate::geometry::{Ending, Hit, Ray, RayCaster};
use std::sync::Mutex;

/// Asks both casters every question, records how their answers compare, and returns the native one.
///
/// Put in the place of a caster, it checks every ray of the real pipeline. Answers that agree cost a
/// few additions on top of the second caster; tallies are merged once per batch.
pub struct CrossChecked<'t, A, B> {
    pub native: A,
    pub other: B,
    judge: Judge<'t>,
    record: Mutex<Record>,
}

/// A count of verdicts, with examples of wrong answers.
#[derive(Debug, Clone, Default)]
pub struct Record {
    pub tally: Tally,
    /// The first few queries that we answered wrongly, as source for a test.
    pub failures: Vec<String>,
    /// Whether the other side is ours too, so that its being wrong is our being wrong.
    pub both_ours: bool,
}

/// Failures that are kept in words: more would say nothing new.
const FAILURES_KEPT: usize = 8;

impl Record {
    pub fn add(&mut self, other: Record) {
        self.tally.add(&other.tally);
        self.failures.extend(other.failures);
        self.failures.truncate(FAILURES_KEPT);
    }

    /// Judges one pair of nearest hits.
    pub fn nearest(&mut self, judge: &Judge, ray: &Ray, native: Option<Hit>, other: Option<Hit>) {
        let judgement = judge.nearest(ray, native, other);
        self.note_nearest(judge, ray, native, other, &judgement);
    }

    /// As [`nearest`](Self::nearest), but settled by the referee even if both agree.
    pub fn settle_nearest(
        &mut self,
        judge: &Judge,
        ray: &Ray,
        native: Option<Hit>,
        other: Option<Hit>,
    ) {
        let judgement = judge.settle_nearest(ray, native, other);
        self.note_nearest(judge, ray, native, other, &judgement);
    }

    fn note_nearest(
        &mut self,
        judge: &Judge,
        ray: &Ray,
        native: Option<Hit>,
        other: Option<Hit>,
        judgement: &Judgement,
    ) {
        self.tally.count(judgement.verdict);
        if let (Some(a), Some(b)) = (native, other)
            && a.triangle == b.triangle
        {
            self.tally.compare_distances(a.t, b.t);
        }
        self.keep(judgement, || judge.source(ray, native, other, judgement));
    }

    /// Judges one pair of answers to "is anything hit?".
    pub fn occluded(&mut self, judge: &Judge, ray: &Ray, native: bool, other: bool) {
        let judgement = judge.occluded(ray, native, other);
        self.note_occluded(judge, ray, native, other, &judgement);
    }

    /// As [`occluded`](Self::occluded), but settled by the referee even if both agree.
    pub fn settle_occluded(&mut self, judge: &Judge, ray: &Ray, native: bool, other: bool) {
        let judgement = judge.settle_occluded(ray, native, other);
        self.note_occluded(judge, ray, native, other, &judgement);
    }

    fn note_occluded(
        &mut self,
        judge: &Judge,
        ray: &Ray,
        native: bool,
        other: bool,
        judgement: &Judgement,
    ) {
        self.tally.count(judgement.verdict);
        self.keep(judgement, || {
            let answers = format!("// any hit: native {native}, other {other}\n");
            answers + &judge.source(ray, None, None, judgement)
        });
    }

    fn keep(&mut self, judgement: &Judgement, words: impl Fn() -> String) {
        let ours =
            judgement.native == Grade::Wrong || self.both_ours && judgement.other == Grade::Wrong;
        if ours && self.failures.len() < FAILURES_KEPT {
            self.failures.push(words());
        }
    }

    /// The counts, with the other side's wrong answers as ours if it is ours.
    pub fn blamed(&self) -> Tally {
        let mut tally = self.tally;
        if self.both_ours {
            tally.native_wrong += std::mem::take(&mut tally.peer_wrong);
        }
        tally
    }
}

impl<'t, A: RayCaster, B: RayCaster> CrossChecked<'t, A, B> {
    /// `judge` must know both casters' triangles and arithmetic.
    pub fn new(native: A, other: B, judge: Judge<'t>) -> Self {
        CrossChecked { native, other, judge, record: Mutex::default() }
    }

    /// A copy of the record so far.
    pub fn record(&self) -> Record {
        self.record.lock().expect("no thread panics while it counts").clone()
    }

    fn note(&self, record: Record) {
        self.record.lock().expect("no thread panics while it counts").add(record);
    }
}

impl<A: RayCaster, B: RayCaster> RayCaster for CrossChecked<'_, A, B> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        let native = self.native.nearest(ray);
        let mut record = Record::default();
        record.nearest(&self.judge, ray, native, self.other.nearest(ray));
        self.note(record);
        native
    }

    fn occluded(&self, ray: &Ray) -> bool {
        let native = self.native.occluded(ray);
        let mut record = Record::default();
        record.occluded(&self.judge, ray, native, self.other.occluded(ray));
        self.note(record);
        native
    }

    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        let mut others = Vec::new();
        self.native.nearest_batch(rays, hits);
        self.other.nearest_batch(rays, &mut others);
        let mut record = Record::default();
        for ((ray, native), other) in rays.iter().zip(&*hits).zip(others) {
            record.nearest(&self.judge, ray, *native, other);
        }
        self.note(record);
    }

    fn nearest_ending(&self, rays: &[Ray], endings: &[Ending], hits: &mut Vec<Option<Hit>>) {
        let mut others = Vec::new();
        self.native.nearest_ending(rays, endings, hits);
        self.other.nearest_ending(rays, endings, &mut others);
        let mut record = Record::default();
        for (((ray, ending), native), other) in rays.iter().zip(endings).zip(&*hits).zip(others) {
            record.nearest(&self.judge.by(*ending), ray, *native, other);
        }
        self.note(record);
    }

    fn occluded_batch(&self, rays: &[Ray], blocked: &mut Vec<bool>) {
        let mut others = Vec::new();
        self.native.occluded_batch(rays, blocked);
        self.other.occluded_batch(rays, &mut others);
        let mut record = Record::default();
        for ((ray, native), other) in rays.iter().zip(&*blocked).zip(others) {
            record.occluded(&self.judge, ray, *native, other);
        }
        self.note(record);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{BruteForce, MollerTrumbore, Triangle};
    use crate::verify::bounds::Arithmetic;
    use glam::Vec3;

    /// Never hits anything.
    struct Blind;

    impl RayCaster for Blind {
        fn nearest(&self, _: &Ray) -> Option<Hit> {
            None
        }
        fn occluded(&self, _: &Ray) -> bool {
            false
        }
    }

    #[test]
    fn the_native_answer_is_returned_and_both_are_judged() {
        let triangles = [Triangle::new(Vec3::ZERO, Vec3::X, Vec3::Y)];
        let judge =
            || Judge::new(&triangles, Arithmetic::MollerTrumbore, Arithmetic::MollerTrumbore);
        let good = || BruteForce::<MollerTrumbore>::new(&triangles);
        let ray = Ray::new(Vec3::new(0.25, 0.25, 1.0), Vec3::NEG_Z);

        let checked = CrossChecked::new(good(), good(), judge());
        assert!(checked.nearest(&ray).is_some() && checked.occluded(&ray));
        assert_eq!(checked.record().tally.agree, 2);

        let checked = CrossChecked::new(good(), Blind, judge());
        let (mut hits, mut blocked) = (Vec::new(), Vec::new());
        checked.nearest_batch(&[ray, ray], &mut hits);
        checked.occluded_batch(&[ray], &mut blocked);
        assert!(hits.iter().all(Option::is_some) && blocked == [true]);
        assert_eq!((checked.record().tally.peer_wrong, checked.record().tally.queries), (3, 3));
        assert!(checked.record().failures.is_empty());

        let checked = CrossChecked::new(Blind, good(), judge());
        assert!(checked.nearest(&ray).is_none() && !checked.occluded(&ray));
        assert_eq!(checked.record().tally.native_wrong, 2);
        assert_eq!(checked.record().failures.len(), 2);
        assert!(checked.record().failures[0].contains("f32::from_bits"));
    }
}
