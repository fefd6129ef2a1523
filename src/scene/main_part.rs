//! What a picture of a scene should show: not the few triangles far away from the rest, and not all of a wide ground,
//! beside which the rest would be small.

use super::Scene;
use crate::error::Warning;
use crate::geometry::Triangle;
use crate::geometry::bounds::Bounds;
use glam::Vec3;

/// Strays have no more than these shares of the area and of the triangles.
const STRAY_AREA: f64 = 0.005;
const STRAY_COUNT: f64 = 0.1;
/// The longest side of the box around all is divided into `BINS` parts, of which the rest fills `MAIN_BINS` at most.
const BINS: usize = 64;
const MAIN_BINS: usize = BINS / 3;
/// Strays may be at both ends, along each axis.
const ROUNDS: usize = 6;

/// A ground is level to the cosine `LEVEL`, in triangles of at least the share `GROUND_AREA` of the area. Its width is a
/// multiple of that of the things on it: beside a narrower one they are large, and on a wider one they are specks.
const LEVEL: f32 = 0.99;
const GROUND_AREA: f64 = 0.01;
const GROUND_WIDTH: std::ops::Range<f32> = 4.0..200.0;
/// What stands on it is this share of its width high or more, and is in it up to this share of its height at most.
const LEAST_HEIGHT: f32 = 0.05;
const MOST_DEPTH: f32 = 0.25;

impl Scene {
    /// The box of what a picture should show.
    pub(crate) fn main_part(&self) -> Bounds {
        let part = self.without_strays();
        self.without_ground(&part).unwrap_or(part)
    }

    /// Says what such a picture does not show.
    pub(crate) fn main_part_warning(&self) -> Option<Warning> {
        let part = self.without_strays();
        let strays = self.triangles.iter().filter(|t| !is_in(t, &part)).count();
        let far = format!("{strays} of {} triangles lie far from the rest", self.triangles.len());
        let what = match (strays, self.without_ground(&part)) {
            (0, None) => return None,
            (0, Some(_)) => {
                "the ground is wide, and the picture shows what stands on it".to_string()
            }
            (_, None) => format!("{far}, which alone the picture shows"),
            (_, Some(_)) => format!("{far}, and the picture shows what stands on a wide ground"),
        };
        Some(Warning::new(format!("{what} (else: --position and --look-at)")))
    }

    fn without_strays(&self) -> Bounds {
        let mut part = self.bounds();
        for _ in 0..ROUNDS {
            let inside = self.triangles.iter().filter(|t| is_in(t, &part));
            let Some(smaller) = main_run(inside, &part) else { break };
            part = smaller;
        }
        part
    }

    /// The box of what stands on a wide ground, if there is one.
    fn without_ground(&self, part: &Bounds) -> Option<Bounds> {
        let least = GROUND_AREA * self.area();
        let inside = || self.triangles.iter().filter(|t| is_in(t, part));
        let is_level = |t: &&Triangle| t.area() >= least && t.normal().dot(self.up).abs() > LEVEL;
        let rest: Bounds = inside().filter(|t| !is_level(t)).flat_map(|t| t.p).collect();
        let ground: Bounds = inside().filter(is_level).flat_map(|t| t.p).collect();
        if rest == Bounds::EMPTY || ground == Bounds::EMPTY {
            return None;
        }
        let width =
            |bounds: &Bounds| (bounds.diagonal() * (Vec3::ONE - self.up.abs())).max_element();
        let heights = |bounds: &Bounds| {
            let [a, b] = [bounds.min, bounds.max].map(|corner| corner.dot(self.up));
            [a.min(b), a.max(b)]
        };
        let ([bottom, top], [_, level]) = (heights(&rest), heights(&ground));
        let stands = top - bottom >= LEAST_HEIGHT * width(&rest)
            && level <= bottom + MOST_DEPTH * (top - bottom);
        (stands && GROUND_WIDTH.contains(&(width(part) / width(&rest)))).then_some(rest)
    }
}

fn is_in(triangle: &Triangle, part: &Bounds) -> bool {
    let bounds = triangle.bounds();
    bounds.min.cmpge(part.min).all() && bounds.max.cmple(part.max).all()
}

