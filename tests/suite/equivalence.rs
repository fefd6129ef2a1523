//! The whole pipeline on Embree instead of the native tracer, and on both at once.

use crate::scenes::{Piece, cube, grey, inside_out, scene, square};
use glam::Vec3;
use isolux::bvh::Bvh;
use isolux::color::{Rgb, luminance, rounded};
use isolux::equivalence::{Cause, Pair, Pipeline};
use isolux::field::{Constant, Interpolated, IrradianceField};
use isolux::form_factor::{Estimator, ExchangeMatrix, Rows, Transport};
use isolux::geometry::{Hit, MollerTrumbore, Ray, RayCaster, Triangle};
use isolux::oracle::{Device, EmbreeScene, Isa, Options, Packets};
use isolux::patches::{PatchId, PatchMesh, Subdivision};
use isolux::radiosity::{self, Choices, Method, Radiosity, Solver};
use isolux::render::{Frame, Image, render};
use isolux::sampling::PointSet;
use isolux::scene::{Camera, Document, Scene};
use isolux::settings::Settings;
use isolux::solution::Solution;
use isolux::solver::Stop;
use isolux::verify::bounds::Arithmetic;
use isolux::verify::cross_checked::CrossChecked;
use isolux::verify::verdict::Judge;
use std::path::Path;

const SCENES: [&str; 3] = ["cornell-box", "course-room", "furnace"];

fn load(name: &str) -> (Scene, Document) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}.toml"));
    let mut description = Document::open(&path).expect("a description");
    // Between the dark sides of walls that nearly touch, a few samples per pair do not converge.
    description.one_sided = true;
    (Scene::load(&description).expect("a scene"), description)
}

/// Embree's approximate reciprocal differs between instruction sets: each that the processor has is held
/// against the native tracer, so that one machine stands for many.
fn for_each_embree(mut check: impl FnMut(Isa, bool)) {
    let isas = Device::available_isas();
    assert!(!isas.is_empty(), "Embree opens no device");
    for isa in isas {
        for robust in [false, true] {
            check(isa, robust);
        }
    }
}

fn embree(triangles: &[Triangle], isa: Isa, robust: bool) -> EmbreeScene {
    let device = Device::new(isa.config()).expect("Embree");
    let options = Options { robust, packets: Packets::Packet16 };
    EmbreeScene::build(&device, triangles, options).expect("a committed scene")
}

fn judge(triangles: &[Triangle], robust: bool) -> Judge<'_> {
    let other = if robust { Arithmetic::EmbreeRobust } else { Arithmetic::EmbreeDefault };
    Judge::new(triangles, Arithmetic::MollerTrumbore, other)
}

fn both(triangles: &[Triangle], isa: Isa, robust: bool) -> CrossChecked<'_, Bvh, EmbreeScene> {
    let embree = embree(triangles, isa, robust);
    CrossChecked::new(Bvh::build(triangles), embree, judge(triangles, robust))
}

fn settings(method: Method) -> Choices {
    Choices {
        method,
        samples: if method == Method::Pairs { 4 } else { 64 },
        points: PointSet::Sobol,
        direct_samples: 0,
        solver: Solver::GaussSeidel,
        stop: Stop::Tolerance(1e-6),
        seed: 3,
        memory_limit: None,
    }
}

fn light(caster: &dyn RayCaster, mesh: &PatchMesh, method: Method) -> Radiosity {
    radiosity::solve(caster, mesh, &settings(method), &()).expect("light")
}

fn draw(caster: &dyn RayCaster, mesh: &PatchMesh, from: &Document, light: &Radiosity) -> Image {
    let flat = Constant::new(&rounded(&light.irradiance), &vec![1.0; mesh.len()]);
    let frame = Frame { samples: 4, seed: 3, ..Frame::new(96, 96) };
    let camera = from.camera.as_ref().expect("a camera");
    render(caster, mesh, camera, &frame, &[&flat], &()).remove(0)
}

