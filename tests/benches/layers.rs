//! What each layer costs, on the Cornell box: `cargo bench`, or `cargo bench -- draw` for one.

use divan::{Bencher, black_box};
use isolux::field::Interpolated;
use isolux::form_factor::{Estimator, Rows};
use isolux::geometry::{Ray, RayCaster};
use isolux::patches::{PatchId, PatchMesh, Sides, Subdivision};
use isolux::sampling::{PointSet, Purpose, Stream};
use isolux::settings::PatchSettings;
use isolux::{Document, Frame, Scene, Settings, Solution, Tracer, View};

fn main() {
    divan::main();
}

fn document() -> Document {
    Document::open(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box.toml"))
        .expect("a scene")
}

fn scene() -> Scene {
    document().scene().expect("triangles")
}

fn patches(levels: u32) -> PatchMesh {
    PatchMesh::subdivide(&scene(), Subdivision::Levels(levels)).expect("few patches")
}

fn solution() -> Solution {
    let (document, scene) = (document(), scene());
    let patches = PatchSettings { levels: Some(4), max_edge: None };
    let settings = Settings { patches, ..Settings::default() };
    Solution::solve(&document, &scene, &Tracer::build(&scene), &settings, &()).expect("light")
}

#[divan::bench]
fn read_the_scene() -> Scene {
    scene()
}

#[divan::bench]
fn build_the_hierarchy(bencher: Bencher) {
    let scene = scene();
    bencher.bench(|| Tracer::build(black_box(&scene)));
}

#[divan::bench]
fn trace_4096_camera_rays(bencher: Bencher) {
    let (document, scene) = (document(), scene());
    let tracer = Tracer::build(&scene);
    let camera = document.view(&scene, &Sides::of_all(&scene), &tracer);
    let stream = Stream::new(1, Purpose::Pixel, 0, PointSet::Sobol);
    let point = |k| stream.point(k);
    let rays: Vec<Ray> = (0..4096).map(point).map(|[x, y, ..]| camera.ray(x, y, 1.0)).collect();
    let mut hits = Vec::new();
    bencher.bench_local(|| tracer.nearest_batch(black_box(&rays), &mut hits));
}

#[divan::bench]
fn subdivide_into_36864_patches(bencher: Bencher) {
    let scene = scene();
    bencher.bench(|| PatchMesh::subdivide(black_box(&scene), Subdivision::Levels(5)));
}

#[divan::bench(sample_count = 10)]
fn estimate_2304_hemisphere_rows(bencher: Bencher) {
    let mesh = patches(3);
    let tracer = Tracer::build(&mesh.scene);
    let estimator = Estimator::new(&tracer, &mesh, 256, PointSet::Sobol, 1, &());
    bencher.bench(|| estimator.hemisphere_rows());
}

#[divan::bench]
fn gather_once_through_2304_rows(bencher: Bencher) {
    let mesh = patches(3);
    let tracer = Tracer::build(&mesh.scene);
    let estimator = Estimator::new(&tracer, &mesh, 256, PointSet::Sobol, 1, &());
    let rows = estimator.hemisphere_rows();
    let radiosity = vec![isolux::color::Rgb64::ONE; mesh.len()];
    let gather = |i| {
        black_box(rows.gather_row(PatchId(i), &radiosity));
    };
    bencher.bench(|| (0..mesh.len() as u32).for_each(gather));
}

#[divan::bench]
fn carry_irradiance_to_vertices(bencher: Bencher) {
    let solution = solution();
    let mesh = solution.patches();
    let (irradiance, uncovered) = (solution.irradiance(), solution.uncovered());
    bencher.bench(|| Interpolated::new(&mesh, irradiance, uncovered, View::CREASE));
}

#[divan::bench(sample_count = 10)]
fn draw_256_by_256_pixels_of_16_samples(bencher: Bencher) {
    let solution = solution();
    let (view, tracer) = (solution.smooth(View::CREASE), Tracer::build(solution.scene()));
    bencher.bench(|| view.draw(&tracer, &solution.camera, &Frame::new(256, 256), &()));
}

#[divan::bench]
fn keep_the_light_and_read_it_back(bencher: Bencher) {
    let solution = solution();
    bencher.bench(|| Solution::from_bytes(&black_box(&solution).to_bytes()).expect("whole"));
}
