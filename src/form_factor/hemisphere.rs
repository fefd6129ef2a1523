//! Hemispherical form factors: F_ij is the share of patch i's cosine-distributed rays that hit j.
//!
//! With directions of density cosθ/π from uniform points of the patch every ray carries the same
//! light (Cohen & Wallace, §4.4), so a row is the list of what its rays hit: 4 bytes per ray, and it
//! sums to 1 wherever every ray hits a front.

use super::stretches::InStretches;
use super::transport::{Eighths, Row, Rows, Transport, gather_rows};
use super::{Estimator, Hemisphere, OnDemand};
use crate::color::Rgb64;
use crate::geometry::{Hit, Ray};
use crate::patches::{Members, PatchId};
use crate::sampling::{
    EIGHTHS, PointSet, Purpose, Stream, cosine_hemisphere, numbers, regular_triangle,
    uniform_triangle,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A ray that left the scene, and one that ended on the black back of a one-sided triangle. Both are
/// beyond every patch's number, so that sorting puts them last.
const ESCAPED: u32 = u32::MAX;
const ON_BACK: u32 = u32::MAX - 1;

/// Rays, about, between two chances to keep what is done: a second's work or two.
const STRETCH: usize = 1 << 22;

/// The hits of each patch's rays.
#[derive(Serialize, Deserialize)]
pub struct HemisphereRows {
    rays_per_row: usize,
    /// Row after row, eighth after eighth of its rays, each sorted, so that patches come first.
    hits: Vec<u32>,
    areas: Vec<f64>,
    /// Whether the eighths of a row are random.
    are_random: bool,
}

impl HemisphereRows {
    /// None yet.
    pub(crate) fn none(of: &Estimator) -> Self {
        HemisphereRows {
            rays_per_row: of.samples as usize,
            hits: Vec::new(),
            areas: (0..of.mesh.len()).map(|i| of.mesh.area(PatchId(i as u32))).collect(),
            are_random: of.points != PointSet::Regular,
        }
    }

    /// Whether an estimator may have begun them.
    pub(super) fn are_possible(&self, of: &Estimator) -> bool {
        let empty = HemisphereRows::none(of);
        let is_known = |&hit: &u32| hit >= ON_BACK || (hit as usize) < self.areas.len();
        let is_row = |row: &[u32]| {
            row.len() == self.rays_per_row && eighths_of(row).all(|hits| hits.is_sorted())
        };
        (self.rays_per_row, self.are_random) == (empty.rays_per_row, empty.are_random)
            && self.areas == empty.areas
            && self.hits.len() <= self.areas.len() * self.rays_per_row
            && self.hits.iter().all(is_known)
            && self.hits.chunks(self.rays_per_row).all(is_row)
    }

    /// Bytes that the rows of this many patches take.
    pub fn bytes_needed(patches: usize, rays: u32) -> u64 {
        (patches as u64).saturating_mul(rays as u64 * size_of::<u32>() as u64)
    }

    /// Memory that those take that are there.
    pub(super) fn bytes(&self) -> u64 {
        size_of_val(&self.hits[..]) as u64
    }

    /// The hits of row i's rays, eighth after eighth.
    #[inline]
    fn hits_of(&self, i: usize) -> &[u32] {
        &self.hits[i * self.rays_per_row..(i + 1) * self.rays_per_row]
    }

    /// The hits of row i's rays that are patches, by eighths, each sorted.
    #[inline]
    fn patches_hit(&self, i: usize) -> impl Iterator<Item = &[u32]> {
        eighths_of(self.hits_of(i)).map(|hits| &hits[..hits.partition_point(|&hit| hit < ON_BACK)])
    }

    /// Row i, sorted.
    fn sorted(&self, i: usize) -> Vec<u32> {
        let mut hits = self.hits_of(i).to_vec();
        hits.sort_unstable();
        hits
    }
}

impl Transport for HemisphereRows {
    fn len(&self) -> usize {
        self.areas.len()
    }

    fn gather(&self, radiosity: &[Rgb64]) -> Vec<Rgb64> {
        gather_rows(self, radiosity)
    }

    fn eighths(&self) -> Option<&dyn Eighths> {
        (self.are_random && self.rays_per_row >= EIGHTHS).then_some(self)
    }

    fn rows(&self) -> Option<&dyn Rows> {
        Some(self)
    }

    /// A difference of two exchanges is at most the larger of them, so an entry whose own exchange
    /// does not exceed the largest defect so far needs no look at its mirror.
    fn reciprocity_defect(&self) -> Option<f64> {
        let n = self.rays_per_row as f64;
        let exchange = |i: usize, count: usize| self.areas[i] * count as f64 / n;
        let largest_of_row = |mut largest: f64, i: usize| {
            let sorted = self.sorted(i);
            for run in sorted.chunk_by(|a, b| a == b).filter(|run| run[0] < ON_BACK) {
                let j = run[0] as usize;
                let smaller = self.areas[i].min(self.areas[j]);
                let ours = exchange(i, run.len());
                if ours / smaller > largest {
                    let mirrored = self.patches_hit(j).map(|hits| count(hits, i as u32));
                    let theirs = exchange(j, mirrored.sum());
                    largest = largest.max((ours - theirs).abs() / smaller);
                }
            }
            largest
        };
        let patches = (0..self.len()).into_par_iter();
        Some(patches.fold(|| 0.0, largest_of_row).reduce(|| 0.0, f64::max))
    }
}

impl Eighths for HemisphereRows {
    fn apart(&self, radiosity: &[f32]) -> Vec<[f32; EIGHTHS]> {
        let mean = |(k, hits): (usize, &[u32])| {
            let sum: f32 = hits.iter().map(|&hit| radiosity[hit as usize]).sum();
            sum / numbers(k, self.rays_per_row, EIGHTHS).len() as f32
        };
        let of_row = |i: usize| {
            let mut means = self.patches_hit(i).enumerate().map(mean);
            std::array::from_fn(|_| means.next().expect("one for each eighth"))
        };
        (0..self.len()).into_par_iter().map(of_row).collect()
    }

    fn together(&self, radiosity: &[[f32; EIGHTHS]]) -> Vec<[f32; EIGHTHS]> {
        let of_row = |i: usize| {
            let mut sum = [0.0; EIGHTHS];
            for &hit in self.patches_hit(i).flatten() {
                sum.iter_mut().zip(radiosity[hit as usize]).for_each(|(sum, b)| *sum += b);
            }
            sum.map(|sum| sum / self.rays_per_row as f32)
        };
        (0..self.len()).into_par_iter().map(of_row).collect()
    }
}

impl Rows for HemisphereRows {
    fn row(&self, i: PatchId) -> Row {
        row_of(&self.sorted(i.index()))
    }

    fn for_each_in_row(&self, i: PatchId, entry: &mut dyn FnMut(usize, f64)) {
        let factor = 1.0 / self.rays_per_row as f64;
        self.patches_hit(i.index()).flatten().for_each(|&hit| entry(hit as usize, factor));
    }

    fn gather_row(&self, i: PatchId, radiosity: &[Rgb64]) -> Rgb64 {
        let hits = self.patches_hit(i.index()).flatten();
        hits.map(|&hit| radiosity[hit as usize]).sum::<Rgb64>() / self.rays_per_row as f64
    }

    fn on_backs(&self, i: PatchId) -> Option<f64> {
        let hits = self.hits_of(i.index());
        let on_backs: usize = eighths_of(hits).map(|hits| count(hits, ON_BACK)).sum();
        Some(on_backs as f64 / hits.len() as f64)
    }
}

/// The row with these hits, sorted.
fn row_of(hits: &[u32]) -> Row {
    let n = hits.len() as f64;
    let runs = hits.chunk_by(|a, b| a == b).filter(|run| run[0] < ON_BACK);
    let entries = runs.map(|run| (PatchId(run[0]), run.len() as f64 / n)).collect();
    Row { entries, on_backs: Some(count(hits, ON_BACK) as f64 / n) }
}

/// The eighths of a row.
fn eighths_of(row: &[u32]) -> impl Iterator<Item = &[u32]> {
    (0..EIGHTHS).map(|k| &row[numbers(k, row.len(), EIGHTHS)])
}

fn count(sorted: &[u32], value: u32) -> usize {
    sorted.partition_point(|&x| x <= value) - sorted.partition_point(|&x| x < value)
}

impl Estimator<'_> {
    /// All rows, in parallel.
    pub fn hemisphere_rows(&self) -> HemisphereRows {
        let mut rows = HemisphereRows::none(self);
        // Rows of a run that is to stop are missing: the solution ends with an error.
        self.in_stretches(&mut rows, &mut |_| Ok(())).ok();
        rows
    }
}