#[test]
fn asked_together_the_native_pipeline_does_not_change_and_nobody_is_wrong() {
    for name in SCENES {
        let (scene, description) = load(name);
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(3)).expect("patches");
        let native = Bvh::<MollerTrumbore>::build(scene.triangles.clone());
        let methods = [Method::Pairs, Method::Hemisphere];
        let alone = methods.map(|method| {
            let light = light(&native, &mesh, method);
            let picture = draw(&native, &mesh, &description, &light);
            (light, picture)
        });
        for_each_embree(|isa, robust| {
            let case = format!("{name}, {isa}, robust {robust}");
            let checked = both(&scene.triangles, isa, robust);
            let mut rays = 0;
            for (method, (alone, picture)) in methods.into_iter().zip(&alone) {
                let together = light(&checked, &mesh, method);
                assert_eq!(alone.radiosity, together.radiosity, "{case}, {method:?}");
                assert_eq!(*picture, draw(&checked, &mesh, &description, &together), "{case}");
                rays += together.rays + 96 * 96 * 4;
            }
            let tally = checked.record().tally;
            println!("{case}: {tally:?}");
            assert_eq!(tally.queries, rays, "{case}: every ray was checked");
            let wrong = tally.native_wrong + tally.peer_wrong + tally.both_wrong;
            assert_eq!(wrong, 0, "{case}: {:?}", checked.record().failures);
        });
    }
}

/// All entries, row by row.
fn entries(matrix: ExchangeMatrix) -> Vec<Vec<(usize, f64)>> {
    let row = |i: usize| {
        let mut row = Vec::new();
        matrix.for_each_in_row(PatchId(i as u32), &mut |j, factor| row.push((j, factor)));
        row
    };
    (0..matrix.len()).map(row).collect()
}

/// Rays between patches have all 24 bits, so that one may pass an edge within rounding: bits may be demanded
/// of a matrix only as far as the verdicts agree, and of a solution wherever its matrix is the same.
#[test]
fn pairwise_form_factors_differ_only_where_a_verdict_says_so_and_equal_ones_give_equal_light() {
    let choices = settings(Method::Pairs);
    let rooms = SCENES.map(|name| (load(name).0, 2)).into_iter().chain([(integer_room(), 1)]);
    for (number, (scene, level)) in rooms.enumerate() {
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(level)).expect("patches");
        let native = Bvh::<MollerTrumbore>::build(scene.triangles.clone());
        let native_light = light(&native, &mesh, Method::Pairs);
        let of = |caster: &dyn RayCaster| {
            let Choices { samples, points, seed, .. } = choices;
            entries(Estimator::new(&caster, &mesh, samples, points, seed, &()).exchange_matrix())
        };
        for_each_embree(|isa, robust| {
            let case = format!("scene {number}, {isa}, robust {robust}");
            let checked = both(&scene.triangles, isa, robust);
            let embree = embree(&scene.triangles, isa, robust);
            let (ours, theirs) = (of(&checked), of(&embree));
            let different = ours.iter().zip(&theirs).filter(|(a, b)| a != b).count() as u64;
            let tally = checked.record().tally;
            println!("{case}: {different} rows differ, {tally:?}");
            // Each segment that is answered differently changes one entry of two rows.
            assert!(
                different <= 2 * (tally.queries - tally.agree),
                "{case}: {different}, {tally:?}"
            );
            if different == 0 {
                let light = light(&embree, &mesh, Method::Pairs);
                assert_eq!(native_light.radiosity, light.radiosity, "{case}");
            }
        });
    }
}

/// Form factors, direct light, coverage, solution and pictures through both tracers; every number that
/// differs must have a cause.
fn compare(scene: &Scene, camera: &Camera, level: u32, isa: Isa, robust: bool) {
    let mesh = PatchMesh::subdivide(scene, Subdivision::Levels(level)).expect("patches");
    let native = Bvh::<MollerTrumbore>::build(scene.triangles.clone());
    let peer = embree(&scene.triangles, isa, robust);
    let judge = judge(&scene.triangles, robust);
    let pair = Pair { native: &native, peer: &peer, judge, peer_is_ours: false };
    let summary = Pipeline {
        mesh: &mesh,
        settings: Choices { direct_samples: 16, ..settings(Method::Hemisphere) },
        camera,
        frame: Frame { samples: 4, seed: 3, ..Frame::new(96, 96) },
        crease: 30.0,
    }
    .compare(&pair, &())
    .expect("light")
    .summary;
    println!("{isa}, robust {robust}: {summary:?}");
    assert_eq!(summary.failures(), 0, "{isa}, robust {robust}: {summary:?}");
    for stage in summary.stages() {
        assert!(stage.total > 0, "{isa}, robust {robust}: {summary:?}");
        assert!(!stage.causes.contains_key(&Cause::PeerWrong), "{isa}: {summary:?}");
    }
}

