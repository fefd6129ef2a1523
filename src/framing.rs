//! A camera for a scene that came without one.
//!
//! An object is seen whole, from three quarters outside, without the few triangles that lie far from the rest and
//! without all of a wide ground. A room, whose walls turn their backs or their dark sides outwards, is seen from within.

use crate::geometry::bounds::Bounds;
use crate::geometry::{Ray, RayCaster, TriangleId};
use crate::patches::Sides;
use crate::scene::{Camera, Document, Scene};
use glam::Vec3;

const FOV_OUTSIDE: f32 = 40.0;
const FOV_INSIDE: f32 = 80.0;
/// A view that shows this share of what another does is about as good.
const GOOD_ENOUGH: f64 = 0.75;
/// Room around what is seen whole.
const MARGIN: f32 = 1.06;

impl Document {
    /// The described camera, or the first of the model files' that is not in the dark, or one that is fitted to the
    /// scene, of whose triangles the given sides reflect.
    pub fn view(&self, scene: &Scene, sides: &[Sides], caster: &dyn RayCaster) -> Camera {
        if let Some(camera) = &self.camera {
            return camera.placed(scene.origin);
        }
        let mut of_files = scene.views.iter().map(|(_, camera)| camera.placed(scene.origin));
        of_files
            .find(|camera| !is_in_the_dark(camera, scene, sides, caster))
            .unwrap_or_else(|| fitted(scene, sides, caster))
    }
}

/// Whether a camera sees nothing but dark sides wherever it looks, as one in a solid does.
fn is_in_the_dark(camera: &Camera, scene: &Scene, sides: &[Sides], caster: &dyn RayCaster) -> bool {
    grid(camera).all(|ray| {
        caster.nearest(&ray).is_some_and(|hit| {
            let is_back = !is_front(scene, hit.triangle, &ray);
            !sides[hit.triangle.index()].has(is_back)
                && scene.radiance_on(hit.triangle, is_back) == Vec3::ZERO
        })
    })
}

/// See the [module](self).
pub(crate) fn fitted(scene: &Scene, sides: &[Sides], caster: &dyn RayCaster) -> Camera {
    let judged = |cameras: Vec<Camera>| -> Vec<(Seen, Camera)> {
        cameras.into_iter().map(|c| (Seen::by(&c, scene, sides, caster), c)).collect()
    };
    let (bounds, frame) = (scene.main_part(), Axes::of(scene.up));
    let [corners, straight] = outside(&bounds, frame).map(judged);
    let inside = judged(inside(&bounds, frame));
    let best = |views: &[(Seen, Camera)], count: fn(&Seen) -> usize| {
        // Of equal views the first, so that `max_by_key` must look from the end.
        let best = views.iter().rev().max_by_key(|(seen, _)| count(seen));
        best.cloned().expect("there are always candidates")
    };
    let dark = |(seen, _): &(Seen, Camera), count: fn(&Seen) -> usize| {
        (seen.hits - count(seen)) as f64 / seen.hits.max(1) as f64
    };
    // The first that is about as good as the best: views from the front come first.
    let foremost = |views: &[(Seen, Camera)], count: fn(&Seen) -> usize| {
        let best = best(views, count);
        let is_good = |view: &&(Seen, Camera)| {
            count(&view.0) as f64 >= GOOD_ENOUGH * count(&best.0) as f64
                && dark(view, count) <= dark(&best, count) + 0.1
        };
        views.iter().find(is_good).cloned().unwrap_or(best)
    };
    let is_drawing = frame.is_drawing(&bounds);
    // First by the fronts that are seen; if no view shows any to speak of, by what reflects at all.
    let counts: [fn(&Seen) -> usize; 2] = [|seen| seen.fronts, |seen| seen.lit];
    let found = counts.into_iter().find_map(|count| {
        let [corner, straight] = [foremost(&corners, count), foremost(&straight, count)];
        let inside = best(&inside, count);
        // Some models have many triangles turned round.
        let from_outside =
            |(seen, _): &(Seen, Camera)| 5 * count(seen) >= 2 * seen.hits && seen.hits > 0;
        let from_inside = |(seen, _): &(Seen, Camera)| 2 * count(seen) >= GRID * GRID;
        let [from_corner, from_straight] = [dark(&corner, count), dark(&straight, count)];
        // A plate from its edge shows little.
        let is_ample = 3 * count(&straight.0) >= 2 * corner.0.hits;
        // Into a room that is open at one side the straight view looks past the dark outsides of its walls.
        let is_clearer = is_ample && from_corner > 0.2 && from_straight < 0.5 * from_corner;
        let straight = Some(straight).filter(|_| is_ample);
        let order = if is_clearer || is_drawing {
            [straight, Some(corner)]
        } else {
            [Some(corner), straight]
        };
        order.into_iter().flatten().find(from_outside).or(Some(inside).filter(from_inside))
    });
    let (_, camera) = found.unwrap_or_else(|| best(&corners, |seen| seen.hits));
    camera.in_file_frame(scene.origin)
}

