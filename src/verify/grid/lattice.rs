//! Triangles and rays of small integers, as functions of a seed.

use crate::geometry::{Ray, Triangle};
use crate::sampling::{PointSet, Purpose, Stream};
use glam::Vec3;

/// Vertices have even coordinates from 0 to this, so that edges have integer midpoints.
const SIDE: u32 = 16;

/// Integers from one stream, one after the other.
pub(super) struct Dice {
    stream: Stream,
    next: u32,
}

impl Dice {
    pub(super) fn new(seed: u64, number: u64) -> Self {
        Dice { stream: Stream::new(seed, Purpose::Verify, number, PointSet::Random), next: 0 }
    }

    /// One of 0 to `sides` − 1.
    fn roll(&mut self, sides: u32) -> u32 {
        self.next += 1;
        // sides · ξ may round up to `sides`.
        ((self.stream.point(self.next)[0] as f64 * sides as f64) as u32).min(sides - 1)
    }

    fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.roll(choices.len() as u32) as usize]
    }

    fn vector(&mut self, mut coordinate: impl FnMut(&mut Dice) -> f32) -> Vec3 {
        Vec3::new(coordinate(self), coordinate(self), coordinate(self))
    }

    fn vertex(&mut self) -> Vec3 {
        self.vector(|dice| 2.0 * dice.roll(SIDE / 2 + 1) as f32)
    }

    /// Any integer point among the triangles.
    fn point(&mut self) -> Vec3 {
        self.vector(|dice| dice.roll(SIDE + 1) as f32)
    }

    /// Any integer point among and around the triangles, from −16 to 32.
    fn origin(&mut self) -> Vec3 {
        self.vector(|dice| dice.roll(3 * SIDE + 1) as f32 - SIDE as f32)
    }

    fn interval(&mut self, ray: Ray) -> Ray {
        let endless = f32::INFINITY;
        // Rays are aimed with t = 1 at the target, so many of these begin or end exactly there.
        let [t_min, t_max] = self.one_of(&[
            [0.0, endless],
            [0.0, endless],
            [0.0, 1.0],
            [1.0, endless],
            [0.0, 0.5],
            [0.5, 2.0],
        ]);
        Ray { t_min, t_max, ..ray }
    }

    /// Along an axis at a speed of 1, 2, 4 or 8; the other components are 0 and −0.
    fn axis_direction(&mut self) -> Vec3 {
        let mut direction = self.vector(|dice| dice.one_of(&[0.0, -0.0]));
        direction[self.roll(3) as usize] = self.one_of(&[1.0, 2.0, 4.0, 8.0, -1.0, -2.0, -4.0]);
        direction
    }
}

/// Number `index` of a scene, given those before it.
pub(super) fn any_triangle(dice: &mut Dice, index: usize, before: &[Triangle]) -> Triangle {
    let (a, b, c) = (dice.vertex(), dice.vertex(), dice.vertex());
    let oblique = Triangle::new(a, b, c);
    if before.is_empty() {
        return oblique;
    }
    let [p, q, r] = dice.one_of(before).p;
    match index % 8 {
        0 | 1 => oblique,
        2 => {
            let mut flat = oblique;
            let axis = dice.roll(3) as usize;
            flat.p.iter_mut().for_each(|p| p[axis] = a[axis]);
            flat
        }
        // All of these in one plane.
        3 => Triangle { p: oblique.p.map(|p| p.with_z(8.0)) },
        4 => Triangle::new(p, q, r),
        5 => Triangle::new(q, p, r),
        6 => Triangle::new(a, b, dice.one_of(&[a, b, 0.5 * (a + b)])),
        _ => Triangle::new(p, q, c),
    }
}

/// Two legs of lengths 2, 4 or 8, one along an axis, the other along a second or halfway between the
/// second and the third: every component of e₁ × e₂ is 0 or plus or minus the same power of two.
pub(super) fn dyadic_triangle(dice: &mut Dice) -> Triangle {
    let axis = dice.roll(3) as usize;
    let [first, second, third] = [0, 1, 2].map(|k| Vec3::AXES[(axis + k) % 3]);
    let tilt = dice.one_of(&[Vec3::ZERO, third, -third]);
    let lengths = [2.0, 4.0, 8.0, -2.0, -4.0, -8.0];
    let (e1, e2) = (first * dice.one_of(&lengths), (second + tilt) * dice.one_of(&lengths));
    let p = dice.vertex();
    // What sticks out is moved back in; legs are even, so the corner stays so.
    let low = p.min(p + e1).min(p + e2).min(Vec3::ZERO);
    let high = p.max(p + e1).max(p + e2).max(Vec3::splat(SIDE as f32)) - SIDE as f32;
    let p = p - low - high;
    Triangle::new(p, p + e1, p + e2)
}

/// Through vertices, edges and points, along edges, within planes, along axes, from surfaces.
pub(super) fn any_ray(dice: &mut Dice, index: usize, triangles: &[Triangle]) -> Ray {
    let [p, q, r] = dice.one_of(triangles).p;
    let (origin, point) = (dice.origin(), dice.point());
    let middle = 0.5 * (p + q);
    let ray = match index % 8 {
        0 => Ray::new(origin, p - origin),
        1 => Ray::new(origin, middle - origin),
        2 => Ray::new(origin, point - origin),
        3 => return dyadic_ray(dice),
        4 => Ray::new(p - (q - p), q - p),
        5 => Ray::new(r, middle - r),
        6 => Ray::new(middle, point - middle),
        _ => {
            let from = dice.point();
            Ray::new(from, p - from)
        }
    };
    dice.interval(ray)
}

pub(super) fn dyadic_ray(dice: &mut Dice) -> Ray {
    let direction = dice.axis_direction();
    let mut origin = dice.point();
    let axis = direction.abs().max_position();
    origin[axis] = dice.one_of(&[origin[axis], -(SIDE as f32), 2.0 * SIDE as f32]);
    dice.interval(Ray::new(origin, direction))
}
