//! Whether an outline in the plane crosses itself.

use glam::DVec2;

/// Edges that come nearer than this to each other's ends, in units of the outline's size, touch rather than cross:
/// files round their coordinates.
const TOUCHING: f64 = 1e-5;

/// Pairs of edges that are looked at, at most; what lies beyond counts as free of crossings.
const MOST: usize = 20_000_000;

/// Whether two edges of an outline of about unit size cross each other in their insides.
///
/// The edges are swept by x: each is held against those that it overlaps there.
pub(super) fn crosses_itself(outline: &[[f64; 2]]) -> bool {
    let corner = |k: usize| DVec2::from(outline[k % outline.len()]);
    let mut edges: Vec<[DVec2; 2]> =
        (0..outline.len()).map(|k| [corner(k), corner(k + 1)]).collect();
    let start = |[a, b]: &[DVec2; 2]| a.x.min(b.x);
    edges.sort_by(|a, b| start(a).total_cmp(&start(b)));
    let (mut open, mut looked_at): (Vec<[DVec2; 2]>, usize) = (Vec::new(), 0);
    for edge in edges {
        open.retain(|[a, b]| a.x.max(b.x) >= start(&edge));
        looked_at += open.len();
        if looked_at > MOST {
            return false;
        }
        if open.iter().any(|other| cross(&edge, other)) {
            return true;
        }
        open.push(edge);
    }
    false
}

/// Whether the ends of each edge lie on different sides of the other, away from it.
fn cross(a: &[DVec2; 2], b: &[DVec2; 2]) -> bool {
    let separates = |line: &[DVec2; 2], ends: &[DVec2; 2]| {
        let Some(along) = (line[1] - line[0]).try_normalize() else { return false };
        let [first, second] = ends.map(|end| along.perp_dot(end - line[0]));
        first.min(second) < -TOUCHING && first.max(second) > TOUCHING
    };
    separates(a, b) && separates(b, a)
}
