//! Scenes made in memory whose light is known exactly.

use glam::Vec3;
use isolux::bvh::Bvh;
use isolux::color::Rgb;
use isolux::form_factor::Estimator;
use isolux::geometry::Triangle;
pub(crate) use isolux::geometry::shapes::{cube, icosphere, inside_out, square};
use isolux::patches::{PatchId, PatchMesh, Subdivision};
use isolux::sampling::PointSet;
use isolux::scene::{Material, MaterialId, Scene};
use std::sync::Arc;

/// Some triangles of one material. The k-th piece of a scene has material k.
pub(crate) struct Piece {
    pub triangles: Vec<Triangle>,
    pub material: Material,
}

impl Piece {
    /// Grey and one-sided, without light of its own.
    pub(crate) fn new(triangles: Vec<Triangle>) -> Piece {
        Piece { triangles, material: Material::fallback() }
    }

    pub(crate) fn reflecting(mut self, reflectance: impl Into<Rgb>) -> Piece {
        self.material.reflectance = reflectance.into();
        self
    }

    /// `radiance` in W·sr⁻¹·m⁻².
    pub(crate) fn emitting(mut self, radiance: impl Into<Rgb>) -> Piece {
        self.material.radiance = radiance.into();
        self
    }

    pub(crate) fn two_sided(mut self) -> Piece {
        self.material.two_sided = true;
        self
    }
}

pub(crate) fn grey(value: f32) -> Rgb {
    Rgb::splat(value)
}

pub(crate) fn scene(pieces: impl IntoIterator<Item = Piece>) -> Scene {
    let (mut triangles, mut material_of, mut materials) = (vec![], vec![], vec![]);
    for piece in pieces {
        material_of.extend(vec![MaterialId(materials.len() as u32); piece.triangles.len()]);
        triangles.extend(piece.triangles);
        materials.push(piece.material);
    }
    Scene::new(triangles, material_of, materials)
}

/// The scene with all coordinates multiplied by `factor`.
pub(crate) fn scaled(scene: &Scene, factor: f32) -> Scene {
    let mut scaled = scene.clone();
    Arc::make_mut(&mut scaled.triangles).iter_mut().for_each(|t| t.p = t.p.map(|p| p * factor));
    scaled
}

/// The triangles turned by angles that are multiples of nothing, and moved.
pub(crate) fn askew(mut triangles: Vec<Triangle>) -> Vec<Triangle> {
    let turn = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.7, 0.4, -1.1);
    let to = Vec3::new(0.3, -1.7, 2.9);
    triangles.iter_mut().for_each(|t| t.p = t.p.map(|p| turn * p + to));
    triangles
}

/// A scene's patches.
pub(crate) fn subdivided(scene: &Scene, levels: u32) -> PatchMesh {
    PatchMesh::subdivide(scene, Subdivision::Levels(levels)).expect("few levels")
}

/// The patches of the piece with material `piece`.
pub(crate) fn patches_of(mesh: &PatchMesh, piece: u32) -> Vec<PatchId> {
    all(mesh).filter(|&p| mesh.side(p).material == MaterialId(piece)).collect()
}

pub(crate) fn all(mesh: &PatchMesh) -> impl Iterator<Item = PatchId> + use<> {
    (0..mesh.len() as u32).map(PatchId)
}

/// A scene's patches and hierarchy.
pub(crate) struct World {
    pub mesh: PatchMesh,
    pub bvh: Bvh,
}

impl World {
    pub(crate) fn new(scene: &Scene, levels: u32) -> Self {
        World::of(subdivided(scene, levels))
    }

    pub(crate) fn of(mesh: PatchMesh) -> Self {
        let bvh = Bvh::build(mesh.scene.triangles.clone());
        World { mesh, bvh }
    }

    pub(crate) fn estimator(&self, samples: u32, points: PointSet, seed: u64) -> Estimator<'_> {
        Estimator::new(&self.bvh, &self.mesh, samples, points, seed, &())
    }

    pub(crate) fn random(&self, samples: u32, seed: u64) -> Estimator<'_> {
        self.estimator(samples, PointSet::Random, seed)
    }
}

/// A mean with its standard error.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measured {
    pub mean: f64,
    pub standard_error: f64,
}

impl Measured {
    /// From independent repetitions, each with a seed of its own: their mean, and its standard
    /// error as the repetitions' scatter shows it, whatever way each of them was estimated.
    pub(crate) fn from_repetitions(values: &[f64]) -> Measured {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
        Measured { mean, standard_error: (variance / n).sqrt() }
    }

    /// How many standard errors the mean lies from `expected`.
    pub(crate) fn errors_from(&self, expected: f64) -> f64 {
        (self.mean - expected) / self.standard_error
    }
}
