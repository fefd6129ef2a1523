//! Explanations are found where there are some, and nowhere else.

use super::*;
use crate::bvh::Bvh;
use crate::color::{Rgb, luminance};
use crate::geometry::{Hit, MollerTrumbore, Plane, Ray, TriangleId};
use crate::patches::Subdivision;
use crate::radiosity::{Method, Solver};
use crate::scene::{Document, Scene};
use crate::solver::Stop;
use crate::verify::{Arithmetic, Judge};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

const FRAME: Frame = Frame {
    width: 24,
    height: 16,
    samples: 4,
    in_one_round: false,
    seed: 5,
    error: None,
    deadline: None,
    background: None,
};

/// Compares on the Cornell box.
fn compare(
    native: impl Fn(Bvh) -> Box<dyn RayCaster>,
    peer: impl Fn(Bvh, Bvh<Plane>) -> Box<dyn RayCaster>,
    arithmetic: Arithmetic,
    peer_is_ours: bool,
) -> Comparison {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box.toml");
    let description = Document::open(&file).unwrap();
    let scene = Scene::load(&description).unwrap();
    let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(2)).unwrap();
    let triangles = &scene.triangles;
    let native = native(Bvh::build(triangles.clone()));
    let peer = peer(
        Bvh::<MollerTrumbore>::build(triangles.clone()),
        Bvh::<Plane>::build(triangles.clone()),
    );
    let judge = Judge::new(triangles, Arithmetic::MollerTrumbore, arithmetic);
    let pair = Pair { native: &*native, peer: &*peer, judge, peer_is_ours };
    let settings = Choices {
        method: Method::Hemisphere,
        samples: 32,
        points: PointSet::Sobol,
        direct_samples: 16,
        solver: Solver::GaussSeidel,
        stop: Stop::Tolerance(1e-4),
        seed: 5,
        memory_limit: None,
    };
    let camera = description.camera.as_ref().unwrap();
    let pipeline = Pipeline { mesh: &mesh, settings, camera, frame: FRAME, crease: 30.0 };
    pipeline.compare(&pair, &()).unwrap()
}

fn against(
    peer: impl Fn(Bvh, Bvh<Plane>) -> Box<dyn RayCaster>,
    arithmetic: Arithmetic,
    peer_is_ours: bool,
) -> Comparison {
    compare(|bvh| Box::new(bvh), peer, arithmetic, peer_is_ours)
}

/// Takes every triangle for its neighbour in the file.
struct Shifted<C>(C);

impl<C: RayCaster> RayCaster for Shifted<C> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        let hit = self.0.nearest(ray)?;
        Some(Hit { triangle: TriangleId(hit.triangle.0 ^ 1), ..hit })
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.0.occluded(ray)
    }
}

/// Loses one in 1009 rays, so that asking again gives another answer.
struct Unsteady<C>(C, AtomicU64);

impl<C: RayCaster> RayCaster for Unsteady<C> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        let is_lost = self.1.fetch_add(1, Ordering::Relaxed).is_multiple_of(1009);
        self.0.nearest(ray).filter(|_| !is_lost)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.0.occluded(ray)
    }
}

fn count(stage: &Compared, cause: Cause) -> u64 {
    stage.causes.get(&cause).copied().unwrap_or(0)
}

#[test]
fn a_tracer_does_not_differ_from_itself_and_the_picture_is_grey() {
    let same = against(|bvh, _| Box::new(bvh), Arithmetic::MollerTrumbore, true);
    assert!(same.summary.stages().iter().all(|stage| stage.total > 0 && stage.differing == 0));
    assert_eq!((same.summary.radiosity.differing, same.summary.failures()), (0, 0));
    let picture = same.difference_image(1.0);
    let grey: Vec<Rgb> = same.smooth.pixels.iter().map(|p| Rgb::splat(luminance(*p))).collect();
    assert_eq!(picture.pixels, grey);
}

#[test]
fn what_the_other_kernel_makes_different_is_explained() {
    let Comparison { summary, causes, .. } =
        against(|_, plane| Box::new(plane), Arithmetic::Plane, true);
    assert_eq!(summary.failures(), 0, "{summary:?}");
    // The plane kernel rounds u and v in another way.
    assert!(count(&summary.smooth, Cause::Rounding) > 0);
    assert_eq!(count(&summary.flat, Cause::Rounding), 0, "u and v are no excuse for flat pixels");
    for stage in summary.stages() {
        assert_eq!(stage.causes.values().sum::<u64>(), stage.differing, "each has one cause");
    }
    let marked = causes.iter().flatten().count() as u64;
    assert!(marked >= summary.smooth.differing && marked <= summary.smooth.total);
}

#[test]
fn wrong_answers_are_blamed_on_whose_they_are() {
    let cramer = Arithmetic::MollerTrumbore;
    let foreign = against(|bvh, _| Box::new(Shifted(bvh)), cramer, false).summary;
    assert!(count(&foreign.form_factors, Cause::PeerWrong) > 0, "{foreign:?}");
    assert!(count(&foreign.flat, Cause::PeerWrong) > 0, "{foreign:?}");
    assert_eq!(foreign.failures(), 0);
    assert!(foreign.sources().next().expect("a source").contains("f32::from_bits"));

    let ours = against(|bvh, _| Box::new(Shifted(bvh)), cramer, true);
    assert!(ours.summary.failures() > 0);
    let red = Rgb::new(1.0, 0.0, 0.0);
    assert!(ours.difference_image(1.0).pixels.contains(&red));

    let wrong = compare(|b| Box::new(Shifted(b)), |b, _| Box::new(b), cramer, false).summary;
    assert!(count(&wrong.flat, Cause::NativeWrong) > 0 && wrong.failures() > 0, "{wrong:?}");
}

#[test]
fn what_does_not_happen_again_is_not_explained() {
    fn unsteady(bvh: Bvh) -> Unsteady<Bvh> {
        Unsteady(bvh, AtomicU64::new(0))
    }
    let cramer = Arithmetic::MollerTrumbore;
    let summary = against(|bvh, _| Box::new(unsteady(bvh)), cramer, false).summary;
    assert!(count(&summary.form_factors, Cause::Unexplained) > 0, "{summary:?}");
    assert!(summary.failures() > 0);
}

#[test]
fn a_solution_that_differs_where_its_equation_does_not_is_unexplained() {
    let light = |value: f64| vec![Rgb64::splat(value); 3];
    let (equal, moved) = (Compared::default(), Compared { differing: 1, ..Compared::default() });
    let found = solutions(&light(2.0), &light(1.0), [&equal, &equal]);
    assert_eq!((found.differing, found.unexplained), (3, 3));
    assert_eq!(found.largest_relative_difference, 0.5);
    assert_eq!(solutions(&light(2.0), &light(1.0), [&equal, &moved]).unexplained, 0);
    assert_eq!(solutions(&light(2.0), &light(2.0), [&equal, &equal]).differing, 0);
}
