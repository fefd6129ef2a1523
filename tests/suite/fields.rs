//! Every way to draw a scene shows the light that paths bring.

use isolux::color::luminance;
use isolux::field::PathTraced;
use isolux::{Document, Frame, Image, Settings, Solution, Tracer, View};
use std::path::PathBuf;

const SIZE: [u32; 2] = [48, 36];

/// All pictures have as many samples per pixel, so that they filter textures alike.
const SAMPLES: u32 = 16;

/// The three channels of every pixel.
fn pixels(solution: &Solution, view: &View, tracer: &Tracer, seed: u64) -> Vec<f64> {
    let frame = Frame { samples: SAMPLES, seed, ..Frame::new(SIZE[0], SIZE[1]) };
    let image = view.draw(tracer, &solution.camera, &frame, &()).expect("a picture");
    image.pixels.iter().flat_map(|pixel| pixel.as_dvec3().to_array()).collect()
}

/// The means of several runs, and the variances of these means.
struct Runs {
    mean: Vec<f64>,
    variance: Vec<f64>,
}

impl Runs {
    fn of(values: &[Vec<f64>]) -> Runs {
        let count = values.len() as f64;
        let mean_of = |k: usize| values.iter().map(|v| v[k]).sum::<f64>() / count;
        let mean: Vec<f64> = (0..values[0].len()).map(mean_of).collect();
        let variance = |k: usize| {
            let squares: f64 = values.iter().map(|v| (v[k] - mean[k]).powi(2)).sum();
            squares / (count - 1.0) / count
        };
        Runs { variance: (0..mean.len()).map(variance).collect(), mean }
    }
}

/// The mean of z² over the pixels, and how far the sums of both lie apart, as a share.
fn compared(paths: &Runs, others: &Runs) -> (f64, f64) {
    let (mut squares, mut count) = (0.0, 0.0);
    for k in 0..paths.mean.len() {
        let (difference, variance) =
            (others.mean[k] - paths.mean[k], others.variance[k] + paths.variance[k]);
        let largest = others.mean[k].max(paths.mean[k]);
        // A lamp and a sky that fill a pixel have no variance but for rounding.
        if variance.sqrt() > 1e-5 * largest {
            squares += difference * difference / variance;
            count += 1.0;
        } else {
            assert!(difference.abs() <= 1e-4 * largest, "number {k}: {difference}");
        }
    }
    let sum = |runs: &Runs| runs.mean.iter().sum::<f64>();
    (if count > 0.0 { squares / count } else { 1.0 }, sum(others) / sum(paths) - 1.0)
}

/// The descriptions in `scenes/`, and the one model without a description.
fn shipped() -> Vec<PathBuf> {
    let folder = std::fs::read_dir(format!("{}/scenes", env!("CARGO_MANIFEST_DIR")));
    let files = folder.expect("a folder").map(|entry| entry.expect("an entry").path());
    let is_scene = |file: &PathBuf| file.extension().is_some_and(|e| e == "toml" || e == "gltf");
    let mut scenes: Vec<PathBuf> = files.filter(is_scene).collect();
    scenes.sort();
    assert_eq!(scenes.len(), 9);
    scenes
}

/// Each pixel of a picture lies within the errors of both from the path-traced one with 512 samples: z² is about 1.1
/// in the mean with 31 and 7 degrees of freedom, and 2 with an error as large as the noise. The sums have less noise;
/// what is left is the error of the solutions.
#[test]
fn gathered_light_is_that_of_the_paths_on_all_shipped_scenes() {
    for file in shipped() {
        let name = file.file_stem().expect("a name").to_string_lossy().into_owned();
        let document = Document::open(&file).expect("a description");
        let scene = document.scene().expect("a scene");
        let tracer = Tracer::build(&scene);
        let solve = |seed| {
            let settings = Settings { seed, ..Settings::default() };
            Solution::solve(&document, &scene, &tracer, &settings, &()).expect("light")
        };
        // Paths owe nothing to the solution.
        let any = solve(1);
        let path_traced = |seed| {
            let view = any.seen_by(PathTraced::new(&any.patches(), seed));
            pixels(&any, &view, &tracer, seed)
        };
        let gathered = |seed| {
            let light = solve(seed);
            pixels(&light, &light.gathered(), &tracer, seed)
        };
        let paths = Runs::of(&(1..33).map(path_traced).collect::<Vec<_>>());
        let gathered = Runs::of(&(41..49).map(gathered).collect::<Vec<_>>());
        let (squares, off) = compared(&paths, &gathered);
        println!("{name}: mean z² {squares:.3}, sums apart by {off:+.5}");
        // Soft light that comes through a doorway throws shadows, which averaging over pixels as wide as these blurs.
        let most = if name == "two-rooms" { 5.0 } else { 2.0 };
        assert!(squares < most, "{name}: {squares}");
        assert!(off.abs() < 0.01, "{name}: {off}");
    }
}

/// Student's t for 95 % with seven degrees of freedom: the spreads of some pixels are averaged, which lie near
/// each other.
const T: f32 = 2.365;

