//! Every kind of ray through every pair of casters.

use super::bounds::Arithmetic;
use super::cross_checked::Record;
use super::rays::{RayKind, RaySource};
use super::tally::Tally;
use super::verdict::Judge;
use crate::bvh::Surfaces;
use crate::geometry::{Hit, Ray, RayCaster};
use crate::progress::{Progress, Stage};
use crate::scene::Scene;
use rayon::prelude::*;

/// A caster to hold the native one against.
pub(crate) struct Peer<'a> {
    pub name: &'static str,
    pub caster: Box<dyn RayCaster + 'a>,
    pub arithmetic: Arithmetic,
    /// Whether it is ours too, so that its being wrong is our being wrong.
    pub is_native: bool,
    /// Whether it is asked ray by ray rather than in batches.
    pub single: bool,
}

impl Peer<'_> {
    /// The peer with the scene's rules about what is seen.
    fn seeing(&self, scene: &Scene) -> Peer<'_> {
        let &Peer { name, arithmetic, is_native, single, .. } = self;
        let caster = Box::new(Surfaces::new(&*self.caster, scene));
        Peer { name, caster, arithmetic, is_native, single }
    }
}

/// The result of a survey about one peer.
#[derive(Debug, Clone)]
pub(crate) struct Finding {
    pub peer: &'static str,
    /// One per kind, in the order of [`RayKind::ALL`]; nearest-hit and any-hit queries together.
    pub by_kind: Vec<Tally>,
    pub failures: Vec<String>,
}

impl Finding {
    pub(crate) fn total(&self) -> Tally {
        sum(&self.by_kind)
    }
}

/// The sum of some tallies.
pub(crate) fn sum<'t>(tallies: impl IntoIterator<Item = &'t Tally>) -> Tally {
    let mut total = Tally::default();
    tallies.into_iter().for_each(|tally| total.add(tally));
    total
}

/// Rays of one kind that are traced, judged and forgotten together.
const CHUNK: u64 = 4096;

/// One in this many queries in which the casters agree is settled by the referee too: two tracers can
/// be wrong alike.
const AUDIT: usize = 64;

/// Asks the native caster and every peer what is seen along `rays` rays, and whether anything is.
pub(crate) fn survey(
    scene: &Scene,
    native: &dyn RayCaster,
    peers: &[Peer],
    source: &RaySource,
    rays: u64,
    progress: &dyn Progress,
) -> Vec<Finding> {
    let native = &Surfaces::new(native, scene);
    let peers: Vec<Peer> = peers.iter().map(|peer| peer.seeing(scene)).collect();
    let chunks = chunks(rays);
    progress.begin(Stage::Verify, Some(chunks.len() as u64));
    let judges: Vec<Judge> = peers
        .iter()
        .map(|peer| Judge::of_scene(scene, Arithmetic::MollerTrumbore, peer.arithmetic))
        .collect();
    let records: Vec<Vec<Record>> = chunks
        .par_iter()
        .map(|chunk| {
            let records = chunk.ask(native, &peers, &judges, source);
            progress.advance(1);
            records
        })
        .collect();
    progress.end();
    peers
        .iter()
        .enumerate()
        .map(|(p, peer)| {
            let mut by_kind = vec![Tally::default(); RayKind::ALL.len()];
            let mut all = Record::default();
            for (chunk, records) in chunks.iter().zip(&records) {
                by_kind[chunk.kind as usize].add(&records[p].blamed());
                all.add(records[p].clone());
            }
            Finding { peer: peer.name, by_kind, failures: all.failures }
        })
        .collect()
}

struct Chunk {
    kind: RayKind,
    first: u64,
    count: u64,
}

/// Divides the rays among the kinds in proportion to their parts, at least one ray each.
fn chunks(rays: u64) -> Vec<Chunk> {
    let parts: u64 = RayKind::ALL.iter().map(|kind| kind.parts()).sum();
    let mut chunks = Vec::new();
    for kind in RayKind::ALL {
        let total = (rays * kind.parts()).div_ceil(parts).max(1);
        for first in (0..total).step_by(CHUNK as usize) {
            chunks.push(Chunk { kind, first, count: CHUNK.min(total - first) });
        }
    }
    chunks
}

impl Chunk {
    /// One record per peer.
    fn ask(
        &self,
        native: &dyn RayCaster,
        peers: &[Peer],
        judges: &[Judge],
        source: &RaySource,
    ) -> Vec<Record> {
        let rays: Vec<Ray> =
            (self.first..self.first + self.count).map(|i| source.ray(self.kind, i)).collect();
        let ours = Answers::of(native, &rays, false);
        peers
            .iter()
            .zip(judges)
            .map(|(peer, judge)| {
                let theirs = Answers::of(&*peer.caster, &rays, peer.single);
                compare(judge, &rays, &ours, &theirs, peer.is_native)
            })
            .collect()
    }
}

/// One caster's answers about some rays.
pub(super) struct Answers {
    pub nearest: Vec<Option<Hit>>,
    pub occluded: Vec<bool>,
}

impl Answers {
    pub(super) fn of(caster: &dyn RayCaster, rays: &[Ray], single: bool) -> Self {
        let mut answers = Answers { nearest: Vec::new(), occluded: Vec::new() };
        if single {
            answers.nearest = rays.iter().map(|ray| caster.nearest(ray)).collect();
            answers.occluded = rays.iter().map(|ray| caster.occluded(ray)).collect();
        } else {
            caster.nearest_batch(rays, &mut answers.nearest);
            caster.occluded_batch(rays, &mut answers.occluded);
        }
        answers
    }
}

fn compare(
    judge: &Judge,
    rays: &[Ray],
    ours: &Answers,
    theirs: &Answers,
    peer_is_native: bool,
) -> Record {
    let mut record = Record { both_ours: peer_is_native, ..Record::default() };
    for (i, ray) in rays.iter().enumerate() {
        let (a, b) = (ours.nearest[i], theirs.nearest[i]);
        if i % AUDIT == 0 {
            record.settle_nearest(judge, ray, a, b);
        } else {
            record.nearest(judge, ray, a, b);
        }
        let (a, b) = (ours.occluded[i], theirs.occluded[i]);
        if i % AUDIT == 0 {
            record.settle_occluded(judge, ray, a, b);
        } else {
            record.occluded(judge, ray, a, b);
        }
    }
    record
}
