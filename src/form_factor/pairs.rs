//! Pairwise form factors: samples of the double area integral
//!
//! ```text
//! A_i F_ij = ∬ V(x, y) cosθ_i cosθ_j / (π r²) dy dx        (x on patch i, y on patch j)
//! ```
//!
//! (Cohen & Wallace, *Radiosity and Realistic Image Synthesis*, eq. 4.2). The integral is symmetric
//! in i and j, so one estimate serves both F_ij and F_ji and A_i F_ij = A_j F_ji holds.

use super::exchange::{ExchangeMatrix, TILE, Tile};
use super::spherical::SphericalTriangle;
use super::stretches::InStretches;
use super::transport::{Row, Rows};
use super::{Estimator, OnDemand, Pairs};
use crate::geometry::{Ray, Triangle};
use crate::patches::{PatchId, PatchMesh, Side};
use crate::sampling::{PointSet, Purpose, Stream, regular_triangle, uniform_triangle};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::PI;

/// A triangle that exchanges light: a patch, or a whole emitter.
pub struct Facet {
    shape: Triangle,
    /// See [`Side::sampling_area`].
    sampled: Triangle,
    side: Side,
    area: f32,
    centroid: Vec3,
    /// The radius of a sphere about the centroid that holds the triangle.
    radius: f32,
}

/// From nearer than this many times the radius of a facet, points of it are sampled by solid angle.
const NEAR: f32 = 4.0;

impl Facet {
    pub(crate) fn new(shape: Triangle, side: &Side) -> Self {
        let centroid = shape.centroid();
        let radius = shape.p.iter().map(|p| p.distance(centroid)).fold(0.0, f32::max);
        let sampled = side.sampling_area(&shape);
        Facet { area: shape.area() as f32, sampled, centroid, radius, shape, side: *side }
    }

    pub(crate) fn patch(mesh: &PatchMesh, patch: PatchId) -> Self {
        Facet::new(mesh.triangle(patch), mesh.side(patch))
    }

    /// In square units.
    pub fn area(&self) -> f64 {
        self.area as f64
    }

    /// The segment from `from`, a point lifted off a surface with that normal, to a point of the facet, and
    /// the irradiance there per exitance of the facet: cosθ cosθ′ A / (π r²).
    pub(crate) fn seen_from(&self, from: Vec3, normal: Vec3, xi: [f32; 2]) -> Option<(Ray, f32)> {
        let near = NEAR * self.radius;
        if from.distance_squared(self.centroid) < near * near {
            return self.seen_in_solid_angle(from, normal, xi);
        }
        let y = self.side.lifted(self.at(uniform_triangle(xi[0], xi[1])));
        let d = y - from;
        let (cos_from, cos_here) = (normal.dot(d), -self.side.normal.dot(d));
        if !(cos_from > 0.0 && cos_here > 0.0) {
            return None;
        }
        let r2 = d.length_squared();
        Some((Ray::segment(from, y), (cos_from / r2) * (self.area * (cos_here / r2)) / PI))
    }

    /// As `seen_from`, with points that are uniform in solid angle: for facets that fill much of the view.
    fn seen_in_solid_angle(&self, from: Vec3, normal: Vec3, xi: [f32; 2]) -> Option<(Ray, f32)> {
        let (y, projected) = self.towards(from, normal, xi)?;
        Some((Ray::segment(from, self.side.lifted(y)), projected / PI))
    }

    /// A point of the facet, uniform in the solid angle that it fills, and that solid angle times the cosine at
    /// `from`.
    fn towards(&self, from: Vec3, normal: Vec3, xi: [f32; 2]) -> Option<(Vec3, f32)> {
        let origin = from.as_dvec3();
        let own_normal = self.side.normal.as_dvec3();
        let height = own_normal.dot(origin - self.shape.p[0].as_dvec3());
        if height <= 0.0 {
            return None;
        }
        let seen = SphericalTriangle::new(self.shape.p.map(|p| p.as_dvec3()), origin)?;
        let direction = seen.direction(xi[0] as f64, xi[1] as f64);
        let (cos_from, cos_here) = (normal.as_dvec3().dot(direction), -own_normal.dot(direction));
        if !(cos_from > 0.0 && cos_here > 0.0) {
            return None;
        }
        let y = (origin + direction * (height / cos_here)).as_vec3();
        Some((y, (seen.solid_angle * cos_from) as f32))
    }

