//! How finely the triangles are split.

use super::Split;
use crate::error::{Error, ErrorKind, Result};
use crate::geometry::Triangle;
use crate::geometry::triangle::MAX_LEVEL;
use crate::scene::Scene;
use crate::settings::{self, PatchSettings};

/// Patch numbers and ray counts stay well inside 32 bits.
const MAX_PATCHES: usize = 1 << 28;

/// How finely triangles are split.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Subdivision {
    /// Each triangle into 4^levels patches.
    Levels(u32),
    /// Each triangle until its patches' longest edge is at most this, in the scene's units.
    MaxEdge(f64),
    /// The shortest `MaxEdge` that makes about this many patches, where triangles that are shorter still are put
    /// together.
    Count(usize),
}

impl Subdivision {
    /// The subdivision that the settings ask for, or the default.
    pub fn of(settings: &PatchSettings) -> Subdivision {
        match (settings.levels, settings.max_edge) {
            (Some(levels), _) => Subdivision::Levels(levels),
            (None, Some(length)) => Subdivision::MaxEdge(length),
            (None, None) => Subdivision::Count(settings::PATCHES),
        }
    }

    /// How often each triangle is split.
    ///
    /// # Errors
    /// A level above [`MAX_LEVEL`], a length that is not a positive number, or more patches than can be
    /// numbered even with one side each.
    pub fn split(self, scene: &Scene) -> Result<Split> {
        check(self)?;
        let edges: Vec<f64> = scene.triangles.iter().map(Triangle::longest_edge).collect();
        let (levels, cube) = match self {
            Subdivision::Levels(levels) => (vec![levels; edges.len()], None),
            Subdivision::MaxEdge(length) => (levels_for(&edges, length), None),
            Subdivision::Count(most) => {
                let areas: Vec<f64> = scene.triangles.iter().map(Triangle::area).collect();
                let length = shortest_edge_for(&edges, &areas, most);
                (levels_for(&edges, length), Some((length * CUBE) as f32))
            }
        };
        let count = levels.iter().map(|&level| 4u64.saturating_pow(level));
        check_count(&levels, count.fold(0, u64::saturating_add))?;
        Ok(Split { levels, cube })
    }
}

/// The edge of a cluster's cube, as a share of the longest edge of a patch: then both have about equal areas.
const CUBE: f64 = 0.5;

/// Refuses more patches than can be numbered, and levels that no triangle may have.
pub(super) fn check_count(levels: &[u32], count: u64) -> Result<usize> {
    if levels.iter().any(|&l| l > MAX_LEVEL) || count > MAX_PATCHES as u64 {
        return Err(Error::new(format!(
            "this subdivision asks for {count} patches or {} levels; the most are {MAX_PATCHES} and \
             {MAX_LEVEL}",
            levels.iter().max().unwrap_or(&0)
        ))
        .of_kind(ErrorKind::Patches)
        .remedy("take larger patches"));
    }
    Ok(count as usize)
}

fn check(subdivision: Subdivision) -> Result<()> {
    match subdivision {
        Subdivision::Levels(levels) if levels > MAX_LEVEL => {
            Err(Error::new(format!("{levels} levels of subdivision; the most are {MAX_LEVEL}"))
                .remedy("each level quadruples the patches; 2 to 5 are usual"))
        }
        Subdivision::MaxEdge(length) if !(length > 0.0 && length.is_finite()) => {
            Err(Error::new(format!("a longest patch edge of {length}"))
                .remedy("give a positive length in the scene's units"))
        }
        _ => Ok(()),
    }
}

/// The least level at which each triangle's longest edge is at most `length`.
fn levels_for(edges: &[f64], length: f64) -> Vec<u32> {
    edges.iter().map(|edge| (edge / length).log2().ceil().clamp(0.0, 30.0) as u32).collect()
}

/// Bisects for the shortest length that makes at most `most` patches, about.
fn shortest_edge_for(edges: &[f64], areas: &[f64], most: usize) -> f64 {
    let patches = |length: f64| -> f64 {
        let cube = length * CUBE;
        let of_triangle = |(&edge, &area): (&f64, &f64)| match edge > cube {
            true => 4f64.powf((edge / length).log2().ceil().max(0.0)),
            // A surface crosses its cubes aslant, and is cut where it turns.
            false => (2.0 * area / (cube * cube)).min(1.0),
        };
        edges.iter().zip(areas).map(of_triangle).sum()
    };
    let longest = edges.iter().copied().fold(0.0, f64::max);
    let area: f64 = areas.iter().sum();
    // With a cube that all triangles fit into, and as large as an even share of the area, there are few enough.
    let widest = longest.max((2.0 * area / most as f64).sqrt());
    let (mut too_short, mut good) = (longest / (1u64 << MAX_LEVEL) as f64, widest / CUBE);
    // Some thirteen octaves, halved 24 times, are known to a millionth.
    for _ in 0..24 {
        let middle = (too_short * good).sqrt();
        if patches(middle) <= most as f64 {
            good = middle;
        } else {
            too_short = middle;
        }
    }
    good
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::shapes;
    use crate::patches::PatchMesh;
    use crate::patches::tests::{one_triangle, scene};
    use glam::Vec3;

    #[test]
    fn each_triangle_gets_the_level_that_its_edge_needs() {
        let mut triangles = one_triangle();
        triangles.push(Triangle::new(Vec3::ZERO, Vec3::X * 0.5, Vec3::Y * 0.5));
        let scene = scene(triangles, false);
        // Longest edges √80 ≈ 8.9 and √½ ≈ 0.7.
        let mesh = PatchMesh::subdivide(&scene, Subdivision::MaxEdge(1.2)).unwrap();
        assert_eq!(mesh.sides().iter().map(|s| s.level).collect::<Vec<_>>(), [3, 0]);
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Count(300)).unwrap();
        assert!(mesh.len() <= 300 && mesh.len() > 75, "{}", mesh.len());
    }

    /// A surface of many triangles that are all alike: none is longer than the others, and each cube holds many.
    #[test]
    fn the_number_of_patches_does_not_follow_triangles_that_are_alike() {
        let scene = scene(shapes::icosphere(6), false);
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Count(1000)).unwrap();
        assert_eq!(scene.triangles.len(), 81920);
        assert!((500..2000).contains(&mesh.len()), "{}", mesh.len());
    }

    #[test]
    fn absurd_subdivisions_are_refused() {
        let scene = scene(one_triangle(), false);
        for bad in [
            Subdivision::Levels(40),
            Subdivision::MaxEdge(0.0),
            Subdivision::MaxEdge(f64::NAN),
            Subdivision::MaxEdge(1e-9),
        ] {
            assert!(PatchMesh::subdivide(&scene, bad).is_err(), "{bad:?}");
        }
    }
}