/// Directions of a scene that stands upright.
#[derive(Clone, Copy)]
struct Axes {
    up: Vec3,
    right: Vec3,
    /// Towards the viewer.
    front: Vec3,
}

impl Axes {
    /// With y up, the viewer stands at +z, and with z up at −y.
    fn of(up: Vec3) -> Axes {
        let right = if up.x.abs() > 0.9 { Vec3::Y } else { Vec3::X };
        Axes { up, right, front: right.cross(up) }
    }

    /// Whether all lies in one upright plane, and not just along a line.
    fn is_drawing(self, bounds: &Bounds) -> bool {
        let size = bounds.diagonal();
        let [depth, width, height] =
            [self.front, self.right, self.up].map(|axis| axis.dot(size).abs());
        let (thin, wide) = (depth.min(width), depth.max(width));
        let largest = size.max_element();
        thin < 1e-3 * largest && wide.min(height) > 0.05 * largest
    }

    /// How far the viewer of a corner stands above it: farther above what is flat.
    fn rise(self, bounds: &Bounds) -> f32 {
        let size = bounds.diagonal();
        if self.up.dot(size).abs() < 0.05 * size.max_element() { 1.2 } else { 0.45 }
    }

    fn direction(self, right: f32, up: f32, front: f32) -> Vec3 {
        (self.right * right + self.up * up + self.front * front).normalize()
    }
}

/// Three-quarter views, and those along the axes.
fn outside(bounds: &Bounds, axes: Axes) -> [Vec<Camera>; 2] {
    let corners = [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]
        .map(|(x, z)| axes.direction(0.6 * x, axes.rise(bounds), z));
    let straight = [axes.front, axes.right, -axes.front, -axes.right];
    let camera = |from| whole(bounds, from, axes.up);
    [corners, straight].map(|from| from.into_iter().filter_map(camera).collect())
}

/// The camera that sees all of the box, from a direction.
fn whole(bounds: &Bounds, from: Vec3, up: Vec3) -> Option<Camera> {
    let center = bounds.center();
    let size = bounds.diagonal().length().max(f32::MIN_POSITIVE);
    let right = up.cross(from).try_normalize()?;
    let top = from.cross(right);
    let slope = (0.5 * FOV_OUTSIDE).to_radians().tan();
    let distance = (0..8)
        .map(|corner| {
            let part =
                |bit: u32, low: f32, high: f32| if corner >> bit & 1 == 0 { low } else { high };
            let (min, max) = (bounds.min, bounds.max);
            let p = Vec3::new(part(0, min.x, max.x), part(1, min.y, max.y), part(2, min.z, max.z));
            let offset = p - center;
            let aside = right.dot(offset).abs().max(top.dot(offset).abs());
            from.dot(offset) + aside / slope
        })
        .fold(size * 1e-3, f32::max);
    Camera::new(center + from * (distance * MARGIN), center, up, FOV_OUTSIDE, 0.0).ok()
}