    /// A lifted point of the facet, from two numbers in [0, 1), and the normal there.
    pub(crate) fn point(&self, xi: [f32; 2]) -> (Vec3, Vec3) {
        let point = self.at(uniform_triangle(xi[0], xi[1]));
        (self.side.lifted(point), self.side.normal)
    }

    fn at(&self, barycentrics: [f32; 3]) -> Vec3 {
        let [p0, p1, p2] = self.sampled.p;
        p0 * barycentrics[0] + p1 * barycentrics[1] + p2 * barycentrics[2]
    }
}

/// Where one sample of a pair lies: barycentrics on each triangle, and the numbers (ξ₀, ξ₁) that
/// the second ones came from, for sampling by solid angle.
pub(crate) struct PairPoint {
    pub on_a: [f32; 3],
    pub on_b: [f32; 3],
    pub xi_b: [f32; 2],
}

impl PairPoint {
    pub(crate) fn uniform([x0, x1, y0, y1]: [f32; 4]) -> Self {
        PairPoint { on_a: uniform_triangle(x0, x1), on_b: uniform_triangle(y0, y1), xi_b: [y0, y1] }
    }
}

/// One sample: the segment whose visibility decides, and what it contributes to A_a F_ab if clear.
pub(crate) struct PairSample {
    pub segment: Ray,
    pub exchange: f32,
}

/// Samples the exchange between two triangles. `None`: this sample contributes nothing.
///
/// Triangles closer than twice the sum of their radii are sampled by solid angle (see
/// [`spherical`](super::spherical)); beyond that, r varies by less than a factor of three over the
/// pair, and sampling by area is good and cheaper.
#[inline]
pub(crate) fn sample(a: &Facet, b: &Facet, point: &PairPoint) -> Option<PairSample> {
    let near = 2.0 * (a.radius + b.radius);
    if a.centroid.distance_squared(b.centroid) < near * near {
        sample_solid_angle(a, b, point)
    } else {
        sample_area(a, b, point)
    }
}

fn sample_area(a: &Facet, b: &Facet, point: &PairPoint) -> Option<PairSample> {
    let (x, y) = (a.at(point.on_a), b.at(point.on_b));
    let d = y - x;
    let (cos_a, cos_b) = (a.side.normal.dot(d), -b.side.normal.dot(d));
    if !(cos_a > 0.0 && cos_b > 0.0) {
        return None;
    }
    // Both cosines still carry a factor r: cosθ_a cosθ_b / r² = cos_a cos_b / r⁴.
    let r2 = d.length_squared();
    Some(PairSample {
        segment: Ray::segment(a.side.lifted(x), b.side.lifted(y)),
        exchange: (a.area * (cos_a / r2)) * (b.area * (cos_b / r2)) / PI,
    })
}

fn sample_solid_angle(a: &Facet, b: &Facet, point: &PairPoint) -> Option<PairSample> {
    let x = a.at(point.on_a);
    let (y, projected) = b.towards(x, a.side.normal, point.xi_b)?;
    Some(PairSample {
        segment: Ray::segment(a.side.lifted(x), b.side.lifted(y)),
        exchange: a.area * projected / PI,
    })
}

/// Samples, about, between two chances to keep what is done: a second's work or two.
const STRETCH: usize = 1 << 24;

/// Tiles that are estimated together, so that many threads have something to do.
const LEAST_TILES: usize = 256;

/// A mean with its standard error, from samples taken as if independent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    pub mean: f64,
    pub standard_error: f64,
}

