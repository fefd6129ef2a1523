//! Rays, ordinary and adversarial, as a function of (seed, kind, index).
//!
//! Ordinary rays are those that rendering casts. Adversarial ones aim at what goes wrong in ray tracers:
//! edges and vertices, planes seen edge-on, zeros and denormals in the direction, origins on surfaces
//! or far away, intervals that end exactly at a hit, and NaN or infinity.

use crate::geometry::surface::{Point, Surface};
use crate::geometry::{Kernel, MollerTrumbore, Ray, Triangle};
use crate::sampling::{PointSet, Purpose, Stream, cosine_hemisphere, orthonormal_basis};
use crate::scene::{Camera, Scene};
use glam::Vec3;

/// The case that a ray is meant to try.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum RayKind {
    /// Cosine-distributed from uniform points of the surfaces, lifted as form factors lift them.
    Surface,
    Camera,
    /// Between two points of the surfaces.
    Segment,
    /// Exactly towards a vertex, as far as f32 can aim.
    Vertex,
    /// Towards the midpoint of an edge.
    Edge,
    /// Along an edge, in the planes of its triangles.
    AlongEdge,
    /// Just above a surface, at 1e-7 to it.
    Grazing,
    /// Along an axis, the other components 0 and −0, through a vertex's coordinates.
    Axis,
    /// A direction so short that its components are denormal.
    Denormal,
    /// From exactly on a surface.
    OnSurface,
    /// From 10⁶ scenes away.
    Far,
    /// An interval that begins or ends exactly at a hit, or one ulp beside it.
    IntervalEnd,
    /// NaN and infinity in the origin or the direction.
    Broken,
}

impl RayKind {
    pub(crate) const ALL: [RayKind; 13] = [
        RayKind::Surface,
        RayKind::Camera,
        RayKind::Segment,
        RayKind::Vertex,
        RayKind::Edge,
        RayKind::AlongEdge,
        RayKind::Grazing,
        RayKind::Axis,
        RayKind::Denormal,
        RayKind::OnSurface,
        RayKind::Far,
        RayKind::IntervalEnd,
        RayKind::Broken,
    ];

    pub(crate) fn name(self) -> &'static str {
        match self {
            RayKind::Surface => "surface",
            RayKind::Camera => "camera",
            RayKind::Segment => "segment",
            RayKind::Vertex => "vertex",
            RayKind::Edge => "edge",
            RayKind::AlongEdge => "along-edge",
            RayKind::Grazing => "grazing",
            RayKind::Axis => "axis",
            RayKind::Denormal => "denormal",
            RayKind::OnSurface => "on-surface",
            RayKind::Far => "far",
            RayKind::IntervalEnd => "interval-end",
            RayKind::Broken => "broken",
        }
    }

    /// Share of the rays, in parts: half of the rays are ordinary.
    pub(crate) fn parts(self) -> u64 {
        match self {
            RayKind::Surface | RayKind::Segment => 4,
            RayKind::Camera => 2,
            _ => 1,
        }
    }
}

/// Makes rays about one scene.
pub(crate) struct RaySource<'s> {
    scene: &'s Scene,
    camera: &'s Camera,
    seed: u64,
    surface: Surface<'s>,
    center: Vec3,
    size: f32,
}

impl<'s> RaySource<'s> {
    pub(crate) fn new(scene: &'s Scene, camera: &'s Camera, seed: u64) -> Self {
        let bounds = scene.bounds();
        let size = bounds.diagonal().length();
        let surface = Surface::new(&scene.triangles);
        RaySource { scene, camera, seed, surface, center: bounds.center(), size }
    }