/// From the middle of each wall and from the corners to the middle of the room.
fn inside(bounds: &Bounds, axes: Axes) -> Vec<Camera> {
    let (center, half) = (bounds.center(), 0.5 * bounds.diagonal());
    let straight = [axes.front, axes.right, -axes.front, -axes.right].map(|d| d * half * 0.96);
    let corners = [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]
        .map(|(x, z)| (axes.right * x + axes.front * z + axes.up * 0.25) * half * 0.9);
    let camera = |from: Vec3| Camera::new(center + from, center, axes.up, FOV_INSIDE, 0.0).ok();
    straight.into_iter().chain(corners).filter_map(camera).collect()
}

const GRID: usize = 48;

/// How many of a grid of rays meet what.
#[derive(Clone, Default)]
struct Seen {
    hits: usize,
    /// Sides that reflect; light sources themselves do not count.
    lit: usize,
    /// The fronts among them.
    fronts: usize,
}

impl Seen {
    fn by(camera: &Camera, scene: &Scene, sides: &[Sides], caster: &dyn RayCaster) -> Seen {
        let mut seen = Seen::default();
        for ray in grid(camera) {
            let Some(hit) = caster.nearest(&ray) else { continue };
            let is_front = is_front(scene, hit.triangle, &ray);
            let reflects = sides[hit.triangle.index()].has(!is_front);
            let is_lit = reflects && !is_lamp(scene, hit.triangle, !is_front);
            seen.hits += 1;
            seen.lit += usize::from(is_lit);
            seen.fronts += usize::from(is_lit && is_front);
        }
        seen
    }
}

/// Rays through a square picture.
fn grid(camera: &Camera) -> impl Iterator<Item = Ray> {
    (0..GRID * GRID).map(|i| {
        let [x, y] = [i % GRID, i / GRID].map(|k| (k as f32 + 0.5) / GRID as f32);
        camera.ray(x, y, 1.0)
    })
}

fn is_front(scene: &Scene, triangle: TriangleId, ray: &Ray) -> bool {
    scene.triangles[triangle.index()].normal().dot(ray.direction) < 0.0
}

