//! The mean of a picture over a triangle.
//!
//! Texels are squares of constant colour. The triangle is cut along the rows of texels, and each row's piece
//! along its columns; a texel weighs as much as the area that the triangle has of it. So triangles that tile a
//! square share its mean between them, to rounding.

use super::pyramid::Pyramid;
use super::{Texture, Wrap};
use glam::{DVec2, DVec4, Vec2};
use std::ops::{Range, RangeInclusive};

/// About the most texels that a mean is taken of. For a triangle over more of them the level of the mip pyramid
/// is taken that has fewer. Its texels are exact means, so that only those on the triangle's edges are wrong:
/// for a triangle about as high as wide at most about 4 in √MOST of the area, by at most the contrast inside one
/// of them. The mean is off by less than 1/32 of that contrast then. A triangle that is narrower than such a
/// texel, as one over a thousand periods of a band, may be off by all of it.
const MOST: f64 = 16384.0;

impl Texture {
    /// The area mean of linear red, green, blue, and opacity over the triangle with the corners `uv`. Exact, to
    /// rounding, up to 16,384 texels; beyond, off by less than 1/32 of the contrast between neighbours if the triangle
    /// is about as high as wide, and by more if it is thin. Where the triangle has no area in the picture: the mean
    /// over 64 points.
    pub fn mean(&self, uv: [Vec2; 3]) -> DVec4 {
        let pyramid = self.pyramid();
        let near = self.moved_near(uv);
        let grid = (0..=pyramid.last_level())
            .map(|level| Grid { texture: self, pyramid, level })
            .find(|grid| grid.count(grid.triangle(near)) <= MOST)
            .unwrap_or(Grid { texture: self, pyramid, level: pyramid.last_level() });
        grid.mean(grid.triangle(near))
    }

    /// (u, 1 − v) of the corners, moved by whole periods towards the origin. What is not finite is 0.
    fn moved_near(&self, uv: [Vec2; 3]) -> [DVec2; 3] {
        // Beyond this f32 cannot tell two texels from one another.
        const FARTHEST: f64 = 1e9;
        let finite =
            |x: f32| if x.is_finite() { f64::from(x).clamp(-FARTHEST, FARTHEST) } else { 0.0 };
        let corners = uv.map(|c| DVec2::new(finite(c.x), 1.0 - finite(c.y)));
        let least = corners[0].min(corners[1]).min(corners[2]);
        let moved = [0, 1].map(|axis| match self.wrap[axis] {
            Wrap::Repeat => least[axis].floor(),
            Wrap::Mirror => 2.0 * (least[axis] / 2.0).floor(),
            Wrap::Clamp => 0.0,
        });
        corners.map(|corner| corner - DVec2::from(moved))
    }
}

/// One level of a picture's pyramid.
#[derive(Clone, Copy)]
struct Grid<'t> {
    texture: &'t Texture,
    pyramid: &'t Pyramid,
    level: usize,
}

