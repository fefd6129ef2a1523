//! Pairs of boxes that touch, by divide and conquer: halves are compared only where their boxes touch
//! (a join of two sets of boxes as in Zomorodian & Edelsbrunner, "Fast Software for Box Intersections",
//! 2000, without their trees).

use crate::geometry::bounds::Bounds;
use glam::Vec3;
use std::sync::atomic::{AtomicU64, Ordering};

/// Sets as small as this are compared pair by pair.
const FEW: usize = 24;

/// Larger sets are divided among threads.
const MANY: usize = 4096;

/// The pairs of touching boxes that are `wanted`, the lower number first, in a fixed order. `None` if more
/// than `most` pairs would have to be looked at.
pub(super) fn pairs(
    boxes: &[Bounds],
    wanted: impl Fn(u32, u32) -> bool + Sync,
    most: u64,
) -> Option<Vec<(u32, u32)>> {
    let join = Join { boxes, wanted, looked_at: AtomicU64::new(0), most };
    let mut pairs = join.within((0..boxes.len() as u32).collect());
    if join.is_exhausted() {
        return None;
    }
    pairs.sort_unstable();
    Some(pairs)
}

struct Join<'b, F> {
    boxes: &'b [Bounds],
    wanted: F,
    looked_at: AtomicU64,
    most: u64,
}

impl<F: Fn(u32, u32) -> bool + Sync> Join<'_, F> {
    fn is_exhausted(&self) -> bool {
        self.looked_at.load(Ordering::Relaxed) > self.most
    }

    fn of(&self, index: u32) -> &Bounds {
        &self.boxes[index as usize]
    }

    fn around(&self, set: &[u32]) -> Bounds {
        set.iter().fold(Bounds::EMPTY, |all, &index| all.with(self.of(index)))
    }

    fn within(&self, mut set: Vec<u32>) -> Vec<(u32, u32)> {
        if set.len() <= FEW {
            self.looked_at.fetch_add((set.len() * set.len() / 2) as u64, Ordering::Relaxed);
            let others = |(k, &a): (usize, &u32)| set[k + 1..].iter().map(move |&b| (a, b));
            let pairs = set.iter().enumerate().flat_map(others);
            return pairs.filter_map(|(a, b)| self.wanted(a, b)).collect();
        }
        let many = set.len() > MANY;
        let upper = self.upper_half(&mut set);
        let (a, b) = (set.clone(), upper.clone());
        let (mut found, (more, between)) = either(
            many,
            || self.within(set),
            || either(many, || self.within(upper), || self.between(a, b)),
        );
        found.extend(more);
        found.extend(between);
        found
    }

    fn between(&self, mut a: Vec<u32>, mut b: Vec<u32>) -> Vec<(u32, u32)> {
        let around = self.around(&b);
        a.retain(|&index| self.of(index).touches(&around));
        let around = self.around(&a);
        b.retain(|&index| self.of(index).touches(&around));
        if a.is_empty() || b.is_empty() || self.is_exhausted() {
            return Vec::new();
        }
        if a.len() * b.len() <= FEW * FEW {
            self.looked_at.fetch_add((a.len() * b.len()) as u64, Ordering::Relaxed);
            let pairs = a.iter().flat_map(|&a| b.iter().map(move |&b| (a, b)));
            return pairs.filter_map(|(a, b)| self.wanted(a, b)).collect();
        }
        if a.len() < b.len() {
            std::mem::swap(&mut a, &mut b);
        }
        let many = a.len() > MANY;
        let (upper, copy) = (self.upper_half(&mut a), b.clone());
        let (mut found, more) = either(many, || self.between(a, b), || self.between(upper, copy));
        found.extend(more);
        found
    }

    fn wanted(&self, a: u32, b: u32) -> Option<(u32, u32)> {
        let touch = self.of(a).touches(self.of(b));
        (touch && (self.wanted)(a, b)).then_some((a.min(b), a.max(b)))
    }

    /// Takes the half away whose centres lie farther along the set's longest side.
    fn upper_half(&self, set: &mut Vec<u32>) -> Vec<u32> {
        let centers: Bounds = set.iter().map(|&index| self.of(index).center()).collect();
        let axis = longest(centers.diagonal());
        let half = set.len() / 2;
        // The number settles ties, so that the order is fixed.
        let place = |index: &u32| self.of(*index).center()[axis];
        set.select_nth_unstable_by(half, |a, b| place(a).total_cmp(&place(b)).then(a.cmp(b)));
        set.split_off(half)
    }
}

/// Does both, at the same time if that is worth it.
fn either<A: Send, B: Send>(
    parallel: bool,
    a: impl FnOnce() -> A + Send,
    b: impl FnOnce() -> B + Send,
) -> (A, B) {
    if parallel { rayon::join(a, b) } else { (a(), b()) }
}

fn longest(v: Vec3) -> usize {
    if v.x >= v.y && v.x >= v.z {
        0
    } else if v.y >= v.z {
        1
    } else {
        2
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{PointSet, Purpose, Stream};

    #[test]
    fn all_pairs_are_found_that_comparing_each_with_each_finds() {
        let stream = Stream::new(5, Purpose::Pair, 0, PointSet::Random);
        let number = |i: u32| {
            let [x, y, z, size] = stream.point(i);
            let at = (Vec3::new(x, y, z) * 8.0).floor();
            Bounds { min: at, max: at + (size * size * 4.0).floor() }
        };
        let boxes: Vec<Bounds> = (0..700).map(number).collect();
        let odd = |a: u32, b: u32| !(a + b).is_multiple_of(3);
        let found = pairs(&boxes, odd, u64::MAX).unwrap();
        let all = (0..700).flat_map(|a| (a + 1..700).map(move |b| (a, b)));
        let touch = |&(a, b): &(u32, u32)| boxes[a as usize].touches(&boxes[b as usize]);
        let expected: Vec<_> = all.filter(touch).filter(|&(a, b)| odd(a, b)).collect();
        assert_eq!(found, expected);
        assert!(found.len() > 1000);
        assert!(pairs(&boxes, odd, 1000).is_none(), "the limit holds");
    }
}
