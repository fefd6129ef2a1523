//! Cuts a polygon into triangles that face the same way as the polygon does.

use super::crossing;
use crate::error::Warning;
use earcut::Earcut;
use earcut::utils3d::project3d_to_2d;
use glam::{DVec2, DVec3};
use std::path::Path;

/// A triangle by its corners, which are indices into the polygon, in the direction of the polygon.
type Cut = [usize; 3];

/// With more corners than this, a polygon that crosses itself becomes a fan: the search for ears would take a time
/// that grows with their square.
const LARGE: usize = 5000;

/// Cuts polygons into triangles. It keeps its buffers, so use one for many polygons.
pub(super) struct Triangulator {
    earcut: Earcut<f64>,
    /// The polygon, moved to the origin and scaled to about unit size.
    local: Vec<[f64; 3]>,
    /// The polygon, projected into its plane.
    flat: Vec<[f64; 2]>,
    corners: Vec<u32>,
}

impl Triangulator {
    pub(super) fn new() -> Self {
        Triangulator {
            earcut: Earcut::new(),
            local: Vec::new(),
            flat: Vec::new(),
            corners: Vec::new(),
        }
    }

    /// Cuts `polygon`, which has at least 3 vertices, and appends the triangles to `cuts`.
    ///
    /// The polygon may be concave and need not be quite planar. A polygon without area becomes
    /// triangles without area. Says whether the outline is known to cross itself: then the triangles overlap, or
    /// leave parts out.
    pub(super) fn triangulate(&mut self, polygon: &[DVec3], cuts: &mut Vec<Cut>) -> bool {
        if polygon.len() == 3 || !self.flatten(polygon) {
            cuts.extend(fan(polygon.len(), 0));
            return polygon.len() > 3 && self.crosses_in_its_largest_part(polygon);
        }
        if let Some(center) = self.fan_center() {
            cuts.extend(fan(polygon.len(), center));
            return false;
        }
        let crosses = crossing::crosses_itself(&self.flat);
        if crosses && polygon.len() > LARGE {
            cuts.extend(fan(polygon.len(), 0));
            return true;
        }
        self.earcut.earcut(self.flat.iter().copied(), &[], &mut self.corners);
        if self.corners.is_empty() {
            cuts.extend(fan(polygon.len(), 0));
            return crosses;
        }
        // Earcut's triangles run counter-clockwise whatever its input, and so does `flat`.
        cuts.extend(self.corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]].map(|k| k as usize)));
        crosses
    }

    /// Whether a polygon whose Newell normal is zero crosses itself: its parts run in opposite directions and are of
    /// equal size, as those of a bow tie, or it has no area and goes back the way that it came.
    fn crosses_in_its_largest_part(&mut self, polygon: &[DVec3]) -> bool {
        let normal = |cut: Cut| {
            let [a, b, c] = cut.map(|k| polygon[k]);
            (b - a).cross(c - a)
        };
        let normals = fan(polygon.len(), 0).map(normal);
        let largest = normals.max_by(|a, b| a.length().total_cmp(&b.length()));
        let Some(across) = largest.and_then(DVec3::try_normalize) else { return false };
        let (x, y) = across.any_orthonormal_pair();
        let size = polygon.iter().map(|p| p.distance(polygon[0])).fold(0.0, f64::max);
        let flat = polygon.iter().map(|p| (*p - polygon[0]) / size).map(|p| [p.dot(x), p.dot(y)]);
        self.flat.clear();
        self.flat.extend(flat);
        crossing::crosses_itself(&self.flat)
    }

    /// Projects the polygon into its plane, where it runs counter-clockwise; false where its
    /// Newell normal is zero.
    fn flatten(&mut self, polygon: &[DVec3]) -> bool {
        let origin = polygon[0];
        let offset = |vertex: &DVec3| *vertex - origin;
        let size = polygon.iter().map(|v| offset(v).abs().max_element()).fold(0.0, f64::max);
        if size == 0.0 {
            return false;
        }
        self.local.clear();
        self.local.extend(polygon.iter().map(|vertex| DVec3::to_array(&(offset(vertex) / size))));
        project3d_to_2d(&self.local, self.local.len(), &mut self.flat)
    }

    /// A vertex around which a fan covers the polygon: none of its triangles is turned over. Best
    /// is one whose triangles all have an area, which a vertex on a straight side spoils. Convex
    /// polygons have one, and concave ones that are star-shaped.
    fn fan_center(&self) -> Option<usize> {
        // A few starts find what there is to find in the polygons of real models.
        let starts = 0..self.flat.len().min(8);
        let fits = |least: f64| {
            move |start: &usize| {
                let flat = |cut: Cut| cut.map(|k| self.flat[k]);
                fan(self.flat.len(), *start).map(flat).all(|corners| twice_area(corners) >= least)
            }
        };
        starts.clone().find(fits(f64::MIN_POSITIVE)).or_else(|| starts.clone().find(fits(0.0)))
    }
}