impl Grid<'_> {
    /// The corners in texels, to the right and down.
    fn triangle(&self, corners: [DVec2; 3]) -> [DVec2; 3] {
        corners.map(|corner| corner * DVec2::from(self.pyramid.size(self.level).map(f64::from)))
    }

    /// The cells that `from` to `to` reaches into along an axis. Outside a clamped picture its last texels go on
    /// without an end.
    fn cells(&self, axis: usize, from: f64, to: f64) -> RangeInclusive<i64> {
        let last = i64::from(self.pyramid.size(self.level)[axis]) - 1;
        let (from, to) = (from.floor() as i64, (to.ceil() as i64 - 1).max(from.floor() as i64));
        match self.texture.wrap[axis] {
            Wrap::Clamp => from.clamp(0, last)..=to.clamp(0, last),
            _ => from..=to,
        }
    }

    /// Where a cell begins and ends along an axis.
    fn span(&self, axis: usize, cell: i64) -> [f64; 2] {
        let last = i64::from(self.pyramid.size(self.level)[axis]) - 1;
        let endless = self.texture.wrap[axis] == Wrap::Clamp;
        [
            if endless && cell == 0 { f64::NEG_INFINITY } else { cell as f64 },
            if endless && cell == last { f64::INFINITY } else { (cell + 1) as f64 },
        ]
    }

    /// About how many cells the triangle covers.
    fn count(&self, triangle: [DVec2; 3]) -> f64 {
        let (least, most) = bounds(&triangle);
        let [across, down] = [0, 1].map(|axis| {
            let cells = self.cells(axis, least[axis], most[axis]);
            (cells.end() - cells.start() + 1) as f64
        });
        0.5 * across * down
    }

    fn texel(&self, x: i64, y: i64) -> DVec4 {
        let size = self.pyramid.size(self.level);
        let [wide, high] = self.texture.wrap;
        let (x, y) = (wide.texel(x, size[0]), high.texel(y, size[1]));
        self.pyramid.texel(self.texture, self.level, x, y).as_dvec4()
    }

    fn mean(&self, triangle: [DVec2; 3]) -> DVec4 {
        let [a, b, c] = triangle;
        let (least, most) = bounds(&triangle);
        let [columns, rows] = [0, 1].map(|axis| self.cells(axis, least[axis], most[axis]));
        if columns.start() == columns.end() && rows.start() == rows.end() {
            return self.texel(*columns.start(), *rows.start());
        }
        // At the last level the grid may still be too fine; all of it is one texel then.
        if self.pyramid.size(self.level) == [1, 1] {
            return self.texel(0, 0);
        }
        let extent = (most - least).max_element();
        if (b - a).perp_dot(c - a).abs() <= 1e-9 * extent * extent {
            return self.mean_of_points(triangle);
        }
        let (mut sum, mut area) = (DVec4::ZERO, 0.0);
        for y in rows {
            let (row_sum, row_area) = self.row(&triangle, y);
            sum += row_sum;
            area += row_area;
        }
        sum / area
    }

    /// Σ area · texel and Σ area of the triangle's piece in a row.
    fn row(&self, triangle: &[DVec2; 3], y: i64) -> (DVec4, f64) {
        let [top, bottom] = self.span(1, y);
        let piece = Piece::new(triangle, top, bottom);
        let [least, most] = piece.span();
        if least > most {
            return (DVec4::ZERO, 0.0);
        }
        let cells = self.cells(0, least, most);
        let full = self.whole_cells(&cells, whole_between(triangle, top, bottom));
        let height = if full.is_empty() { 0.0 } else { bottom - top };
        let mut sum = self.sum(y, full.clone()) * height;
        let mut area = (full.end - full.start) as f64 * height;
        for cells in [*cells.start()..full.start, full.end..cells.end() + 1] {
            let mut left = piece.area_left_of(self.span(0, cells.start)[0]);
            for x in cells {
                let right = piece.area_left_of(self.span(0, x)[1]);
                let weight = (right - left).max(0.0);
                sum += self.texel(x, y) * weight;
                area += weight;
                left = right;
            }
        }
        (sum, area)
    }

    /// Those of some cells of a row that lie between two places; an empty range at their start if none does.
    fn whole_cells(&self, cells: &RangeInclusive<i64>, [left, right]: [f64; 2]) -> Range<i64> {
        let (mut from, mut to) = (*cells.start(), cells.end() + 1);
        if self.texture.wrap[0] == Wrap::Clamp {
            // The first and the last cell have no end.
            from = from.max(1);
            to = to.min(i64::from(self.pyramid.size(self.level)[0]) - 1);
        }
        // What is infinite or too large becomes the greatest or least number.
        let (from, to) = (from.max(left.ceil() as i64), to.min(right.floor() as i64));
        if from < to { from..to } else { *cells.start()..*cells.start() }
    }

    /// The sum of a row's texels.
    fn sum(&self, y: i64, cells: Range<i64>) -> DVec4 {
        let [width, height] = self.pyramid.size(self.level);
        let [wide, high] = self.texture.wrap;
        if wide == Wrap::Mirror {
            return cells.map(|x| self.texel(x, y)).sum();
        }
        let (y, width) = (high.texel(y, height), i64::from(width));
        let (mut from, mut sum) = (cells.start, DVec4::ZERO);
        // From one edge of the picture to the next.
        while from < cells.end {
            let start = from.rem_euclid(width);
            let count = (width - start).min(cells.end - from);
            let run = start as u32..(start + count) as u32;
            sum += self.pyramid.sum(self.texture, self.level, y, run);
            from += count;
        }
        sum
    }

    /// The mean at the centroids of 64 equal pieces, for a triangle that is a line or a point in the picture.
    fn mean_of_points(&self, [a, b, c]: [DVec2; 3]) -> DVec4 {
        let piece = |i: u32, j: u32, third: f64| {
            let (u, v) = ((f64::from(i) + third) / 8.0, (f64::from(j) + third) / 8.0);
            let at = a + (b - a) * u + (c - a) * v;
            self.texel(at.x.floor() as i64, at.y.floor() as i64)
        };
        let upright = (0..8).flat_map(|i| (0..8 - i).map(move |j| (i, j, 1.0 / 3.0)));
        let inverted = (0..7).flat_map(|i| (0..7 - i).map(move |j| (i, j, 2.0 / 3.0)));
        upright.chain(inverted).map(|(i, j, third)| piece(i, j, third)).sum::<DVec4>() / 64.0
    }
}