/// The box of the triangles in `part`, which is their box, that hang together along its longest axis and have nearly
/// all of the area; `None` if they are not much smaller.
fn main_run<'t>(
    triangles: impl Iterator<Item = &'t Triangle> + Clone,
    part: &Bounds,
) -> Option<Bounds> {
    let size = part.diagonal();
    let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b]))?;
    let bin = |x: f32| (((x - part.min[axis]) / size[axis] * BINS as f32) as usize).min(BINS - 1);
    // How many triangles begin before each bin, less those that end; and the areas that begin in it.
    let (mut open, mut begun, mut areas) = ([0i64; BINS + 1], [0; BINS], [0.0; BINS]);
    for triangle in triangles.clone() {
        let bounds = triangle.bounds();
        let (first, last) = (bin(bounds.min[axis]), bin(bounds.max[axis]));
        open[first] += 1;
        open[last + 1] -= 1;
        areas[first] += triangle.area();
        begun[first] += 1;
    }
    let mut runs: Vec<(std::ops::Range<usize>, f64)> = Vec::new();
    let mut count = 0;
    for k in 0..BINS {
        count += open[k];
        match runs.last_mut() {
            _ if count == 0 => {}
            Some((run, area)) if run.end == k => {
                run.end = k + 1;
                *area += areas[k];
            }
            _ => runs.push((k..k + 1, areas[k])),
        }
    }
    let total: f64 = areas.iter().sum();
    let (run, area) = runs.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let (all, of_run): (usize, usize) = (begun.iter().sum(), begun[run.clone()].iter().sum());
    if run.len() > MAIN_BINS
        || total - area > STRAY_AREA * total
        || (all - of_run) as f64 > STRAY_COUNT * all as f64
    {
        return None;
    }
    let kept = triangles.filter(|triangle| run.contains(&bin(triangle.bounds().min[axis])));
    Some(kept.flat_map(|triangle| triangle.p).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::shapes;
    use crate::scene::{Material, MaterialId};

    fn scene(triangles: Vec<Triangle>) -> Scene {
        let material_of = vec![MaterialId(0); triangles.len()];
        Scene::new(triangles, material_of, vec![Material::fallback()])
    }

    #[test]
    fn specks_far_away_and_a_wide_ground_are_no_part_and_what_is_large_or_near_is() {
        let ball = shapes::icosphere(3);
        let main = scene(ball.clone()).bounds();
        let with = |more: &[(f32, Vec3)]| {
            let speck = |&(size, at): &(f32, Vec3)| Triangle {
                p: [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p * size + at),
            };
            let scene = scene(ball.iter().copied().chain(more.iter().map(speck)).collect());
            let all = scene.bounds();
            let part = scene.main_part();
            assert_eq!(scene.main_part_warning().is_some(), part != all);
            (part, all)
        };
        let far = [(0.1, Vec3::Z * 9.0), (0.2, Vec3::Z * -40.0), (0.1, Vec3::Y * 12.0)];
        assert_eq!(with(&far).0, main);
        // A large one, and a near one.
        for alone in [(1.0, Vec3::Z * 9.0), (0.1, Vec3::Z * 3.0)] {
            let (part, all) = with(&[alone]);
            assert_eq!(part, all);
        }
    }

    #[test]
    fn what_stands_on_a_wide_ground_is_looked_at_and_nothing_else() {
        let ball = shapes::icosphere(3);
        let with = |size: f32, height: f32, scale: f32| {
            let corners = [Vec3::ZERO, Vec3::Z, Vec3::X].map(|p| p * size);
            let at = Vec3::new(-0.3 * size, height, -0.3 * size);
            let ground = Triangle { p: corners.map(|p| p + at) };
            let thing = ball.iter().map(|t| Triangle { p: t.p.map(|p| p * scale) });
            let scene = scene(thing.chain([ground]).collect());
            scene.main_part() != scene.bounds()
        };
        assert!(with(20.0, -1.0, 1.0) && with(20.0, -0.6, 1.0));
        // Not wide, a roof, in the middle, and a speck.
        assert!(!with(6.0, -1.0, 1.0) && !with(20.0, 1.0, 1.0));
        assert!(!with(20.0, 0.0, 1.0) && !with(20.0, -0.01, 0.01));
        // Flat things do not stand.
        let tile = |k: u8| Triangle {
            p: [Vec3::ZERO, Vec3::Z, Vec3::X].map(|p| p + Vec3::X * f32::from(k)),
        };
        let map =
            scene((0..3).map(tile).chain([Triangle { p: tile(0).p.map(|p| p * 40.0) }]).collect());
        assert_eq!(map.main_part(), map.bounds());
    }
}