#[test]
fn everything_downstream_differs_only_where_a_verdict_says_so() {
    let shipped = SCENES.map(|name| {
        let (scene, description) = load(name);
        (scene, description.camera.expect("a camera"), 3)
    });
    for (scene, camera, level) in shipped.into_iter().chain([(integer_room(), grid_camera(), 1)]) {
        for_each_embree(|isa, robust| compare(&scene, &camera, level, isa, robust));
    }
}

/// A closed room from -8 to 8 with a lamp under its ceiling and three blocks, all corners at
/// integers. From the middle each block shows one face.
fn integer_room() -> Scene {
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z];
    let block = |center: Vec3| cube(center - 1.0, 2.0);
    let blocks = [block(x * -5.0), block(y * -4.0), block(z * 6.0)];
    let lamp = square(Vec3::new(-2.0, 7.0, -2.0), x * 4.0, z * 4.0);
    scene([
        Piece::new(inside_out(cube(Vec3::splat(-8.0), 16.0))).reflecting(Rgb::new(0.8, 0.6, 0.4)),
        Piece::new(blocks.concat()).reflecting(Rgb::new(0.3, 0.5, 0.7)),
        Piece::new(lamp).reflecting(grey(0.5)).emitting(Rgb::new(9.0, 8.0, 7.0)),
    ])
}

/// Rounds the rays of a camera in the middle of [`integer_room`] to targets on a grid on its walls:
/// off every edge of a triangle or a patch, and such that every determinant is a power of two and no
/// operation of any kernel rounds.
struct OnGrid<'c>(&'c dyn RayCaster);

impl OnGrid<'_> {
    fn snap(ray: &Ray) -> Ray {
        let to_wall = ray.direction * (8.0 / ray.direction.abs().max_element());
        let is_depth = to_wall.abs().cmpeq(Vec3::splat(to_wall.abs().max_element()));
        // With three different offsets no two coordinates have an integer sum or difference.
        let offsets = Vec3::new(1.0 / 8.0, 1.0 / 16.0, 1.0 / 32.0);
        let on_grid = (to_wall * 4.0).floor() / 4.0 + offsets;
        let direction = Vec3::select(is_depth, to_wall.signum() * 8.0, on_grid);
        Ray { direction, ..*ray }
    }
}

impl RayCaster for OnGrid<'_> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        self.0.nearest(&OnGrid::snap(ray))
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.0.occluded(&OnGrid::snap(ray))
    }

    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        let rays: Vec<Ray> = rays.iter().map(OnGrid::snap).collect();
        self.0.nearest_batch(&rays, hits);
    }
}

/// Flat and smooth.
fn grid_pictures(caster: &dyn RayCaster, mesh: &PatchMesh, light: &Radiosity) -> [Image; 2] {
    let shares = vec![1.0; mesh.len()];
    let irradiance = rounded(&light.irradiance);
    let flat = Constant::new(&irradiance, &shares);
    let smooth = Interpolated::new(mesh, &irradiance, &shares, 30.0);
    let fields: [&dyn IrradianceField; 2] = [&flat, &smooth];
    let camera = grid_camera();
    let frame = Frame { samples: 4, seed: 3, ..Frame::new(96, 96) };
    let (caster, quiet) = (OnGrid(caster), ());
    let pictures = render(&caster, mesh, &camera, &frame, &fields, &quiet);
    pictures.try_into().expect("two pictures")
}

fn grid_camera() -> Camera {
    let camera = Camera::new(Vec3::ZERO, Vec3::new(0.3, -0.6, 1.0), Vec3::Y, 100.0, 0.0);
    camera.expect("a camera")
}

fn bits(image: &Image) -> Vec<[u32; 3]> {
    image.pixels.iter().map(|p| p.to_array().map(f32::to_bits)).collect()
}