/// Faces whose outlines cross themselves.
#[derive(Default)]
pub(super) struct Crossings {
    count: usize,
    first: u32,
}

impl Crossings {
    /// Counts a face, by its number from 1.
    pub(super) fn add(&mut self, face: u32) {
        if self.count == 0 {
            self.first = face;
        }
        self.count += 1;
    }

    /// One warning for all faces of a file.
    pub(super) fn warning(&self, file: &Path) -> Option<Warning> {
        let Crossings { count, first } = self;
        let text = format!(
            "the outlines of faces cross themselves: parts are covered twice or not at all ({count} in all, \
             first face {first})"
        );
        (*count > 0).then(|| Warning::in_file(file, None, text))
    }
}

/// The triangles of the fan around vertex `center` of a polygon with `count` vertices.
fn fan(count: usize, center: usize) -> impl Iterator<Item = Cut> {
    let vertex = move |k: usize| (center + k) % count;
    (1..count - 1).map(move |k| [vertex(0), vertex(k), vertex(k + 1)])
}

/// Positive if the corners run counter-clockwise.
fn twice_area(corners: [[f64; 2]; 3]) -> f64 {
    let [a, b, c] = corners.map(DVec2::from);
    (b - a).perp_dot(c - a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    type Triangle = [Vec3; 3];

    fn triangulate(polygon: &[Vec3]) -> Vec<Triangle> {
        let mut cuts = Vec::new();
        let exact: Vec<DVec3> = polygon.iter().map(|p| p.as_dvec3()).collect();
        Triangulator::new().triangulate(&exact, &mut cuts);
        cuts.into_iter().map(|cut| cut.map(|k| polygon[k])).collect()
    }

    fn area_vector([a, b, c]: Triangle) -> DVec3 {
        let [a, b, c] = [a.as_dvec3(), b.as_dvec3(), c.as_dvec3()];
        0.5 * (b - a).cross(c - a)
    }

    /// Newell: half the sum of the cross products of successive vertices, here seen from the first.
    fn newell(polygon: &[Vec3]) -> DVec3 {
        fan(polygon.len(), 0).map(|cut| area_vector(cut.map(|k| polygon[k]))).sum()
    }

    /// Area is kept only if the triangles do not overlap, direction only if none is turned over.
    fn assert_covers(polygon: &[Vec3]) {
        let triangles = triangulate(polygon);
        assert_eq!(triangles.len(), polygon.len() - 2);
        let expected = newell(polygon);
        let total: DVec3 = triangles.iter().copied().map(area_vector).sum();
        assert!((total - expected).length() < 1e-5 * expected.length(), "{total} {expected}");
        let sum_of_areas: f64 = triangles.iter().map(|t| area_vector(*t).length()).sum();
        assert!((sum_of_areas - expected.length()).abs() < 1e-5 * sum_of_areas, "overlap");
        for triangle in triangles {
            assert!(area_vector(triangle).dot(expected) > 0.0, "turned over: {triangle:?}");
        }
    }

    /// A letter L, counter-clockwise; its inner corner is hidden from half of its vertices.
    const L: [[f32; 2]; 6] =
        [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 4.0], [0.0, 4.0]];

    /// All ways to begin the ring, both windings, in the given plane.
    fn all_rings(ring: &[[f32; 2]], place: impl Fn(f32, f32) -> Vec3) -> Vec<Vec<Vec3>> {
        let placed: Vec<Vec3> = ring.iter().map(|&[x, y]| place(x, y)).collect();
        let mut rings = Vec::new();
        for start in 0..placed.len() {
            let mut turned = placed.clone();
            turned.rotate_left(start);
            rings.push(turned.clone());
            turned.reverse();
            rings.push(turned);
        }
        rings
    }

    #[test]
    fn a_concave_polygon_is_covered_once_and_keeps_its_winding() {
        let slanted = |x, y| Vec3::new(x + 10.0, y - 0.3 * x, 0.7 * x + 0.2 * y - 500.0);
        let planes: [&dyn Fn(f32, f32) -> Vec3; 4] = [
            &|x, y| Vec3::new(x, y, 2.0),
            &|x, y| Vec3::new(y, 2.0, x),
            &|x, y| Vec3::new(2.0, x, y),
            &slanted,
        ];
        for plane in planes {
            all_rings(&L, plane).iter().for_each(|ring| assert_covers(ring));
        }
    }

    #[test]
    fn a_concave_quad_is_not_cut_across_its_outside() {
        let arrow = [[0.0, 0.0], [2.0, 1.0], [0.0, 2.0], [0.5, 1.0]];
        all_rings(&arrow, |x, y| Vec3::new(x, y, 0.0)).iter().for_each(|ring| assert_covers(ring));
    }

    #[test]
    fn tiny_polygons_are_cut_as_well_as_large_ones() {
        for size in [1e-17, 1e9] {
            let place = |x, y| size * Vec3::new(x, y, 1.0);
            all_rings(&L, place).iter().for_each(|ring| {
                let expected = newell(ring);
                let triangles = triangulate(ring);
                let sum: f64 = triangles.iter().map(|t| area_vector(*t).length()).sum();
                assert!((sum / expected.length() - 1.0).abs() < 1e-5);
            });
        }
    }

    #[test]
    fn a_convex_polygon_becomes_the_fan_around_its_first_vertex() {
        let square = [Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y];
        let [a, b, c, d] = square;
        assert_eq!(triangulate(&square), [[a, b, c], [a, c, d]]);
    }

    #[test]
    fn a_skew_quad_keeps_its_four_vertices() {
        let skew = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.4), Vec3::Y];
        let triangles = triangulate(&skew);
        assert_eq!(triangles.len(), 2);
        assert!(skew.iter().all(|vertex| triangles.concat().contains(vertex)));
        assert!(triangles.iter().all(|t| area_vector(*t).dot(newell(&skew)) > 0.0));
    }

    #[test]
    fn outlines_that_cross_themselves_are_known() {
        let crosses = |ring: &[[f32; 2]]| {
            let polygon: Vec<DVec3> =
                ring.iter().map(|p| DVec3::new(p[0].into(), p[1].into(), 0.0)).collect();
            Triangulator::new().triangulate(&polygon, &mut Vec::new())
        };
        let bow = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]];
        let uneven = [[0.0, 0.0], [3.0, 1.0], [3.0, 0.0], [0.0, 2.0]];
        assert!(crosses(&bow) && crosses(&uneven));
        // A hole, by a bridge that runs there and back.
        let (o, i) = ([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]], [1.0, 3.0]);
        let hole = [[i[0], i[0]], [i[0], i[1]], [i[1], i[1]], [i[1], i[0]], [i[0], i[0]]];
        let bridged = [&o[..], &o[..1], &hole[..]].concat();
        assert!(!crosses(&L) && !crosses(&bridged));
    }

    #[test]
    fn a_large_polygon_that_crosses_itself_ends_soon() {
        let place = |i: usize| {
            let share = |step: f64| (i as f64 * step).fract();
            DVec3::new(share(0.618034), share(0.7548777), 0.0)
        };
        let polygon: Vec<DVec3> = (0..200_000).map(place).collect();
        let mut cuts = Vec::new();
        assert!(Triangulator::new().triangulate(&polygon, &mut cuts));
        assert_eq!(cuts.len(), polygon.len() - 2);
    }

    #[test]
    fn a_polygon_without_area_becomes_triangles_without_area() {
        let line: Vec<Vec3> = (0..5).map(|i| i as f32 * Vec3::ONE).collect();
        let point = vec![Vec3::ONE; 4];
        for polygon in [line, point] {
            let triangles = triangulate(&polygon);
            assert_eq!(triangles.len(), polygon.len() - 2);
            assert!(triangles.iter().all(|t| area_vector(*t).length() == 0.0));
        }
    }
}
