//! Scenes made in memory whose light is known exactly.

use glam::{DVec3, Vec3};
use isolux::bvh::Bvh;
use isolux::color::Rgb;
use isolux::form_factor::Estimator;
use isolux::geometry::Triangle;
use isolux::patches::{PatchId, PatchMesh, Subdivision};
use isolux::sampling::PointSet;
use isolux::scene::{Material, MaterialId, Scene};
use std::sync::Arc;

/// Some triangles of one material. The k-th piece of a scene has material k.
pub struct Piece {
    pub triangles: Vec<Triangle>,
    pub material: Material,
}

impl Piece {
    /// Grey and one-sided, without light of its own.
    pub fn new(triangles: Vec<Triangle>) -> Piece {
        Piece { triangles, material: Material::fallback() }
    }

    pub fn reflecting(mut self, reflectance: impl Into<Rgb>) -> Piece {
        self.material.reflectance = reflectance.into();
        self
    }

    /// `radiance` in W·sr⁻¹·m⁻².
    pub fn emitting(mut self, radiance: impl Into<Rgb>) -> Piece {
        self.material.radiance = radiance.into();
        self
    }

    pub fn two_sided(mut self) -> Piece {
        self.material.two_sided = true;
        self
    }
}

pub fn grey(value: f32) -> Rgb {
    Rgb::splat(value)
}

pub fn scene(pieces: impl IntoIterator<Item = Piece>) -> Scene {
    let (mut triangles, mut material_of, mut materials) = (vec![], vec![], vec![]);
    for piece in pieces {
        material_of.extend(vec![MaterialId(materials.len() as u32); piece.triangles.len()]);
        triangles.extend(piece.triangles);
        materials.push(piece.material);
    }
    Scene::new(triangles, material_of, materials)
}

/// The scene with all coordinates multiplied by `factor`.
pub fn scaled(scene: &Scene, factor: f32) -> Scene {
    let mut scaled = scene.clone();
    Arc::make_mut(&mut scaled.triangles).iter_mut().for_each(|t| t.p = t.p.map(|p| p * factor));
    scaled
}

/// The parallelogram with edges `u` and `v` at `corner`; its front looks along u × v.
pub fn square(corner: Vec3, u: Vec3, v: Vec3) -> Vec<Triangle> {
    let [a, b, c, d] = [corner, corner + u, corner + u + v, corner + v];
    vec![Triangle::new(a, b, c), Triangle::new(a, c, d)]
}

/// The six faces of a cube, looking outwards.
pub fn cube(corner: Vec3, edge: f32) -> Vec<Triangle> {
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * edge);
    [(x, y, z), (y, z, x), (z, x, y)]
        .into_iter()
        .flat_map(|(u, v, w)| [square(corner, v, u), square(corner + w, u, v)].concat())
        .collect()
}

/// The same triangles seen from behind.
pub fn inside_out(mut triangles: Vec<Triangle>) -> Vec<Triangle> {
    triangles.iter_mut().for_each(|t| t.p.swap(1, 2));
    triangles
}

/// 20 · 4^levels triangles, their corners on the unit sphere, looking outwards.
pub fn icosphere(levels: u32) -> Vec<Triangle> {
    let golden = (1.0 + 5f64.sqrt()) / 2.0;
    let corner = |i: usize| {
        let (one, phi) = ([1.0, -1.0][i % 2], [golden, -golden][i / 2 % 2]);
        [DVec3::new(0.0, one, phi), DVec3::new(one, phi, 0.0), DVec3::new(phi, 0.0, one)][i / 4]
            .normalize()
    };
    // The icosahedron's faces are its triples of corners one edge, 2 / √(1 + φ²), apart.
    let edge = 2.0 / (1.0 + golden * golden).sqrt();
    let near = |a: usize, b: usize| (corner(a).distance(corner(b)) - edge).abs() < 1e-9;
    let mut faces = Vec::new();
    for (a, b, c) in
        (0..12).flat_map(|a| (a..12).flat_map(move |b| (b..12).map(move |c| (a, b, c))))
    {
        if near(a, b) && near(b, c) && near(c, a) {
            let [a, b, c] = [a, b, c].map(corner);
            let outwards = (b - a).cross(c - a).dot(a) > 0.0;
            faces.push(if outwards { [a, b, c] } else { [a, c, b] });
        }
    }
    assert_eq!(faces.len(), 20);
    for _ in 0..levels {
        faces = faces
            .into_iter()
            .flat_map(|[a, b, c]| {
                let [ab, bc, ca] = [a + b, b + c, c + a].map(DVec3::normalize);
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [bc, ca, ab]]
            })
            .collect();
    }
    faces.into_iter().map(|p| Triangle { p: p.map(|p| p.as_vec3()) }).collect()
}

/// The same triangles turned by angles that are multiples of nothing, and moved.
pub fn askew(mut triangles: Vec<Triangle>) -> Vec<Triangle> {
    let turn = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.7, 0.4, -1.1);
    let to = Vec3::new(0.3, -1.7, 2.9);
    triangles.iter_mut().for_each(|t| t.p = t.p.map(|p| turn * p + to));
    triangles
}

/// A scene's patches.
pub fn subdivided(scene: &Scene, levels: u32) -> PatchMesh {
    PatchMesh::subdivide(scene, Subdivision::Levels(levels)).expect("few levels")
}

/// The patches of the piece with material `piece`.
pub fn patches_of(mesh: &PatchMesh, piece: u32) -> Vec<PatchId> {
    all(mesh).filter(|&p| mesh.side(p).material == MaterialId(piece)).collect()
}

pub fn all(mesh: &PatchMesh) -> impl Iterator<Item = PatchId> + use<> {
    (0..mesh.len() as u32).map(PatchId)
}

/// What estimates of a scene need beside their settings.
pub struct World {
    pub mesh: PatchMesh,
    pub bvh: Bvh,
}

impl World {
    pub fn new(scene: &Scene, levels: u32) -> Self {
        World::of(subdivided(scene, levels))
    }

    pub fn of(mesh: PatchMesh) -> Self {
        let bvh = Bvh::build(mesh.scene.triangles.clone());
        World { mesh, bvh }
    }

    pub fn estimator(&self, samples: u32, points: PointSet, seed: u64) -> Estimator<'_, Bvh> {
        Estimator::new(&self.bvh, &self.mesh, samples, points, seed, &())
    }

    pub fn random(&self, samples: u32, seed: u64) -> Estimator<'_, Bvh> {
        self.estimator(samples, PointSet::Random, seed)
    }
}

/// A mean with its standard error.
#[derive(Debug, Clone, Copy)]
pub struct Measured {
    pub mean: f64,
    pub standard_error: f64,
}

impl Measured {
    /// From independent repetitions, each with a seed of its own: their mean, and its standard
    /// error as the repetitions' scatter shows it, whatever way each of them was estimated.
    pub fn from_repetitions(values: &[f64]) -> Measured {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
        Measured { mean, standard_error: (variance / n).sqrt() }
    }

    /// How many standard errors the mean lies from `expected`.
    pub fn errors_from(&self, expected: f64) -> f64 {
        (self.mean - expected) / self.standard_error
    }
}
