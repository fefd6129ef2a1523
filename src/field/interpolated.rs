//! Irradiance carried from the patches to their vertices, so that it can be interpolated.
//!
//! A vertex gets the mean of the patches around it, weighted by the area of theirs that is not
//! covered (Cohen & Wallace, §10.1; what lies under a block is no neighbour). Where
//! two triangles meet at less than the crease angle, the vertices of their common edge are one.
//! Irradiance is carried rather than radiosity, so that a change of material along a smooth surface
//! stays sharp.
//!
//! Where a finely split triangle meets a coarser one, the fine one's extra vertices along the common
//! edge take the value that the coarse one interpolates there: without it the picture would crack.

use super::IrradianceField;
use crate::color::{Rgb, Rgb64};
use crate::geometry::RayCaster;
use crate::patches::{Cell, PatchMesh, Side, SurfacePoint};
use crate::scene::groups::Groups;

/// Irradiance in W·m⁻² at the lattice points of every side.
pub struct Interpolated {
    values: Vec<Rgb>,
    /// Per side: where its lattice begins.
    first: Vec<usize>,
}

impl Interpolated {
    /// `irradiance` in W·m⁻² and the uncovered share of its area, per patch; `crease` in degrees.
    pub fn new(mesh: &PatchMesh, irradiance: &[Rgb], uncovered: &[f32], crease: f32) -> Self {
        let mut lattices = Lattices::of(mesh, irradiance, uncovered);
        let seams = seams(mesh, crease);
        lattices.join_corners(mesh, &seams);
        for seam in &seams {
            lattices.join_edge(mesh, seam);
        }
        let values = lattices.sums.iter().map(|sum| sum.mean()).collect();
        let mut vertices = Interpolated { values, first: lattices.first };
        for seam in &seams {
            vertices.close_crack(mesh, seam);
        }
        vertices
    }

    /// H at a point, interpolated within its patch.
    #[inline]
    fn at(&self, point: &SurfacePoint) -> Rgb {
        let values = &self.values[self.first[point.side_number]..];
        let [a, b, c] = cell_corners(point.side.level, point.cell);
        let (a, b, c) = (values[a], values[b], values[c]);
        a * (1.0 - point.l1 - point.l2) + b * point.l1 + c * point.l2
    }

    /// Along a seam, puts the finer side's extra vertices on the coarser side's line.
    fn close_crack(&mut self, mesh: &PatchMesh, seam: &Seam) {
        let coarse = seam.iter().map(|edge| edge.side(mesh).level).min().expect("two sides");
        for edge in seam {
            let level = edge.side(mesh).level;
            let step = 1 << (level - coarse);
            for k in (0..1u32 << level).filter(|k| k % step != 0) {
                let before = k - k % step;
                let [value, start, end] = [k, before, before + step]
                    .map(|k| self.first[edge.side] + edge.point(level, k));
                let fraction = (k % step) as f32 / step as f32;
                self.values[value] = self.values[start].lerp(self.values[end], fraction);
            }
        }
    }
}

impl IrradianceField for Interpolated {
    fn irradiance(&self, _: &dyn RayCaster, at: &[SurfacePoint], irradiance: &mut [Rgb]) {
        for (point, irradiance) in at.iter().zip(irradiance) {
            *irradiance = self.at(point);
        }
    }
}

/// One side's part of a seam: its edge between two of its triangle's corners.
#[derive(Debug, Clone, Copy)]
struct EdgeOf {
    side: usize,
    from: usize,
    to: usize,
}

/// An edge at which two sides meet smoothly, run along in the same direction on both.
type Seam = [EdgeOf; 2];

impl EdgeOf {
    fn side<'m>(&self, mesh: &'m PatchMesh) -> &'m Side {
        &mesh.sides()[self.side]
    }

    /// Lattice index of the k-th of 2^level steps from `from` to `to`.
    fn point(&self, level: u32, k: u32) -> usize {
        const CORNER: [(u32, u32); 3] = [(0, 0), (1, 0), (0, 1)];
        let ((fi, fj), (ti, tj)) = (CORNER[self.from], CORNER[self.to]);
        let rest = (1 << level) - k;
        lattice_index(level, (fi * rest + ti * k, fj * rest + tj * k))
    }
}

