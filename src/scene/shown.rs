//! What is seen of triangles that overlap in one plane.

use super::Scene;
use super::overlaps::{Overlaps, flat};
use crate::geometry::{Triangle, TriangleId};
use crate::known::known;
use crate::sampling::regular_triangle;
use glam::Vec3;

/// A side that is seen in the place of another.
struct Cover {
    triangle: TriangleId,
    is_back: bool,
}

impl Scene {
    /// Which triangles overlap in one plane. It is computed once, then shared by all clones, so change the
    /// triangles only before the first call.
    pub fn overlaps(&self) -> &Overlaps {
        let find = || Overlaps::find(&self.triangles, &self.material_of);
        known(&self.known_overlaps, find)
    }

    /// The share of a piece of a triangle's side, in [0, 1], that is seen and not another triangle in its place.
    pub(crate) fn shown_share(&self, of: TriangleId, is_back: bool, piece: &Triangle) -> f64 {
        let covers = self.covers(of, is_back);
        if covers.is_empty() {
            return 1.0;
        }
        let axis = flat::axis_of(self.triangles[of.index()].double_area_normal());
        let (open, opaque): (Vec<_>, Vec<_>) = covers.into_iter().partition(|c| self.opens(c));
        self.share_beside(axis, &opaque, piece) * self.share_through(axis, &open, piece)
    }

    /// What is seen in the place of a side where it overlaps that.
    fn covers(&self, of: TriangleId, is_back: bool) -> Vec<Cover> {
        let overlaps = self.overlaps();
        let others = overlaps.with(of);
        if others.is_empty() {
            return Vec::new();
        }
        let normal = if is_back { -self.normal_of(of) } else { self.normal_of(of) };
        let cover = |&triangle: &TriangleId| {
            let faces = self.normal_of(triangle).dot(normal) > 0.0;
            let hides = overlaps.comes_first((triangle, faces), (of, !is_back));
            hides.then_some(Cover { triangle, is_back: !faces })
        };
        others.iter().filter_map(cover).collect()
    }

    fn opens(&self, cover: &Cover) -> bool {
        let material = self.material_on(cover.triangle, cover.is_back);
        self.materials[material.0 as usize].is_see_through()
    }

    /// The share of a piece's area that lies beside all covers.
    fn share_beside(&self, axis: usize, covers: &[Cover], piece: &Triangle) -> f64 {
        let whole = flat::seen_along(axis, piece).to_vec();
        let area = flat::area(&whole);
        let (low, high) = flat::bounds(&whole);
        let mut shown = vec![whole];
        for cover in covers {
            let cover = flat::seen_along(axis, &self.triangles[cover.triangle.index()]);
            let (from, to) = flat::bounds(&cover);
            if from.cmplt(high).all() && low.cmplt(to).all() {
                shown = shown.into_iter().flat_map(|part| flat::without(part, &cover)).collect();
            }
            if shown.is_empty() {
                break;
            }
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

    pub(super) fn normal_of(&self, triangle: TriangleId) -> Vec3 {
        self.triangles[triangle.index()].normal()
    }
}
