//! The truth about one ray and all triangles.
//!
//! Every triangle is examined, but those that the line clearly passes by: boxes are tested in f64
//! with room to spare. They form a tree of the plainest kind, so that it is not wrong in the way a
//! renderer's hierarchy could be: triangles in Morton order, a box for every 8 of them, a box for
//! every 8 boxes, and so on.

use super::contact::{Contact, Examined, compare, examine};
use super::cramer::Cramer;
use crate::geometry::{Ray, Triangle, TriangleId};
use glam::{DVec3, Vec3};
use std::cmp::Ordering;

/// Triangles, or boxes, that share a box.
const FANOUT: usize = 8;

/// Relative slack of a box test in f64. A coordinate is off by 3 roundings at most; this is 2¹² times
/// that.
const EXACT_SLACK: f64 = f64::EPSILON * 4096.0;

/// The slack that remains where all coordinates are zero: less than any f32, but not zero.
const PAD: f64 = f32::from_bits(1) as f64 / 4096.0;

/// A triangle that a ray meets, or touches.
#[derive(Debug, Clone, Copy)]
pub struct Met {
    pub triangle: TriangleId,
    pub contact: Contact,
    pub cramer: Cramer,
}

/// All triangles of a scene, to be asked one exact question at a time.
pub struct Referee<'t> {
    triangles: &'t [Triangle],
    /// In Morton order.
    order: Vec<TriangleId>,
    /// Extent `i` of level 0 holds triangles 8i to 8i + 7 of `order`, and that of level k + 1 boxes 8i
    /// to 8i + 7 of level k. The last level has one box; there is none without triangles.
    levels: Vec<Vec<Extent>>,
}

impl<'t> Referee<'t> {
    pub fn new(triangles: &'t [Triangle]) -> Self {
        let order = morton_order(triangles);
        let enclose = |run: &[TriangleId]| {
            Extent::around(run.iter().map(|id| Extent::of(&triangles[id.index()])))
        };
        let mut levels: Vec<Vec<Extent>> = vec![order.chunks(FANOUT).map(enclose).collect()];
        while let Some(below) = levels.last().filter(|level| level.len() > 1) {
            let above =
                below.chunks(FANOUT).map(|run| Extent::around(run.iter().copied())).collect();
            levels.push(above);
        }
        Referee { triangles, order, levels }
    }

    pub fn triangles(&self) -> &'t [Triangle] {
        self.triangles
    }

    pub fn triangle(&self, id: TriangleId) -> &'t Triangle {
        &self.triangles[id.index()]
    }

    /// The exact truth about one triangle.
    pub fn examine(&self, ray: &Ray, id: TriangleId) -> Examined {
        examine(ray, self.triangle(id))
    }

    /// Every triangle that the ray hits or touches, in the scene's order. Those in one plane with the
    /// line (coplanar or degenerate) count only if the ray meets their box.
    pub fn met(&self, ray: &Ray) -> Vec<Met> {
        let mut met = Vec::new();
        for id in self.near(ray, EXACT_SLACK) {
            let Examined { contact, cramer } = self.examine(ray, id);
            if !matches!(contact, Contact::Miss(_)) {
                met.push(Met { triangle: id, contact, cramer });
            }
        }
        met.sort_by_key(|met| met.triangle);
        met
    }

    /// The nearest of the triangles that are hit, not only touched; of several the first.
    pub fn nearest(&self, ray: &Ray) -> Option<Met> {
        let hits =
            self.met(ray).into_iter().filter(|met| matches!(met.contact, Contact::Hit { .. }));
        hits.reduce(|nearest, met| match self.compare(ray, &met, &nearest) {
            Some(Ordering::Less) => met,
            _ => nearest,
        })
    }

    /// Which of two triangles the ray meets first, exactly; `None` if it is parallel to one.
    pub fn compare(&self, ray: &Ray, first: &Met, second: &Met) -> Option<Ordering> {
        let (a, b) = (self.triangle(first.triangle), self.triangle(second.triangle));
        compare(ray, (a, &first.cramer), (b, &second.cramer))
    }

    /// The triangles whose box, grown by `slack` times its coordinates and the origin's, the ray
    /// meets. An infinite slack gives all triangles.
    pub fn near(&self, ray: &Ray, slack: f64) -> Vec<TriangleId> {
        let mut found = Vec::new();
        let slabs = Slabs::new(ray, slack);
        if let Some(top) = self.levels.len().checked_sub(1) {
            self.gather(&slabs, top, 0..self.levels[top].len(), &mut found);
        }
        found
    }

    fn gather(
        &self,
        slabs: &Slabs,
        level: usize,
        boxes: std::ops::Range<usize>,
        found: &mut Vec<TriangleId>,
    ) {
        for index in boxes.filter(|&index| slabs.meet(&self.levels[level][index])) {
            let below = index * FANOUT..(index + 1) * FANOUT;
            if level > 0 {
                let below = below.start..below.end.min(self.levels[level - 1].len());
                self.gather(slabs, level - 1, below, found);
            } else {
                let run = &self.order[below.start..below.end.min(self.order.len())];
                let is_near = |id: &&TriangleId| slabs.meet(&Extent::of(self.triangle(**id)));
                found.extend(run.iter().filter(is_near));
            }
        }
    }
}

