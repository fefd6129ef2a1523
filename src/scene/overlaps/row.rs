//! Eight things in a row, compared with another one at once.

use crate::geometry::bounds::Bounds;
use fearless_simd::{Simd, f32x8, prelude::*};
use glam::Vec3;

pub(super) const WIDTH: usize = 8;

/// Normals with a smaller cosine between them are not those of one plane. Within the tolerance of rays two
/// planes at a degree stay together for a few thousandths of a percent of the scene only.
pub(super) const PARALLEL: f32 = 0.9998;

/// Something flat in a box.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flat {
    pub bounds: Bounds,
    /// Of length 1, or 0 for what is parallel to nothing.
    pub normal: Vec3,
}

impl Flat {
    /// Whether this may overlap another one: their boxes touch and they are parallel, be it that one is turned round.
    pub(super) fn fits(&self, other: &Flat) -> bool {
        self.bounds.touches(&other.bounds) && self.normal.dot(other.normal).abs() > PARALLEL
    }
}

/// Up to eight vectors as `[axis][lane]`.
type Lanes = [[f32; WIDTH]; 3];

/// Up to eight boxes. A lane without one touches nothing.
#[derive(Debug)]
pub(super) struct Boxes {
    min: Lanes,
    max: Lanes,
}

impl Boxes {
    const EMPTY: Boxes =
        Boxes { min: [[f32::INFINITY; WIDTH]; 3], max: [[f32::NEG_INFINITY; WIDTH]; 3] };

    pub(super) fn new(boxes: impl Iterator<Item = Bounds>) -> Boxes {
        let mut lanes = Boxes::EMPTY;
        boxes.enumerate().for_each(|(lane, bounds)| lanes.set(lane, bounds));
        lanes
    }

    fn set(&mut self, lane: usize, bounds: Bounds) {
        set(&mut self.min, lane, bounds.min);
        set(&mut self.max, lane, bounds.max);
    }

    pub(super) fn get(&self, lane: usize) -> Bounds {
        Bounds { min: vector(&self.min, lane), max: vector(&self.max, lane) }
    }

    /// The box around them.
    pub(super) fn around(&self) -> Bounds {
        (0..WIDTH).fold(Bounds::EMPTY, |all, lane| all.with(&self.get(lane)))
    }

    /// One of them, in all lanes. It is read from where it lies: a copy in between would be waited for.
    #[inline(always)]
    pub(super) fn broadcast<S: Simd>(&self, simd: S, lane: usize) -> BoxLanes<S> {
        BoxLanes { min: broadcast(simd, &self.min, lane), max: broadcast(simd, &self.max, lane) }
    }

    /// The lanes whose boxes touch another one, as a mask.
    #[inline(always)]
    pub(super) fn touching<S: Simd>(&self, simd: S, other: &BoxLanes<S>) -> u64 {
        let along = |axis: usize| {
            let min = f32x8::load_array_ref(simd, &self.min[axis]);
            let max = f32x8::load_array_ref(simd, &self.max[axis]);
            min.simd_le(other.max[axis]) & max.simd_ge(other.min[axis])
        };
        (along(0) & along(1) & along(2)).to_bitmask()
    }
}

/// One box in all lanes.
pub(super) struct BoxLanes<S: Simd> {
    min: [f32x8<S>; 3],
    max: [f32x8<S>; 3],
}

impl<S: Simd> BoxLanes<S> {
    #[inline(always)]
    pub(super) fn of(simd: S, bounds: &Bounds) -> Self {
        let [min, max] = [bounds.min, bounds.max];
        let everywhere =
            |v: Vec3| [f32x8::splat(simd, v.x), f32x8::splat(simd, v.y), f32x8::splat(simd, v.z)];
        BoxLanes { min: everywhere(min), max: everywhere(max) }
    }
}

/// Up to eight flat things with their numbers.
#[derive(Debug)]
pub(super) struct Row {
    pub boxes: Boxes,
    normals: Lanes,
    pub numbers: [u32; WIDTH],
}