    /// The ray number `index` of a kind.
    pub(crate) fn ray(&self, kind: RayKind, index: u64) -> Ray {
        let number = (kind as u64) << 48 | index;
        let stream = Stream::new(self.seed, Purpose::Verify, number, PointSet::Random);
        let (a, b, c) = (stream.point(0), stream.point(1), stream.point(2));
        match kind {
            RayKind::Surface => self.leaving_surface(a, b),
            RayKind::Camera => self.camera.ray(a[0], a[1], 1.0),
            RayKind::Segment => Ray::segment(self.lifted(a), self.lifted(b)),
            RayKind::Vertex => self.towards(a, b, self.corner(c)),
            RayKind::Edge => {
                let [p, q] = self.edge(c);
                self.towards(a, b, 0.5 * p + 0.5 * q)
            }
            RayKind::AlongEdge => {
                let [p, q] = self.edge(a);
                Ray::new(p - (q - p) * (b[0] * 4.0 - 1.0), q - p)
            }
            RayKind::Grazing => self.grazing(a, b),
            RayKind::Axis => self.along_axis(a, b),
            RayKind::Denormal => {
                let ray = self.leaving_surface(a, b);
                Ray { direction: ray.direction * 1e-40, ..ray }
            }
            RayKind::OnSurface => {
                let (triangle, u, v) = self.point(a);
                let normal = triangle.normal() * if c[0] < 0.5 { 1.0 } else { -1.0 };
                Ray::new(triangle.at(u, v), cosine_hemisphere(normal, b[0], b[1]))
            }
            RayKind::Far => {
                let (triangle, u, v) = self.point(a);
                let away = Vec3::new(b[0] - 0.5, b[1] - 0.5, b[2] - 0.5).normalize_or(Vec3::X);
                let origin = self.center + away * (self.size * 1e6);
                Ray::new(origin, triangle.at(u, v) - origin)
            }
            RayKind::IntervalEnd => self.interval_end(a, b, c),
            RayKind::Broken => self.broken(a, b, c),
        }
    }

    /// A point of the surfaces, uniform in area.
    fn point(&self, xi: [f32; 4]) -> (&'s Triangle, f32, f32) {
        let Point { triangle, u, v } = self.surface.point(xi);
        (triangle, u, v)
    }

    fn lifted(&self, xi: [f32; 4]) -> Vec3 {
        self.surface.point(xi).lifted()
    }

    fn leaving_surface(&self, a: [f32; 4], b: [f32; 4]) -> Ray {
        self.surface.point(a).leaving(b[0], b[1])
    }

    /// From a point of the surfaces, or from anywhere in and around the scene.
    fn towards(&self, a: [f32; 4], b: [f32; 4], target: Vec3) -> Ray {
        let origin = if b[3] < 0.5 { self.lifted(a) } else { self.anywhere(b) };
        Ray::new(origin, target - origin)
    }

    fn anywhere(&self, xi: [f32; 4]) -> Vec3 {
        self.center + (Vec3::new(xi[0], xi[1], xi[2]) - 0.5) * self.size
    }

