//! The checks prove themselves: whatever is wrong on purpose, one of them finds and names it.

use super::Arithmetic;
use super::grid::Grid;
use super::leaks::leaks;
use super::rays::{RayKind, RaySource};
use super::survey::{Peer, survey};
use crate::bvh::mutants::{CONTROL, MUTANTS, Mutant};
use crate::framing::fitted;
use crate::geometry::{BruteForce, MollerTrumbore, Triangle};
use crate::patches::Sides;
use crate::scene::{Material, MaterialId, Scene};
use glam::{Quat, Vec3};

const RAYS: u64 = 10_000;

/// Signs of f64 are wrong so seldom that one ray in thousands gets out.
const SEAM_RAYS: u64 = 100_000;

/// A closed cube of 300 triangles, askew in space. Corners shared by faces have the same bits.
fn room() -> Scene {
    const CELLS: usize = 5;
    let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.7, 0.4, -1.1);
    let corner = |p: Vec3| turn * (p / CELLS as f32 * 3.0) + Vec3::new(0.3, -1.7, 2.9);
    let triangles: Vec<Triangle> = (0..6 * CELLS * CELLS)
        .flat_map(|square| {
            let (face, i, j) = (square % 6, square / 6 % CELLS, square / 6 / CELLS);
            let [u, v, w] = [0, 1, 2].map(|k| Vec3::AXES[(face / 2 + k) % 3]);
            let p = u * i as f32 + v * j as f32 + w * (face % 2 * CELLS) as f32;
            let (u, v) = if face % 2 == 0 { (v, u) } else { (u, v) };
            let [a, b, c, d] = [p, p + u, p + u + v, p + v].map(corner);
            [Triangle::new(a, b, c), Triangle::new(a, c, d)]
        })
        .collect();
    let material_of = vec![MaterialId(0); triangles.len()];
    Scene::new(triangles, material_of, vec![Material::fallback()])
}

/// By which checks of `isolux verify` the caster is caught, each with what it found.
fn caught(mutant: &Mutant) -> Vec<String> {
    [surveyed(mutant), leaked(mutant), gridded(mutant)].into_iter().flatten().collect()
}

fn brute_force(triangles: &[Triangle]) -> Peer<'_> {
    let caster = Box::new(BruteForce::<MollerTrumbore>::new(triangles));
    let arithmetic = Arithmetic::MollerTrumbore;
    Peer { name: "brute force", caster, arithmetic, is_native: true, single: false }
}

fn surveyed(mutant: &Mutant) -> Option<String> {
    let scene = room();
    let native = (mutant.build)(&scene.triangles);
    let camera = fitted(
        &scene,
        &Sides::of_all(&scene),
        &BruteForce::<MollerTrumbore>::new(&scene.triangles),
    );
    let source = RaySource::new(&scene, &camera, 1);
    let peers = [brute_force(&scene.triangles)];
    let finding = survey(&scene, &*native, &peers, &source, RAYS / 2, &()).remove(0);
    let wrong = finding.total().failures();
    assert_eq!(wrong > 0, finding.failures.iter().any(|source| source.contains("from_bits")));
    let kinds: Vec<String> = RayKind::ALL
        .iter()
        .map(|&kind| (kind, finding.by_kind[kind as usize].failures()))
        .filter(|(_, wrong)| *wrong > 0)
        .map(|(kind, wrong)| format!("{} {wrong}", kind.name()))
        .collect();
    (wrong > 0).then(|| format!("survey ({})", kinds.join(", ")))
}

fn leaked(mutant: &Mutant) -> Option<String> {
    let triangles = room().triangles;
    let native = (mutant.build)(&triangles);
    let leak = leaks(&triangles, &*native, &[], SEAM_RAYS, 1).remove(0);
    (leak.escaped > 0).then(|| format!("leaks ({} of {})", leak.escaped, leak.rays))
}

fn gridded(mutant: &Mutant) -> Option<String> {
    let grid = Grid::general(RAYS, 1);
    let caster = (mutant.build)(&grid.triangles);
    let peer = Peer { name: mutant.name, caster, ..brute_force(&grid.triangles) };
    let finding = grid.ask(&[peer]).remove(0);
    assert_eq!(
        finding.wrong > 0,
        finding.failures.iter().any(|source| source.contains("from_bits"))
    );
    (finding.wrong > 0).then(|| format!("grid ({} of {})", finding.wrong, finding.queries))
}

#[test]
fn every_deliberate_fault_is_caught_and_none_is_found_without() {
    assert_eq!(caught(&CONTROL), Vec::<String>::new(), "{}", CONTROL.name);
    let mut missed = Vec::new();
    for mutant in &MUTANTS {
        let by = caught(mutant);
        println!("{:<42} {}", mutant.name, by.join(", "));
        if by.is_empty() {
            missed.push(mutant.name);
        }
    }
    assert!(missed.is_empty(), "no check finds: {missed:?}");
}
