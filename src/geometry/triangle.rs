//! A triangle of the scene.

use super::bounds::Bounds;
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

/// Index into [`Scene::triangles`](crate::scene::Scene::triangles).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TriangleId(pub u32);

impl TriangleId {
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// The most times that a triangle may be split into four, which makes 4¹² pieces of it: any piece's
/// number fits in 24 bits.
pub const MAX_LEVEL: u32 = 12;

/// Three vertices, counter-clockwise seen from the front.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Triangle {
    pub p: [Vec3; 3],
}

impl Triangle {
    pub fn new(p0: Vec3, p1: Vec3, p2: Vec3) -> Self {
        Triangle { p: [p0, p1, p2] }
    }

    /// The edges from p₀ to p₁ and to p₂, as every kernel uses them.
    pub fn edges(&self) -> (Vec3, Vec3) {
        (self.p[1] - self.p[0], self.p[2] - self.p[0])
    }

    /// The largest component of the edges from p₀.
    pub fn reach(&self) -> f32 {
        let (e1, e2) = self.edges();
        e1.abs().max(e2.abs()).max_element()
    }

    /// The point with barycentrics (1 − u − v, u, v).
    pub fn at(&self, u: f32, v: f32) -> Vec3 {
        let (e1, e2) = self.edges();
        self.p[0] + e1 * u + e2 * v
    }

    /// The front's normal with the doubled area as length, in double precision.
    #[inline]
    pub fn double_area_normal(&self) -> DVec3 {
        let [p0, p1, p2] = self.p;
        let p0 = p0.as_dvec3();
        (p1.as_dvec3() - p0).cross(p2.as_dvec3() - p0)
    }

    #[inline]
    pub fn area(&self) -> f64 {
        0.5 * self.double_area_normal().length()
    }

    /// Whether the area is more than zero, to the last bit.
    #[inline]
    pub fn has_area(&self) -> bool {
        self.double_area_normal().length_squared() > 0.0
    }

    /// The front's unit normal. Zero for a triangle without area.
    #[inline]
    pub fn normal(&self) -> Vec3 {
        self.double_area_normal().normalize_or_zero().as_vec3()
    }

    pub fn centroid(&self) -> Vec3 {
        self.at(1.0 / 3.0, 1.0 / 3.0)
    }

    /// The triangle with every edge moved inwards by `distance`; its incenter if that is too far.
    ///
    /// Shrinking about the incenter by a share of the inradius moves all three edges alike.
    pub fn inset(&self, distance: f64) -> Triangle {
        let p = self.p.map(|p| p.as_dvec3());
        // Each vertex weighs as much as the edge opposite to it is long.
        let opposite = [p[1].distance(p[2]), p[2].distance(p[0]), p[0].distance(p[1])];
        let perimeter: f64 = opposite.iter().sum();
        let incenter = (p[0] * opposite[0] + p[1] * opposite[1] + p[2] * opposite[2]) / perimeter;
        let inradius = 2.0 * self.area() / perimeter;
        let share = (distance / inradius).min(1.0);
        Triangle { p: p.map(|p| p.lerp(incenter, share).as_vec3()) }
    }

    #[inline]
    pub fn longest_edge(&self) -> f64 {
        let [p0, p1, p2] = self.p.map(|p| p.as_dvec3());
        // The root of the largest square is the largest root, to the last bit.
        let square = p0.distance_squared(p1).max(p1.distance_squared(p2));
        square.max(p2.distance_squared(p0)).sqrt()
    }

    #[inline]
    pub fn bounds(&self) -> Bounds {
        let [p0, p1, p2] = self.p;
        Bounds { min: p0.min(p1).min(p2), max: p0.max(p1).max(p2) }
    }

    /// How far above the surface a ray must start so that it cannot hit the triangle it leaves.
    ///
    /// With ε = 2⁻²⁴ and M the largest coordinate, [`Triangle::at`] rounds each coordinate by at
    /// most 15 εM (edges up to 2M, five roundings), so the point lies within √3·15 εM < 26 εM of
    /// the plane; adding the offset rounds by 2 εM more and a kernel's own subtraction of p₀ by
    /// 4 εM. 64 εM covers the sum twice. It scales with the scene: no absolute epsilon.
    #[inline]
    pub fn ray_offset(&self) -> f32 {
        let largest = self.p.iter().map(|p| p.abs().max_element()).fold(0.0, f32::max);
        largest * (64.0 * f32::EPSILON / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_right_triangle_has_half_its_legs_product_as_area() {
        let t = Triangle::new(Vec3::ZERO, Vec3::X * 3.0, Vec3::Y * 4.0);
        assert_eq!(t.area(), 6.0);
        assert_eq!(t.normal(), Vec3::Z);
        assert_eq!(t.longest_edge(), 5.0);
    }

    #[test]
    fn an_inset_moves_every_edge_by_its_distance() {
        // Legs 3 and 4: inradius 1, incenter (1, 1).
        let t = Triangle::new(Vec3::ZERO, Vec3::X * 3.0, Vec3::Y * 4.0);
        let inset = t.inset(0.25);
        assert_eq!(inset.p[0], Vec3::new(0.25, 0.25, 0.0));
        // The inradius is 3/4, so the area shrinks to its square.
        assert!((inset.area() - 6.0 * 0.5625).abs() < 1e-5);
        assert_eq!(t.inset(9.0).p, [Vec3::new(1.0, 1.0, 0.0); 3]);
    }

    #[test]
    fn barycentrics_reach_the_vertices() {
        let t = Triangle::new(Vec3::ONE, Vec3::X * 3.0, Vec3::Y * 4.0);
        assert_eq!(t.at(0.0, 0.0), t.p[0]);
        assert_eq!(t.at(1.0, 0.0), t.p[1]);
        assert_eq!(t.at(0.0, 1.0), t.p[2]);
    }
}
