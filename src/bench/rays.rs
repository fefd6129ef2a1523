//! The rays that radiosity casts.

use super::scenes::BenchScene;
use crate::geometry::Ray;
use crate::geometry::surface::Surface;
use crate::sampling::{PointSet, Purpose, Stream};
use rayon::prelude::*;

/// The use that the rays are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Workload {
    /// Nearest hits of one picture's rays, in tiles of 4 × 4 pixels.
    Camera,
    /// Nearest hits of cosine-distributed rays, each from another point of the surfaces.
    Incoherent,
    /// Any hit between two points of the surfaces that face each other.
    Segments,
}

impl Workload {
    pub(crate) const ALL: [Workload; 3] =
        [Workload::Camera, Workload::Incoherent, Workload::Segments];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Workload::Camera => "camera",
            Workload::Incoherent => "incoherent",
            Workload::Segments => "segments",
        }
    }

    /// About `count` rays: for a picture, the next square of tiles.
    pub(crate) fn rays(self, scene: &BenchScene, count: u64, seed: u64) -> Vec<Ray> {
        match self {
            Workload::Camera => camera(scene, count),
            Workload::Incoherent => incoherent(scene, count, seed),
            Workload::Segments => segments(scene, count, seed),
        }
    }
}

const TILE: u32 = 4;

fn camera(scene: &BenchScene, count: u64) -> Vec<Ray> {
    let tiles = ((count as f64).sqrt() / TILE as f64).ceil() as u32;
    let size = (tiles * TILE) as f32;
    let pixel = |tile: u32, k: u32| {
        let (x, y) = (tile % tiles * TILE + k % TILE, tile / tiles * TILE + k / TILE);
        scene.camera.ray((x as f32 + 0.5) / size, (y as f32 + 0.5) / size, 1.0)
    };
    (0..tiles * tiles).flat_map(|tile| (0..TILE * TILE).map(move |k| pixel(tile, k))).collect()
}

fn stream(seed: u64, index: u64) -> Stream {
    Stream::new(seed, Purpose::Bench, index + 1, PointSet::Random)
}

fn incoherent(scene: &BenchScene, count: u64, seed: u64) -> Vec<Ray> {
    let surface = Surface::new(&scene.triangles);
    let ray = |index| {
        let stream = stream(seed, index);
        let [xi0, xi1, ..] = stream.point(1);
        surface.point(stream.point(0)).leaving(xi0, xi1)
    };
    (0..count).into_par_iter().map(ray).collect()
}

/// Draws before a pair that faces each other is given up: in a room half of the pairs do.
const ATTEMPTS: u32 = 64;

fn segments(scene: &BenchScene, count: u64, seed: u64) -> Vec<Ray> {
    let surface = Surface::new(&scene.triangles);
    let segment = |index| {
        let stream = stream(seed, index);
        (0..ATTEMPTS).find_map(|attempt| {
            let a = surface.point(stream.point(2 * attempt));
            let b = surface.point(stream.point(2 * attempt + 1));
            let between = b.position() - a.position();
            let faces = between.dot(a.triangle.normal()) > 0.0;
            let faced = between.dot(b.triangle.normal()) < 0.0;
            (faces && faced).then(|| Ray::segment(a.lifted(), b.lifted()))
        })
    };
    (0..count).into_par_iter().filter_map(segment).collect()
}