/// The part of a triangle between two horizontal lines, by its edges.
struct Piece {
    edges: [Edge; 3],
    /// That of the corners' order, ±1.
    sign: f64,
}

/// What lies between the lines of a directed edge.
#[derive(Clone, Copy)]
struct Edge {
    /// Along y, with the edge's direction.
    height: f64,
    /// Along x.
    least: f64,
    most: f64,
}

impl Piece {
    fn new(triangle: &[DVec2; 3], top: f64, bottom: f64) -> Piece {
        let [a, b, c] = *triangle;
        let edge = |a: DVec2, b: DVec2| {
            let [from, to] = [a.y, b.y].map(|y| y.clamp(top, bottom));
            let at = |y: f64| a.x + (b.x - a.x) * ((y - a.y) / (b.y - a.y));
            // Both ends outside, on one side: nothing is between the lines, and a level edge bounds no area.
            let [x, z] = if from == to { [0.0; 2] } else { [at(from), at(to)] };
            Edge { height: to - from, least: x.min(z), most: x.max(z) }
        };
        let sign = if (b - a).perp_dot(c - a) < 0.0 { 1.0 } else { -1.0 };
        Piece { edges: [edge(a, b), edge(b, c), edge(c, a)], sign }
    }

    /// The least and the greatest x; (∞, −∞) if there is nothing.
    fn span(&self) -> [f64; 2] {
        let bounding = self.edges.iter().filter(|edge| edge.height != 0.0);
        bounding.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], edge| {
            [least.min(edge.least), most.max(edge.most)]
        })
    }

    /// The area of what lies to the left of x.
    fn area_left_of(&self, x: f64) -> f64 {
        self.sign * self.edges.iter().map(|edge| edge.area_left_of(x)).sum::<f64>()
    }
}

impl Edge {
    /// The signed area between the edge and what of a vertical line is to its right. Beyond all edges the line's
    /// place cancels between them, so that it is left out where it is infinite.
    fn area_left_of(&self, x: f64) -> f64 {
        if x <= self.least || self.height == 0.0 {
            0.0
        } else if x < self.most {
            0.5 * self.height * (x - self.least) * ((x - self.least) / (self.most - self.least))
        } else {
            let x = if x.is_finite() { x } else { 0.0 };
            self.height * (x - 0.5 * (self.least + self.most))
        }
    }
}

fn bounds(points: &[DVec2]) -> (DVec2, DVec2) {
    let start = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    points.iter().fold(start, |(least, most), p| (least.min(*p), most.max(*p)))
}

/// Where along x the triangle fills a row from top to bottom: by convexity, where it reaches both lines. An
/// empty span if it does not.
fn whole_between(triangle: &[DVec2; 3], top: f64, bottom: f64) -> [f64; 2] {
    [top, bottom].into_iter().fold([f64::NEG_INFINITY, f64::INFINITY], |[left, right], y| {
        let (least, most) = crossing(triangle, y);
        [left.max(least), right.min(most)]
    })
}

/// Where a horizontal line enters and leaves a triangle; (∞, −∞) where it misses it.
fn crossing(triangle: &[DVec2; 3], y: f64) -> (f64, f64) {
    let mut span = (f64::INFINITY, f64::NEG_INFINITY);
    for k in 0..3 {
        let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
        if (a.y <= y) != (b.y <= y) {
            let x = a.x + (b.x - a.x) * ((y - a.y) / (b.y - a.y));
            span = (span.0.min(x), span.1.max(x));
        }
    }
    span
}

#[cfg(test)]
mod tests {
    use super::super::tests::checker;
    use super::*;

    const SQUARE: [[Vec2; 3]; 2] =
        [[Vec2::ZERO, Vec2::X, Vec2::ONE], [Vec2::ZERO, Vec2::ONE, Vec2::Y]];

    fn noise(width: u32, height: u32, wrap: Wrap) -> Texture {
        let pixel = |i: u32| (i.wrapping_mul(2_654_435_761) ^ (i << 7)).to_le_bytes();
        let pixels: Vec<[u8; 4]> = (0..width * height).map(pixel).collect();
        Texture::new("noise".into(), [width, height], pixels.into(), [wrap; 2])
    }

    fn whole(texture: &Texture) -> DVec4 {
        SQUARE.map(|triangle| texture.mean(triangle)).into_iter().sum::<DVec4>() / 2.0
    }

    fn near(a: DVec4, b: DVec4, error: f64) -> bool {
        (a - b).abs().max_element() < error
    }