impl Estimator<'_> {
    /// A_i F_ij in square units. Symmetric: swapping i and j gives the same bits.
    pub fn pair(&self, i: PatchId, j: PatchId) -> Estimate {
        let (i, j) = (i.min(j), i.max(j));
        let (a, b) = (Facet::patch(self.mesh, i), Facet::patch(self.mesh, j));
        let mut work = PairWork::default();
        let points = PairPoints::new(self);
        let (mut sum, mut squares) = (0.0, 0.0);
        let mut add = |_: usize, exchange: f32| {
            sum += exchange as f64;
            squares += (exchange as f64).powi(2);
        };
        if !self.faces_away(i, j) {
            self.estimate(&mut work, &points, 0, (&a, i), (&b, j), &mut add);
        }
        self.resolve(&mut work, &mut add);
        let n = self.samples as f64;
        let variance = (squares / n - (sum / n).powi(2)).max(0.0);
        Estimate { mean: sum / n, standard_error: (variance / (n - 1.0).max(1.0)).sqrt() }
    }

    /// The whole matrix, tile by tile, in parallel.
    pub fn exchange_matrix(&self) -> ExchangeMatrix {
        let mut matrix = ExchangeMatrix::none(self);
        // Tiles of a run that is to stop are missing: the solution ends with an error.
        self.in_stretches(&mut matrix, &mut |_| Ok(())).ok();
        matrix
    }

    /// The exchanges of block `row`'s patches with those of block `column` ≥ `row`; `None` if all
    /// are zero.
    fn tile(
        &self,
        points: &PairPoints,
        work: &mut PairWork,
        row: usize,
        column: usize,
    ) -> Option<Box<Tile>> {
        let members = |block: usize| {
            (block * TILE..((block + 1) * TILE).min(self.mesh.len())).map(|i| PatchId(i as u32))
        };
        let facets = |block| members(block).map(|i| Facet::patch(self.mesh, i)).collect::<Vec<_>>();
        let (rows, columns) = (facets(row), facets(column));
        let mut facing = FacingCache::default();
        let mut tile = Box::new([[0.0; TILE]; TILE]);
        let mut any = false;
        let weight = 1.0 / self.samples as f32;
        let mut add = |slot: usize, exchange: f32| {
            tile[slot / TILE][slot % TILE] += exchange * weight;
            any = true;
        };
        for (a, i) in rows.iter().zip(members(row)) {
            for (b, j) in columns.iter().zip(members(column)) {
                if j > i && facing.possible(self, i, j) {
                    let slot = (i.index() % TILE) * TILE + j.index() % TILE;
                    self.estimate(work, points, slot, (a, i), (b, j), &mut add);
                }
            }
        }
        self.resolve(work, &mut add);
        self.progress.advance(1);
        any.then_some(tile)
    }

    /// Collects the samples of one pair, tracing whenever a batch is full.
    fn estimate(
        &self,
        work: &mut PairWork,
        points: &PairPoints,
        slot: usize,
        (a, i): (&Facet, PatchId),
        (b, j): (&Facet, PatchId),
        mut add: impl FnMut(usize, f32),
    ) {
        let opacity = (self.mesh.opacity(i) * self.mesh.opacity(j)) as f32;
        for k in 0..self.samples {
            if let Some(sample) = sample(a, b, &points.get(i, j, k)) {
                work.segments.push(sample.segment);
                work.exchanges.push((slot, sample.exchange * opacity));
            }
            if work.segments.len() >= BATCH {
                self.resolve(work, &mut add);
            }
        }
    }

    /// Traces the collected segments and passes each clear one's exchange on.
    fn resolve(&self, work: &mut PairWork, mut add: impl FnMut(usize, f32)) {
        self.caster.occluded_batch(&work.segments, &mut work.blocked);
        self.count_rays(work.segments.len());
        for (&(slot, exchange), blocked) in work.exchanges.iter().zip(&work.blocked) {
            if !blocked {
                add(slot, exchange);
            }
        }
        work.segments.clear();
        work.exchanges.clear();
    }

    /// Whether no point of either patch can see the other's front, which their triangles decide.
    fn faces_away(&self, i: PatchId, j: PatchId) -> bool {
        // Of one triangle the test below would ask whether 0 is above 0, and rounding answer yes.
        if self.mesh.side(i).triangle == self.mesh.side(j).triangle {
            return true;
        }
        let behind = |from: PatchId, of: PatchId| {
            let [shape, other] =
                [of, from].map(|p| &self.mesh.scene.triangles[self.mesh.side(p).triangle.index()]);
            let sign = if self.mesh.side(of).is_back { -1.0 } else { 1.0 };
            let normal = shape.double_area_normal() * sign;
            let p0 = shape.p[0].as_dvec3();
            let size = shape.longest_edge();
            // A corner on the plane (a shared one, say) is not in front of it. The triple product
            // rounds 7 times at most, each of its 6 products is below size² times the distance.
            let rounding = 7.0 * 6.0 * f64::EPSILON * size * size;
            other.p.iter().all(|p| {
                let to_corner = p.as_dvec3() - p0;
                normal.dot(to_corner) <= rounding * to_corner.length()
            })
        };
        behind(i, j) || behind(j, i)
    }
}

impl InStretches for ExchangeMatrix {
    fn amounts(&self) -> [usize; 2] {
        [self.tiles.len(), self.all_tiles()]
    }

