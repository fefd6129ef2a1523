//! Where a patch lies in its triangle, by arithmetic.
//!
//! ```text
//!            v                       Row i holds, for j = 0, 1, …, the upright patch of
//!            |\                      lattice cell (i, j) and then the inverted one, which
//!            | \                     the last cell of a row lacks. Rows 0…i−1 hold
//!            |--\                    i·(2n − i) patches.
//!            |\ |\
//!            | \| \
//!            +------ u
//! ```

use crate::geometry::triangle::MAX_LEVEL;

/// A patch within its triangle: lattice cell (i, j) of n rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    pub i: u32,
    pub j: u32,
    pub inverted: bool,
}

impl Cell {
    /// The patch that holds barycentrics (u, v), and the barycentrics (λ₁, λ₂) within it.
    #[inline]
    pub fn containing(level: u32, u: f32, v: f32) -> (Cell, f32, f32) {
        let n = 1u32 << level;
        // Scaling by a power of two is exact; the clamps catch u + v rounded past 1. `max` and `min` would check
        // for NaN, and a conversion to 32 bits for numbers that are too large.
        const { assert!(MAX_LEVEL < u16::BITS, "a row's number fits") };
        let above_zero = |x: f32| if x > 0.0 { x } else { 0.0 };
        let below_one = |x: f32| if x < 1.0 { x } else { 1.0 };
        let (x, y) = (above_zero(u) * n as f32, above_zero(v) * n as f32);
        let i = (x as u16 as u32).min(n - 1);
        let j = (y as u16 as u32).min(n - 1 - i);
        let (fx, fy) = (below_one(x - i as f32), below_one(y - j as f32));
        let inverted = (fx + fy > 1.0) & (i + j + 1 < n);
        // 1 − f where inverted, else f, without a branch: half of all points would mispredict it.
        let one = inverted as u32 as f32;
        (Cell { i, j, inverted }, (one - fx).abs(), (one - fy).abs())
    }

    /// The patch's number within its triangle.
    #[inline]
    pub fn number(self, level: u32) -> u32 {
        let n = 1u32 << level;
        self.i * (2 * n - self.i) + 2 * self.j + self.inverted as u32
    }

    /// The inverse of [`Cell::number`].
    #[inline]
    pub fn from_number(level: u32, number: u32) -> Cell {
        // number = i·(2n − i) at a row's start, so i = n − √(n² − number). Squares are exact and
        // correctly rounded roots of n² ≤ 2²⁴ cannot round across an integer, but the loop proves it.
        let n = 1u32 << level;
        let root = ((n as u64 * n as u64 - number as u64) as f64).sqrt();
        let mut i = (n as f64 - root) as u32;
        while (i + 1) * (2 * n - (i + 1)) <= number && i + 1 < n {
            i += 1;
        }
        let in_row = number - i * (2 * n - i);
        Cell { i, j: in_row / 2, inverted: in_row % 2 == 1 }
    }

    /// Barycentrics (u, v) in the triangle of the patch's own (λ₁, λ₂).
    #[inline]
    pub fn to_triangle(self, level: u32, l1: f32, l2: f32) -> (f32, f32) {
        let n = (1u32 << level) as f32;
        let (x, y) = if self.inverted { (1.0 - l1, 1.0 - l2) } else { (l1, l2) };
        ((self.i as f32 + x) / n, (self.j as f32 + y) / n)
    }

    /// The lattice points (i, j) of its corners, in its triangle's winding; corner k has λₖ = 1.
    pub fn corners(self) -> [(u32, u32); 3] {
        let Cell { i, j, inverted } = self;
        let (near, far) = (inverted as u32, !inverted as u32);
        [(i + near, j + near), (i + far, j + near), (i + near, j + far)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::patches::MAX_LEVEL;
    use proptest::prelude::*;

    #[test]
    fn numbers_and_cells_are_inverse_and_in_order() {
        for level in 0..=MAX_LEVEL.min(8) {
            for number in 0..1u32 << (2 * level) {
                let cell = Cell::from_number(level, number);
                assert!(cell.i + cell.j + (cell.inverted as u32) < 1 << level);
                assert_eq!(cell.number(level), number, "level {level}");
            }
        }
        let last = (1u32 << (2 * MAX_LEVEL)) - 1;
        assert_eq!(Cell::from_number(MAX_LEVEL, last).number(MAX_LEVEL), last);
    }

    proptest! {
        #[test]
        fn the_cell_under_a_point_holds_it(level in 0u32..9, a in 0f32..1.0, b in 0f32..1.0) {
            let (u, v) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
            let (cell, l1, l2) = Cell::containing(level, u, v);
            prop_assert!(l1 >= 0.0 && l2 >= 0.0 && l1 + l2 <= 1.0 + f32::EPSILON);
            let (u2, v2) = cell.to_triangle(level, l1, l2);
            // l1 and l2 are multiples of u's and v's last bits, scaled by 2^level.
            prop_assert!((u - u2).abs() <= f32::EPSILON && (v - v2).abs() <= f32::EPSILON);
            let corners = cell.corners();
            prop_assert!(corners.iter().all(|&(i, j)| i + j <= 1 << level));
        }
    }

    #[test]
    fn corners_and_edges_of_the_triangle_have_a_patch() {
        for level in [0, 1, 5, MAX_LEVEL] {
            for (u, v) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.5), (0.3, 0.70000005)] {
                let (cell, ..) = Cell::containing(level, u, v);
                assert!(cell.number(level) < 1 << (2 * level), "({u}, {v}) at {level}");
            }
        }
    }
}
