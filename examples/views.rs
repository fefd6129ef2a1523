//! Solves a scene once and draws ten views of it, from around the middle of the room.
//!
//! `cargo run --release --example views`

use glam::Vec3;
use isolux::{Camera, Document, Frame, Settings, Solution, Tracer};
use std::time::Instant;

fn main() -> isolux::Result<()> {
    let document = Document::open("scenes/cornell-box.toml")?;
    let scene = document.scene()?;
    let tracer = Tracer::build(&scene);
    let light = Solution::solve(&document, &scene, &tracer, &Settings::default(), &())?;
    let view = light.gathered();
    let (middle, frame) = (scene.bounds().center(), Frame::new(256, 256));
    for number in 0..10 {
        let start = Instant::now();
        let (x, z) = (std::f32::consts::TAU * number as f32 / 10.0).sin_cos();
        let position = middle + Vec3::new(x, 0.2, z) * 200.0;
        let camera = Camera::new(position, middle, Camera::USUAL_UP, 70.0, 0.0)?;
        let picture = view.draw(&tracer, &camera, &frame, &())?;
        let file = format!("view-{number}.png");
        picture.save(&file, light.exposure(&picture))?;
        println!("{file} in {:.3} s", start.elapsed().as_secs_f64());
    }
    Ok(())
}