    fn add(&mut self, of: &Estimator) {
        let [done, all] = self.amounts();
        let per_tile = TILE * TILE * of.samples as usize;
        let end = (done + (STRETCH / per_tile).max(LEAST_TILES)).min(all);
        let more = (done..end).into_par_iter().map_init(
            || (PairPoints::new(of), PairWork::default()),
            |(points, work), number| {
                let (row, column) = self.blocks_of(number);
                let is_stopped = of.progress.is_stopped();
                if is_stopped { None } else { of.tile(points, work, row, column) }
            },
        );
        let mut more: Vec<_> = more.collect();
        self.tiles.append(&mut more);
    }

    fn take_back(&mut self, done: usize) {
        self.tiles.truncate(done);
    }
}

/// Neighbouring patches belong to the same triangles: remember the last answer.
#[derive(Default)]
struct FacingCache {
    sides: Option<(usize, usize)>,
    possible: bool,
}

impl FacingCache {
    fn possible(&mut self, of: &Estimator, i: PatchId, j: PatchId) -> bool {
        let sides = Some((of.mesh.side_number(i), of.mesh.side_number(j)));
        if self.sides != sides {
            self.sides = sides;
            self.possible = !of.faces_away(i, j);
        }
        self.possible
    }
}

/// Segments that are traced together: enough to pay for a call, few enough for the cache.
const BATCH: usize = 16 * 1024;

/// Samples waiting to be traced in one batch.
#[derive(Default)]
struct PairWork {
    segments: Vec<Ray>,
    /// (slot, exchange) of each segment.
    exchanges: Vec<(usize, f32)>,
    blocked: Vec<bool>,
}

/// The points of every pair, as the estimator's point set places them.
struct PairPoints {
    seed: u64,
    points: PointSet,
    centroids: Vec<[f32; 3]>,
}

impl PairPoints {
    fn new(estimator: &Estimator) -> Self {
        let regular = estimator.points == PointSet::Regular;
        PairPoints {
            seed: estimator.seed,
            points: estimator.points,
            centroids: if regular {
                regular_triangle(estimator.samples.isqrt())
            } else {
                Vec::new()
            },
        }
    }

    #[inline]
    fn get(&self, i: PatchId, j: PatchId, k: u32) -> PairPoint {
        let pair = (i.0 as u64) << 32 | j.0 as u64;
        let stream = Stream::new(self.seed, Purpose::Pair, pair, self.points);
        let point = PairPoint::uniform(stream.point(k));
        if self.centroids.is_empty() {
            return point;
        }
        // Centroid k on one patch meets another one on the other, a different one for each pair.
        let n = self.centroids.len();
        let (k, turn) = (k as usize, (i.0.wrapping_mul(31) ^ j.0) as usize);
        PairPoint { on_a: self.centroids[k], on_b: self.centroids[(n - 1 - k + turn) % n], ..point }
    }
}

impl Rows for OnDemand<'_, Pairs> {
    fn row(&self, i: PatchId) -> Row {
        let of = self.of;
        let area = of.mesh.opaque_area(i);
        let blocks = of.mesh.len().div_ceil(TILE);
        let entries: Vec<Vec<(PatchId, f64)>> = (0..blocks)
            .into_par_iter()
            .map_init(
                || (PairPoints::new(of), PairWork::default()),
                |(points, work), block| self.row_block(i, area, block, points, work),
            )
            .collect();
        Row { entries: entries.concat(), on_backs: None }
    }
}

impl OnDemand<'_, Pairs> {
    fn row_block(
        &self,
        i: PatchId,
        area: f64,
        block: usize,
        points: &PairPoints,
        work: &mut PairWork,
    ) -> Vec<(PatchId, f64)> {
        let of = self.of;
        let own = Facet::patch(of.mesh, i);
        let first = block * TILE;
        let mut facing = FacingCache::default();
        let mut exchange = [0f32; TILE];
        let weight = 1.0 / of.samples as f32;
        let mut add = |slot: usize, sample: f32| exchange[slot] += sample * weight;
        for j in (first..(first + TILE).min(of.mesh.len())).map(|j| PatchId(j as u32)) {
            if j == i || !facing.possible(of, i, j) {
                continue;
            }
            let other = Facet::patch(of.mesh, j);
            // The lower number's patch comes first, as in the matrix.
            let (low, high) = (i.min(j), i.max(j));
            let (a, b) = if i < j { (&own, &other) } else { (&other, &own) };
            let slot = j.index() - first;
            of.estimate(work, points, slot, (a, low), (b, high), &mut add);
        }
        of.resolve(work, &mut add);
        (0..TILE)
            .filter(|&slot| exchange[slot] > 0.0)
            .map(|slot| (PatchId((first + slot) as u32), exchange[slot] as f64 / area))
            .collect()
    }
}