/// The triangles along a curve that keeps neighbours together: the bits of a corner's three
/// coordinates, 10 of each, interleaved (Morton, 1966).
fn morton_order(triangles: &[Triangle]) -> Vec<TriangleId> {
    let scene = Extent::around(triangles.iter().map(Extent::of));
    let key = |triangle: &Triangle| {
        // A corner that is no number casts to 0.
        let share = (triangle.p[0] - scene.min) / (scene.max - scene.min);
        let [x, y, z] = (share * 1023.0).to_array().map(|x| x as u32 & 1023);
        (0..10).fold(0, |key, bit| {
            key | ((x >> bit) & 1) << (3 * bit)
                | ((y >> bit) & 1) << (3 * bit + 1)
                | ((z >> bit) & 1) << (3 * bit + 2)
        })
    };
    let mut order: Vec<TriangleId> = (0..triangles.len() as u32).map(TriangleId).collect();
    order.sort_by_cached_key(|id| key(&triangles[id.index()]));
    order
}

/// Bounds without any rounding. Those of no points have `min` above `max`, and no ray meets them.
#[derive(Debug, Clone, Copy)]
struct Extent {
    min: Vec3,
    max: Vec3,
}

impl Extent {
    const EMPTY: Extent = Extent { min: Vec3::MAX, max: Vec3::MIN };

    /// A triangle with a coordinate that is not finite is never met.
    fn of(triangle: &Triangle) -> Self {
        let [p0, p1, p2] = triangle.p;
        if !(p0.is_finite() && p1.is_finite() && p2.is_finite()) {
            return Extent::EMPTY;
        }
        Extent { min: p0.min(p1).min(p2), max: p0.max(p1).max(p2) }
    }

    fn around(boxes: impl Iterator<Item = Extent>) -> Self {
        boxes.fold(Extent::EMPTY, |a, b| Extent { min: a.min.min(b.min), max: a.max.max(b.max) })
    }
}

/// A ray's side of the slab test (Kay and Kajiya, *Ray Tracing Complex Scenes*, 1986).
struct Slabs {
    origin: DVec3,
    inverse: DVec3,
    interval: [f64; 2],
    slack: f64,
}

impl Slabs {
    fn new(ray: &Ray, slack: f64) -> Self {
        // 2⁵⁰⁰ stands for 1/0. It is beyond 2¹⁴⁹, the inverse of the smallest denormal, and its
        // product with PAD is beyond every t, which are below 2²⁷⁸.
        let beyond = DVec3::splat(2f64.powi(500));
        Slabs {
            origin: ray.origin.as_dvec3(),
            inverse: ray.direction.as_dvec3().recip().clamp(-beyond, beyond),
            interval: [ray.t_min as f64, ray.t_max as f64],
            slack,
        }
    }