/// Whether a side is a source of light and nothing else to look at. Under a sky what glows is seen like anything
/// else, and a picture of light is that of a surface with a few lights on it.
fn is_lamp(scene: &Scene, triangle: TriangleId, is_back: bool) -> bool {
    let material = &scene.materials[scene.material_on(triangle, is_back).0 as usize];
    let is_plain = scene.sky == Vec3::ZERO && material.radiance_map.is_none();
    is_plain && scene.radiance_on(triangle, is_back) != Vec3::ZERO
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{BruteForce, MollerTrumbore, Triangle, shapes};
    use crate::scene::{Material, MaterialId};

    fn scene(triangles: Vec<Triangle>) -> Scene {
        let material_of = vec![MaterialId(0); triangles.len()];
        Scene::new(triangles, material_of, vec![Material::fallback()])
    }

    fn fit(scene: &Scene) -> Camera {
        let caster = BruteForce::<MollerTrumbore>::new(&scene.triangles);
        fitted(scene, &Sides::of_all(scene), &caster)
    }

    #[test]
    fn a_single_triangle_is_seen_from_its_front() {
        let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
        let axis = |t| fit(&scene(vec![t])).ray(0.5, 0.5, 1.0).direction;
        assert!(axis(Triangle::new(a, b, c)).z < 0.0);
        assert!(axis(Triangle::new(a, c, b)).z > 0.0);
    }

    #[test]
    fn an_upright_drawing_is_looked_at_straight_and_a_plate_from_well_above() {
        let wall = shapes::square(Vec3::ZERO, Vec3::X * 2.0, Vec3::Y);
        let axis = fit(&scene(wall)).ray(0.5, 0.5, 1.0).direction.normalize();
        assert!(axis.dot(Vec3::NEG_Z) > 0.999, "{axis}");
        let plate = shapes::square(Vec3::ZERO, Vec3::Z, Vec3::X);
        let axis = fit(&scene(plate)).ray(0.5, 0.5, 1.0).direction.normalize();
        assert!(axis.y < -0.6, "{axis}");
    }

    #[test]
    fn an_object_is_seen_from_its_front_though_its_back_shows_a_little_more() {
        let flag = shapes::square(Vec3::new(0.4, 1.0, 0.0), Vec3::Y * 0.2, Vec3::X * 0.2);
        let triangles = [shapes::cube(Vec3::ZERO, 1.0), flag].concat();
        assert!(fit(&scene(triangles)).ray(0.5, 0.5, 1.0).direction.z < 0.0);
    }

    #[test]
    fn a_plate_that_shows_many_backs_from_above_is_not_seen_from_its_edge() {
        let is_top = |t: &Triangle| t.normal().y > 0.9;
        let mut plate = shapes::cube(Vec3::ZERO, 1.0);
        plate.retain(|triangle| !is_top(triangle));
        // A third of the top shows its front.
        let [a, b, c, d, e] = [(0.0, 0.0), (0.0, 1.0), (0.66, 1.0), (1.0, 1.0), (1.0, 0.0)]
            .map(|(x, z)| Vec3::new(x, 1.0, z));
        plate.extend([Triangle::new(a, b, c), Triangle::new(a, d, c), Triangle::new(a, e, d)]);
        let thin = Vec3::new(1.0, 0.1, 1.0);
        plate.iter_mut().for_each(|triangle| triangle.p = triangle.p.map(|p| p * thin));
        let axis = fit(&scene(plate)).ray(0.5, 0.5, 1.0).direction.normalize();
        assert!(axis.y < -0.3, "{axis}");
    }

    #[test]
    fn an_object_that_glows_under_a_sky_is_seen_from_outside() {
        let cube = shapes::cube(Vec3::ZERO, 1.0);
        let glow = Material { radiance: Vec3::splat(0.5), two_sided: true, ..Material::fallback() };
        let mut scene = Scene::new(cube.clone(), vec![MaterialId(0); cube.len()], vec![glow]);
        scene.sky = Vec3::ONE;
        let (eye, bounds) = (fit(&scene).ray(0.5, 0.5, 1.0).origin, scene.bounds());
        assert!(!(eye.cmpge(bounds.min) & eye.cmple(bounds.max)).all(), "{eye}");
    }

    #[test]
    fn a_room_that_is_open_at_one_side_is_looked_into() {
        let mut walls = shapes::inside_out(shapes::cube(Vec3::ZERO, 1.0));
        walls.retain(|wall| wall.normal() != Vec3::NEG_Z);
        assert_eq!(walls.len(), 10);
        let direction = fit(&scene(walls)).ray(0.5, 0.5, 1.0).direction;
        assert!(direction.normalize().dot(Vec3::NEG_Z) > 0.999, "{direction}");
    }

    #[test]
    fn an_object_is_seen_whole_from_outside_and_a_room_from_within() {
        let cube = shapes::cube(Vec3::ZERO, 1.0);
        let object = fit(&scene(cube.clone()));
        let bounds = scene(cube.clone()).bounds();
        for i in 0..GRID * 4 {
            let along = i % GRID;
            let edge = (along as f32 + 0.5) / GRID as f32;
            let (x, y) = [(edge, 0.0), (edge, 1.0), (0.0, edge), (1.0, edge)][i / GRID];
            let (triangles, ray) = (cube.clone(), object.ray(x, y, 1.0));
            assert!(BruteForce::<MollerTrumbore>::new(&triangles).nearest(&ray).is_none());
        }
        let inside = |camera: &Camera| {
            let eye = camera.ray(0.5, 0.5, 1.0).origin;
            eye.cmpge(bounds.min).all() && eye.cmple(bounds.max).all()
        };
        assert!(!inside(&object));
        assert!(inside(&fit(&scene(shapes::inside_out(cube)))));
    }
}