impl Row {
    pub(super) fn new(numbers: impl Iterator<Item = u32>, thing: impl Fn(u32) -> Flat) -> Row {
        let mut row = Row { boxes: Boxes::EMPTY, normals: [[0.0; WIDTH]; 3], numbers: [0; WIDTH] };
        for (lane, number) in numbers.enumerate() {
            let Flat { bounds, normal } = thing(number);
            row.boxes.set(lane, bounds);
            set(&mut row.normals, lane, normal);
            row.numbers[lane] = number;
        }
        row
    }

    /// The lanes that may overlap a thing of some row: their boxes touch its box, and the cosine between the normals
    /// is larger than `parallel`, be it that one is turned round.
    #[inline(always)]
    pub(super) fn fitting<S: Simd>(
        &self,
        simd: S,
        (row, lane): (&Row, usize),
        parallel: f32,
    ) -> u64 {
        let normal = broadcast(simd, &row.normals, lane);
        let along = |axis: usize| f32x8::load_array_ref(simd, &self.normals[axis]) * normal[axis];
        let cosines = along(0) + along(1) + along(2);
        let is_parallel = cosines.abs().simd_gt(f32x8::splat(simd, parallel));
        self.boxes.touching(simd, &row.boxes.broadcast(simd, lane)) & is_parallel.to_bitmask()
    }
}

/// The numbers of the bits that are set in a mask.
#[inline(always)]
pub(super) fn lanes(mut mask: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = (mask != 0).then_some(mask.trailing_zeros() as usize)?;
        mask &= mask - 1;
        Some(lane)
    })
}

fn set(lanes: &mut Lanes, lane: usize, vector: Vec3) {
    for axis in 0..3 {
        lanes[axis][lane] = vector[axis];
    }
}

#[inline(always)]
fn broadcast<S: Simd>(simd: S, lanes: &Lanes, lane: usize) -> [f32x8<S>; 3] {
    [
        f32x8::splat(simd, lanes[0][lane]),
        f32x8::splat(simd, lanes[1][lane]),
        f32x8::splat(simd, lanes[2][lane]),
    ]
}

#[inline(always)]
fn vector(lanes: &Lanes, lane: usize) -> Vec3 {
    Vec3::new(lanes[0][lane], lanes[1][lane], lanes[2][lane])
}

#[cfg(test)]
mod tests {
    use super::*;
    use fearless_simd::{Level, dispatch};

    fn unit_box(x: f32) -> Bounds {
        Bounds { min: Vec3::new(x, 0.0, -1.0), max: Vec3::new(x + 1.0, 1.0, 0.0) }
    }

    #[test]
    fn lanes_answer_as_single_boxes_do_and_empty_ones_not_at_all() {
        let boxes = Boxes::new((0..5).map(|k| unit_box(2.0 * k as f32)));
        assert_eq!(boxes.around(), Bounds { max: Vec3::new(9.0, 1.0, 0.0), ..unit_box(0.0) });
        let everywhere = Bounds { min: Vec3::splat(-1e30), max: Vec3::splat(1e30) };
        let beside = Bounds { min: Vec3::splat(0.25), max: Vec3::splat(9.0) };
        for other in [unit_box(3.0), unit_box(0.5), everywhere, beside] {
            let touching =
                dispatch!(Level::new(), simd => boxes.touching(simd, &BoxLanes::of(simd, &other)));
            let each = (0..5).filter(|&lane| boxes.get(lane).touches(&other));
            assert_eq!(lanes(touching).collect::<Vec<_>>(), each.collect::<Vec<_>>());
        }
    }

    #[test]
    fn what_fits_touches_and_is_parallel() {
        let normals = [Vec3::X, Vec3::Y, Vec3::NEG_X, Vec3::new(0.999, 0.04, 0.0), Vec3::X];
        let thing = |k: u32| Flat {
            bounds: unit_box(if k == 7 { 4.0 } else { 0.0 }),
            normal: normals[k as usize % normals.len()],
        };
        let row = Row::new([3, 1, 2, 5, 7, 6].into_iter(), thing);
        let fitting = |parallel| {
            let other = Row::new([0].into_iter(), thing);
            let mask = dispatch!(Level::new(), simd => row.fitting(simd, (&other, 0), parallel));
            lanes(mask).map(|lane| row.numbers[lane]).collect::<Vec<_>>()
        };
        assert_eq!(fitting(0.99), [3, 2, 5]);
        assert_eq!(fitting(0.9995), [2, 5]);
    }
}