    fn meet(&self, bounds: &Extent) -> bool {
        if self.slack.is_infinite() {
            return true;
        }
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let pad = (self.origin.abs() + min.abs().max(max.abs())) * self.slack + PAD;
        let a = (min - pad - self.origin) * self.inverse;
        let b = (max + pad - self.origin) * self.inverse;
        let enter = a.min(b).max_element().max(self.interval[0]);
        let leave = a.max(b).min_element().min(self.interval[1]);
        enter <= leave
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{PointSet, Purpose, Stream};
    use crate::verify::contact::Touch;

    /// Ordinary triangles, flat ones in the coordinate planes, and broken ones.
    fn scene() -> Vec<Triangle> {
        let stream = Stream::new(3, Purpose::Pair, 0, PointSet::Random);
        let vector = |i| Vec3::from_slice(&stream.point(i)[..3]) * 2.0 - 1.0;
        let triangle = |i: u32| {
            let p = [0, 1, 2].map(|corner| vector(4 * i) + vector(4 * i + 1 + corner) * 0.3);
            match i % 4 {
                0 => Triangle { p: p.map(|p| p.with_z(0.0)) },
                1 => Triangle { p: p.map(|p| (p * 4.0).round() / 4.0) },
                2 if i % 50 == 2 => Triangle { p: [p[0], p[1], Vec3::splat(f32::NAN)] },
                _ => Triangle { p },
            }
        };
        (0..500).map(triangle).collect()
    }

    #[test]
    fn no_triangle_that_a_ray_meets_is_passed_over() {
        let scene = scene();
        let referee = Referee::new(&scene);
        let stream = Stream::new(4, Purpose::Pair, 0, PointSet::Random);
        let mut count = 0;
        for i in 0..3000 {
            let [x, y, z, w] = stream.point(2 * i);
            let origin = ((Vec3::new(x, y, z) * 2.0 - 1.0) * 8.0).round() / 4.0;
            let target = scene[(w * 500.0) as usize].p[i as usize % 3];
            let direction = match i % 5 {
                0 => Vec3::AXES[i as usize / 5 % 3],
                1 => Vec3::new(-0.0, -1.0, 0.0),
                2 => (target - origin) * f32::MIN_POSITIVE,
                3 => (target - origin).with_z(0.0),
                _ => target - origin,
            };
            let end = if i % 2 == 0 { f32::INFINITY } else { 1.0 };
            let ray = Ray { t_max: end, ..Ray::new(origin, direction) };
            let met: Vec<_> = referee.met(&ray).iter().map(|met| met.triangle).collect();
            for id in (0..500).map(TriangleId) {
                let must = match referee.examine(&ray, id).contact {
                    Contact::Miss(_) => false,
                    Contact::Touching(Touch::Coplanar | Touch::Degenerate) => continue,
                    Contact::Touching(_) | Contact::Hit { .. } => true,
                };
                assert_eq!(met.contains(&id), must, "{id:?}, {ray:?}");
            }
            count += met.len();
        }
        assert!(count > 5000, "only {count} were met");
    }

    #[test]
    fn the_nearest_is_the_one_at_the_least_exact_distance() {
        let at = |z: f32| Triangle::new(Vec3::Z * z, Vec3::X + Vec3::Z * z, Vec3::Y + Vec3::Z * z);
        let scene = [at(3.0), at(1f32.next_up()), at(1.0), at(-1.0), at(1.0)];
        let referee = Referee::new(&scene);
        let nearest = |t_min, d| {
            let ray = Ray { t_min, ..Ray::new(Vec3::new(0.25, 0.25, 0.0), Vec3::Z * d) };
            referee.nearest(&ray).map(|met| met.triangle.0)
        };
        assert_eq!(nearest(0.0, 1.0), Some(2));
        assert_eq!(nearest(1.0, 1.0), Some(1));
        assert_eq!(nearest(0.0, 1e-40), Some(2));
        assert_eq!(nearest(0.0, -1.0), Some(3));
        assert_eq!(nearest(4.0, 1.0), None);
        assert!(Referee::new(&[]).nearest(&Ray::new(Vec3::ZERO, Vec3::X)).is_none());
    }

    #[test]
    fn an_infinite_slack_leaves_nothing_out() {
        let scene = scene();
        let mut all = Referee::new(&scene).near(&Ray::new(Vec3::ZERO, Vec3::X), f64::INFINITY);
        all.sort();
        assert_eq!(all, (0..500).map(TriangleId).collect::<Vec<_>>());
    }
}