    fn any_triangle(&self, xi: f32) -> &'s Triangle {
        let count = self.scene.triangles.len();
        &self.scene.triangles[((xi as f64 * count as f64) as usize).min(count - 1)]
    }

    fn corner(&self, xi: [f32; 4]) -> Vec3 {
        self.any_triangle(xi[0]).p[(xi[1] * 3.0) as usize % 3]
    }

    fn edge(&self, xi: [f32; 4]) -> [Vec3; 2] {
        let p = self.any_triangle(xi[0]).p;
        let start = (xi[1] * 3.0) as usize % 3;
        [p[start], p[(start + 1) % 3]]
    }

    fn grazing(&self, a: [f32; 4], b: [f32; 4]) -> Ray {
        let (triangle, u, v) = self.point(a);
        let normal = triangle.normal();
        let (tangent, bitangent) = orthonormal_basis(normal);
        let (sin, cos) = (std::f32::consts::TAU * b[0]).sin_cos();
        let along = tangent * cos + bitangent * sin;
        let origin = triangle.at(u, v) + normal * (1e-7 * self.size);
        Ray::new(origin - along * (b[1] * self.size), along + normal * (1e-7 * (b[2] - 0.5)))
    }

    fn along_axis(&self, a: [f32; 4], b: [f32; 4]) -> Ray {
        let axis = (b[0] * 3.0) as usize % 3;
        let zero = if b[1] < 0.5 { 0.0 } else { -0.0 };
        let sign = if b[2] < 0.5 { 1.0 } else { -1.0 };
        let mut direction = Vec3::splat(zero);
        direction[axis] = sign;
        let mut origin = if b[3] < 0.5 { self.corner(a) } else { self.anywhere(a) };
        origin[axis] = self.center[axis] - sign * self.size * (a[3] * 2.0);
        Ray::new(origin, direction)
    }

    /// A ray at a triangle's inside, whose own t then bounds the interval.
    fn interval_end(&self, a: [f32; 4], b: [f32; 4], c: [f32; 4]) -> Ray {
        let (triangle, u, v) = self.point(a);
        let origin = self.anywhere(b);
        let ray = Ray::new(origin, triangle.at(u, v) - origin);
        let Some((t, ..)) = MollerTrumbore::intersect(&ray, triangle) else { return ray };
        match (c[0] * 5.0) as u32 {
            0 => Ray { t_max: t, ..ray },
            1 => Ray { t_max: t.next_down(), ..ray },
            2 => Ray { t_min: t, ..ray },
            3 => Ray { t_min: t.next_down(), ..ray },
            _ => Ray { t_min: t.next_down(), t_max: t, ..ray },
        }
    }

    fn broken(&self, a: [f32; 4], b: [f32; 4], c: [f32; 4]) -> Ray {
        let mut ray = self.leaving_surface(a, b);
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][(c[0] * 3.0) as usize % 3];
        let axis = (c[1] * 3.0) as usize % 3;
        let part = if c[2] < 0.5 { &mut ray.origin } else { &mut ray.direction };
        part[axis] = bad;
        ray
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{BruteForce, RayCaster};
    use crate::scene::{Material, MaterialId};

    fn scene() -> Scene {
        let p = [Vec3::ZERO, Vec3::X * 2.0, Vec3::Y * 3.0, Vec3::Z];
        let triangles: Vec<Triangle> = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
            .map(|corners| Triangle { p: corners.map(|i: usize| p[i]) })
            .to_vec();
        Scene::new(triangles, vec![MaterialId(0); 4], vec![Material::fallback()])
    }

    fn camera() -> Camera {
        Camera::new(Vec3::splat(5.0), Vec3::ZERO, Vec3::Y, 40.0, 0.0).expect("a good camera")
    }

    #[test]
    fn a_ray_depends_on_seed_kind_and_index_alone() {
        let (scene, camera) = (scene(), camera());
        let source = |seed| RaySource::new(&scene, &camera, seed);
        for kind in RayKind::ALL {
            let bits = |ray: Ray| format!("{ray:?}");
            assert_eq!(bits(source(1).ray(kind, 5)), bits(source(1).ray(kind, 5)));
            assert_ne!(bits(source(1).ray(kind, 5)), bits(source(1).ray(kind, 6)), "{kind:?}");
            assert_ne!(bits(source(1).ray(kind, 5)), bits(source(2).ray(kind, 5)), "{kind:?}");
        }
    }

    #[test]
    fn every_kind_but_the_broken_one_hits_something() {
        let (scene, camera) = (scene(), camera());
        let source = RaySource::new(&scene, &camera, 1);
        let caster = BruteForce::<MollerTrumbore>::new(&scene.triangles);
        for kind in RayKind::ALL {
            let hits =
                (0..1000).filter(|&i| caster.nearest(&source.ray(kind, i)).is_some()).count();
            match kind {
                RayKind::Broken => assert_eq!(hits, 0),
                // Grazing its own plane, a convex body hits nothing else.
                RayKind::Surface | RayKind::Denormal | RayKind::Segment | RayKind::Grazing => {}
                _ => assert!(hits > 20, "{kind:?}: {hits} of 1000"),
            }
        }
    }
}
