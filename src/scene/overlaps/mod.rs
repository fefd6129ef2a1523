//! Triangles that overlap in one plane: a carpet exactly on a floor, a lamp in a ceiling, a decal on a wall.
//!
//! No ray can tell which of them is in front, so rounding would decide, point by point. Here one of them is seen
//! over the whole overlap: one whose front faces the viewer before one whose back does, then that of the smaller
//! surface, then the later one. The others are there as little as what is behind them.

mod flat;
mod near;

use super::Scene;
use super::groups::Groups;
use crate::error::Warning;
use crate::geometry::bounds::Bounds;
use crate::geometry::{Triangle, TriangleId};
use crate::sampling::regular_triangle;
use flat::Polygon;
use glam::Vec3;
use std::cmp::Reverse;
use std::collections::BTreeMap;

/// Normals with a smaller cosine between them are not those of one plane. Within the tolerance of rays two
/// planes at a degree stay together for a few thousandths of a percent of the scene only.
const PARALLEL: f32 = 0.9998;

/// Pairs that are looked at: per triangle, and beyond.
const MOST_PAIRS: (u64, u64) = (1024, 100_000_000);

/// Which triangles overlap others in their plane, and which of them are seen.
#[derive(Debug, Default)]
pub struct Overlaps {
    /// Per triangle and one beyond, where its list in `others` begins; empty if nothing overlaps.
    first: Vec<u32>,
    others: Vec<TriangleId>,
    /// Per triangle: of two that overlap the lower is seen.
    rank: Vec<u32>,
    /// Whether the search was given up: nearly all triangles are in one place.
    pub(crate) is_given_up: bool,
}

impl Scene {
    /// Which triangles overlap in one plane. It is computed once, then shared by all clones, so change the
    /// triangles only before the first call.
    pub fn overlaps(&self) -> &Overlaps {
        self.known_overlaps.get_or_init(|| Overlaps::find(self))
    }

    /// The share of a piece of a triangle's side, in [0, 1], that is seen and not another triangle in its place.
    pub(crate) fn shown_share(&self, of: TriangleId, is_back: bool, piece: &Triangle) -> f64 {
        let covers = self.covers(of, is_back);
        if covers.is_empty() {
            return 1.0;
        }
        let axis = flat::axis_of(self.normal_of(of));
        let (open, opaque): (Vec<_>, Vec<_>) = covers.into_iter().partition(|c| self.opens(c));
        self.share_beside(axis, &opaque, piece) * self.share_through(axis, &open, piece)
    }

    /// What is seen in the place of a side where it overlaps that.
    fn covers(&self, of: TriangleId, is_back: bool) -> Vec<Cover> {
        let overlaps = self.overlaps();
        let normal = if is_back { -self.normal_of(of) } else { self.normal_of(of) };
        let cover = |&triangle: &TriangleId| {
            let faces = self.normal_of(triangle).dot(normal) > 0.0;
            let hides = overlaps.comes_first((triangle, faces), (of, !is_back));
            hides.then_some(Cover { triangle, is_back: !faces })
        };
        overlaps.with(of).iter().filter_map(cover).collect()
    }

    fn opens(&self, cover: &Cover) -> bool {
        let material = self.material_on(cover.triangle, cover.is_back);
        self.materials[material.0 as usize].is_see_through()
    }

    /// The share of a piece's area that lies beside all covers.
    fn share_beside(&self, axis: usize, covers: &[Cover], piece: &Triangle) -> f64 {
        let whole = flat::seen_along(axis, piece);
        let area = flat::area(&whole);
        let mut shown = vec![whole];
        for cover in covers {
            let cover = flat::seen_along(axis, &self.triangles[cover.triangle.index()]);
            shown = shown.into_iter().flat_map(|part| flat::without(part, &cover)).collect();
        }
        let left: f64 = shown.iter().map(|part| flat::area(part)).sum();
        if area > 0.0 { (left / area).min(1.0) } else { 0.0 }
    }