/// The share of the pixels of several pictures that lie within [`T`] standard errors of a picture with 64 times as
/// many samples, of one solution: its own error is no picture's.
fn covered(file: &str, pictures: u64) -> f64 {
    let document =
        Document::open(format!("{}/{file}", env!("CARGO_MANIFEST_DIR"))).expect("a description");
    let scene = document.scene().expect("a scene");
    let tracer = Tracer::build(&scene);
    let light =
        Solution::solve(&document, &scene, &tracer, &Settings::default(), &()).expect("light");
    let draw = |seed, samples| {
        let frame = Frame { samples, seed, ..Frame::new(SIZE[0], SIZE[1]) };
        light.gathered().draw(&tracer, &light.camera, &frame, &()).expect("a picture")
    };
    let truth = draw(1000, 64 * SAMPLES);
    let (mut within, mut all) = (0.0, 0.0);
    for picture in (1..=pictures).map(|seed| draw(seed, SAMPLES)) {
        for ((pixel, true_pixel), error) in
            picture.pixels.iter().zip(&truth.pixels).zip(&picture.error)
        {
            let (found, expected) = (luminance(*pixel), luminance(*true_pixel));
            // What is alike in all samples has no error but for rounding.
            within += f64::from((found - expected).abs() <= T * error + 1e-5 * expected);
            all += 1.0;
        }
    }
    within / all
}

#[test]
fn nine_of_ten_pixels_and_more_lie_within_the_interval_that_is_stated_for_95_per_cent() {
    for name in ["cornell-box", "course-room", "two-rooms", "colour-cube"] {
        let share = covered(&format!("scenes/{name}.toml"), 16);
        println!("{name}: {share:.4}");
        assert!((0.93..=0.98).contains(&share), "{name}: {share}");
    }
}

/// Each picture is held against the mean of the others, whose own error is known from theirs.
#[test]
fn path_traced_pixels_lie_within_the_interval_that_is_stated_for_95_per_cent() {
    for (name, samples) in [("cornell-box", 16), ("colour-cube", 64), ("greenhouse", 5)] {
        let file = format!("{}/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let document = Document::open(file).expect("a description");
        let scene = document.scene().expect("a scene");
        let tracer = Tracer::build(&scene);
        let settings = Settings::default();
        let light = Solution::solve(&document, &scene, &tracer, &settings, &()).expect("light");
        let pictures: Vec<_> = (1..=13)
            .map(|seed| {
                let frame = Frame { samples, seed, ..Frame::new(SIZE[0], SIZE[1]) };
                let view = light.seen_by(PathTraced::new(&light.patches(), seed));
                view.draw(&tracer, &light.camera, &frame, &()).expect("a picture")
            })
            .collect();
        let count = pictures.len() as f32;
        let (mut within, mut all) = (0.0, 0.0);
        for pixel in 0..pictures[0].pixels.len() {
            let of = |picture: &Image| luminance(picture.pixels[pixel]);
            let sum: f32 = pictures.iter().map(of).sum();
            // Where all samples are alike nothing is estimated.
            for picture in pictures.iter().filter(|picture| picture.error[pixel] > 0.0) {
                let others = (sum - of(picture)) / (count - 1.0);
                let error = picture.error[pixel] * (1.0 + 1.0 / (count - 1.0)).sqrt();
                within += f64::from((of(picture) - others).abs() <= T * error + 1e-5 * others);
                all += 1.0;
            }
        }
        let share: f64 = within / all;
        println!("{name}, {samples} samples: {share:.4}");
        assert!((0.93..=0.98).contains(&share), "{name}: {share}");
    }
}

/// Where very many samples are taken, little is averaged over pixels, and no more than the noise allows: otherwise pictures
/// of one solution lie further apart than they state.
#[test]
fn pictures_with_a_small_error_lie_within_it_about_their_mean() {
    let document =
        Document::open(format!("{}/scenes/cornell-box.toml", env!("CARGO_MANIFEST_DIR")))
            .expect("a description");
    let scene = document.scene().expect("a scene");
    let tracer = Tracer::build(&scene);
    let light =
        Solution::solve(&document, &scene, &tracer, &Settings::default(), &()).expect("light");
    let draw = |seed| {
        let frame = Frame { seed, error: Some(0.005), ..Frame::new(SIZE[0], SIZE[1]) };
        light.gathered().draw(&tracer, &light.camera, &frame, &()).expect("a picture")
    };
    let pictures: Vec<_> = (1..=8).map(draw).collect();
    let n = pictures.len() as f32;
    // A picture is nearer to a mean to which it belongs.
    let most = T * ((n - 1.0) / n).sqrt();
    let (mut within, mut all) = (0.0, 0.0);
    for pixel in 0..pictures[0].pixels.len() {
        let found = |k: usize| luminance(pictures[k].pixels[pixel]);
        let mean = (0..pictures.len()).map(found).sum::<f32>() / n;
        for (k, picture) in pictures.iter().enumerate() {
            let error = picture.error[pixel];
            within += f64::from((found(k) - mean).abs() <= most * error + 1e-5 * mean);
            all += 1.0;
        }
    }
    let share = within / all;
    println!("{share:.4}");
    assert!((0.93..=0.98).contains(&share), "{share}");
}