/// Lattice points are numbered in rows of 2^level + 1, 2^level, …, 1.
#[inline]
fn lattice_index(level: u32, (i, j): (u32, u32)) -> usize {
    let n = (1u32 << level) as usize;
    let (i, j) = (i as usize, j as usize);
    i * (n + 1) - i * i.saturating_sub(1) / 2 + j
}

/// The lattice indices of a cell's corners: those of [`Cell::corners`], with one multiplication for all three and
/// no branch.
#[inline]
fn cell_corners(level: u32, cell: Cell) -> [usize; 3] {
    let least = lattice_index(level, (cell.i, cell.j));
    let row = (1 << level) + 1 - cell.i as usize;
    let inverted = cell.inverted as usize;
    let (one, other) = if cell.inverted { (1, row) } else { (row, 1) };
    [least + inverted * (row + 1), least + one, least + other]
}

fn lattice_size(level: u32) -> usize {
    let n = 1usize << level;
    (n + 1) * (n + 2) / 2
}

/// The edges that exactly two triangles share, with the pairs of their sides whose normals differ
/// by at most the crease angle. Where three or more triangles meet, a wall stands on a floor, and
/// nothing is smoothed through it.
fn seams(mesh: &PatchMesh, crease: f32) -> Vec<Seam> {
    let topology = mesh.scene.topology();
    let cos_crease = crease.to_radians().cos();
    let mut sides_of = vec![Vec::new(); mesh.scene.triangles.len()];
    for (number, side) in mesh.sides().iter().enumerate() {
        sides_of[side.triangle.index()].push(number);
    }
    let mut seams = Vec::new();
    for edge in topology.edges() {
        let halves: Vec<_> = edge.take(3).collect();
        let [a, b] = halves[..] else { continue };
        let vertex = |half: crate::scene::topology::HalfEdge, step: usize| {
            topology.corners[half.triangle.index()][(half.start + step) % 3]
        };
        let (b_from, b_to) = if vertex(a, 0) == vertex(b, 0) {
            (b.start, (b.start + 1) % 3)
        } else {
            ((b.start + 1) % 3, b.start)
        };
        for &side_a in &sides_of[a.triangle.index()] {
            for &side_b in &sides_of[b.triangle.index()] {
                let cos = mesh.sides()[side_a].normal.dot(mesh.sides()[side_b].normal);
                if cos >= cos_crease {
                    seams.push([
                        EdgeOf { side: side_a, from: a.start, to: (a.start + 1) % 3 },
                        EdgeOf { side: side_b, from: b_from, to: b_to },
                    ]);
                }
            }
        }
    }
    seams
}

/// A weighted sum on its way to a mean. Patches that are covered everywhere are kept apart: they
/// count only where there are no others.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    power: Rgb64,
    area: f64,
    covered_power: Rgb64,
    covered_area: f64,
}

impl Sum {
    fn of(irradiance: Rgb, area: f64, uncovered: f32) -> Self {
        let power = irradiance.as_dvec3() * area;
        if uncovered > 0.0 {
            // What arrives on the patch arrives on its uncovered part.
            Sum { power, area: area * uncovered as f64, ..Sum::default() }
        } else {
            Sum { covered_power: power, covered_area: area, ..Sum::default() }
        }
    }

    fn add(&mut self, other: Sum) {
        self.power += other.power;
        self.area += other.area;
        self.covered_power += other.covered_power;
        self.covered_area += other.covered_area;
    }

    fn mean(&self) -> Rgb {
        let mean = if self.area > 0.0 {
            self.power / self.area
        } else {
            self.covered_power / self.covered_area
        };
        mean.as_vec3()
    }
}

/// For every lattice point of every side, the sum over the patches around it.
struct Lattices {
    sums: Vec<Sum>,
    first: Vec<usize>,
}

impl Lattices {
    fn of(mesh: &PatchMesh, irradiance: &[Rgb], uncovered: &[f32]) -> Self {
        let mut lattices = Lattices { sums: Vec::new(), first: Vec::new() };
        for side in mesh.sides() {
            let first = lattices.sums.len();
            lattices.first.push(first);
            lattices.sums.resize(first + lattice_size(side.level), Sum::default());
            for (number, patch) in side.patches().enumerate() {
                let (irradiance, uncovered) = (irradiance[patch.index()], uncovered[patch.index()]);
                let sum = Sum::of(irradiance, side.patch_area, uncovered);
                for corner in Cell::from_number(side.level, number as u32).corners() {
                    lattices.sums[first + lattice_index(side.level, corner)].add(sum);
                }
            }
        }
        lattices
    }