/// How far two smooth pixels may lie apart whose rays have the same exact u and v of [`OnGrid`], of
/// `level` 1, in units of the largest irradiance H of a patch. No vertex has more, being a mean of patches.
///
/// With ε = 2⁻²⁴: on the grid numerators and determinants are exact, so that u, v ≤ 1 are off by Embree's
/// reciprocal alone, at most γ₈ of their value (see `verify::bounds`). Within a patch, λ = 2u − i and
/// 2v − j: off by 2γ₈ each, and 1 − λ₁ − λ₂ by 4γ₈. Each of the three weighs a value of at most H, so that
/// the interpolated irradiance is off by 8γ₈H; that u + v ≤ 1 would halve it is left as room. Both tracers
/// round it: the weights by 2ε, products and sums by 3ε, times the reflectance and over π by 2ε, the mean of
/// four samples by 4ε: less than γ₁₂H on each side. No pixel shows the lamp, so that nothing is added to
/// ρH/π < H/3, with ρ ≤ 0.8. γₙ exceeds nε by less than 2⁻¹⁴ of it.
const SMOOTH_BOUND: f64 =
    (8.0 * 8.0 + 2.0 * 12.0) * (f32::EPSILON as f64 / 2.0) * (1.0 + 1.0 / 16384.0) / 3.0;

/// On the grid no ray comes near an edge of a triangle or a patch, and no operation but Embree's
/// approximate reciprocal rounds. So the patches are the same with every instruction set by construction,
/// and flat pictures the same to the bit; u and v, and with them smooth pictures, are not.
#[test]
fn on_an_integer_grid_flat_pictures_are_equal_bit_for_bit_and_smooth_ones_within_the_bound() {
    let scene = integer_room();
    let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(1)).expect("patches");
    let native = Bvh::<MollerTrumbore>::build(scene.triangles.clone());
    let light = light(&native, &mesh, Method::Hemisphere);
    let [flat, smooth] = grid_pictures(&native, &mesh, &light);
    for picture in [&flat, &smooth] {
        let mut colors = bits(picture);
        colors.sort_unstable();
        colors.dedup();
        assert!(colors.len() > 50, "a picture of something: {} colours", colors.len());
    }
    let lamp = 7.0;
    let shows_no_lamp = |p: &Rgb| p.max_element() < lamp;
    assert!(smooth.pixels.iter().all(shows_no_lamp), "the bound leaves emission out");
    let most = light.irradiance.iter().map(|h| h.max_element()).fold(0.0, f64::max);
    for_each_embree(|isa, robust| {
        let embree = embree(&scene.triangles, isa, robust);
        let [embree_flat, embree_smooth] = grid_pictures(&embree, &mesh, &light);
        assert!(bits(&flat) == bits(&embree_flat), "{isa}, robust {robust}");
        let differences = smooth
            .pixels
            .iter()
            .zip(&embree_smooth.pixels)
            .map(|(a, b)| (a.as_dvec3() - b.as_dvec3()).abs().max_element() / most);
        let largest = differences.fold(0.0, f64::max);
        println!("{isa}, robust {robust}: {largest:e} of {SMOOTH_BOUND:e}");
        assert!(largest <= SMOOTH_BOUND, "{isa}, robust {robust}: {largest:e}");
    });
}

/// Embree's hits lie at other bits of the same places, so a path may turn aside where it meets an edge. What that
/// changes is far below a picture's noise.
#[test]
fn gathered_pictures_are_one_picture_by_both_tracers() {
    for name in SCENES {
        let (scene, description) = load(name);
        let native: Bvh = Bvh::build(&*scene.triangles);
        let light = Solution::solve(&description, &scene, &native, &Settings::default(), &());
        let light = light.expect("light");
        let view = light.gathered();
        let frame = Frame { samples: 8, ..Frame::new(48, 48) };
        let draw = |caster: &dyn RayCaster| {
            view.draw(caster, &light.camera, &frame, &()).expect("a picture")
        };
        let ours = draw(&native);
        for_each_embree(|isa, robust| {
            let theirs = draw(&embree(&scene.triangles, isa, robust));
            let (mut difference, mut sum) = (0.0, 0.0);
            for (k, (a, b)) in ours.pixels.iter().zip(&theirs.pixels).enumerate() {
                let (a, b) = (luminance(*a), luminance(*b));
                let allowed = 3.0 * ours.error[k] + 1e-4 * a;
                assert!((a - b).abs() <= allowed, "{name}, {isa:?}, pixel {k}: {a} and {b}");
                difference += (a - b).abs() as f64;
                sum += a as f64;
            }
            println!("{name}, {isa:?}: apart by {:.1e} in the mean", difference / sum);
            assert!(difference < 1e-3 * sum, "{name}, {isa:?}: {difference} of {sum}");
        });
    }
}
