//! Solves a scene, keeps its light, and draws a picture.
//!
//! `cargo run --release --example render`

use isolux::{Document, Frame, Settings, Solution, Tracer};

fn main() -> isolux::Result<()> {
    let document = Document::open("scenes/cornell-box.toml")?;
    let scene = document.scene()?;
    let tracer = Tracer::build(&scene);
    let light = Solution::solve(&document, &scene, &tracer, &Settings::default(), &())?;
    light.save("cornell.light")?;
    let frame = Frame::new(512, 512);
    let picture = light.gathered().draw(&tracer, &light.camera, &frame, &())?;
    picture.save("cornell.png", light.exposure(&picture))
}