    /// Gives the points inside a seam that both sides have their common sum.
    fn join_edge(&mut self, mesh: &PatchMesh, seam: &Seam) {
        let levels = seam.map(|edge| edge.side(mesh).level);
        let coarse = levels[0].min(levels[1]);
        for k in 1..1u32 << coarse {
            let slots = [0, 1].map(|s| {
                self.first[seam[s].side] + seam[s].point(levels[s], k << (levels[s] - coarse))
            });
            let mut sum = self.sums[slots[0]];
            sum.add(self.sums[slots[1]]);
            for slot in slots {
                self.sums[slot] = sum;
            }
        }
    }

    /// Gives all corners that seams connect, around a vertex, their common sum.
    fn join_corners(&mut self, mesh: &PatchMesh, seams: &[Seam]) {
        let mut groups = Groups::new(3 * mesh.sides().len());
        for [a, b] in seams {
            groups.join(3 * a.side + a.from, 3 * b.side + b.from);
            groups.join(3 * a.side + a.to, 3 * b.side + b.to);
        }
        let slot = |corner: usize| {
            let (side, corner) = (corner / 3, corner % 3);
            let edge = EdgeOf { side, from: corner, to: (corner + 1) % 3 };
            self.first[side] + edge.point(mesh.sides()[side].level, 0)
        };
        let slots: Vec<usize> = (0..3 * mesh.sides().len()).map(slot).collect();
        let mut sums = vec![Sum::default(); slots.len()];
        for (corner, &slot) in slots.iter().enumerate() {
            sums[groups.root(corner)].add(self.sums[slot]);
        }
        for (corner, &slot) in slots.iter().enumerate() {
            self.sums[slot] = sums[groups.root(corner)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Triangle;
    use crate::patches::{PatchId, SampleId, Subdivision};
    use crate::scene::{Material, MaterialId, Scene};
    use glam::Vec3;

    fn scene(triangles: Vec<Triangle>) -> Scene {
        let count = triangles.len();
        Scene::new(triangles, vec![MaterialId(0); count], vec![Material::fallback()])
    }

    /// Two triangles of very different size that share the edge (0,0,0)–(0,1,0), folded by `angle`
    /// degrees along it.
    fn fold(angle: f32) -> Scene {
        let (sin, cos) = angle.to_radians().sin_cos();
        let (a, b) = (Vec3::ZERO, Vec3::Y);
        let far = Vec3::new(4.0, 0.5, 0.0);
        let folded = Vec3::new(-cos, 0.5, sin);
        scene(vec![Triangle::new(b, a, far), Triangle::new(folded, a, b)])
    }

    fn vertices(mesh: &PatchMesh, irradiance: &[Rgb], crease: f32) -> Interpolated {
        Interpolated::new(mesh, irradiance, &vec![1.0; mesh.len()], crease)
    }

    fn at_corner(v: &Interpolated, mesh: &PatchMesh, side: usize, i: u32, j: u32) -> Rgb {
        v.values[v.first[side] + lattice_index(mesh.sides()[side].level, (i, j))]
    }

    /// Both sides' values at the same fraction of the common edge.
    fn along_edge(v: &Interpolated, mesh: &PatchMesh, fraction: f32) -> [Rgb; 2] {
        // The edge is p0–p1 on side 0 (from b to a) and p1–p2 on side 1 (from a to b).
        let value = |side: usize, u: f32, w: f32| {
            let level = mesh.sides()[side].level;
            let (cell, l1, l2) = Cell::containing(level, u, w);
            let first = mesh.sides()[side].first.0;
            v.at(&SurfacePoint {
                side: &mesh.sides()[side],
                side_number: side,
                cell,
                patch: PatchId(first + cell.number(level)),
                l1,
                l2,
                position: Vec3::ZERO,
                sample: SampleId { pixel: [0; 2], number: 0 },
            })
        };
        [value(0, 1.0 - fraction, 0.0), value(1, 1.0 - fraction, fraction)]
    }

    #[test]
    fn the_corners_of_a_cell_are_lattice_points() {
        for level in 0..=5 {
            for number in 0..1 << (2 * level) {
                let cell = Cell::from_number(level, number);
                let corners = cell.corners().map(|corner| lattice_index(level, corner));
                assert_eq!(cell_corners(level, cell), corners, "level {level}, {cell:?}");
            }
        }
    }

    fn noise(count: usize) -> Vec<Rgb> {
        (0..count).map(|i| Rgb::splat(((i * 7919) % 101) as f32)).collect()
    }

    #[test]
    fn a_constant_stays_constant() {
        let scene = fold(20.0);
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(3)).unwrap();
        let v = vertices(&mesh, &vec![Rgb::splat(3.0); mesh.len()], 30.0);
        assert!(v.values.iter().all(|value| (*value - 3.0).abs().max_element() < 1e-6));
    }

    #[test]
    fn no_crack_where_a_fine_triangle_meets_a_coarse_one() {
        let scene = fold(20.0);
        let mesh = PatchMesh::subdivide(&scene, Subdivision::MaxEdge(0.6)).unwrap();
        let levels: Vec<u32> = mesh.sides().iter().map(|side| side.level).collect();
        assert_ne!(levels[0], levels[1], "the test needs different levels");
        let v = vertices(&mesh, &noise(mesh.len()), 30.0);
        for k in 0..=64 {
            let [a, b] = along_edge(&v, &mesh, k as f32 / 64.0);
            assert!((a - b).abs().max_element() < 1e-4, "{k}/64: {a} and {b}");
        }
    }

    #[test]
    fn a_crease_stays_sharp() {
        let scene = fold(40.0);
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(0)).unwrap();
        let values = [Rgb::splat(1.0), Rgb::splat(5.0)];
        let sharp = vertices(&mesh, &values, 30.0);
        assert_eq!(along_edge(&sharp, &mesh, 0.5), [Rgb::splat(1.0), Rgb::splat(5.0)]);
        let soft = vertices(&mesh, &values, 50.0);
        let [a, b] = along_edge(&soft, &mesh, 0.5);
        assert_eq!(a, b);
        // The mean by area lies between the two.
        assert!(a.x > 1.0 && a.x < 5.0);
    }

    #[test]
    fn nothing_is_smoothed_through_a_wall_on_a_floor() {
        let mut triangles = fold(0.0).triangles.to_vec();
        triangles.push(Triangle::new(Vec3::ZERO, Vec3::Y, Vec3::new(0.0, 0.5, 1.0)));
        let scene = scene(triangles);
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(0)).unwrap();
        let values = [1.0, 5.0, 9.0].map(Rgb::splat);
        let v = vertices(&mesh, &values, 30.0);
        assert_eq!(along_edge(&v, &mesh, 0.5), [Rgb::splat(1.0), Rgb::splat(5.0)]);
    }