    #[test]
    fn a_checkerboard_is_half_over_whole_squares() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            assert!(near(whole(&checker(wrap)), DVec4::splat(0.5), 1e-7));
        }
        let corners = [Vec2::new(-3.0, 2.0), Vec2::new(5.0, 2.0), Vec2::new(-3.0, 10.0)];
        assert!((checker(Wrap::Repeat).mean(corners).x - 0.5).abs() < 1e-9);
    }

    #[test]
    fn half_covered_texels_count_half() {
        // The lower left triangle: the white texel below wholly, half of each black neighbour.
        let mean = checker(Wrap::Clamp).mean([Vec2::ZERO, Vec2::X, Vec2::Y]);
        assert!((mean.x - 0.5).abs() < 1e-12, "{mean}");
        let mean =
            checker(Wrap::Clamp).mean([Vec2::ZERO, Vec2::new(0.5, 0.0), Vec2::new(0.0, 1.0)]);
        // In texels the triangle (0, 2), (1, 2), (0, 0) has area 1; 3/4 of it lie in the lower, white texel.
        assert!((mean.x - 0.75).abs() < 1e-12, "{mean}");
    }

    #[test]
    fn a_triangle_inside_a_texel_or_without_extent_has_its_colour() {
        let texture = noise(5, 3, Wrap::Repeat);
        let texel = |x: u32, y: u32| Pyramid::of(&texture).texel(&texture, 0, x, y).as_dvec4();
        let at = |u: f32, v: f32| Vec2::new(u / 5.0, 1.0 - v / 3.0);
        assert_eq!(texture.mean([at(1.2, 2.2), at(1.8, 2.2), at(1.2, 2.9)]), texel(1, 2));
        assert_eq!(texture.mean([at(3.5, 0.5); 3]), texel(3, 0));
        assert_eq!(texture.mean([at(8.5, -2.5); 3]), texel(3, 0));
        // A line along the first row, over all five texels.
        let line = texture.mean([at(0.0, 0.5), at(5.0, 0.5), at(0.0, 0.5)]);
        let row = (0..5).map(|x| texel(x, 0)).sum::<DVec4>() / 5.0;
        assert!(line.is_finite() && near(line, row, 0.3));
    }

    #[test]
    fn triangles_that_tile_the_square_share_its_mean() {
        for (width, height) in [(7, 4), (64, 64), (3, 50)] {
            let texture = noise(width, height, Wrap::Repeat);
            let (n, mut sum) = (9u16, DVec4::ZERO);
            let at = |i: u16, j: u16| Vec2::new(f32::from(i), f32::from(j)) / f32::from(n);
            for i in 0..n {
                for j in 0..n {
                    let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                    sum += texture.mean([a, b, c]) + texture.mean([c, d, a]);
                }
            }
            let mean = sum / (2.0 * f64::from(n) * f64::from(n));
            assert!(near(mean, whole(&texture), 1e-6), "{width} × {height}");
            let pyramid = texture.pyramid();
            let top = pyramid.texel(&texture, pyramid.last_level(), 0, 0).as_dvec4();
            assert!(near(mean, top, 1e-6), "{width} × {height}");
        }
    }

    #[test]
    fn outside_a_clamped_picture_its_border_goes_on() {
        let texture = checker(Wrap::Clamp);
        let far = [Vec2::new(1.0, 0.0), Vec2::new(1e6, 0.0), Vec2::new(1.0, -1e6)];
        assert!(near(texture.mean(far), DVec4::new(0.0, 0.0, 0.0, 1.0), 1e-9));
    }

    /// The error that the module states for triangles over very many texels, on the worst picture: noise.
    #[test]
    fn over_many_texels_the_mean_comes_from_a_coarser_level() {
        let texture = noise(1024, 1024, Wrap::Repeat);
        let corners = [Vec2::new(0.03, 0.02), Vec2::new(0.91, 0.17), Vec2::new(0.4, 0.97)];
        let grid = Grid { texture: &texture, pyramid: texture.pyramid(), level: 0 };
        let exact = grid.mean(grid.triangle(texture.moved_near(corners)));
        assert!(near(texture.mean(corners), exact, 1.0 / 32.0));
        assert!(near(texture.mean(corners), exact, 1e-3), "and far less in practice");
    }

    #[test]
    fn any_coordinates_have_a_mean() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            let texture = noise(6, 5, wrap);
            for x in [f32::NAN, f32::INFINITY, f32::MAX, -1e20, 1e-30, 123_456.78] {
                let mean =
                    texture.mean([Vec2::new(x, 0.1), Vec2::new(0.3, x), Vec2::new(-0.2, 2.0)]);
                assert!(mean.is_finite() && mean.min_element() >= 0.0 && mean.max_element() <= 1.0);
            }
        }
    }
}