impl InStretches for HemisphereRows {
    fn amounts(&self) -> [usize; 2] {
        [self.hits.len() / self.rays_per_row, self.areas.len()]
    }

    fn add(&mut self, of: &Estimator) {
        let rays = self.rays_per_row;
        let [done, all] = self.amounts();
        let more = (STRETCH / rays).max(1).min(all - done);
        self.hits.reserve_exact((all - done) * rays);
        self.hits.resize((done + more) * rays, ESCAPED);
        self.hits[done * rays..].par_chunks_mut(rays).enumerate().for_each_init(
            || HemisphereWork::new(of),
            |work, (i, row)| {
                if of.progress.is_stopped() {
                    return;
                }
                work.trace(of, PatchId((done + i) as u32), row);
                (0..EIGHTHS).for_each(|k| row[numbers(k, rays, EIGHTHS)].sort_unstable());
                if i % 64 == 0 {
                    of.progress.advance(64);
                }
            },
        );
    }

    fn take_back(&mut self, done: usize) {
        self.hits.truncate(done * self.rays_per_row);
    }
}

/// One thread's buffers.
struct HemisphereWork {
    centroids: Vec<[f32; 3]>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    /// A row that is made on demand.
    row: Vec<u32>,
}

impl HemisphereWork {
    fn new(of: &Estimator) -> Self {
        let regular = of.points == PointSet::Regular;
        let centroids = if regular { regular_triangle(of.samples.isqrt()) } else { Vec::new() };
        HemisphereWork { centroids, rays: Vec::new(), hits: Vec::new(), row: Vec::new() }
    }