    #[test]
    fn a_covered_part_does_not_darken_the_vertex() {
        // Irradiance 3 on each uncovered part; half of the second triangle is covered.
        let scene = fold(0.0);
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(0)).unwrap();
        let values = [3.0, 1.5].map(Rgb::splat);
        let v = Interpolated::new(&mesh, &values, &[1.0, 0.5], 30.0);
        assert_eq!(along_edge(&v, &mesh, 0.5), [Rgb::splat(3.0); 2]);
        // Covered everywhere, the second triangle says nothing about the common edge.
        let values = [3.0, 0.0].map(Rgb::splat);
        let v = Interpolated::new(&mesh, &values, &[1.0, 0.0], 30.0);
        assert_eq!(along_edge(&v, &mesh, 0.5), [Rgb::splat(3.0); 2]);
    }

    #[test]
    fn a_vertex_gets_the_mean_of_all_triangles_around_it() {
        // Four equal quarters of a square about the origin.
        let corners = [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::NEG_Y];
        let quarter = |k: usize| Triangle::new(Vec3::ZERO, corners[k], corners[(k + 1) % 4]);
        let scene = scene((0..4).map(quarter).collect());
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(0)).unwrap();
        let values = [1.0, 2.0, 3.0, 6.0].map(Rgb::splat);
        let v = vertices(&mesh, &values, 30.0);
        for side in 0..4 {
            assert_eq!(at_corner(&v, &mesh, side, 0, 0), Rgb::splat(3.0));
        }
    }
}
