//! Where paths start, and their random numbers.

use crate::patches::{Members, PatchId, PatchMesh, SurfacePoint};
use crate::sampling::{Purpose, Shuffled, uniform_triangle};
use glam::Vec3;

/// Where a path starts.
#[derive(Clone, Copy)]
pub(crate) struct Start {
    /// Lifted off its surface.
    pub(super) point: Vec3,
    pub(super) normal: Vec3,
    /// The path's random numbers.
    pub(super) stream: u64,
    pub(super) number: u32,
}

impl Start {
    /// One path from a point that is lifted off its surface.
    pub(crate) fn new(point: Vec3, normal: Vec3, stream: u64, number: u32) -> Start {
        Start { point, normal, stream, number }
    }

    /// One path for a sample of a picture, with numbers of its pixel's own.
    pub(crate) fn at(point: &SurfacePoint) -> Start {
        let [x, y] = point.sample.pixel;
        Start {
            point: point.side.lifted(point.position),
            normal: point.side.normal,
            stream: (y as u64) << 20 | x as u64,
            number: point.sample.number,
        }
    }

    /// One of `paths` paths for a sample, with numbers that go well with those of the pixels around: in the square
    /// of pixels that contains it, along a curve that stays near (Ahmed & Wonka, *Screen-Space Blue-Noise
    /// Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of Pixels*, ACM TOG 39(6), 2020). A power
    /// of two of paths, `first`, is what a pixel has in general; more follow.
    pub(crate) fn of_square(point: &SurfacePoint, path: u32, paths: u32, first: u32) -> Start {
        let [x, y] = point.sample.pixel;
        let number = point.sample.number * paths + path;
        let [more, number] = [number / first, number % first];
        let place = z_order(x % SQUARE, y % SQUARE);
        Start {
            stream: SQUARES | ((y / SQUARE) as u64) << 20 | (x / SQUARE) as u64,
            number: (more * SQUARE * SQUARE + place) * first + number,
            ..Start::at(point)
        }
    }
}

/// The paths of one patch, from points all over it.
pub(crate) struct PatchPaths {
    pub seed: u64,
    /// Sets of paths that are independent of each other.
    pub sets: u32,
    /// Paths of each set, which share a low-discrepancy sequence.
    pub paths: u32,
}

impl PatchPaths {
    /// Adds the starts of a patch's paths, set by set.
    pub(crate) fn add_starts(&self, mesh: &PatchMesh, patch: PatchId, starts: &mut Vec<Start>) {
        let members = Members::of(mesh, patch);
        let only = (!mesh.is_cluster(patch))
            .then(|| mesh.side(patch).sampling_area(&mesh.triangle(patch)));
        for set in 0..self.sets {
            let stream = OF_PATCHES | (patch.0 as u64 * self.sets as u64 + set as u64);
            let places = Shuffled::new(self.seed, Purpose::PatchPoint, stream);
            starts.extend((0..self.paths).map(|number| {
                let [x0, x1, ..] = places.point(number);
                let (side, x0) = members.choose(x0);
                let [p0, p1, p2] =
                    only.unwrap_or_else(|| side.sampling_area(&members.part(side))).p;
                let [l0, l1, l2] = uniform_triangle(x0, x1);
                let point = side.lifted(p0 * l0 + p1 * l1 + p2 * l2);
                Start { point, normal: side.normal, stream, number }
            }));
        }
    }
}

/// Tells the streams of patches from those of pixels.
const OF_PATCHES: u64 = 1 << 51;

/// Pixels along an edge of a square: a power of two.
const SQUARE: u32 = 32;

/// Tells the streams of squares from those of pixels.
const SQUARES: u64 = 1 << 40;

/// The place along a curve of Morton's: the binary digits of both numbers in turn.
fn z_order(x: u32, y: u32) -> u32 {
    let digits = |n: u32| (0..5).map(|k| (n >> k & 1) << (2 * k)).sum::<u32>();
    digits(x) | digits(y) << 1
}