    /// Fills the row with what patch i's rays hit.
    fn trace(&mut self, of: &Estimator, i: PatchId, row: &mut [u32]) {
        let members = Members::of(of.mesh, i);
        let only =
            (!of.mesh.is_cluster(i)).then(|| of.mesh.side(i).sampling_area(&of.mesh.triangle(i)));
        let stream = Stream::new(of.seed, Purpose::Hemisphere, i.0 as u64, of.points);
        self.rays.clear();
        self.rays.extend((0..of.samples).map(|k| {
            let [d0, d1, x0, x1] = stream.point(k);
            let (side, x0) = members.choose(x0);
            let [p0, p1, p2] = only.unwrap_or_else(|| side.sampling_area(&members.part(side))).p;
            let [l0, l1, l2] = match self.centroids.get(k as usize) {
                Some(&centroid) => centroid,
                None => uniform_triangle(x0, x1),
            };
            let origin = side.lifted(p0 * l0 + p1 * l1 + p2 * l2);
            Ray::new(origin, cosine_hemisphere(side.normal, d0, d1))
        }));
        of.caster.nearest_batch(&self.rays, &mut self.hits);
        of.count_rays(self.rays.len());
        for ((entry, ray), hit) in row.iter_mut().zip(&self.rays).zip(&self.hits) {
            let landed = |hit| of.mesh.patch_hit(ray, &hit).map_or(ON_BACK, |patch| patch.0);
            *entry = hit.map_or(ESCAPED, landed);
        }
    }

    fn row(&mut self, of: &Estimator, i: PatchId) -> Row {
        let mut row = std::mem::take(&mut self.row);
        row.resize(of.samples as usize, ESCAPED);
        self.trace(of, i, &mut row);
        row.sort_unstable();
        self.row = row;
        row_of(&self.row)
    }
}

impl Rows for OnDemand<'_, Hemisphere> {
    fn row(&self, i: PatchId) -> Row {
        HemisphereWork::new(self.of).row(self.of, i)
    }

    fn rows_of(&self, patches: &[PatchId]) -> Vec<Row> {
        let work = || HemisphereWork::new(self.of);
        patches.par_iter().map_init(work, |work, &i| work.row(self.of, i)).collect()
    }
}
