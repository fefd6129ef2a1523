//! Scenes made in memory from a seed, small enough to sit in a cache and large enough not to.

use crate::geometry::Triangle;
use crate::sampling::{PointSet, Purpose, Stream};
use crate::scene::Camera;
use glam::{Quat, Vec3};
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// Triangles and where to look at them from.
pub(crate) struct BenchScene {
    pub name: String,
    pub triangles: Arc<[Triangle]>,
    pub camera: Camera,
}

/// The scenes by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BuiltIn {
    /// 36 triangles: a room with a lamp and two blocks.
    Cornell,
    /// About 70,000: a room full of curved things.
    Room,
    /// About 1,600,000: columns, statues, blades of grass and wires, which are long thin triangles.
    Atrium,
}

impl BuiltIn {
    pub(crate) const ALL: [BuiltIn; 3] = [BuiltIn::Cornell, BuiltIn::Room, BuiltIn::Atrium];

    pub(crate) fn name(self) -> &'static str {
        match self {
            BuiltIn::Cornell => "cornell",
            BuiltIn::Room => "room",
            BuiltIn::Atrium => "atrium",
        }
    }

    pub(crate) fn scene(self, seed: u64) -> BenchScene {
        let dice = Dice { stream: Stream::new(seed, Purpose::Bench, 0, PointSet::Random), next: 0 };
        let (triangles, eye, target) = match self {
            BuiltIn::Cornell => cornell(),
            BuiltIn::Room => room(dice),
            BuiltIn::Atrium => atrium(dice),
        };
        let camera = Camera::new(eye, target, Vec3::Y, 60.0, 0.0).expect("an ordinary view");
        BenchScene { name: self.name().into(), triangles: triangles.into(), camera }
    }
}

/// Triangles, an eye and what it looks at.
type View = (Vec<Triangle>, Vec3, Vec3);

/// Uniform numbers, one after the other.
struct Dice {
    stream: Stream,
    next: u32,
}

impl Dice {
    fn roll(&mut self) -> [f32; 4] {
        self.next += 1;
        self.stream.point(self.next)
    }

    fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.roll()[0]
    }

    /// A point above a floor that reaches from −`half` to `half`.
    fn place(&mut self, half: Vec3, height: f32) -> Vec3 {
        let [x, z, ..] = self.roll();
        Vec3::new((2.0 * x - 1.0) * half.x, height, (2.0 * z - 1.0) * half.z)
    }
}

/// Two triangles for each cell of a `rows` × `columns` grid over the unit square, bent by `point`;
/// those without area, at the poles of what is round, are left out.
fn sheet(into: &mut Vec<Triangle>, rows: u32, columns: u32, point: impl Fn(f32, f32) -> Vec3) {
    let at = |i: u32, j: u32| point(i as f32 / rows as f32, j as f32 / columns as f32);
    for i in 0..rows {
        for j in 0..columns {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            let pair = [Triangle::new(a, b, c), Triangle::new(a, c, d)];
            into.extend(pair.into_iter().filter(|triangle| triangle.area() > 0.0));
        }
    }
}

/// A box; its faces look outwards, or inwards if it is a room.
fn cuboid(into: &mut Vec<Triangle>, center: Vec3, half: Vec3, turn: f32, is_room: bool) {
    let rotation = Quat::from_rotation_y(turn);
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut out = Vec3::ZERO;
            out[axis] = sign;
            let across = Vec3::from_array([out.z, out.x, out.y]);
            let along = out.cross(across);
            let corner =
                |a: f32, b: f32| center + rotation * ((out + across * a + along * b) * half);
            let [a, b, c, d] =
                [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            let (b, d) = if is_room { (d, b) } else { (b, d) };
            into.extend([Triangle::new(a, b, c), Triangle::new(a, c, d)]);
        }
    }
}

/// A sphere whose radius swings: `lobes` around and as many from pole to pole.
fn lump(into: &mut Vec<Triangle>, rows: u32, center: Vec3, radius: f32, lobes: f32, phase: f32) {
    sheet(into, rows, rows, |i, j| {
        let (theta, phi) = (PI * i, TAU * j);
        let swing = 1.0 + 0.25 * (lobes * phi).sin() * (lobes * theta + phase).sin() * theta.sin();
        let direction = Vec3::new(theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin());
        center + direction * radius * swing
    });
}

fn torus(into: &mut Vec<Triangle>, rows: u32, center: Vec3, radius: f32, turn: Quat) {
    sheet(into, rows, rows, |i, j| {
        let (around, about) = (TAU * i, TAU * j);
        let ring = Vec3::new(around.cos(), 0.0, around.sin());
        center
            + turn * (ring * radius + (ring * about.cos() + Vec3::Y * about.sin()) * radius * 0.35)
    });
}