    /// The mean share of light that covers with openings let through to a piece, over 64 points.
    fn share_through(&self, axis: usize, covers: &[Cover], piece: &Triangle) -> f64 {
        if covers.is_empty() {
            return 1.0;
        }
        let points = regular_triangle(8);
        let through = |l: &[f32; 3]| {
            let point = piece.p[0] * l[0] + piece.p[1] * l[1] + piece.p[2] * l[2];
            let share = |cover: &Cover| {
                let triangle = &self.triangles[cover.triangle.index()];
                let [u, v] = flat::barycentrics(axis, triangle, point)?;
                Some(1.0 - self.opacity_at(cover.triangle, cover.is_back, u, v) as f64)
            };
            covers.iter().filter_map(share).product::<f64>()
        };
        points.iter().map(through).sum::<f64>() / points.len() as f64
    }

    fn normal_of(&self, triangle: TriangleId) -> Vec3 {
        self.triangles[triangle.index()].normal()
    }
}

/// A side that is seen in the place of another.
struct Cover {
    triangle: TriangleId,
    is_back: bool,
}

impl Overlaps {
    pub fn is_empty(&self) -> bool {
        self.others.is_empty()
    }

    /// The triangles that overlap this one in its plane.
    #[inline]
    pub fn with(&self, triangle: TriangleId) -> &[TriangleId] {
        match self.first.get(triangle.index()..triangle.index() + 2) {
            Some(&[start, end]) => &self.others[start as usize..end as usize],
            _ => &[],
        }
    }

    /// Whether the first of two triangles that overlap is seen. Each comes with whether its front faces the
    /// viewer.
    pub fn comes_first(&self, a: (TriangleId, bool), b: (TriangleId, bool)) -> bool {
        let place = |(triangle, faces): (TriangleId, bool)| (!faces, self.rank[triangle.index()]);
        place(a) < place(b)
    }

    /// Says what is assumed, where two fronts or two backs are in one place.
    pub(crate) fn warning(&self, scene: &Scene) -> Option<Warning> {
        if self.is_given_up {
            return Some(Warning::new(
                "so many triangles are in one place that rounding decides which of those in one plane is seen",
            ));
        }
        let alike = |t: TriangleId| {
            let normal = scene.normal_of(t);
            self.with(t).iter().any(|&other| scene.normal_of(other).dot(normal) > 0.0)
        };
        let mut doubtful = self.triangles().filter(|&t| alike(t));
        let first = doubtful.next()?;
        let face = match scene.mesh.origins.get(first.index()) {
            Some(origin) => format!(" (the first: face {})", origin.face),
            None => String::new(),
        };
        Some(Warning::new(format!(
            "{} triangles overlap others in the same plane{face}: where they do, the smaller surface is seen",
            1 + doubtful.count()
        )))
    }

    /// The triangles that overlap others.
    pub(crate) fn triangles(&self) -> impl Iterator<Item = TriangleId> + '_ {
        let numbers = (0..).map(TriangleId);
        self.first.windows(2).zip(numbers).filter(|(list, _)| list[0] < list[1]).map(|(_, t)| t)
    }

    fn find(scene: &Scene) -> Overlaps {
        let triangles = &scene.triangles;
        let boxes: Vec<Bounds> = triangles.iter().map(padded).collect();
        let normals: Vec<Vec3> = triangles.iter().map(Triangle::normal).collect();
        let overlap = |a: u32, b: u32| {
            let (a, b) = (a as usize, b as usize);
            normals[a].dot(normals[b]).abs() > PARALLEL
                && overlap(&triangles[a], &triangles[b], flat::axis_of(normals[a]))
        };
        let most = MOST_PAIRS.0 * triangles.len() as u64 + MOST_PAIRS.1;
        match near::pairs(&boxes, overlap, most) {
            None => Overlaps { is_given_up: true, ..Overlaps::default() },
            Some(pairs) if pairs.is_empty() => Overlaps::default(),
            Some(pairs) => Overlaps::new(scene, &normals, &pairs),
        }
    }

    fn new(scene: &Scene, normals: &[Vec3], pairs: &[(u32, u32)]) -> Overlaps {
        let mut both: Vec<(u32, u32)> = pairs.iter().flat_map(|&(a, b)| [(a, b), (b, a)]).collect();
        both.sort_unstable();
        let count = scene.triangles.len() as u32;
        Overlaps {
            first: (0..=count).map(|t| both.partition_point(|pair| pair.0 < t) as u32).collect(),
            others: both.iter().map(|pair| TriangleId(pair.1)).collect(),
            rank: ranks(scene, normals, pairs),
            is_given_up: false,
        }
    }
}