/// A fluted column whose width swings a little with the height.
fn column(into: &mut Vec<Triangle>, foot: Vec3, height: f32, radius: f32) {
    sheet(into, 128, 96, |i, j| {
        let angle = TAU * j;
        let width = radius * (1.0 + 0.08 * (16.0 * angle).cos() - 0.2 * (PI * i).sin());
        foot + Vec3::new(width * angle.cos(), height * i, -width * angle.sin())
    });
}

fn cornell() -> View {
    let mut triangles = Vec::new();
    cuboid(&mut triangles, Vec3::ZERO, Vec3::ONE, 0.0, true);
    cuboid(&mut triangles, Vec3::new(-0.35, -0.4, -0.3), Vec3::new(0.3, 0.6, 0.3), 0.3, false);
    cuboid(&mut triangles, Vec3::new(0.35, -0.7, 0.3), Vec3::splat(0.3), -0.3, false);
    (triangles, Vec3::new(0.0, 0.0, 0.95), Vec3::ZERO)
}

fn room(mut dice: Dice) -> View {
    let mut triangles = Vec::new();
    let half = Vec3::new(5.0, 2.0, 4.0);
    cuboid(&mut triangles, Vec3::ZERO, half, 0.0, true);
    for _ in 0..6 {
        let place = dice.place(half * 0.8, -1.6);
        cuboid(&mut triangles, place, Vec3::new(0.6, 0.4, 0.4), dice.between(0.0, TAU), false);
    }
    for k in 0..24 {
        let (place, radius) = (dice.place(half * 0.85, 0.0), dice.between(0.2, 0.6));
        let place = place.with_y(dice.between(radius - half.y, half.y - radius));
        match k % 2 {
            0 => lump(&mut triangles, 38, place, radius, 5.0, dice.between(0.0, TAU)),
            _ => {
                let axis = Vec3::from_slice(&dice.roll()).normalize_or(Vec3::Y);
                torus(&mut triangles, 38, place, radius * 0.7, Quat::from_axis_angle(axis, 2.0));
            }
        }
    }
    (triangles, Vec3::new(-4.6, 1.2, 3.6), Vec3::new(1.0, -0.6, -0.8))
}

fn atrium(mut dice: Dice) -> View {
    let mut triangles = Vec::new();
    let half = Vec3::new(20.0, 6.0, 10.0);
    cuboid(&mut triangles, Vec3::ZERO, half, 0.0, true);
    sheet(&mut triangles, 60, 30, |i, j| Vec3::new(2.0 * i - 1.0, -0.999, 1.0 - 2.0 * j) * half);
    for k in 0..24 {
        let foot = Vec3::new((k / 2) as f32 * 3.2 - 17.6, -half.y, (k % 2) as f32 * 10.0 - 5.0);
        column(&mut triangles, foot, 2.0 * half.y, 0.5);
    }
    for k in 0..16 {
        let place = Vec3::new(k as f32 * 2.4 - 18.0, -4.5, dice.between(-3.0, 3.0));
        lump(&mut triangles, 128, place, dice.between(0.6, 1.2), 9.0, dice.between(0.0, TAU));
    }
    for _ in 0..16 {
        let root = dice.place(half * 0.9, -half.y);
        plant(&mut triangles, &mut dice, root, 29_000);
    }
    for _ in 0..400 {
        let (a, b) = (dice.place(half * 0.98, 0.0), dice.place(half * 0.98, 0.0));
        let (a, b) = (a.with_y(dice.between(3.0, 5.9)), b.with_y(dice.between(3.0, 5.9)));
        triangles.push(Triangle::new(a, b, b + Vec3::Y * 0.01));
    }
    (triangles, Vec3::new(-18.5, 0.5, 8.0), Vec3::new(6.0, -2.5, -2.0))
}

/// Blades in a half ball about `root`: each is one triangle, some 25 times as long as wide.
fn plant(into: &mut Vec<Triangle>, dice: &mut Dice, root: Vec3, blades: u32) {
    for _ in 0..blades {
        let ([x, y, z, length], [a, b, c, _]) = (dice.roll(), dice.roll());
        let outward = Vec3::new(2.0 * x - 1.0, y, 2.0 * z - 1.0);
        let foot = root + outward * Vec3::new(2.0, 3.0, 2.0);
        let along = Vec3::new(2.0 * a - 1.0, b, 2.0 * c - 1.0).normalize_or(Vec3::Y);
        let side = along.any_orthonormal_vector() * 0.005;
        into.push(Triangle::new(foot - side, foot + side, foot + along * (0.1 + 0.3 * length)));
    }
}