/// Grown by what lifts rays off the triangle.
fn padded(triangle: &Triangle) -> Bounds {
    let (bounds, pad) = (triangle.bounds(), triangle.ray_offset());
    Bounds { min: bounds.min - pad, max: bounds.max + pad }
}

/// Whether two triangles lie so near to each other over a common area that rays lifted off one of them start
/// beyond the other. A common rim, no wider than that, does not count.
fn overlap(a: &Triangle, b: &Triangle, axis: usize) -> bool {
    let tolerance = a.ray_offset().max(b.ray_offset()) as f64;
    let n = a.normal().as_dvec3();
    let away = b.p.map(|p| n.dot((p - a.p[0]).as_dvec3()));
    if away.iter().all(|&d| d > tolerance) || away.iter().all(|&d| d < -tolerance) {
        return false;
    }
    let common: Polygon = flat::common(&flat::seen_along(axis, a), &flat::seen_along(axis, b));
    let steepness = n[axis].abs();
    let apart = |&p| (flat::height_at(axis, a, p) - flat::height_at(axis, b, p)).abs() * steepness;
    flat::area(&common) > tolerance * flat::perimeter(&common)
        && common.iter().all(|p| apart(p) <= tolerance)
}

/// Orders the triangles so that those of smaller surfaces come first.
///
/// A carpet may lie on many tiles, each smaller than it: so first all triangles of a material that hang together,
/// be it by edges or by what overlaps them, are one surface; only then those that hang together by edges.
fn ranks(scene: &Scene, normals: &[Vec3], pairs: &[(u32, u32)]) -> Vec<u32> {
    let count = scene.triangles.len();
    let (mut surfaces, mut places) = (Groups::new(count), Groups::new(count));
    for edge in scene.topology().edges() {
        let halves: Vec<usize> = edge.map(|half| half.triangle.index()).collect();
        for pair in halves.windows(2) {
            let alike = scene.material_of[pair[0]] == scene.material_of[pair[1]];
            if alike && normals[pair[0]].dot(normals[pair[1]]) > PARALLEL {
                surfaces.join(pair[0], pair[1]);
                places.join(pair[0], pair[1]);
            }
        }
    }
    pairs.iter().for_each(|&(a, b)| places.join(a as usize, b as usize));
    let (mut of_material, mut of_surface) = (BTreeMap::new(), vec![0.0; count]);
    for (t, triangle) in scene.triangles.iter().enumerate() {
        let place = (places.root(t), scene.material_of[t].0);
        *of_material.entry(place).or_insert(0.0) += triangle.area();
        of_surface[surfaces.root(t)] += triangle.area();
    }
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_cached_key(|&t| {
        let surface = surfaces.root(t);
        let material = of_material[&(places.root(t), scene.material_of[t].0)];
        // Areas are not negative, and the bits of such numbers are in their order.
        (material.to_bits(), of_surface[surface].to_bits(), Reverse((surface, t)))
    });
    let mut rank = vec![0; count];
    order.into_iter().enumerate().for_each(|(place, t)| rank[t] = place as u32);
    rank
}

#[cfg(test)]
mod tests;
